"""Console output: tables, log lines, and progress as a bar on a terminal or as plain log lines elsewhere."""

import logging
import re
import stat
import sys
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TextIO

import click
from rich.console import Console, ConsoleOptions, RenderableType
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.segment import Segment
from rich.table import Table

from gliderhpc.cli.messages import UnexpectedError, echo, environment, is_expected, printable, with_options
from gliderhpc.errors import InputError

_FILE_WIDTH = 160


class _Console(Console):
    """A console without markup that replaces control characters in texts."""

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        for segment in super().render(renderable, options):
            yield segment if segment.control else Segment(printable(segment.text), segment.style)


class LogFormatter(logging.Formatter):
    """Format of log lines: a message is one line, followed by the traceback, if any.

    Lines name the options of the command that is running when the formatter is created, also lines of other threads.
    """

    def __init__(self) -> None:
        super().__init__("%(asctime)s %(levelname)s %(message)s")
        context = click.get_current_context(silent=True)
        self._command = None if context is None else context.command

    def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: N802 - logging's name
        """Format the line."""
        return printable(with_options(super().formatMessage(record), self._command), lines=False)

    def formatException(self, ei: Any) -> str:  # noqa: N802 - logging's name
        """Format the traceback."""
        return printable(super().formatException(ei))


def results() -> Console:
    """Return a console on stdout, wide if stdout is a file or a pipe, to avoid cutting columns."""
    console = _Console(markup=False, emoji=False)
    return console if console.is_terminal else _Console(width=_FILE_WIDTH, markup=False, emoji=False)


def table(title: str, rows: Sequence[tuple[str, ...]], headings: Sequence[str], words: Collection[str]) -> Table:
    """Return a table of texts; columns whose heading is in `words` are left-aligned, the others right-aligned."""
    grid = Table(title=title, title_justify="left")
    for heading in headings:
        grid.add_column(heading, justify="left" if heading in words else "right")
    for row in rows:
        grid.add_row(*row)
    return grid


_LOG_LINE = re.compile(rb"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d,\d{3} [A-Z]+ ")
"""Pattern of the beginning of a log line, as `LogFormatter` writes it."""


@contextmanager
def logging_to(log_file: Path | None) -> Iterator[None]:
    """Send the package's log to a file, and to stderr unless that is a terminal.

    Raises
    ------
    InputError
        The file cannot be written.
    UnexpectedError
        The body ended in an error of the program itself; its traceback is in the file.
    """
    logger = logging.getLogger("gliderhpc")
    handlers: list[logging.Handler] = []
    if log_file is not None:
        handlers.append(_file_handler(log_file))
    if sys.stderr is not None and not sys.stderr.isatty():
        handlers.append(_StreamLog(sys.stderr))
    before = logger.level
    logger.setLevel(logging.INFO)
    for handler in handlers:
        handler.setFormatter(LogFormatter())
        logger.addHandler(handler)
    try:
        yield
    except Exception as error:
        if log_file is None or is_expected(error):
            raise
        handlers[0].handle(
            logger.makeRecord(
                logger.name,
                logging.ERROR,
                __file__,
                0,
                "unexpected error, %s",
                (environment(),),
                (type(error), error, error.__traceback__),
            )
        )
        raise UnexpectedError(error, log_file) from error
    finally:
        logger.setLevel(before)
        for handler in handlers:
            logger.removeHandler(handler)
            handler.close()


PRINTED = {"is_printed": True}
"""Extra attribute of log records whose text the command prints on stderr itself."""


class _StreamLog(logging.StreamHandler[TextIO]):
    """A log on stderr that ends when stderr is closed, while the run continues."""

    def emit(self, record: logging.LogRecord) -> None:
        """Write the line of a record unless its text is printed on stderr in another way."""
        if not getattr(record, "is_printed", False):
            super().emit(record)

    def handleError(self, record: logging.LogRecord) -> None:  # noqa: N802 - logging's name
        """Stop logging to a closed stream; leave any other error to logging."""
        if isinstance(sys.exc_info()[1], OSError):
            self.setLevel(logging.CRITICAL + 1)
        else:
            super().handleError(record)


class _FileLog(logging.FileHandler):
    """A log file that ends with one line on stderr when it cannot be written any more, while the run continues."""

    def handleError(self, record: logging.LogRecord) -> None:  # noqa: N802 - logging's name
        """Report a full or lost disk; leave any other error to logging."""
        error = sys.exc_info()[1]
        if isinstance(error, OSError):
            self._end(error)
        else:
            super().handleError(record)

    def close(self) -> None:
        """Close the file, reporting lines that cannot be written."""
        try:
            super().close()
        except OSError as error:
            self._end(error)

    def _end(self, error: OSError) -> None:
        if self.level <= logging.CRITICAL:
            self.setLevel(logging.CRITICAL + 1)
            echo(f"gliderhpc: the log {self.baseFilename} can no longer be written ({error.strerror})", err=True)


def _file_handler(log_file: Path) -> logging.Handler:
    _check_is_log(log_file)
    try:
        return _FileLog(log_file, encoding="utf-8")
    except OSError as error:
        raise InputError(f"{log_file}: cannot be written ({error.strerror}); give another --log-file") from None


def _check_is_log(log_file: Path) -> None:
    """Check that a log may be appended to: a new or empty file, one that begins with a log line, or a terminal.

    Raises
    ------
    InputError
        The file is something else or cannot be read; the message names the remedy.
    """
    if not log_file.exists() or stat.S_ISCHR(log_file.stat().st_mode):
        return
    if not log_file.is_file():
        raise InputError(f"{log_file}: is not a regular file; give another --log-file")
    try:
        with log_file.open("rb") as stream:
            head = stream.read(64)
    except OSError as error:
        raise InputError(f"{log_file}: cannot be read ({error.strerror}); give another --log-file") from None
    if head and not _LOG_LINE.match(head):
        raise InputError(f"{log_file}: exists and is not a log of gliderhpc; give another --log-file")


@contextmanager
def progress(total: int, what: str) -> Iterator[Callable[[], None]]:
    """Show a progress bar over `total` steps, and yield the function that advances it."""
    console = Console(stderr=True)
    with Progress(
        TextColumn(what),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
        console=console,
        disable=not console.is_terminal,
        transient=True,
    ) as bar:
        task = bar.add_task(what, total=total)
        yield lambda: bar.advance(task)
