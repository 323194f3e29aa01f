"""Consolidated metadata: a copy in the root of the metadata of every group and variable, for fast opening.

Zarr's own function gives the same result, but creates an object for every array, which takes ten times as long.
"""

from __future__ import annotations

import asyncio
import json
import os
from functools import lru_cache
from typing import Any

from zarr.abc.store import Store
from zarr.core.buffer import default_buffer_prototype

from gliderhpc.store_schema.location import CONSOLIDATED, ROOT, FolderStore, Location, store_at, stored_bytes, wait_for

Metadata = dict[str, Any]
"""Content of one ``zarr.json``."""


def consolidate(location: Location) -> None:
    """Consolidate all metadata of an archive at its root; this is necessary after every change of metadata.

    Raises
    ------
    ValueError
        The metadata of a group or variable is damaged.
    """
    consolidate_store(store_at(location))


def consolidate_store(store: Store) -> None:
    """Consolidate all metadata in a store; errors as in `consolidate`."""
    metadata = stored_metadata(store)
    root = without_members(metadata.pop(""))
    paths = sorted(metadata, key=lambda path: (path.count("/"), path.casefold()))
    members = {path: without_members(metadata[path]) for path in paths}
    for member in members.values():
        if member["node_type"] == "group":
            member[CONSOLIDATED] = _inline({})
    # Without indentation, which would take up most of the time of writing and reading.
    content = json.dumps({**root, CONSOLIDATED: _inline(members)}, separators=(",", ":"), allow_nan=False)
    wait_for(store.set(ROOT, default_buffer_prototype().buffer.from_bytes(content.encode())))


def stored_metadata(store: Store) -> dict[str, Metadata]:
    """Read the metadata of every group and variable by its path; the path of the root is "".

    Raises
    ------
    ValueError
        Some of it is damaged.
    """
    content = _in_folder(store) if isinstance(store, FolderStore) else wait_for(_in_store(store))
    root = json.loads(content.pop(""))
    return {"": _checked("", root), **{path: _checked(path, _parsed(text)) for path, text in content.items()}}


@lru_cache(maxsize=2048)
def _parsed(text: bytes) -> Any:
    # A study changes a few of the several hundred texts, and consolidates three times.
    return json.loads(text)


def _checked(path: str, metadata: Any) -> Metadata:
    if not isinstance(metadata, dict) or metadata.get("node_type") not in ("group", "array"):
        raise ValueError(f"{path}/{ROOT}: neither a group's metadata nor an array's")
    return metadata


def _inline(members: dict[str, Metadata]) -> Metadata:
    return {"kind": "inline", "must_understand": False, "metadata": members}


def without_members(metadata: Metadata) -> Metadata:
    """Return metadata without the consolidated metadata of its members."""
    return {key: value for key, value in metadata.items() if key != CONSOLIDATED}


def _in_folder(store: FolderStore) -> dict[str, bytes]:
    """Read a folder in this thread; zarr would hand every file to another thread."""
    found, groups = {"": store.content(ROOT)}, [""]
    while groups:
        group = groups.pop()
        with os.scandir(store.root / group) as entries:
            paths = [f"{group}/{entry.name}".lstrip("/") for entry in entries if entry.is_dir()]
        for path in paths:
            try:
                found[path] = store.content(f"{path}/{ROOT}")
            except (FileNotFoundError, NotADirectoryError):
                continue
            if _is_group(found[path]):
                groups.append(path)
    return found


async def _in_store(store: Store) -> dict[str, bytes]:
    root = await stored_bytes(store, ROOT)
    if root is None:
        raise FileNotFoundError(f"{store}: no {ROOT}")
    found, groups = {"": root}, [""]
    while groups:
        group = groups.pop()
        names = [name async for name in store.list_dir(group)]
        paths = [f"{group}/{name}".strip("/") for name in names if not name.endswith(ROOT)]
        contents = await asyncio.gather(*(stored_bytes(store, f"{path}/{ROOT}") for path in paths))
        for path, content in zip(paths, contents, strict=True):
            if content is not None:
                found[path] = content
                if _is_group(content):
                    groups.append(path)
    return found


def _is_group(content: bytes) -> bool:
    return b'"group"' in content
