"""Progress on stderr: a bar with an estimate of the time left, or plain log lines where there is no terminal."""

import logging
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from gliderhpc.errors import InputError

_FORMAT = "%(asctime)s %(levelname)s %(message)s"


@contextmanager
def logging_to(log_file: Path | None) -> Iterator[None]:
    """Send the package's log to a file, and to stderr where that is no terminal."""
    logger = logging.getLogger("gliderhpc")
    handlers: list[logging.Handler] = []
    if log_file is not None:
        handlers.append(_file_handler(log_file))
    if not sys.stderr.isatty():
        handlers.append(logging.StreamHandler(sys.stderr))
    before = logger.level
    logger.setLevel(logging.INFO)
    for handler in handlers:
        handler.setFormatter(logging.Formatter(_FORMAT))
        logger.addHandler(handler)
    try:
        yield
    finally:
        logger.setLevel(before)
        for handler in handlers:
            logger.removeHandler(handler)
            handler.close()


def _file_handler(log_file: Path) -> logging.Handler:
    try:
        return logging.FileHandler(log_file, encoding="utf-8")
    except OSError as error:
        raise InputError(f"{log_file}: cannot be written ({error.strerror}); give another --log-file") from None


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
