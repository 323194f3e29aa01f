"""Where results are printed."""

from collections.abc import Collection, Sequence

from rich.console import Console
from rich.table import Table

_FILE_WIDTH = 160


def results() -> Console:
    """Console on stdout; wide where that is a file or a pipe, so that no column is cut."""
    console = Console()
    return console if console.is_terminal else Console(width=_FILE_WIDTH)


def table(title: str, rows: Sequence[tuple[str, ...]], headings: Sequence[str], words: Collection[str]) -> Table:
    """Table of texts; columns whose heading is among `words` are aligned to the left, figures to the right."""
    made = Table(title=title, title_justify="left")
    for heading in headings:
        made.add_column(heading, justify="left" if heading in words else "right")
    for row in rows:
        made.add_row(*row)
    return made
