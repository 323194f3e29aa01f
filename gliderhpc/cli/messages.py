"""Text for a terminal, through which every printed line passes, and one-line reports of unexpected errors.

Names, messages and attributes come from files and may contain control characters, which a terminal must not obey.
"""

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

_REPLACED = "\N{REPLACEMENT CHARACTER}"

_RANGES = ((0x00, 0x20), (0x7F, 0xA0), (0x202A, 0x202F), (0x2066, 0x206A), (0xD800, 0xE000))

_CONTROLS = {code: _REPLACED for first, end in _RANGES for code in range(first, end) if chr(code) not in "\t\n"}
"""Control characters of terminals and of writing direction, and surrogates that no stream can encode."""


def printable(text: str, *, lines: bool = True) -> str:
    """Return a text with control characters replaced, and line ends too unless `lines` is set."""
    shown = text.translate(_CONTROLS)
    return shown if lines else shown.replace("\n", " ")


def say(text: object = "", *, err: bool = False, nl: bool = True) -> None:
    """Print a text to stdout or stderr."""
    click.echo(printable(str(text)), err=err, nl=nl)


FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""Errors of a full disk."""

_UNUSABLE = (
    errno.EACCES,
    errno.EPERM,
    errno.EROFS,
    errno.ENOENT,
    errno.ENOTDIR,
    errno.EISDIR,
    errno.ENAMETOOLONG,
    errno.ELOOP,
    errno.EEXIST,
    errno.ENXIO,
    errno.EINVAL,
)
"""Errors of the file system that another name or other permissions would avoid."""


class UnexpectedError(Exception):
    """An error of the program itself, and the file with its traceback."""

    def __init__(self, error: BaseException, file: Path) -> None:
        super().__init__(str(error))
        self.error, self.file = error, file


_EXPECTED = (
    GliderhpcError,
    click.ClickException,
    click.exceptions.Exit,
    click.Abort,
    MemoryError,
    UnexpectedError,
)


def is_expected(error: BaseException) -> bool:
    """Return whether an error can be caused by the user or the machine and has a message of its own."""
    if isinstance(error, OSError):
        return error.errno in FULL or is_of_a_file(error) or isinstance(error, BrokenPipeError)
    return isinstance(error, _EXPECTED)


def is_of_a_file(error: OSError) -> bool:
    """Return whether an error names a file and a reason."""
    return error.filename is not None and error.errno is not None and bool(error.strerror)


def is_unusable(error: OSError) -> bool:
    """Return whether another name or other permissions would avoid an error of a file."""
    return error.errno in _UNUSABLE


def describe_unexpected(found: Exception) -> str:
    """Describe an unexpected error in one line; its traceback is written to a file."""
    if not isinstance(found, UnexpectedError):
        found = UnexpectedError(found, _write_traceback(found))
    what = (str(found.error).splitlines() or ["no message"])[0]
    return (
        f"unexpected error, {type(found.error).__name__}: {what}; this is a bug in gliderhpc: please send {found.file} "
        "and the command to its maintainers"
    )


def environment() -> str:
    """Return command and versions, for the maintainers."""
    return (
        f"gliderhpc {__version__}, Python {platform.python_version()}, {platform.platform()}: "
        f"{shlex.join(map(str, sys.argv))}"
    )


def _write_traceback(error: BaseException) -> Path:
    """Write the traceback to a new file in the temporary folder, or to stderr where that fails."""
    text = f"{environment()}\n\n{''.join(traceback.format_exception(error))}"
    try:
        descriptor, name = tempfile.mkstemp(prefix="gliderhpc-error-", suffix=".txt", text=True)
        with os.fdopen(descriptor, "w", encoding="utf-8", errors="backslashreplace") as file:
            file.write(text)
    except OSError:
        click.echo(text, err=True)
        return Path("the text above")
    return Path(name)
