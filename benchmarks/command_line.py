"""Command lines of the benchmarks whose arguments are all positional: ``--help``, and one line for a wrong call."""

import argparse
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any


def positional(description: str | None, **arguments: dict[str, Any]) -> argparse.Namespace:
    """Read positional arguments, given by name with the options of `argparse`."""
    parser = argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawDescriptionHelpFormatter, allow_abbrev=False
    )
    for name, options in arguments.items():
        parser.add_argument(name, **options)
    return parser.parse_args()


@contextmanager
def data_and_work_folders(description: str | None) -> Iterator[tuple[Path, Path]]:
    """Read a folder of data and a working folder, temporary if none is given."""
    given = positional(description, data={"type": Path}, work={"type": Path, "nargs": "?"})
    with nullcontext(given.work) if given.work else tempfile.TemporaryDirectory() as work:
        yield given.data, Path(work)
