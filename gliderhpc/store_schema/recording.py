"""A store that remembers the digest of everything written through it.

The digest is that of the bytes as they were handed over, so a disk that keeps something else is found out.
"""

from __future__ import annotations

import hashlib

from zarr.abc.store import Store
from zarr.core.buffer import Buffer
from zarr.storage import WrapperStore

Digests = dict[str, str | None]
"""By key of a chunk, the digest of its bytes; None says that there is no such chunk, for all of it is fill."""

_SIZE = 16


def digest_of(content: bytes) -> str:
    """BLAKE2b of 128 bits, in hexadecimal."""
    return hashlib.blake2b(content, digest_size=_SIZE).hexdigest()


class RecordingStore(WrapperStore[Store]):
    """Hands everything on to another store.

    Attributes
    ----------
    digests : dict
        By key, what was last written, None for what was last deleted.
    """

    # Newer versions of zarr write past `set` where a store says that it can do without waiting.
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
