"""Zarr's codecs of texts and of compressed chunks, as used to read and write archives.

Importing this module registers them. Every store of an archive is opened by `gliderhpc.store_schema.place`, which
imports it.
"""

from __future__ import annotations

from typing import Any

import zarr
from zarr.codecs import BloscCodec, vlen_utf8
from zarr.registry import register_codec

MAX_INLINE_BYTES = 2**20
"""Largest chunk that is read and decoded in the calling thread, bytes."""

_LENGTH_BYTES = 4
"""Size of the number of texts, and of the length before each text, bytes."""


# Zarr selects the text codec by this class name.
class VLenUTF8Codec(vlen_utf8.VLenUTF8Codec):
    """Zarr's text codec, which refuses a chunk too short for the number of texts that it claims.

    A chunk of texts begins with their number, and zarr's decoder allocates memory for that many before it reads the
    first. In a damaged chunk the number can be as large as four thousand million, and commit markers are read before
    any digest is known that could reveal the damage.
    """

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
    count = int.from_bytes(content[:_LENGTH_BYTES], "little")
    if len(content) < _LENGTH_BYTES * (count + 1):
        raise ValueError(f"a text chunk of {len(content)} bytes claims {count} texts")


_DECODES_INLINE = hasattr(BloscCodec, "_decode_sync")
"""Whether this version of zarr can decode without another thread."""


class InlineBloscCodec(BloscCodec):
    """Zarr's Blosc codec, which handles a chunk of ordinary size in the calling thread.

    Zarr hands every chunk to another thread, which takes several times as long as decoding a row of an archive.
    """

    async def _decode_single(self, chunk_bytes: Any, chunk_spec: Any) -> Any:
        if len(chunk_bytes) > MAX_INLINE_BYTES or not _DECODES_INLINE:
            return await super()._decode_single(chunk_bytes, chunk_spec)
        return self._decode_sync(chunk_bytes, chunk_spec)

    async def _encode_single(self, chunk_bytes: Any, chunk_spec: Any) -> Any:
        if len(chunk_bytes) > MAX_INLINE_BYTES or not _DECODES_INLINE:
            return await super()._encode_single(chunk_bytes, chunk_spec)
        return self._encode_sync(chunk_bytes, chunk_spec)


for _name, _codec in (("vlen-utf8", VLenUTF8Codec), ("blosc", InlineBloscCodec)):
    register_codec(_name, _codec)
    zarr.config.set({f"codecs.{_name}": f"{_codec.__module__}.{_codec.__qualname__}"})
