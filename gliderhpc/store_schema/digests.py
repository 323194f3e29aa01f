"""Digests of chunks, and a store that records those of everything written through it."""

from __future__ import annotations

import hashlib

from zarr.abc.store import Store
from zarr.core.buffer import Buffer
from zarr.storage import WrapperStore

Digests = dict[str, str | None]
"""Digests of chunks by key; None where there is no chunk because all its values are fill."""

_DIGEST_BYTES = 16


def digest_of(content: bytes) -> str:
    """Return the 128-bit BLAKE2b digest in hexadecimal."""
    return hashlib.blake2b(content, digest_size=_DIGEST_BYTES).hexdigest()


class RecordingStore(WrapperStore[Store]):
    """Wrapper of a store that records the digest of everything written through it.

    The digest is computed from the bytes before they are written; a disk that stores other bytes is thus detected.

    Attributes
    ----------
    digests : dict
        Digest of the last write by key, None after a deletion.
    """

    # Newer versions of zarr bypass `set` where a store supports synchronous access.
    _supports_sync_io = False

    def __init__(self, store: Store, digests: Digests | None = None) -> None:
        super().__init__(store)
        self.digests: Digests = {} if digests is None else digests

    def _with_store(self, store: Store) -> RecordingStore:
        return RecordingStore(store, self.digests)

    async def set(self, key: str, value: Buffer) -> None:
        """Store a value."""
        await super().set(key, value)
        self.digests[key] = digest_of(value.to_bytes())

    async def delete(self, key: str) -> None:
        """Delete a value."""
        await super().delete(key)
        self.digests[key] = None
