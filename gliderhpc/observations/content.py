"""Contents of a file that is not what its name says, by its first bytes."""

from pathlib import Path

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
