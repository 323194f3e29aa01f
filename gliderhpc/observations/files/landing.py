"""Files that arrive in a folder: detection of the complete ones, and unchanging copies of them."""

import glob
import hashlib
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from gliderhpc.errors import InputError
from gliderhpc.output_files import written_aside

_UNFINISHED = (".part", ".partial", ".tmp", ".filepart", ".crdownload", ".swp")
"""Suffixes that programs give to files during a transfer."""

_BLOCK = 1 << 20


@dataclass(frozen=True)
class FileState:
    """Size (bytes) and time of the last change (ns since 1970) of a file."""

    size: int
    modified: int

    def age(self, now: float) -> float:
        """Seconds between the last change and `now`; positive even if the change is in the future."""
        return abs(now - self.modified / 1e9)


@dataclass(frozen=True)
class CopiedFile:
    """A copied file: its state when it was copied, and the SHA-256 of the copy."""

    state: FileState
    digest: str


def list_files(source: Path | str) -> dict[Path, FileState]:
    """Return the files of a source with their state, in the order of their names.

    Parameters
    ----------
    source : Path or str
        A folder, a file, or a pattern such as ``from-glider/p249*.nc``. Hidden files and files with the temporary name
        of a transfer are ignored.

    Raises
    ------
    InputError
        The source does not exist and is not a pattern.
    """
    path, text = Path(source), str(source)
    if path.is_dir():
        found: Iterable[Path] = path.iterdir()
    elif path.exists():
        found = [path]
    elif glob.has_magic(text):
        found = map(Path, glob.glob(text))  # noqa: PTH207 - a pattern may be absolute
    else:
        raise InputError(f"{source}: no such file or folder; give the folder in which the glider's files land")
    return dict(sorted((file, state) for file in found if _is_finished(file) and (state := _state_of(file))))


def same_names(files: Iterable[Path]) -> dict[str, str]:
    """Return the files with the name of a file in an earlier folder of the source, and a message for each."""
    first: dict[str, Path] = {}
    return {
        str(path): f"{path}: {first[path.name].parent} has a file of the same name, and only that is used; rename one"
        for path in files
        if first.setdefault(path.name, path) != path
    }


def folder_of(source: Path | str) -> Path:
    """Return the folder that contains the files of a source."""
    return Path(source) if Path(source).is_dir() else Path(source).parent


def _is_finished(path: Path) -> bool:
    return not path.name.startswith(".") and path.suffix.lower() not in _UNFINISHED


def _state_of(path: Path) -> FileState | None:
    """Return a file's state; None if it has vanished or is not a regular file."""
    try:
        status = path.stat()
    except FileNotFoundError:
        return None
    return FileState(status.st_size, status.st_mtime_ns) if path.is_file() else None


def unchanged(files: Mapping[Path, FileState], before: Mapping[Path, FileState]) -> list[Path]:
    """Return the files whose state has not changed since `before`."""
    return [path for path, state in files.items() if before.get(path) == state]


def older(files: Mapping[Path, FileState], seconds: float, now: float | None = None) -> list[Path]:
    """Return the files whose last change is at least `seconds` ago."""
    now = time.time() if now is None else now
    return [path for path, state in files.items() if state.age(now) >= seconds]


def copy_file(path: Path, state: FileState, folder: Path) -> CopiedFile | None:
    """Copy a file into a folder under its own name; None if it has changed from `state` or no longer exists.

    The copy appears only when it is complete.

    Raises
    ------
    InputError
        The file may not be read, or the copy cannot be written.
    """
    sha = hashlib.sha256()
    try:
        with _opened(path) as stream, written_aside(folder / path.name, overwrite=True) as aside:
            with aside.open("wb") as copy:
                while block := stream.read(_BLOCK):
                    sha.update(block)
                    copy.write(block)
            _check_unchanged(path, state)
    except (FileNotFoundError, _ChangedError):
        return None
    return CopiedFile(state, sha.hexdigest())


def _opened(path: Path) -> BinaryIO:
    try:
        return path.open("rb")
    except FileNotFoundError:
        raise
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error


def _check_unchanged(path: Path, state: FileState) -> None:
    if _state_of(path) != state:
        raise _ChangedError


class _ChangedError(Exception):
    """A file changed while it was copied; the copy is discarded."""


def duplicates(copied: Mapping[str, CopiedFile]) -> dict[str, str]:
    """Return the files whose content equals that of an earlier file by name, each with the name of the first one."""
    first: dict[str, str] = {}
    for name in sorted(copied):
        first.setdefault(copied[name].digest, name)
    return {name: first[one.digest] for name, one in copied.items() if first[one.digest] != name}
