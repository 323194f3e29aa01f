"""Places of output files: refused before the work where they could cost something, written aside, then renamed."""

import os
import secrets
import stat
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from gliderhpc.errors import InputError

_ZARR_MARKS = ("zarr.json", ".zgroup", ".zmetadata")


def check_output(
    out: Path, *, overwrite: bool, inputs: Iterable[Path | str] = (), instead: str = "another name"
) -> None:
    """Refuse a place for a file that cannot be written, or where writing it would cost something.

    Parameters
    ----------
    out : Path
        The file to be written.
    overwrite : bool
        Whether a regular file that is there may be replaced.
    inputs : iterable of Path or str
        Files and Zarr folders that are read; what is no place on this machine is left alone.
    instead : str
        What else could be given, for the message.

    Raises
    ------
    InputError
        It is a folder, a device, a pipe or a dangling link; it exists and may not be replaced; it is one of the inputs
        or lies in one; or its folder does not exist or cannot be written to.
    """
    folder = _target(out).parent
    if out.is_dir():
        raise InputError(f"{out}: cannot be written, it is a folder; give {instead}")
    if not out.exists() and out.is_symlink():
        raise InputError(f"{out}: cannot be written, it is a link to nothing; remove it or give {instead}")
    if out.exists() and not stat.S_ISREG(out.stat().st_mode):
        raise InputError(f"{out}: cannot be written, it is a device or a pipe; give {instead}")
    _check_no_input(out, inputs, instead)
    if out.exists() and not overwrite:
        raise InputError(f"{out}: this file exists; give {instead} or replace it with --overwrite")
    if not folder.is_dir():
        raise InputError(f"{out}: there is no folder {folder}: it does not exist; make it first or give {instead}")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise InputError(f"{out}: cannot be written, the folder {folder} takes no files from you; give {instead}")


@contextmanager
def written_aside(out: Path, *, overwrite: bool) -> Iterator[Path]:
    """Give a temporary place in the folder of a file, and rename it when the block ends without an error.

    A link is followed: it stays, and the file that it leads to is replaced. Nothing is left after an error.

    Parameters
    ----------
    out : Path
        The file.
    overwrite : bool
        Whether one that is there may be replaced.

    Raises
    ------
    InputError
        As `check_output`, before the block; or another program has made the file meanwhile.
    OSError
        The file system refuses.
    """
    check_output(out, overwrite=overwrite)
    target = _target(out)
    # The name does not grow with the file's, which may be as long as the file system allows.
    aside = target.with_name(f".{secrets.token_hex(8)}.partial")
    try:
        yield aside
        if overwrite:
            aside.replace(target)
        else:
            _rename_unless_there(aside, target, out)
    finally:
        aside.unlink(missing_ok=True)


def write_text(out: Path, text: str, *, overwrite: bool) -> None:
    """Write a whole text file or none.

    Raises
    ------
    InputError
        As `check_output`, or it cannot be written.
    """
    try:
        with written_aside(out, overwrite=overwrite) as aside:
            aside.write_text(text, "utf-8")
    except OSError as error:
        raise InputError(f"{out}: cannot be written: {error.strerror or error}") from error


def _target(out: Path) -> Path:
    return Path(os.path.realpath(out))


def _check_no_input(out: Path, inputs: Iterable[Path | str], instead: str) -> None:
    target = _target(out)
    for given in map(Path, inputs):
        if out.exists() and given.exists() and out.samefile(given):
            raise InputError(f"{out}: is one of the inputs; give {instead}")
        store = _target(given)
        if store in target.parents and any((store / mark).exists() for mark in _ZARR_MARKS):
            raise InputError(f"{out}: lies within the input {given}; give {instead}")


def _rename_unless_there(aside: Path, target: Path, out: Path) -> None:
    """Rename a file to a name that nobody has; a link fails where a rename would replace what has come meanwhile."""
    try:
        os.link(aside, target)
    except FileExistsError:
        raise InputError(f"{out}: another program has written this file meanwhile; it is left as it is") from None
    except OSError:
        # A file system without links.
        if target.exists():
            raise InputError(f"{out}: another program has written this file meanwhile; it is left as it is") from None
        aside.replace(target)
