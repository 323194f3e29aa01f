"""Where results are printed."""

from rich.console import Console

_FILE_WIDTH = 160


def results() -> Console:
    """Console on stdout; wide where that is a file or a pipe, so that no column is cut."""
    console = Console()
    return console if console.is_terminal else Console(width=_FILE_WIDTH)
