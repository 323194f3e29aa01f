"""The files that an import is given: by name, or by the folder that holds them."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path

from gliderhpc.errors import InputError
from gliderhpc.observations.content import describe_content

_COMPRESSED = (".gz", ".bz2", ".xz", ".zip")


def files_of(sources: Sequence[Path], belongs: Callable[[Path], bool]) -> Iterator[Path]:
    """Files as given, and of a folder those that belong, by name.

    Raises
    ------
    InputError
        A source does not exist, or is compressed where only plain files belong.
    """
    for source in sources:
        if source.is_dir():
            held = sorted(source.iterdir())
            # A pipe or a device that is named like a record would be waited for, or read for ever.
            chosen = [path for path in held if belongs(path) and path.is_file()]
            if not chosen:
                refuse_compressed(path for path in held if belongs(path.with_suffix("")))
            yield from chosen
        elif source.is_file():
            if not belongs(source):
                refuse_compressed([source])
            yield source
        else:
            what = "is a device or a pipe, no regular file" if source.exists() else "no such file or folder"
            raise InputError(f"{source}: {what}")


def refuse_compressed(paths: Iterable[Path]) -> None:
    """Refuse the first file that is compressed, by its name.

    Raises
    ------
    InputError
        With the remedy.
    """
    for path in paths:
        content = describe_content(path) if path.suffix.lower() in _COMPRESSED and path.is_file() else ""
        if content:
            raise InputError(f"{path}: {content}")
