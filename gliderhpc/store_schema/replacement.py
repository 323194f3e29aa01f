"""Making room for a new archive: the one in its place stays in the same folder until the new one holds a profile.

A new archive is built under a name of its own and renamed, so that no half-made one is ever seen. Names carry the run's
token: nothing is removed that the run did not make. In an object store nothing can be renamed, so there the old archive
goes when the new one is made.
"""

from __future__ import annotations

import errno
import logging
import re
import secrets
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from gliderhpc.errors import InputError
from gliderhpc.store_schema.commits import has_commits, is_begun
from gliderhpc.store_schema.place import Place, absolute, is_address, is_archive, remove

log = logging.getLogger(__name__)

_SET_ASIDE = r"\.[0-9a-f]{16}\.old"


@dataclass(frozen=True)
class Predecessor:
    """The archive that a new one has replaced.

    Attributes
    ----------
    place : str
        Where the new archive is.
    aside : Path or None
        Where the one before it lies, None where there was none or where it is gone.
    """

    place: str
    aside: Path | None

    def discard(self) -> None:
        """Remove it for good."""
        if self.aside is not None:
            shutil.rmtree(self.aside, ignore_errors=True)

    def restore(self) -> None:
        """Put it back in the place of the new archive, which is removed."""
        if is_address(self.place):
            remove(self.place)
        else:
            _put_back(Path(self.place), self.aside)


@contextmanager
def replacing(place: Place, create: Callable[[Place], None], token: str) -> Iterator[Callable[[], None]]:
    """Put a new archive into its place for as long as the context lasts, and for good once it holds a profile.

    Parameters
    ----------
    place : str or Path
        Where the archive is to be; missing parent folders are made.
    create : callable
        Creates the empty archive in the place it is given.
    token : str
        Sixteen hexadecimal digits that no other run has.

    Yields
    ------
    callable
        To be called when a profile is committed: what was in the place before is removed. Without a committed profile
        at the end, the new archive is removed and the one before it comes back.

    Raises
    ------
    InputError
        The place cannot be written.
    """
    before = replace(place, create, token)
    try:
        yield before.discard
    finally:
        if has_commits(before.place):
            before.discard()
        else:
            before.restore()


def replace(place: Place, create: Callable[[Place], None], token: str) -> Predecessor:
    """Put a new archive into its place and set aside what was there.

    Raises
    ------
    InputError
        The place cannot be written.
    """
    name = absolute(place)
    if is_address(name):
        remove(name)
        create(name)
        return Predecessor(name, None)
    path = Path(name)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        aside = _exchange(path, create, token)
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            raise
        raise InputError(f"{place}: cannot be written ({error.strerror}); give another place with --store") from None
    return Predecessor(name, aside)


def restore_set_aside(place: Place) -> None:
    """Put back the archive that a killed run had set aside and not replaced by a single profile.

    For the holder of the archive's lock alone: while another run lives, what it has set aside is its own.
    """
    if is_address(place):
        return
    path = Path(absolute(place))
    found = _archives_set_aside(path)
    if not found:
        return
    if is_begun(path):
        log.warning("%s: is what an earlier run replaced; remove it if it is not needed", found[-1])
        return
    _put_back(path, found[-1])
    log.warning("%s: the run that was to replace this archive was killed before its first profile; it is back", path)


def new_token() -> str:
    """Sixteen hexadecimal digits that nobody else has."""
    return secrets.token_hex(8)


def _exchange(path: Path, create: Callable[[Place], None], token: str) -> Path | None:
    """Create an archive and rename it into its place; returns where the one before it lies now."""
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


def _put_back(path: Path, aside: Path | None) -> None:
    """Remove an archive without a profile, after what it replaced has its place again."""
    failed = _named_after(path, new_token(), "partial")
    there = path.exists()
    if there:
        path.rename(failed)
    if aside is not None:
        aside.rename(path)
    if there:
        shutil.rmtree(failed)


def _archives_set_aside(path: Path) -> list[Path]:
    """Archives that runs have set aside, the oldest first."""
    if not path.parent.is_dir():
        return []
    pattern = re.compile(re.escape(path.name) + _SET_ASIDE)
    names = [entry for entry in path.parent.iterdir() if pattern.fullmatch(entry.name)]
    return sorted((entry for entry in names if is_archive(entry)), key=lambda entry: entry.stat().st_mtime)


def _named_after(path: Path, token: str, kind: str) -> Path:
    return path.with_name(f"{path.name}.{token}.{kind}")
