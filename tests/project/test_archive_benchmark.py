"""Programs that measure the archive, on a small archive."""

import shutil
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.archive import LAYOUTS, ask, measure_layouts, rewrite, rounding, write_share
from benchmarks.archive_queries import QUERIES
from benchmarks.faults import _damage
from gliderhpc.store_schema import check_archive, damaged_chunks
from gliderhpc.store_schema.compare import compare_archives

pytestmark = pytest.mark.compiled


@pytest.mark.long
def test_an_archive_written_row_by_row_is_the_same_archive(brief_store, tmp_path):
    found = rewrite(brief_store, tmp_path / "again.zarr")
    assert found["profiles"] == 3
    assert check_archive(tmp_path / "again.zarr") == []
    different = compare_archives(brief_store, tmp_path / "again.zarr").variables
    assert {difference.variable.partition("/")[0] for difference in different} <= {"smoothed"}
    seconds, part = write_share(brief_store, tmp_path)
    assert 0.0 < part < 1.0
    assert seconds > 0.0


@pytest.mark.long
@pytest.mark.parametrize("query", QUERIES, ids=[query.title for query in QUERIES])
def test_every_query_runs(brief_store, query):
    seconds, worked, memory, shown = ask(replace(query, code=query.code.replace("68", "2")), brief_store)
    assert shown
    assert seconds > 0.0
    assert worked > 0.0
    assert memory < 500.0


@pytest.mark.long
def test_every_layout_holds_the_same(brief_store, tmp_path):
    found = measure_layouts(brief_store, tmp_path, 2)
    assert [one["layout"] for one in found] == [layout.name for layout in LAYOUTS]
    assert all(one["kib"] > 0.0 for one in found)


@pytest.mark.long
def test_single_precision_lies_below_the_noise(brief_store):
    for name, largest, deviation in rounding(brief_store):
        assert largest < 0.02 * deviation, name


@pytest.mark.long
@pytest.mark.damages_archive
@pytest.mark.parametrize("seed", range(6))
def test_the_deep_check_finds_the_damage_of_the_fault_trials(brief_store, tmp_path, seed):
    store = shutil.copytree(brief_store, tmp_path / "damaged.zarr")
    random = np.random.default_rng(seed)
    chunks = sorted(path for path in store.rglob("c.*") if path.is_file() and "sample" not in path.parts)
    chunk = chunks[random.integers(len(chunks))]
    _damage(chunk, random)
    # As `check --deep` does; it names the variable, of a coordinate that of the group whose labels are wrong.
    lines = check_archive(store) or damaged_chunks(store)
    assert any(chunk.parent.name in line for line in lines), lines
