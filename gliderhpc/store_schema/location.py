"""Location of an archive, a folder or a prefix of an object store, and the stores that read and write it.

All access to an archive is through zarr stores; readers and writers are independent of the kind of location.
Importing this module registers the codecs of `gliderhpc.store_schema.codecs`.
"""

from __future__ import annotations

import asyncio
import errno
import json
import os
import re
import secrets
import shutil
import stat
import sys
from collections.abc import Coroutine, Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal, TypeVar

import zarr
from zarr.abc.store import ByteRequest, Store
from zarr.core.buffer import Buffer, BufferPrototype, default_buffer_prototype
from zarr.core.sync import sync
from zarr.storage import LocalStore, MemoryStore, ObjectStore, StorePath

from gliderhpc.errors import InputError, first_line
from gliderhpc.output_files import raise_full_disk
from gliderhpc.store_schema.codecs import MAX_INLINE_BYTES
from gliderhpc.store_schema.schema import COMMITS, PROFILE, SCHEMA_NAME

Location = str | Path
"""A folder, or an address such as ``s3://bucket/mission.zarr``."""

Value = TypeVar("Value")

ROOT = "zarr.json"
"""Key of an archive's own metadata."""

CONSOLIDATED = "consolidated_metadata"
"""Entry of the root's metadata with that of all groups and variables."""

_AT_ONCE = 32
"""Number of concurrent requests to a store."""

_SCHEME = "://"
_PARTIAL = re.compile(r".+\.[0-9a-f]{32}\.partial")
"""Pattern of the names that zarr gives to files while writing them."""


_IN_MEMORY: dict[str, MemoryStore] = {}
"""Archives in this process's memory, by address."""


@contextmanager
def location_in_memory() -> Iterator[Location]:
    """Yield the address of an archive in this process's memory, which is removed when the block ends."""
    address = f"memory://{secrets.token_hex(8)}"
    _IN_MEMORY[address] = MemoryStore()
    try:
        yield address
    finally:
        del _IN_MEMORY[address]


def is_address(location: Location) -> bool:
    """Return whether a location is an address in an object store."""
    return _SCHEME in str(location)


def absolute(location: Location) -> str:
    """Return the absolute name of a location."""
    return str(location) if is_address(location) else str(Path(location).resolve())


def with_suffix(location: Location, suffix: str) -> str:
    """Return the name of a location with a suffix appended to its last part."""
    return str(location).rstrip("/") + suffix


def store_at(location: Location, *, read_only: bool = False) -> Store:
    """Open the store of a location, which need not exist yet.

    Raises
    ------
    InputError
        The address is of an unknown kind, or the extra that reads it is not installed.
    """
    if location in _IN_MEMORY:
        return _IN_MEMORY[str(location)].with_read_only(read_only)
    if is_address(location):
        return object_store_at(str(location), read_only=read_only)
    return FolderStore(Path(location), read_only=read_only)


class FolderStore(LocalStore):
    """Archive in a folder; a pipe in place of a chunk, which would block its reader, is refused."""

    async def get(
        self, key: str, prototype: BufferPrototype | None = None, byte_range: ByteRequest | None = None
    ) -> Buffer | None:
        """Return the value stored under a key, None if there is none.

        Raises
        ------
        InputError
            A pipe, socket or device is there.
        """
        if self._size(key) > MAX_INLINE_BYTES or byte_range is not None or not self._is_open:
            return await super().get(key, prototype, byte_range)
        # Most chunks take less time to read than to hand to another thread.
        content = self.content_or_none(key)
        return None if content is None else (prototype or default_buffer_prototype()).buffer.from_bytes(content)

    def get_sync(self, key: str, **options: Any) -> Buffer | None:
        """Return the value stored under a key, in versions of zarr with synchronous access; errors as in `get`."""
        self._size(key)
        return super().get_sync(key, **options)

    async def set(self, key: str, value: Buffer) -> None:
        """Store a value; a file is complete as soon as it has its name.

        Raises
        ------
        OSError
            The file system refuses the operation; if the disk is full, it has the archive's name.
        """
        try:
            await self._write_file(key, value)
        except OSError as error:
            raise_full_disk(error, self.root)
            raise

    async def _write_file(self, key: str, value: Buffer) -> None:
        if len(value) > MAX_INLINE_BYTES or not self._is_open:
            return await super().set(key, value)
        self._check_writable()
        path = self.root / key
        partial = path.with_suffix(f".{secrets.token_hex(16)}.partial")
        try:
            try:
                partial.write_bytes(value.to_bytes())
            except FileNotFoundError:
                path.parent.mkdir(parents=True, exist_ok=True)
                partial.write_bytes(value.to_bytes())
            partial.replace(path)
        except BaseException:
            partial.unlink(missing_ok=True)
            raise

    async def delete(self, key: str) -> None:
        """Delete a value, or a folder of values, if it exists."""
        self._check_writable()
        path = self.root / key
        try:
            path.unlink(missing_ok=True)
        except (IsADirectoryError, PermissionError):
            await super().delete(key)

    def content(self, key: str) -> bytes:
        """Read a file in this thread; errors as in `get`, and FileNotFoundError where there is none."""
        self._size(key)
        with open(self._name(key), "rb") as file:  # noqa: PTH123 - as in `_size`
            return file.read()

    def content_or_none(self, key: str) -> bytes | None:
        """Read a file in this thread, None where there is none; errors as in `get`."""
        try:
            return self.content(key)
        except (FileNotFoundError, IsADirectoryError, NotADirectoryError):
            return None

    def _size(self, key: str) -> int:
        """Return the size of a file, 0 where there is none, and refuse a pipe."""
        try:
            status = os.stat(self._name(key))  # noqa: PTH116 - a path takes several times as long
        except OSError:
            return 0  # The store itself reports the error, or that there is no file.
        if not (stat.S_ISREG(status.st_mode) or stat.S_ISDIR(status.st_mode)):
            raise InputError(f"{self.root}: {key} is a pipe, socket or device, not a file; remove it")
        return status.st_size

    def _name(self, key: str) -> str:
        return f"{self.root}{os.sep}{key}"


def group_at(location: Location, path: str = "", *, writable: bool = False) -> zarr.Group:
    """Open an archive, or one of its groups by its path, without the consolidated metadata, which may be damaged.

    Raises
    ------
    InputError
        Python runs without assertions, on which zarr depends for reading.
    """
    check_assertions()
    store = store_at(location, read_only=not writable)
    own = None if path else own_metadata(root_content(store))
    if own is not None and own.get("node_type") == "group":
        return zarr.Group(zarr.AsyncGroup.from_dict(StorePath(store), own))
    mode: Literal["r", "r+"] = "r+" if writable else "r"
    return zarr.open_group(store, mode=mode, path=path, use_consolidated=False)


def check_assertions() -> None:
    """Refuse a Python without assertions, on which zarr depends for reading.

    Long jobs call this before they begin, since the archive itself is first read when its profiles are done.

    Raises
    ------
    InputError
        Python was started with ``-O`` or with ``PYTHONOPTIMIZE``.
    """
    if sys.flags.optimize:
        raise InputError(
            "zarr cannot read archives in a Python without assertions; start Python without -O, or unset PYTHONOPTIMIZE"
        )


def root_content(store: Store) -> bytes | None:
    """Read the root's metadata from a store, None where there is none."""
    return store.content_or_none(ROOT) if isinstance(store, FolderStore) else wait_for(stored_bytes(store, ROOT))


def own_metadata(content: bytes | None) -> dict[str, Any] | None:
    """Parse the root's metadata without that of its members, None where there is none or it is damaged."""
    text = "" if content is None else _own_text(content)
    return json.loads(text) if text else None


@lru_cache(maxsize=4)
def _own_text(content: bytes) -> str:
    """Return the root's own metadata, which parses in a hundredth of the time of the whole; empty if damaged."""
    try:
        metadata = parsed_root(content)
    except ValueError:
        return ""
    if not isinstance(metadata, dict):
        return ""
    return json.dumps({key: value for key, value in metadata.items() if key != CONSOLIDATED})


@lru_cache(maxsize=1)
def parsed_root(content: bytes) -> Any:
    """Parse the root's whole metadata; the result is cached and must not be changed.

    Raises
    ------
    ValueError
        It is damaged.
    """
    return json.loads(content)


def wait_for(answer: Coroutine[Any, Any, Value]) -> Value:
    """Run a store's coroutine to completion, in any thread."""
    return sync(answer)


def wait_for_all(answers: Iterable[Coroutine[Any, Any, Value]]) -> list[Value]:
    """Run coroutines concurrently; once all have ended, return their results or raise the first error."""

    async def gathered() -> list[Value | BaseException]:
        return await asyncio.gather(*answers, return_exceptions=True)

    results: list[Value] = []
    for result in wait_for(gathered()):
        if isinstance(result, BaseException):
            raise result
        results.append(result)
    return results


async def stored_bytes(store: Store, key: str) -> bytes | None:
    """Return the bytes stored under a key, None where there are none."""
    value = await store.get(key, default_buffer_prototype())
    return None if value is None else value.to_bytes()


def write_group(content: Mapping[str, Buffer], location: Location, group: str = "") -> None:
    """Write the content of a store in memory to a location, or to one of its groups, with the root's metadata last."""
    prefix = f"{group}/" if group else ""
    last = [key for key in content if key == ROOT]
    keys = [key for key in content if key != ROOT]
    if is_address(location):
        target = store_at(location)
        for at_once in (keys, last):
            wait_for(_set_many(target, {prefix + key: content[key] for key in at_once}))
        return
    # In this thread: another thread would go on writing after Ctrl-C.
    for key in (*keys, *last):
        path = Path(location, group, key)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content[key].to_bytes())
        except OSError as error:
            raise_full_disk(error, location)
            raise


async def _set_many(target: Store, content: Mapping[str, Buffer]) -> None:
    at_once = asyncio.Semaphore(_AT_ONCE)

    async def set_one(key: str) -> None:
        async with at_once:
            await target.set(key, content[key])

    await asyncio.gather(*map(set_one, content))


def read_group(location: Location, group: str) -> dict[str, Buffer]:
    """Read the content of a group by key, in the form for `write_group`; empty if the group does not exist."""
    if is_address(location):
        return wait_for(_get_many(store_at(location, read_only=True), f"{group}/"))
    folder, as_buffer = Path(location, group), default_buffer_prototype().buffer.from_bytes
    files = [path for path in folder.rglob("*") if path.is_file()]
    return {path.relative_to(folder).as_posix(): as_buffer(path.read_bytes()) for path in files}


async def _get_many(source: Store, prefix: str) -> dict[str, Buffer]:
    at_once, prototype = asyncio.Semaphore(_AT_ONCE), default_buffer_prototype()

    async def get_one(key: str) -> tuple[str, Buffer | None]:
        async with at_once:
            return key.removeprefix(prefix), await source.get(key, prototype)

    found = await asyncio.gather(*[get_one(key) async for key in source.list_prefix(prefix)])
    return {key: value for key, value in found if value is not None}


def root_metadata(location: Location) -> dict[str, Any] | None:
    """Read the metadata of the group at a location without its members, None where there is none or it is damaged."""
    if not is_address(location) and not Path(location).is_dir():
        return None
    return own_metadata(root_content(store_at(location, read_only=True)))


def folder_identity(location: Location) -> tuple[int, int] | None:
    """Return device and inode of a folder: those of another archive renamed into its place differ.

    None in an object store, where nothing is renamed, and where there is no folder.
    """
    if is_address(location):
        return None
    try:
        status = Path(location).stat()
    except OSError:
        return None
    return status.st_dev, status.st_ino


def is_empty(location: Location) -> bool:
    """Return whether a location is empty or does not exist."""
    if is_address(location):
        return wait_for(store_at(location, read_only=True).is_empty(""))
    path = Path(location)
    return not path.exists() or (path.is_dir() and not any(path.iterdir()))


def remove(location: Location) -> None:
    """Remove everything at a location."""
    if is_address(location):
        wait_for(store_at(location).clear())
    else:
        shutil.rmtree(Path(location))


def remove_group(location: Location, group: str) -> None:
    """Remove a group at a location, if it exists."""
    if is_address(location):
        wait_for(store_at(location).delete_dir(group))
    elif Path(location, group).exists():
        shutil.rmtree(Path(location, group))


def is_archive(location: Location) -> bool:
    """Return whether a location holds an archive of this program, of any version; a copy by xarray is none."""
    return _has_results(location) and not _is_copy(location)


_XARRAY_SEPARATOR = "/"
"""Separator in the names of chunks that xarray writes; archives of all versions have another one."""


def _has_results(location: Location) -> bool:
    """Return whether the root has the attributes of an archive."""
    metadata = root_metadata(location)
    attributes = metadata.get("attributes") if metadata is not None else None
    return isinstance(attributes, dict) and attributes.get("schema") == SCHEMA_NAME


def _is_copy(location: Location) -> bool:
    """Return whether groups of an archive were written by xarray: without commits, or with its names of the chunks."""
    content = root_content(store_at(location, read_only=True))
    consolidated = parsed_root(content).get(CONSOLIDATED) if content is not None else None
    members = consolidated.get("metadata") if isinstance(consolidated, dict) else None
    if not isinstance(members, dict) or not isinstance(members.get(PROFILE), dict):
        return False
    keys = members[PROFILE].get("chunk_key_encoding", {}).get("configuration", {})
    return COMMITS not in members or keys.get("separator") == _XARRAY_SEPARATOR


def describe_other(location: Location) -> str:
    """Describe a location that holds something other than an archive, with the remedy."""
    if not is_address(location) and Path(location).is_file():
        wanted = "give the folder that `gliderhpc run-mission` makes from records"
        return f"{location}: a file, not an archive of gliderhpc; {wanted}"
    if _has_results(location):
        return (
            f"{location}: {kind_of_other(location)}: open it with xarray.open_datatree, and give the folder that "
            "`gliderhpc run-mission` wrote"
        )
    return f"{location}: {kind_of_other(location)}; give the folder that `gliderhpc run-mission` wrote"


def kind_of_other(location: Location) -> str:
    """Return what a location holds that is not an archive."""
    if _has_results(location):
        return "a copy of results, such as of one dive, that xarray wrote (`to_zarr`), not an archive"
    return "not an archive of gliderhpc"


def remove_partial_files(location: Location) -> None:
    """Remove the incomplete files that zarr left when its writer was killed."""
    if is_address(location):
        return
    for folder, names in _folders(Path(location)):
        # Most names are those of chunks; only a few become paths.
        found = [folder / name for name in names if name.endswith(".partial") and _PARTIAL.fullmatch(name)]
        for file in found if ROOT in names else ():
            if file.is_file():
                file.unlink(missing_ok=True)


def _folders(top: Path) -> Iterator[tuple[Path, list[str]]]:
    """Yield the folders of an archive, each with the names in it; names with a dot, as of chunks, are those of files.

    An archive of hundreds of profiles has tens of thousands of chunks, none of which is looked at by itself.
    """
    try:
        names = [] if top.is_symlink() else os.listdir(top)  # noqa: PTH208 - names, not paths
    except (FileNotFoundError, NotADirectoryError, PermissionError):
        return
    yield top, names
    for name in names:
        if "." not in name:
            yield from _folders(top / name)


def object_store_at(address: str, *, read_only: bool = False) -> Store:
    """Open the store of an address such as ``s3://bucket/mission.zarr``.

    Keys, region and endpoint come from the usual environment variables (``AWS_ACCESS_KEY_ID``,
    ``AWS_SECRET_ACCESS_KEY``, ``AWS_REGION``, ``AWS_ENDPOINT_URL``, ``AWS_ALLOW_HTTP``).

    Raises
    ------
    InputError
        obstore is not installed, or does not support the address.
    """
    return ObjectStore(bucket_at(address), read_only=read_only)


def bucket_at(address: str) -> Any:
    """Open obstore's own store below an address.

    Raises
    ------
    InputError
        obstore is not installed, or does not support the address.
    """
    try:
        from obstore.exceptions import BaseError
        from obstore.store import from_url
    except ImportError:
        raise InputError(
            f"{address}: object stores need obstore; install it with `pip install 'gliderhpc[cloud]'`"
        ) from None
    try:
        return from_url(address)
    except (BaseError, ValueError) as error:
        raise InputError(f"{address}: cannot be opened ({str(error).splitlines()[0]})") from None


@contextmanager
def network_errors() -> Iterator[None]:
    """Convert an error of obstore, which is none of the system, to an `OSError`; not that an object exists already."""
    from obstore.exceptions import AlreadyExistsError, BaseError

    try:
        yield
    except AlreadyExistsError:
        raise
    except BaseError as error:
        raise OSError(errno.EIO, first_line(error)) from error
