"""Progress on stderr: a bar with an estimate of the time left, or plain log lines where there is no terminal."""

import logging
import re
import stat
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from gliderhpc.cli.console import LogFormatter
from gliderhpc.cli.text import say
from gliderhpc.cli.unexpected import UnexpectedError, environment, is_expected
from gliderhpc.errors import InputError

_FORMAT = "%(asctime)s %(levelname)s %(message)s"
_LOG_LINE = re.compile(rb"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d,\d{3} [A-Z]+ ")
"""Beginning of a line in that format."""


@contextmanager
def logging_to(log_file: Path | None) -> Iterator[None]:
    """Send the package's log to a file, and to stderr where that is no terminal.

    Raises
    ------
    InputError
        The file cannot be written.
    UnexpectedError
        The body ended in an error that is a fault of the program's; its traceback is in the file.
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
        handlers[0].handle(logger.makeRecord(
            logger.name, logging.ERROR, __file__, 0, "unexpected error, %s", (environment(),),
            (type(error), error, error.__traceback__),
        ))  # fmt: skip
        raise UnexpectedError(error, log_file) from error
    finally:
        logger.setLevel(before)
        for handler in handlers:
            logger.removeHandler(handler)
            handler.close()


class _StreamLog(logging.StreamHandler[TextIO]):
    """A log on stderr that ends where nobody reads it any more: the run goes on."""

    def handleError(self, record: logging.LogRecord) -> None:  # noqa: N802 - logging's name
        """Say no more on a stream that is closed; any other error is logging's."""
        if isinstance(sys.exc_info()[1], OSError):
            self.setLevel(logging.CRITICAL + 1)
        else:
            super().handleError(record)


class _FileLog(logging.FileHandler):
    """A log file that ends with one line on stderr where it cannot be written any more: the run goes on."""

    def handleError(self, record: logging.LogRecord) -> None:  # noqa: N802 - logging's name
        """Tell of a disk that is full or lost; any other error is logging's."""
        error = sys.exc_info()[1]
        if isinstance(error, OSError):
            self._end(error)
        else:
            super().handleError(record)

    def close(self) -> None:
        """Close the file, whatever of it is still to be written."""
        try:
            super().close()
        except OSError as error:
            self._end(error)

    def _end(self, error: OSError) -> None:
        if self.level <= logging.CRITICAL:
            self.setLevel(logging.CRITICAL + 1)
            say(f"gliderhpc: the log {self.baseFilename} cannot be written any more ({error.strerror})", err=True)


def _file_handler(log_file: Path) -> logging.Handler:
    _check_is_log(log_file)
    try:
        return _FileLog(log_file, encoding="utf-8")
    except OSError as error:
        raise InputError(f"{log_file}: cannot be written ({error.strerror}); give another --log-file") from None


def _check_is_log(log_file: Path) -> None:
    """Refuse to append to what is no log: a new or empty file, one that begins as ours do, or a terminal will do.

    Raises
    ------
    InputError
        With the remedy.
    """
    if not log_file.exists() or stat.S_ISCHR(log_file.stat().st_mode):
        return
    if not log_file.is_file():
        raise InputError(f"{log_file}: is no regular file; give another --log-file")
    try:
        with log_file.open("rb") as stream:
            head = stream.read(64)
    except OSError as error:
        raise InputError(f"{log_file}: cannot be read ({error.strerror}); give another --log-file") from None
    if head and not _LOG_LINE.match(head):
        raise InputError(f"{log_file}: is there and no log of gliderhpc; give another --log-file")


@contextmanager
def progress(total: int, what: str) -> Iterator[Callable[[], None]]:
    """Bar over `total` steps; yields the function that advances it."""
    console = Console(stderr=True)
    with Progress(
        TextColumn(what), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TextColumn("left"),
        TimeRemainingColumn(), console=console, disable=not console.is_terminal, transient=True,
    ) as bar:  # fmt: skip
        task = bar.add_task(what, total=total)
        yield lambda: bar.advance(task)
