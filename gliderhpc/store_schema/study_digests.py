"""Digests of what a finished study left, for `check --deep`."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import zarr

from gliderhpc.store_schema.commits import (
    Damage,
    array_at,
    arrays_at,
    compared,
    row_arrays,
    row_chunks,
    row_names,
    stored_digests,
)
from gliderhpc.store_schema.place import Place, store_at
from gliderhpc.store_schema.recording import Digests
from gliderhpc.store_schema.schema import PROFILE, Group
from gliderhpc.store_schema.studies import DIGESTS, MANIFEST, study_called


def write_manifests(place: Place, name: str, written: Mapping[int, Digests]) -> None:
    """Write the manifest of every profile's rows of a study whose group was made anew.

    Parameters
    ----------
    place : str or Path
        The archive.
    name : str
        The study's group.
    written : mapping of int to mapping of str to str or None
        By position along the profile dimension, the digests of the chunks that were written; there are no others.
    """

    def digests(index: int, chunks: Mapping[str, str]) -> Digests:
        return {key: written.get(index, {}).get(key) for key in chunks}

    _put_manifests(zarr.open_group(store_at(place), mode="r+", use_consolidated=False), study_called(name), digests)


def complete_manifests(place: Place, group: Group) -> None:
    """Write the manifests of a study's rows from what is stored, where whoever wrote the rows left none."""
    store = store_at(place)
    root = zarr.open_group(store, mode="r+", use_consolidated=False)
    if row_names([group]) and not all(np.asarray(array_at(root, f"{group.name}/{MANIFEST}")[:])):
        _put_manifests(root, group, lambda _, chunks: stored_digests(store, chunks))


def _put_manifests(root: zarr.Group, group: Group, digests: Callable[[int, Mapping[str, str]], Digests]) -> None:
    if row_names([group]):
        arrays = row_arrays(root, [group])
        manifests = array_at(root, f"{group.name}/{MANIFEST}")
        texts = [json.dumps(digests(i, row_chunks(arrays, i)), sort_keys=True) for i in range(manifests.shape[0])]
        manifests[:] = np.array(texts, dtype=np.dtypes.StringDType())


def table_digests(place: Place, group: Group) -> Digests:
    """Digests of the chunks of a study's tables, by key."""
    store = store_at(place, read_only=True)
    root = zarr.open_group(store, mode="r", use_consolidated=False)
    return stored_digests(store, _table_chunks(root, group))


def table_damages(place: Place, group: Group) -> list[Damage]:
    """Chunks of a study's tables that are not as they were when it was finished; their profile is -1."""
    store = store_at(place, read_only=True)
    node = zarr.open_group(store, mode="r", path=group.name, use_consolidated=False)
    attributes: dict[str, Any] = dict(node.attrs)
    wanted = dict(attributes.get(DIGESTS, {}))
    variables = {key: key.rpartition("/")[0] for key in wanted}
    return compared(-1, variables, wanted, stored_digests(store, wanted))


def _table_chunks(root: zarr.Group, group: Group) -> dict[str, str]:
    """Variable by key of the chunks that are written whole; the profiles' numbers are held against the root's."""
    names = [f"{group.name}/{v.name}" for v in group.variables if not v.is_row and v.name != PROFILE]
    arrays = arrays_at(root, names)
    return {f"{name}/{array.metadata.encode_chunk_key((0,) * array.ndim)}": name for name, array in arrays.items()}
