"""The files that an import is given: by name, or by the folder that holds them."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from gliderhpc.errors import InputError


def files_of(sources: Sequence[Path], belongs: Callable[[Path], bool]) -> Iterator[Path]:
    """Files as given, and of a folder those that belong, by name.

    Raises
    ------
    InputError
        A source does not exist.
    """
    for source in sources:
        if source.is_dir():
            yield from sorted(path for path in source.iterdir() if belongs(path))
        elif source.is_file():
            yield source
        else:
            raise InputError(f"{source}: no such file or folder")
