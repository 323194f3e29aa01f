"""Replacement of an archive: the old one is retained in the same folder until the new one holds a profile.

A new archive is created under a temporary name and renamed; a partial one is never visible. Temporary names contain the
run's token, which keeps runs from removing each other's archives. An object store cannot rename; there, the old archive
is removed when the new one is created.
"""

from __future__ import annotations

import logging
import re
import secrets
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from gliderhpc.errors import InputError
from gliderhpc.output_files import raise_full_disk
from gliderhpc.store_schema.commits import has_commits, is_begun
from gliderhpc.store_schema.location import Location, absolute, is_address, is_archive, remove

log = logging.getLogger(__name__)

_SET_ASIDE = r"\.[0-9a-f]{16}\.old"


@dataclass(frozen=True)
class Predecessor:
    """The archive that a new one has replaced.

    Attributes
    ----------
    location : str
        Location of the new archive.
    aside : Path or None
        Present location of the replaced archive, None where there was none or it was removed.
    """

    location: str
    aside: Path | None

    def discard(self) -> None:
        """Remove the replaced archive permanently."""
        if self.aside is not None:
            shutil.rmtree(self.aside, ignore_errors=True)

    def restore(self) -> None:
        """Restore the replaced archive and remove the new one."""
        if is_address(self.location):
            remove(self.location)
        else:
            _restore(Path(self.location), self.aside)


@contextmanager
def replacing(location: Location, create: Callable[[Location], None], token: str) -> Iterator[Callable[[], None]]:
    """Create a new archive in its place for the duration of the context, and permanently once it holds a profile.

    Parameters
    ----------
    location : str or Path
        Location of the new archive; missing parent folders are created.
    create : callable
        Function that creates the empty archive at a given location.
    token : str
        Sixteen hexadecimal digits, unique to the run.

    Yields
    ------
    callable
        Function to call when a profile is committed; it removes the replaced archive. If no profile is committed at the
        end, the new archive is removed and the replaced one restored.

    Raises
    ------
    InputError
        The location cannot be written.
    """
    before = replace(location, create, token)
    try:
        yield before.discard
    finally:
        if has_commits(before.location):
            before.discard()
            if before.aside is not None and before.aside.exists():
                # For example without the permission to write in its folders.
                log.warning("%s: the replaced archive cannot be removed; remove it if it is not needed", before.aside)
        else:
            before.restore()


def replace(location: Location, create: Callable[[Location], None], token: str) -> Predecessor:
    """Create a new archive in its place and set aside an existing one.

    Raises
    ------
    InputError
        The location cannot be written.
    """
    name = absolute(location)
    if is_address(name):
        remove(name)
        create(name)
        return Predecessor(name, None)
    path = Path(name)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        aside = _exchange(path, create, token)
    except OSError as error:
        raise_full_disk(error, location)
        raise InputError(f"{location}: cannot be written ({error.strerror}); give another place with `store`") from None
    return Predecessor(name, aside)


def restore_set_aside(location: Location) -> None:
    """Restore the archive that a killed run had set aside without completing a single profile.

    Only for the holder of the archive's lock: a run in progress owns the archive that it has set aside.
    """
    if is_address(location):
        return
    path = Path(absolute(location))
    found = _archives_set_aside(path)
    if not found:
        return
    if is_begun(path):
        log.warning("%s: is the archive that an earlier run replaced; remove it if it is not needed", found[-1])
        return
    _restore(path, found[-1])
    log.warning(
        "%s: this archive is restored, because the run that was to replace it was killed before its first profile", path
    )


def new_token() -> str:
    """Return sixteen random hexadecimal digits."""
    return secrets.token_hex(8)


def _exchange(path: Path, create: Callable[[Location], None], token: str) -> Path | None:
    """Create an archive and rename it into its place; return the location of the replaced one."""
    partial, aside = (_named_after(path, token, kind) for kind in ("partial", "old"))
    try:
        create(partial)
        if path.exists():
            path.rename(aside)
        partial.rename(path)
    except BaseException:
        if aside.exists() and not path.exists():
            aside.rename(path)
        shutil.rmtree(partial, ignore_errors=True)
        raise
    return aside if aside.exists() else None


def _restore(path: Path, aside: Path | None) -> None:
    """Restore a replaced archive, then remove the new one."""
    failed = _named_after(path, new_token(), "partial")
    there = path.exists()
    if there:
        path.rename(failed)
    if aside is not None:
        aside.rename(path)
    if there:
        shutil.rmtree(failed)


def _archives_set_aside(path: Path) -> list[Path]:
    """Return the archives that runs have set aside, the oldest first."""
    if not path.parent.is_dir():
        return []
    pattern = re.compile(re.escape(path.name) + _SET_ASIDE)
    names = [entry for entry in path.parent.iterdir() if pattern.fullmatch(entry.name)]
    return sorted((entry for entry in names if is_archive(entry)), key=lambda entry: entry.stat().st_mtime)


def _named_after(path: Path, token: str, kind: str) -> Path:
    return path.with_name(f"{path.name}.{token}.{kind}")
