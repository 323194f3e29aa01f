"""Output files and folders: checked in advance, written under a temporary name, and renamed when complete."""

import errno
import os
import secrets
import shutil
import stat
import sys
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from gliderhpc.errors import InputError

_OTHER_FORMATS = frozenset(
    (".csv", ".html", ".json", ".mat", ".parquet", ".pdf", ".png", ".txt", ".xlsx", ".yaml", ".yml", ".zarr", ".zip")
)
"""Endings of names of files that are not netCDF."""

NO_SPACE = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""Errors of a full disk, an exhausted quota, and a limit on the size of files (``ulimit -f``)."""

_PROBE_BYTES = 1 << 20
"""Bytes that must fit onto the disk after a failed write, or its cause was a full disk."""

_ZARR_MARKS = ("zarr.json", ".zgroup", ".zmetadata")


def check_output(
    out: Path, *, overwrite: bool, inputs: Iterable[Path | str] = (), instead: str = "another name"
) -> None:
    """Check that a file can be written without losing anything.

    Parameters
    ----------
    out : Path
        The file to be written.
    overwrite : bool
        True if an existing regular file may be replaced.
    inputs : iterable of Path or str
        Files and Zarr folders that are read; addresses are ignored.
    instead : str
        Alternative to suggest in messages.

    Raises
    ------
    InputError
        It is a folder, a device, a pipe or a dangling link; it exists and may not be replaced; it is one of the inputs
        or lies in one; or its folder is a file, does not exist or cannot be written to.
    """
    folder = _target(out).parent
    if out.is_dir():
        raise InputError(f"{out}: cannot be written, it is a folder; give {instead}")
    if not out.exists() and out.is_symlink():
        raise InputError(f"{out}: cannot be written, it is a broken link; remove it or give {instead}")
    if out.exists() and not stat.S_ISREG(out.stat().st_mode):
        raise InputError(f"{out}: cannot be written, it is a device or a pipe; give {instead}")
    _check_no_input(out, inputs, instead)
    if out.exists() and not overwrite:
        raise InputError(f"{out}: this file exists; give {instead} or replace it with `overwrite=True`")
    check_parents(out, instead)
    if not folder.is_dir():
        raise InputError(f"{out}: the folder {folder} does not exist; create it first or give {instead}")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise InputError(
            f"{out}: cannot be written, you have no write permission in the folder {folder}; give {instead}"
        )


def check_netcdf_name(out: Path) -> None:
    """Refuse the name of a netCDF file that ends like that of a file in another format.

    Raises
    ------
    InputError
        The name ends so.
    """
    if out.suffix.lower() in _OTHER_FORMATS:
        raise InputError(f"{out}: is written as netCDF, which {out.suffix} is not; give a name that ends in .nc")


def check_parents(out: Path, instead: str) -> None:
    """Refuse a path in a file.

    Raises
    ------
    InputError
        The path goes through a file as if it were a folder; the message names that file.
    """
    parent = next((path for path in _target(out).parents if path.exists()), None)
    if parent is not None and not parent.is_dir():
        raise InputError(f"{out}: cannot be written, {parent} is a file and not a folder; give {instead}")


def fault_of_name(path: Path) -> str:
    """Fault of a path that libraries cannot encode, with the remedy; empty if they can.

    Python opens such files, but the netCDF library does not.
    """
    encoding = sys.getfilesystemencoding()
    try:
        str(path).encode(encoding)
    except UnicodeEncodeError:
        return f"has characters in its path that are not valid in {encoding}; rename it, or use a locale with UTF-8"
    return ""


@contextmanager
def written_aside(out: Path, *, overwrite: bool) -> Iterator[Path]:
    """Yield a temporary path in a file's folder; it is renamed to the file when the block ends without an error.

    A link is followed: it remains, and its target is replaced. Nothing remains after an error.

    Parameters
    ----------
    out : Path
        The file.
    overwrite : bool
        True if an existing file may be replaced.

    Raises
    ------
    InputError
        `check_output` refuses the file, before the block; or its path cannot be encoded; or another program has written
        the file meanwhile.
    OSError
        The file system refuses the operation; with one of `NO_SPACE` and the file's name if the disk is full.
    """
    check_output(out, overwrite=overwrite)
    target = _target(out)
    # A name of fixed length, since the file's own name may be as long as the file system allows.
    aside = target.with_name(f".{secrets.token_hex(8)}.partial")
    try:
        yield aside
        if overwrite:
            aside.replace(target)
        else:
            _rename_unless_there(aside, target, out)
    except UnicodeEncodeError as error:
        fault = fault_of_name(aside)
        if not fault:
            raise
        raise InputError(f"{out}: {fault}") from error
    except (OSError, RuntimeError) as error:
        full = full_disk_error(error, aside, out)
        if full is None:
            raise
        raise full from error
    finally:
        aside.unlink(missing_ok=True)


def raise_full_disk(error: OSError, out: Path | str) -> None:
    """Raise the error of a full disk with the name of the file or folder being written; return for other errors.

    Raises
    ------
    OSError
        The disk is full.
    """
    if error.errno in NO_SPACE:
        raise OSError(error.errno, error.strerror, str(out)) from error


def full_disk_error(error: Exception, aside: Path, out: Path) -> OSError | None:
    """Return the error of a full disk with the file's name, if that is the cause of a failed write; None if not.

    The netCDF library reports a full disk as an HDF error, or as a denied permission. After such an error a write to
    the temporary file, which is about to be removed, is tried.

    Parameters
    ----------
    error : Exception
        Error of the write.
    aside : Path
        The temporary file.
    out : Path
        The file that it was to become.
    """
    number = error.errno if isinstance(error, OSError) else None
    if number not in NO_SPACE:
        number = _error_of_write(aside)
    return OSError(number, os.strerror(number), str(out)) if number in NO_SPACE else None


def _error_of_write(aside: Path) -> int | None:
    """Append some bytes to a temporary file, and return the number of the error, if any."""
    try:
        with aside.open("ab") as file:
            file.write(bytes(_PROBE_BYTES))
    except OSError as error:
        return error.errno
    return None


@contextmanager
def output_file(out: Path, *, overwrite: bool) -> Iterator[Path]:
    """Yield a temporary path, as `written_aside` does, and convert an error of the file system to an `InputError`.

    Raises
    ------
    InputError
        `check_output` refuses the file, or it cannot be written.
    OSError
        The disk is full.
    """
    try:
        with written_aside(out, overwrite=overwrite) as aside:
            yield aside
    except OSError as error:
        if error.errno in NO_SPACE:
            raise
        raise InputError(f"{out}: cannot be written: {error.strerror or error}") from error


def write_text(out: Path, text: str, *, overwrite: bool) -> None:
    """Write a text file atomically.

    Raises
    ------
    InputError
        `check_output` refuses the file, or it cannot be written.
    OSError
        The disk is full.
    """
    with output_file(out, overwrite=overwrite) as aside:
        aside.write_text(text, "utf-8")


def _target(out: Path) -> Path:
    return Path(os.path.realpath(out))


def _check_no_input(out: Path, inputs: Iterable[Path | str], instead: str) -> None:
    target = _target(out)
    for source in map(Path, inputs):
        if out.exists() and source.exists() and out.samefile(source):
            raise InputError(f"{out}: is one of the inputs; give {instead}")
        store = _target(source)
        if store in target.parents and any((store / mark).exists() for mark in _ZARR_MARKS):
            raise InputError(f"{out}: lies within the input {source}; give {instead}")


def link_unless_there(aside: Path, target: Path) -> None:
    """Give a file a further name, unless another file has it; on a file system without hard links, a copy of it.

    A hard link, unlike a rename, does not replace a file that was written meanwhile.

    Raises
    ------
    FileExistsError
        Another file has the name.
    OSError
        The file system refuses the operation.
    """
    try:
        os.link(aside, target)
    except FileExistsError:
        # NFS also reports this where the reply to its first attempt was lost.
        if aside.stat().st_nlink < 2:
            raise
    except OSError:
        with aside.open("rb") as content, target.open("xb") as copy:
            shutil.copyfileobj(content, copy)


def _rename_unless_there(aside: Path, target: Path, out: Path) -> None:
    """Rename a file unless the name exists."""
    try:
        link_unless_there(aside, target)
    except FileExistsError:
        raise InputError(f"{out}: another program has written this file meanwhile, so it is not replaced") from None


def check_folder(out: Path) -> None:
    """Check that a folder can be created or written to.

    Parameters
    ----------
    out : Path
        The folder; neither it nor its parents need exist.

    Raises
    ------
    InputError
        The folder or a parent is a file, a dangling link, or a folder without write access.
    """
    existing = next(path for path in (out, *out.absolute().parents) if os.path.lexists(path))
    if not existing.exists():
        raise InputError(f"{out}: cannot be written, {existing} is a broken link; remove it or give another `out`")
    if not existing.is_dir():
        raise InputError(f"{out}: cannot be written, {existing} is not a folder; give another `out`")
    if not os.access(existing, os.W_OK | os.X_OK):
        raise InputError(
            f"{out}: cannot be written, you have no write permission in the folder {existing}; give another `out`"
        )


@contextmanager
def filled_aside(out: Path) -> Iterator[Path]:
    """Yield an empty folder; its files are moved to `out` when the block ends without an error.

    Parameters
    ----------
    out : Path
        Output folder, created if missing; files of the same names are replaced.

    Raises
    ------
    InputError
        `check_folder` refuses the folder, or it cannot be written.
    OSError
        The disk is full; it has the folder's name.
    """
    check_folder(out)
    missing = [folder for folder in (out, *out.parents) if not folder.exists()]
    try:
        out.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=out, prefix=".", suffix=".partial", ignore_cleanup_errors=True) as aside:
            yield Path(aside)
            for path in sorted(Path(aside).iterdir()):
                path.replace(out / path.name)
    except OSError as error:
        raise_full_disk(error, out)
        raise InputError(f"{out}: cannot be written ({error.strerror or error}); give another `out`") from None
    finally:
        for folder in missing:
            # A folder that is not empty remains.
            with suppress(OSError):
                folder.rmdir()
