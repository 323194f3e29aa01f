"""Files that an import is given, by name or by folder, and contents that are not what a name promises."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path

from gliderhpc.errors import InputError

_HEADS = (
    (b"\x1f\x8b", "is gzip-compressed; unpack it first (gunzip)"),
    (b"BZh", "is bzip2-compressed; unpack it first (bunzip2)"),
    (b"\xfd7zXZ", "is xz-compressed; unpack it first (unxz)"),
    (b"PK\x03\x04", "is a zip archive; unpack it first (unzip)"),
    (b"version https://git-lfs", "is a pointer of Git LFS, not the file itself; fetch it (git lfs pull)"),
    (b"<", "is a web page or XML, not the file itself; download it again"),
)


def describe_content(path: Path) -> str:
    """Say what else a file is than netCDF, and what to do; empty where its first bytes do not tell.

    Parameters
    ----------
    path : Path
        A file.
    """
    try:
        with path.open("rb") as stream:
            head = stream.read(64)
    except OSError:
        return ""
    if not head:
        return "is empty; fetch it again"
    return next((words for start, words in _HEADS if head.lstrip().startswith(start)), "")


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
