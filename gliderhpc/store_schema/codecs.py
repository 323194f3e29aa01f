"""Zarr's codecs of strings and of compressed chunks, as used to read and write archives.

Importing this module registers them. Every store of an archive is opened by `gliderhpc.store_schema.location`, which
imports it.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import zarr
from zarr.abc.codec import BaseCodec
from zarr.codecs import BloscCodec, BytesCodec, Crc32cCodec, vlen_utf8
from zarr.registry import register_codec

MAX_INLINE_BYTES = 2**20
"""Largest chunk that is read and decoded in the calling thread, bytes."""

_LENGTH_BYTES = 4
"""Size of the number of texts, and of the length before each text, bytes."""


class _OneByOne(BaseCodec[Any, Any]):
    """Coding of chunks one after the other.

    Zarr starts a task for every chunk and codec, which takes as long as the coding of a row of an archive.
    """

    async def decode(self, chunks_and_specs: Iterable[tuple[Any, Any]]) -> list[Any]:
        return [None if chunk is None else await self._decode_single(chunk, spec) for chunk, spec in chunks_and_specs]

    async def encode(self, chunks_and_specs: Iterable[tuple[Any, Any]]) -> list[Any]:
        return [None if chunk is None else await self._encode_single(chunk, spec) for chunk, spec in chunks_and_specs]


class InlineBytesCodec(_OneByOne, BytesCodec):
    """Zarr's codec from arrays to bytes, chunk by chunk."""


class InlineCrc32cCodec(_OneByOne, Crc32cCodec):
    """Zarr's checksum, chunk by chunk."""


# Zarr selects the text codec by this class name.
class VLenUTF8Codec(_OneByOne, vlen_utf8.VLenUTF8Codec):
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
"""True if this version of zarr can decode without another thread."""


class InlineBloscCodec(_OneByOne, BloscCodec):
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


_CODECS: dict[str, type] = {
    "vlen-utf8": VLenUTF8Codec, "blosc": InlineBloscCodec, "bytes": InlineBytesCodec, "crc32c": InlineCrc32cCodec
}  # fmt: skip
for _name, _codec in _CODECS.items():
    register_codec(_name, _codec)
    zarr.config.set({f"codecs.{_name}": f"{_codec.__module__}.{_codec.__qualname__}"})
# One by one, chunks as small as the commit markers take half as long again. More are not in memory together than are
# read at once anyway.
zarr.config.set({"codec_pipeline.batch_size": zarr.config.get("async.concurrency")})
