"""Where an archive lies: a folder, or a prefix of an object store.

Everything of an archive goes through a store of zarr's own, so that what reads and writes it need not know which.
"""

from __future__ import annotations

import asyncio
import json
import os
import re
import shutil
import stat
from collections.abc import Coroutine, Mapping
from pathlib import Path
from typing import Any, TypeVar

from zarr.abc.store import ByteRequest, Store
from zarr.core.buffer import Buffer, BufferPrototype, default_buffer_prototype
from zarr.core.sync import sync
from zarr.storage import LocalStore

from gliderhpc.errors import InputError
from gliderhpc.store_schema.schema import SCHEMA_NAME
from gliderhpc.store_schema.text_codec import use_bounded_text

use_bounded_text()

Place = str | Path
"""A folder, or an address such as ``s3://bucket/mission.zarr``."""

Value = TypeVar("Value")

ROOT = "zarr.json"
"""Key of an archive's own metadata."""

_AT_ONCE = 32
"""Requests to a store that are under way together."""

_SCHEME = "://"
_PARTIAL = re.compile(r".+\.[0-9a-f]{32}\.partial")
"""Names that zarr gives to what it has not written to the end."""


def is_address(place: Place) -> bool:
    """Whether an archive lies in an object store."""
    return _SCHEME in str(place)


def absolute(place: Place) -> str:
    """Name of a place that holds in any working folder."""
    return str(place) if is_address(place) else str(Path(place).resolve())


def beside(place: Place, suffix: str) -> str:
    """Name of a place with something added to its last part."""
    return str(place).rstrip("/") + suffix


def store_at(place: Place, *, read_only: bool = False) -> Store:
    """Open the store of a place; nothing need be there yet.

    Raises
    ------
    InputError
        The address is of no known kind, or the extra that reads it is not installed.
    """
    if is_address(place):
        from gliderhpc.store_schema.object_store import object_store_at

        return object_store_at(str(place), read_only=read_only)
    return FolderStore(Path(place), read_only=read_only)


class FolderStore(LocalStore):
    """An archive in a folder, none of whose files keeps its reader waiting: a pipe in place of a chunk is refused."""

    async def get(
        self, key: str, prototype: BufferPrototype | None = None, byte_range: ByteRequest | None = None
    ) -> Buffer | None:
        """Return what is stored under a key, None where there is nothing.

        Raises
        ------
        InputError
            A pipe, socket or device is there.
        """
        self._refuse_pipe(key)
        return await super().get(key, prototype, byte_range)

    def get_sync(self, key: str, **options: Any) -> Buffer | None:
        """Return what is stored under a key, in versions of zarr that do without waiting; errors as in `get`."""
        self._refuse_pipe(key)
        return super().get_sync(key, **options)

    def _refuse_pipe(self, key: str) -> None:
        try:
            mode = os.stat(self.root / key).st_mode  # noqa: PTH116 - a path's own method takes three times as long
        except OSError:
            return  # The store says what is the matter, or that there is nothing.
        if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
            raise InputError(f"{self.root}: {key} is a pipe, socket or device, not a file; remove it")


def wait_for(answer: Coroutine[Any, Any, Value]) -> Value:
    """Run a store's coroutine to its end, in any thread."""
    return sync(answer)


async def stored_bytes(store: Store, key: str) -> bytes | None:
    """Bytes stored under a key, None where there is none."""
    value = await store.get(key, default_buffer_prototype())
    return None if value is None else value.to_bytes()


def write_group(content: Mapping[str, Buffer], place: Place, group: str = "") -> None:
    """Write what a store in memory holds to a place, or to a group there, the metadata of its root last."""
    prefix = f"{group}/" if group else ""
    last = [key for key in content if key == ROOT]
    keys = [key for key in content if key != ROOT]
    if is_address(place):
        target = store_at(place)
        for at_once in (keys, last):
            wait_for(_set_many(target, {prefix + key: content[key] for key in at_once}))
        return
    # By this thread, so that Ctrl-C leaves nobody behind who goes on writing.
    for key in (*keys, *last):
        path = Path(place, group, key)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content[key].to_bytes())


async def _set_many(target: Store, content: Mapping[str, Buffer]) -> None:
    at_once = asyncio.Semaphore(_AT_ONCE)

    async def set_one(key: str) -> None:
        async with at_once:
            await target.set(key, content[key])

    await asyncio.gather(*map(set_one, content))


def read_group(place: Place, group: str) -> dict[str, Buffer]:
    """Read everything that a place holds of a group, by key, as `write_group` takes it; nothing where there is none."""
    if is_address(place):
        return wait_for(_get_many(store_at(place, read_only=True), f"{group}/"))
    folder, as_buffer = Path(place, group), default_buffer_prototype().buffer.from_bytes
    files = [path for path in folder.rglob("*") if path.is_file()]
    return {path.relative_to(folder).as_posix(): as_buffer(path.read_bytes()) for path in files}


async def _get_many(source: Store, prefix: str) -> dict[str, Buffer]:
    at_once, prototype = asyncio.Semaphore(_AT_ONCE), default_buffer_prototype()

    async def get_one(key: str) -> tuple[str, Buffer | None]:
        async with at_once:
            return key.removeprefix(prefix), await source.get(key, prototype)

    found = await asyncio.gather(*[get_one(key) async for key in source.list_prefix(prefix)])
    return {key: value for key, value in found if value is not None}


def root_metadata(place: Place) -> dict[str, Any] | None:
    """Metadata of the group at a place, None where there is none that can be read."""
    if not is_address(place) and not Path(place).is_dir():
        return None
    content = wait_for(stored_bytes(store_at(place, read_only=True), ROOT))
    if content is None:
        return None
    try:
        metadata = json.loads(content)
    except ValueError:
        return None
    return metadata if isinstance(metadata, dict) else None


def is_empty(place: Place) -> bool:
    """Whether nothing is at a place."""
    if is_address(place):
        return wait_for(store_at(place, read_only=True).is_empty(""))
    path = Path(place)
    return not path.exists() or (path.is_dir() and not any(path.iterdir()))


def remove(place: Place) -> None:
    """Remove all that is at a place."""
    if is_address(place):
        wait_for(store_at(place).clear())
    else:
        shutil.rmtree(Path(place))


def remove_group(place: Place, group: str) -> None:
    """Remove a group of what is at a place; it need not be there."""
    if is_address(place):
        wait_for(store_at(place).delete_dir(group))
    elif Path(place, group).exists():
        shutil.rmtree(Path(place, group))


def is_archive(place: Place) -> bool:
    """Whether a place holds an archive of this program, whatever its version."""
    metadata = root_metadata(place)
    attributes = metadata.get("attributes") if metadata is not None else None
    return isinstance(attributes, dict) and attributes.get("schema") == SCHEMA_NAME


def remove_partial_files(place: Place) -> None:
    """Remove the files that zarr had not written to the end when its writer was killed, and nothing else."""
    if is_address(place):
        return
    for file in Path(place).rglob("*.partial"):
        if _PARTIAL.fullmatch(file.name) and file.is_file() and (file.parent / "zarr.json").exists():
            file.unlink(missing_ok=True)
