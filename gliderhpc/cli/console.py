"""Where tables and log lines are printed; lines go by `gliderhpc.cli.text`."""

import logging
from collections.abc import Collection, Iterable, Sequence
from typing import Any

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment
from rich.table import Table

from gliderhpc.cli.text import printable

_FILE_WIDTH = 160


class _Console(Console):
    """A console that takes no text for markup and sends no control of a text's on."""

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        for segment in super().render(renderable, options):
            yield segment if segment.control else Segment(printable(segment.text), segment.style)


class LogFormatter(logging.Formatter):
    """Format of log lines, in which a message is one line; a traceback follows as it is."""

    def __init__(self) -> None:
        super().__init__("%(asctime)s %(levelname)s %(message)s")

    def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: N802 - logging's name
        """Format the line."""
        return printable(super().formatMessage(record), lines=False)

    def formatException(self, ei: Any) -> str:  # noqa: N802 - logging's name
        """Format the traceback."""
        return printable(super().formatException(ei))


def results() -> Console:
    """Console on stdout; wide where that is a file or a pipe, so that no column is cut."""
    console = _Console(markup=False, emoji=False)
    return console if console.is_terminal else _Console(width=_FILE_WIDTH, markup=False, emoji=False)


def table(title: str, rows: Sequence[tuple[str, ...]], headings: Sequence[str], words: Collection[str]) -> Table:
    """Table of texts; columns whose heading is among `words` are aligned to the left, figures to the right."""
    made = Table(title=title, title_justify="left")
    for heading in headings:
        made.add_column(heading, justify="left" if heading in words else "right")
    for row in rows:
        made.add_row(*row)
    return made
