"""Consolidated metadata: identical to zarr's own, without indentation."""

import json
import os

import numpy as np
import pytest
import zarr
from zarr.storage import MemoryStore

from gliderhpc.errors import InputError
from gliderhpc.store_schema import consolidate, create_archive, create_study, finish_study
from gliderhpc.store_schema.consolidation import consolidate_store, stored_metadata
from gliderhpc.store_schema.location import store_at

pytestmark = pytest.mark.filterwarnings("ignore:Consolidated metadata", "ignore:Object at")
SIZES = {"sample": 5, "record": 4, "window": 3, "segment": 2}


@pytest.fixture
def archive(tmp_path):
    path = tmp_path / "mission.zarr"
    create_archive(path, [3, 4], SIZES, {"step": 0.1, "missing": None})
    create_study(path, "events", sizes={"event": 2})
    finish_study(path, "events", {})
    return path


def as_zarr_has_it(path):
    zarr.consolidate_metadata(path, zarr_format=3)
    return json.loads((path / "zarr.json").read_text())


def test_consolidated_metadata_equals_that_written_by_zarr(archive):
    ours = json.loads((archive / "zarr.json").read_text())
    theirs = as_zarr_has_it(archive)
    assert ours == theirs
    assert list(ours["consolidated_metadata"]["metadata"]) == list(theirs["consolidated_metadata"]["metadata"])


@pytest.mark.damages_archive
def test_groups_of_others_and_groups_within_groups_are_in_it(archive):
    root = zarr.open_group(archive, mode="r+", use_consolidated=False)
    inner = root.create_group("Notes").create_group("inner", attributes={"kind": "group"})
    inner.create_array("depth", data=np.arange(3.0), attributes={"of": "group"})
    (archive / "a folder of a user's").mkdir()
    consolidate(archive)
    ours = json.loads((archive / "zarr.json").read_text())
    assert ours == as_zarr_has_it(archive)
    assert "Notes/inner/depth" in ours["consolidated_metadata"]["metadata"]
    assert zarr.open_group(archive, mode="r")["Notes/inner/depth"][1] == 1.0


def test_a_store_in_memory_is_consolidated_alike(archive):
    content = {key: value for key, value in _everything(archive).items() if key.endswith("zarr.json")}
    memory = MemoryStore({key: zarr.core.buffer.cpu.Buffer.from_bytes(value) for key, value in content.items()})
    assert stored_metadata(memory) == stored_metadata(store_at(archive))
    root = json.loads(content["zarr.json"])
    del root["consolidated_metadata"]
    memory._store_dict["zarr.json"] = zarr.core.buffer.cpu.Buffer.from_bytes(json.dumps(root).encode())
    consolidate_store(memory)
    assert memory._store_dict["zarr.json"].to_bytes() == content["zarr.json"]


def _everything(folder):
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.damages_archive
def test_damaged_metadata_is_not_copied(archive):
    before = (archive / "zarr.json").read_bytes()
    for damage in ("{", "[]", '{"node_type": "chunk"}'):
        (archive / "series" / "depth" / "zarr.json").write_text(damage)
        with pytest.raises(ValueError, match=r"series/depth|Expecting"):
            consolidate(archive)
    assert (archive / "zarr.json").read_bytes() == before


@pytest.mark.damages_archive
def test_a_pipe_in_place_of_metadata_keeps_nobody_waiting(archive):
    (archive / "series" / "depth" / "zarr.json").unlink()
    os.mkfifo(archive / "series" / "depth" / "zarr.json")
    with pytest.raises(InputError, match=r"series/depth/zarr.json is a pipe"):
        consolidate(archive)
