"""Encoding of values in an archive, and decoding of text chunks bounded by their size.

A chunk of texts begins with their number, and zarr's decoder allocates memory for that many before it reads the first.
In a damaged chunk the number can be as large as four thousand million, and commit markers are read before any digest is
known that could reveal the damage.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import zarr
from numpy.typing import ArrayLike, NDArray
from zarr.codecs import vlen_utf8
from zarr.registry import register_codec

from gliderhpc.store_schema.schema import Variable


def encoded(variable: Variable, values: Any) -> Any:
    """Convert times to seconds since 1970 (NaT to NaN); return other values unchanged."""
    if not (variable.is_time and np.asarray(values).dtype.kind == "M"):
        return values
    instants = np.asarray(values).astype("datetime64[ns]")
    since = np.datetime64(0, "ns")
    return np.where(np.isnat(instants), np.nan, (instants - since) / np.timedelta64(1, "s"))


def padded_row(variable: Variable, label: str, row: ArrayLike, length: int) -> NDArray[Any]:
    """Check a row against its variable and pad it with the fill value to its length."""
    values = np.asarray(encoded(variable, row))
    if values.ndim != 1 or values.size > length:
        raise ValueError(f"{label}: a row of shape {values.shape} does not fit into {length} columns")
    if not variable.dtype.startswith("float") and values.dtype.kind not in "iub":
        raise ValueError(f"{label}: {values.dtype} values cannot go into {variable.dtype} without loss")
    padded = np.full(length, variable.fill_value, dtype=variable.dtype)
    padded[: values.size] = values
    return padded


def check_position(index: int, count: int) -> None:
    """Check that a position lies within the archive."""
    # zarr interprets -1 as the last row, so that a worker's error would overwrite another profile's data.
    if not 0 <= index < count:
        raise ValueError(f"position {index} is outside the archive's {count} profiles")


NAME = "vlen-utf8"

_LENGTH = 4
"""Bytes of the number of texts, and of the length before each text."""


# Zarr selects the text codec by this class name.
class VLenUTF8Codec(vlen_utf8.VLenUTF8Codec):
    """Zarr's text codec, which refuses a chunk too short for the number of texts that it claims."""

    def _decode_sync(self, chunk_bytes: Any, chunk_spec: Any) -> Any:
        check_text_count(chunk_bytes.to_bytes())
        return super()._decode_sync(chunk_bytes, chunk_spec)

    async def _decode_single(self, chunk_bytes: Any, chunk_spec: Any) -> Any:
        check_text_count(chunk_bytes.to_bytes())
        return await super()._decode_single(chunk_bytes, chunk_spec)


def check_text_count(content: bytes) -> None:
    """Check that a text chunk does not claim more texts than its bytes can hold.

    Raises
    ------
    ValueError
        It claims more.
    """
    count = int.from_bytes(content[:_LENGTH], "little")
    if len(content) < _LENGTH * (count + 1):
        raise ValueError(f"a text chunk of {len(content)} bytes claims {count} texts")


def use_bounded_text() -> None:
    """Register the bounded text codec with zarr in this process."""
    register_codec(NAME, VLenUTF8Codec)
    zarr.config.set({f"codecs.{NAME}": f"{VLenUTF8Codec.__module__}.{VLenUTF8Codec.__qualname__}"})
