"""Completeness of files in the classic netCDF formats (netCDF-3): the library reads the missing part as zeros.

The header gives the place of every variable. netCDF-4 files need no such check, because the library refuses those that
are too short.
"""

import math
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from gliderhpc.errors import InputError
from gliderhpc.wording import counted

_VERSIONS = (1, 2, 5)
"""Versions of the format, the byte after ``CDF``: classic, with 64-bit offsets, and with 64-bit data."""

_SIZES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 4, 6: 8, 7: 1, 8: 2, 9: 4, 10: 8, 11: 8}
"""Bytes of a value by the number of its type."""


def refuse_cut_off(path: Path) -> None:
    """Refuse a classic netCDF file whose end is missing.

    Raises
    ------
    InputError
        Bytes are missing.
    """
    missing = missing_bytes(path)
    if missing:
        raise InputError(f"{path}: is truncated, its last {counted(missing, 'byte')} are missing; copy it again")


def missing_bytes(path: Path) -> int:
    """Return the number of bytes that are missing at the end of a classic netCDF file; 0 for any other file.

    Parameters
    ----------
    path : Path
        A regular file.
    """
    with path.open("rb") as stream:
        magic = stream.read(4)
        if magic[:3] != b"CDF" or len(magic) < 4 or magic[3] not in _VERSIONS:
            return 0
        try:
            length = _Header(stream, magic[3]).file_length()
        except (struct.error, KeyError, IndexError, OverflowError, ValueError, OSError):
            # The library refuses a header that is cut off or damaged.
            return 0
        return max(length - stream.seek(0, 2), 0)


@dataclass(frozen=True)
class _Variable:
    """Place of a variable: its first byte, bytes of its values (of a record), and whether it has records."""

    begin: int
    size: int
    has_records: bool

    @property
    def padded(self) -> int:
        return _padded(self.size)


class _Header:
    """Header of a classic netCDF file, read from a stream behind its first four bytes."""

    def __init__(self, stream: BinaryIO, version: int) -> None:
        self._stream = stream
        self._count_format = ">Q" if version == 5 else ">I"
        self._offset_format = ">I" if version == 1 else ">Q"

    def file_length(self) -> int:
        """Return the least length of the file (bytes): the end of its last value."""
        streaming = 2 ** (8 * struct.calcsize(self._count_format)) - 1
        records = self._count()
        lengths = [self._dimension() for _ in range(self._list_length())]
        self._skip_attributes()
        variables = [self._variable(lengths) for _ in range(self._list_length())]
        ends = [each.begin + each.size for each in variables if not each.has_records]
        recorded = [each for each in variables if each.has_records]
        if 0 < records < streaming:
            # Records of a single variable are not padded.
            record_size = recorded[0].size if len(recorded) == 1 else sum(each.padded for each in recorded)
            ends += [each.begin + (records - 1) * record_size + each.size for each in recorded]
        return max(ends, default=0)

    def _number(self, form: str) -> int:
        (value,) = struct.unpack(form, self._stream.read(struct.calcsize(form)))
        return int(value)

    def _count(self) -> int:
        return self._number(self._count_format)

    def _list_length(self) -> int:
        self._number(">I")  # the kind of list, 0 for none
        return self._count()

    def _skip(self, size: int) -> None:
        self._stream.seek(_padded(size), 1)

    def _dimension(self) -> int:
        self._skip(self._count())
        return self._count()

    def _skip_attributes(self) -> None:
        for _ in range(self._list_length()):
            self._skip(self._count())
            value_size = _SIZES[self._number(">I")]
            self._skip(value_size * self._count())

    def _variable(self, lengths: list[int]) -> _Variable:
        self._skip(self._count())
        shape = [lengths[self._count()] for _ in range(self._count())]
        self._skip_attributes()
        value_size = _SIZES[self._number(">I")]
        self._count()  # the size, which overflows in large variables
        begin = self._number(self._offset_format)
        # The dimension that grows has length 0 in the header.
        has_records = bool(shape) and shape[0] == 0
        return _Variable(begin, value_size * math.prod(shape[has_records:]), has_records)


def _padded(size: int) -> int:
    return -(-size // 4) * 4
