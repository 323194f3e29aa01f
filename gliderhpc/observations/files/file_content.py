"""Descriptions of files that cannot be opened as netCDF, by their first bytes and names."""

from pathlib import Path

import netCDF4

from gliderhpc.output_files import fault_of_name

_HEADS = (
    (b"\x1f\x8b", "is gzip-compressed; unpack it first (gunzip)"),
    (b"BZh", "is bzip2-compressed; unpack it first (bunzip2)"),
    (b"\xfd7zXZ", "is xz-compressed; unpack it first (unxz)"),
    (b"PK\x03\x04", "is a zip archive; unpack it first (unzip)"),
    (b"version https://git-lfs", "is a Git LFS pointer, not the file itself; fetch it (git lfs pull)"),
    (b"\xff\xfe", "is UTF-16 text; convert it to UTF-8"),
    (b"\xfe\xff", "is UTF-16 text; convert it to UTF-8"),
    (b"<", "is a web page or XML, not the file itself; download it again"),
)


def describe_content(path: Path) -> str:
    """Describe why a file cannot be opened as netCDF, and the remedy; empty if name and first bytes do not reveal it.

    Parameters
    ----------
    path : Path
        The file.
    """
    fault = fault_of_name(path)
    if fault:
        return fault
    head = _head(path)
    if head == b"":
        return "is empty; copy it again"
    return next((words for start, words in _HEADS if head is not None and head.lstrip().startswith(start)), "")


def describe_missing(path: Path) -> str:
    """Describe a path that does not exist, an address of the web among them."""
    if path.parts[:1] in (("http:",), ("https:",), ("ftp:",)):
        return "is an address; download the file, and give its path"
    if path.parts[:1] == ("file:",):
        return "is an address; give the path alone"
    if path.is_symlink():
        return "is a symbolic link to a file or folder that does not exist, or to itself"
    return "no such file or folder"


def _head(path: Path) -> bytes | None:
    """First bytes of a file; None if it cannot be opened."""
    try:
        with path.open("rb") as stream:
            return stream.read(64)
    except OSError:
        return None


def describe_groups(path: Path) -> str:
    """Clause that names the groups of a netCDF file, which are not read; empty if there are none."""
    if not path.is_file() or not (_head(path) or b"").startswith(_NETCDF_HEADS):
        return ""
    with netCDF4.Dataset(path) as content:
        groups = list(content.groups)
    return f"; its groups ({', '.join(groups)}) are not read: write their variables outside of groups" if groups else ""


_NETCDF_HEADS = (b"\x89HDF", b"CDF")


def describe_failure(path: Path, error: Exception) -> str:
    """Describe why a library failed to read a file, as `describe_content` does; empty if its content is not the reason.

    Other errors are about variables and attributes, which were read.
    """
    if not isinstance(error, OSError | RuntimeError | UnicodeError):
        return ""
    content = describe_content(path)
    if not content and (_head(path) or b"").startswith(_NETCDF_HEADS):
        return "is truncated or damaged; copy it again"
    return content
