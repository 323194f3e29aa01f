"""Text for a terminal, and one-line reports of unexpected errors. Every printed line passes through this module.

Names, messages and attributes come from files and may contain control characters, which must not reach a terminal. The
library's messages name arguments and settings, in backquotes; a command shows its options instead.
"""

import errno
import os
import platform
import re
import shlex
import sys
import tempfile
import traceback
from collections.abc import Mapping, Sequence
from pathlib import Path

import click

from gliderhpc.errors import GliderhpcError, InputError, message_line
from gliderhpc.output_files import NO_SPACE
from gliderhpc.version import __version__

_REPLACED = "\N{REPLACEMENT CHARACTER}"

_RANGES = ((0x00, 0x20), (0x7F, 0xA0), (0x202A, 0x202F), (0x2066, 0x206A), (0xD800, 0xE000))

_CONTROLS = {code: _REPLACED for first, end in _RANGES for code in range(first, end) if chr(code) not in "\t\n"}
"""Control characters of terminals and of writing direction, and surrogates that no stream can encode."""


def printable(text: str, *, lines: bool = True) -> str:
    """Replace the control characters of a text, and its line ends unless `lines` is set."""
    shown = text.translate(_CONTROLS)
    return shown if lines else shown.replace("\n", " ")


_QUOTED = re.compile(r"`([\w.]+)(?:=([^`]+))?`")
"""Pattern of an argument or a setting in a message, with its value if any."""


def with_options(text: str, command: click.Command | None = None) -> str:
    """Replace the arguments and settings named in a message by the options of a command.

    Parameters
    ----------
    text : str
        Message of the library, such as ``this file exists; replace it with `overwrite=True```.
    command : click.Command, optional
        The command that shows it; by default the one being run. Without a command the text remains as it is.

    Returns
    -------
    str
        Such as ``this file exists; replace it with --overwrite``. An argument that the command does not have, and any
        other text in backquotes, remain.
    """
    if command is None:
        context = click.get_current_context(silent=True)
        if context is None:
            return text
        command = context.command
    parameters = {str(parameter.name): parameter for parameter in command.params}

    def option(quoted: re.Match[str]) -> str:
        name, value = quoted.groups()
        if name in parameters:
            return _describe_parameter(parameters[name], value)
        # Only flags have the value True in messages.
        is_setting = "." in name or value not in (None, "True")
        return f"--set {quoted[0][1:-1]}" if is_setting and "assignments" in parameters else quoted[0]

    return _QUOTED.sub(option, text)


def _describe_parameter(parameter: click.Parameter, value: str | None) -> str:
    """Return an option with its value, or the name of a positional argument in the command's usage."""
    name = parameter.opts[0] if isinstance(parameter, click.Option) else parameter.human_readable_name
    return name if value is None or getattr(parameter, "is_flag", False) else f"{name} {value}"


class Verb(click.Command):
    """Command whose errors name its options."""

    def invoke(self, ctx: click.Context) -> object:
        """Run the command."""
        try:
            return super().invoke(ctx)
        except GliderhpcError as error:
            error.args = (with_options(str(error), self), *error.args[1:])
            raise


def refuse_empty(words: Sequence[str]) -> None:
    """Refuse an empty word of a command line, which would mean the current folder.

    Raises
    ------
    InputError
        A word, or the value of an option, is empty; the message names the option.
    """
    for place, word in enumerate(words):
        option = word[:-1] if re.fullmatch(r"--[\w-]+=", word) else words[place - 1] if place and not word else ""
        if option or not word:
            named = option if option.startswith("-") else f"the argument after {option or 'gliderhpc'}"
            raise InputError(f"{named}: is empty; give a value (a variable of the shell may be unset)")


def echo(text: object = "", *, err: bool = False, nl: bool = True) -> None:
    """Print a text to stdout or stderr."""
    click.echo(printable(with_options(str(text))), err=err, nl=nl)


def warn(text: str, *, err: bool = False) -> None:
    """Print a warning to stdout, where it belongs to a result, or to stderr."""
    echo(f"warning: {text}", err=err)


_SHOWN_LEFT_OUT = 10
"""Maximum number of profiles that are listed with the reason for leaving them out."""


def print_left_out(reasons: Mapping[int, str]) -> None:
    """Print the profiles left out with their reasons, and the number of those not listed."""
    for number in list(reasons)[:_SHOWN_LEFT_OUT]:
        echo(f"profile {number} left out: {reasons[number]}")
    if len(reasons) > _SHOWN_LEFT_OUT:
        echo(f"{len(reasons) - _SHOWN_LEFT_OUT} more left out")


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
"""File-system errors that another name or other permissions would fix."""


class UnexpectedError(Exception):
    """Error of the program itself, with the file that contains its traceback."""

    def __init__(self, error: BaseException, file: Path) -> None:
        super().__init__(str(error))
        self.error, self.file = error, file


_EXPECTED = (
    GliderhpcError,
    click.ClickException,
    click.exceptions.Exit,
    click.Abort,
    UnexpectedError,
)


def is_expected(error: BaseException) -> bool:
    """Return whether an error is the user's or the machine's rather than a bug, and explains itself."""
    if is_memory_shortage(error):
        return True
    if isinstance(error, OSError):
        return error.errno in NO_SPACE or names_a_file(error) or isinstance(error, BrokenPipeError)
    return isinstance(error, _EXPECTED)


_NO_ROOM = ("failed to map segment", "cannot allocate memory")
"""Words of the dynamic linker where a library does not fit into memory."""


def is_memory_shortage(error: BaseException) -> bool:
    """Return whether memory was short, also where a library could not be loaded for that reason."""
    if isinstance(error, MemoryError) or (isinstance(error, OSError) and error.errno == errno.ENOMEM):
        return True
    return isinstance(error, ImportError | OSError) and any(words in str(error).lower() for words in _NO_ROOM)


def names_a_file(error: OSError) -> bool:
    """Return whether an error names a file and a reason."""
    return error.filename is not None and error.errno is not None and bool(error.strerror)


def is_unusable(error: OSError) -> bool:
    """Return whether another file name or other permissions would fix an error."""
    return error.errno in _UNUSABLE


def describe_unexpected(error: Exception) -> str:
    """Write the traceback of an unexpected error to a file, and describe the error in one line."""
    if not isinstance(error, UnexpectedError):
        error = UnexpectedError(error, _write_traceback(error))
    what = message_line(error.error) or "no message"
    return (
        f"unexpected error, {type(error.error).__name__}: {what}; this is a bug in gliderhpc: please send {error.file} "
        "and the command to its maintainers"
    )


def environment() -> str:
    """Return the versions and the command, for the maintainers."""
    return (
        f"gliderhpc {__version__}, Python {platform.python_version()}, {platform.platform()}: "
        f"{shlex.join(map(str, sys.argv))}"
    )


def _write_traceback(error: BaseException) -> Path:
    """Write the traceback to a new file in the temporary folder, or to stderr if that fails."""
    text = f"{environment()}\n\n{''.join(traceback.format_exception(error))}"
    try:
        descriptor, name = tempfile.mkstemp(prefix="gliderhpc-error-", suffix=".txt", text=True)
        with os.fdopen(descriptor, "w", encoding="utf-8", errors="backslashreplace") as file:
            file.write(text)
    except OSError:
        click.echo(text, err=True)
        return Path("the text above")
    return Path(name)
