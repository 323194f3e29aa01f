"""Store that compares every chunk it reads with the digest that its writer recorded.

Zarr reads a missing chunk as fill values. The manifests name the chunks that must exist, with their digests, and this
store thereby distinguishes a row without values from a lost one. A profile's manifest is read with its first chunk.
"""

from __future__ import annotations

import json

import numpy as np
import zarr.api.asynchronous as zarr_async
from zarr.abc.store import ByteRequest, Store
from zarr.core.buffer import Buffer, BufferPrototype, default_buffer_prototype
from zarr.storage import WrapperStore

from gliderhpc.errors import InputError, first_line
from gliderhpc.store_schema.commits import BY_RESUME, UNREADABLE, AsyncArray, parsed_commit, row_names
from gliderhpc.store_schema.digests import Digests, digest_of
from gliderhpc.store_schema.schema import COMMITS, COMPLETE, DIGESTS, MANIFEST, MISSION, PROFILE, STUDIES

_STUDIES = {study.name for study in STUDIES}
_ROWS: dict[str, str | None] = {
    **dict.fromkeys(row_names(MISSION)),
    **{name: study.name for study in STUDIES for name in row_names([study])},
}
"""Study of every variable that holds profiles' rows, None for those of the mission."""


class VerifiedStore(WrapperStore[Store]):
    """Wrapper of a store that refuses chunks that differ from those written.

    Parameters
    ----------
    store : zarr.abc.store.Store
        Store of the archive.
    location : str
        Name of the archive in messages.
    """

    # Newer versions of zarr bypass `get` where a store supports synchronous access.
    _supports_sync_io = False

    def __init__(self, store: Store, location: str) -> None:
        super().__init__(store)
        self._location = location
        self._manifests: dict[tuple[str | None, int], Digests | None] = {}
        self._tables: dict[str, Digests] = {}
        self._arrays: dict[str, AsyncArray] = {}

    def _with_store(self, store: Store) -> VerifiedStore:
        return VerifiedStore(store, self._location)

    async def get(
        self, key: str, prototype: BufferPrototype | None = None, byte_range: ByteRequest | None = None
    ) -> Buffer | None:
        """Return a value.

        Raises
        ------
        InputError
            It is a chunk that is missing, or differs from the one written.
        """
        value = await self._store.get(key, prototype or default_buffer_prototype(), byte_range)
        if byte_range is None:
            await self._verify(key, value)
        return value

    async def _verify(self, key: str, value: Buffer | None) -> None:
        variable, _, chunk = key.rpartition("/")
        if not chunk.startswith("c"):
            return
        digest = None if value is None else digest_of(value.to_bytes())
        if variable in _ROWS:
            index = int(chunk.split(".")[1])
            if self._differs(await self._manifest(variable, index), key, digest):
                # A run may have recomputed the profile meanwhile.
                self._manifests.pop((_ROWS[variable], index))
                if self._differs(await self._manifest(variable, index), key, digest):
                    raise InputError(await self._message(index, variable, digest))
        elif self._differs(await self._table_digests(variable), key, digest):
            study = variable.partition("/")[0]
            raise InputError(f"{self._location}: {variable}: the chunk is {_state(digest)}; run {study} again")

    @staticmethod
    def _differs(expected: Digests | None, key: str, digest: str | None) -> bool:
        return expected is not None and key in expected and expected[key] != digest

    async def _manifest(self, variable: str, index: int) -> Digests | None:
        """Return the digests of a profile's chunks of the mission or of a study, None where it is not committed."""
        study = _ROWS[variable]
        if (study, index) not in self._manifests:
            text = self._commit(index) if study is None else self._study(study, index)
            self._manifests[study, index] = await text
        return self._manifests[study, index]

    async def _commit(self, index: int) -> Digests | None:
        try:
            marker, manifest = [await self._text(f"{COMMITS}/{name}", index) for name in ("marker", "manifest")]
            commit = parsed_commit(marker, manifest)
        except UNREADABLE as error:
            commit = first_line(error)
        if isinstance(commit, str):
            raise InputError(f"{self._location}: profile {await self._number(index)}, {COMMITS}: {commit}; {BY_RESUME}")
        return None if commit is None else commit.manifest

    async def _study(self, study: str, index: int) -> Digests | None:
        """Return the digests of a profile's rows of a finished study."""
        if not await self._table_digests(study + "/"):
            return None
        text = await self._text(f"{study}/{MANIFEST}", index)
        return dict(json.loads(text)) if text else None

    async def _table_digests(self, variable: str) -> Digests:
        """Return the digests of the tables of a variable's study; empty for the mission, whose commits repeat them."""
        study = variable.partition("/")[0]
        if study not in _STUDIES or "/" not in variable:
            return {}
        if study not in self._tables:
            attributes = (await zarr_async.open_group(store=self._store, path=study, mode="r")).attrs
            digests = attributes.get(DIGESTS) if attributes.get(COMPLETE) else None
            self._tables[study] = dict(digests) if isinstance(digests, dict) else {}
        return self._tables[study]

    async def _text(self, name: str, index: int) -> str:
        if name not in self._arrays:
            self._arrays[name] = await zarr_async.open_array(store=self._store, path=name, mode="r")
        return str(np.asarray(await self._arrays[name].getitem(slice(index, index + 1)))[0])

    async def _message(self, index: int, variable: str, digest: str | None) -> str:
        study = _ROWS[variable]
        remedy = BY_RESUME if study is None else f"run {study} again"
        number = await self._number(index)
        return f"{self._location}: profile {number}, {variable}: the chunk is {_state(digest)}; {remedy}"

    async def _number(self, index: int) -> int:
        array = await zarr_async.open_array(store=self._store, path=PROFILE, mode="r")
        return int(np.asarray(await array.getitem(slice(index, index + 1)))[0])


def _state(digest: str | None) -> str:
    return "missing" if digest is None else "damaged"
