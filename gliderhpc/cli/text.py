"""Text as a terminal shows it: every line that a command prints passes through here.

Names, messages and attributes come from files and may hold anything; a terminal must not obey it.
"""

import click

_REPLACED = "\N{REPLACEMENT CHARACTER}"

_RANGES = ((0x00, 0x20), (0x7F, 0xA0), (0x202A, 0x202F), (0x2066, 0x206A), (0xD800, 0xE000))

_CONTROLS = {code: _REPLACED for first, end in _RANGES for code in range(first, end) if chr(code) not in "\t\n"}
"""Controls of terminals, of the direction of writing, and halves of characters that no stream can encode."""


def printable(text: str, *, lines: bool = True) -> str:
    """Return text that a terminal only shows: controls replaced, and line ends too unless there may be `lines`."""
    shown = text.translate(_CONTROLS)
    return shown if lines else shown.replace("\n", " ")


def say(text: object = "", *, err: bool = False, nl: bool = True) -> None:
    """Print a text on stdout or stderr."""
    click.echo(printable(str(text)), err=err, nl=nl)
