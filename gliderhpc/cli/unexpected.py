"""The last handler: an error that nobody foresaw becomes one line, and a file for the maintainers."""

import errno
import os
import platform
import shlex
import sys
import tempfile
import traceback
from pathlib import Path

import click

from gliderhpc.errors import GliderhpcError
from gliderhpc.version import __version__

FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""Errors of a disk that takes no more."""

_UNUSABLE = (
    errno.EACCES, errno.EPERM, errno.EROFS, errno.ENOENT, errno.ENOTDIR, errno.EISDIR, errno.ENAMETOOLONG, errno.ELOOP,
    errno.EEXIST, errno.ENXIO, errno.EINVAL,
)  # fmt: skip
"""Errors of the file system that another name or other rights would mend."""


class UnexpectedError(Exception):
    """An error that is a fault of the program's, and the file that holds its traceback."""

    def __init__(self, error: BaseException, file: Path) -> None:
        super().__init__(str(error))
        self.error, self.file = error, file


_EXPECTED = (
    GliderhpcError, click.ClickException, click.exceptions.Exit, click.Abort, MemoryError, UnexpectedError,
)  # fmt: skip


def is_expected(error: BaseException) -> bool:
    """Whether an error is one that a user or the machine can cause, with a message of its own."""
    if isinstance(error, OSError):
        return error.errno in FULL or is_of_a_file(error) or isinstance(error, BrokenPipeError)
    return isinstance(error, _EXPECTED)


def is_of_a_file(error: OSError) -> bool:
    """Whether an error names a file and what stands in its way."""
    return error.filename is not None and error.errno is not None and bool(error.strerror)


def is_unusable(error: OSError) -> bool:
    """Whether another name or other rights would mend an error of a file."""
    return error.errno in _UNUSABLE


def describe_unexpected(found: Exception) -> str:
    """One line on an error that nobody foresaw; its traceback is left in a file."""
    if not isinstance(found, UnexpectedError):
        found = UnexpectedError(found, _left_file(found))
    what = (str(found.error).splitlines() or ["no message"])[0]
    return (
        f"unexpected error, {type(found.error).__name__}: {what}; a fault of gliderhpc: please send {found.file} and "
        "the command to its maintainers"
    )


def environment() -> str:
    """Command and versions, for the maintainers."""
    return (
        f"gliderhpc {__version__}, Python {platform.python_version()}, {platform.platform()}: "
        f"{shlex.join(map(str, sys.argv))}"
    )


def _left_file(error: BaseException) -> Path:
    """Write the traceback to a file of our own in the temporary folder; where that is full it goes to stderr."""
    text = f"{environment()}\n\n{''.join(traceback.format_exception(error))}"
    try:
        descriptor, name = tempfile.mkstemp(prefix="gliderhpc-error-", suffix=".txt", text=True)
        with os.fdopen(descriptor, "w", encoding="utf-8", errors="backslashreplace") as file:
            file.write(text)
    except OSError:
        click.echo(text, err=True)
        return Path("the text above")
    return Path(name)
