"""Decoding of text chunks that a damaged chunk cannot make allocate more than it holds.

A chunk of texts begins with their number, and zarr's decoder allocates room for that many before it looks at the first.
In a damaged chunk the number is anything up to four thousand million, and markers of commits are read before any digest
is known that could tell.
"""

from __future__ import annotations

from typing import Any

import zarr
from zarr.codecs import vlen_utf8
from zarr.registry import register_codec

NAME = "vlen-utf8"

_LENGTH = 4
"""Bytes of the number of texts, and of the length before each text."""


# Zarr takes for texts what has this name.
class VLenUTF8Codec(vlen_utf8.VLenUTF8Codec):
    """Zarr's codec of texts, refusing a chunk too short for the number of texts that it claims."""

    def _decode_sync(self, chunk_bytes: Any, chunk_spec: Any) -> Any:
        check_text_count(chunk_bytes.to_bytes())
        return super()._decode_sync(chunk_bytes, chunk_spec)

    async def _decode_single(self, chunk_bytes: Any, chunk_spec: Any) -> Any:
        check_text_count(chunk_bytes.to_bytes())
        return await super()._decode_single(chunk_bytes, chunk_spec)


def check_text_count(content: bytes) -> None:
    """Refuse a text chunk that claims more texts than its bytes can hold.

    Raises
    ------
    ValueError
        It does.
    """
    count = int.from_bytes(content[:_LENGTH], "little")
    if len(content) < _LENGTH * (count + 1):
        raise ValueError(f"a text chunk of {len(content)} bytes claims {count} texts")


def use_bounded_text() -> None:
    """Have zarr decode texts with the codec above in this process; other chunks and all writing stay as they are."""
    register_codec(NAME, VLenUTF8Codec)
    zarr.config.set({f"codecs.{NAME}": f"{VLenUTF8Codec.__module__}.{VLenUTF8Codec.__qualname__}"})
