"""Commit protocol: completeness, verification and repair."""

import json
import os
import shutil
import time
from contextlib import contextmanager

import numpy as np
import pytest
import xarray as xr
import zarr
from support.missions import WHOLE, archive_bytes, program

from gliderhpc.archive.mission import open_mission
from gliderhpc.errors import InputError, RunStoppedError
from gliderhpc.mission.executors import SerialExecutor
from gliderhpc.mission.lock import SUFFIX, FileLock, check_held, locked
from gliderhpc.mission.resume import check_profiles
from gliderhpc.store_schema import (
    ArchiveRows,
    committed_rows,
    consolidate,
    damaged_chunks,
    read_commits,
    read_profiles,
    set_attributes,
)

pytestmark = pytest.mark.compiled


@pytest.fixture
def own_copy(swift_store, tmp_path):
    """An archive of the swift mission, to be damaged."""
    return shutil.copytree(swift_store, tmp_path / "copy.zarr")


def resume(swift, store, *more):
    return program("run-mission", swift, *WHOLE, "--store", store, "--resume", *more)


# Manifests and markers


def test_the_manifest_names_every_chunk_of_the_profile(swift_store):
    for index, commit in read_commits(swift_store).items():
        there = {
            path.relative_to(swift_store).as_posix() for path in swift_store.glob(f"*/*/c.{index}.*")
        }  # fmt: skip
        assert there == {key for key, digest in commit.manifest.items() if digest is not None}
        assert {key for key, digest in commit.manifest.items() if digest is None}
        assert set(commit.inputs) == {"software", "settings", "platform", "record", "fixes"}


def test_chunks_come_before_manifest_and_marker(swift_store):
    """The file system's own times: nothing of a profile is younger than its marker."""
    for index in range(3):
        marker = (swift_store / "commits" / "marker" / f"c.{index}").stat().st_mtime_ns
        manifest = (swift_store / "commits" / "manifest" / f"c.{index}").stat().st_mtime_ns
        chunks = [path.stat().st_mtime_ns for path in swift_store.glob(f"*/*/c.{index}.0")]
        assert max(chunks) <= manifest <= marker


def test_a_profile_written_again_leaves_nothing_of_the_first(own_copy):
    """Chunks of the first time that the second does not write are removed, and the manifest records it."""
    rows, before = ArchiveRows(own_copy), read_commits(own_copy)[1]
    rows.begin(1)
    rows.write(1, "series", {"B_cu": np.ones(10)})
    rows.commit(1, {"status": "done"}, before.inputs, "2026-01-01T00:00:00Z")
    assert [path.name for path in own_copy.glob("*/*/c.1.0")] == ["c.1.0"]
    after = read_commits(own_copy)[1]
    assert [key for key, digest in after.manifest.items() if digest is not None] == ["series/B_cu/c.1.0"]


def test_a_profile_that_was_begun_is_not_committed(own_copy):
    ArchiveRows(own_copy).begin(2)
    assert set(read_commits(own_copy)) == {0, 1}


# Damage is found and mended


def truncate(path):
    path.write_bytes(path.read_bytes()[:-5])


def empty(path):
    path.write_bytes(b"")


def flip(path):
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 0x10
    path.write_bytes(content)


def delete(path):
    path.unlink()


SPOT = {
    "series/B_cr/c.1.0": "profile 2, series/B_cr: the chunk is",
    "smoothed/depth_std/c.0.0": "profile 1, smoothed/depth_std: the chunk is",
    "windows/outcome/c.2.0": "profile 3, windows/outcome: the chunk is",
    "commits/marker/c.1": "profile 2, commits",
    "commits/manifest/c.0": "profile 1, commits",
    "dac_north/c.0": ", dac_north: ",
    "smoothed/passes/c.0": ", smoothed/passes: ",
    "status/c.0": "status: ",
    "profile/c.0": "/profile: ",
    "series/sample/c.0": "series/sample: ",
}


@pytest.mark.long
@pytest.mark.parametrize("damage", [truncate, empty, flip, delete])
def test_check_names_damaged_chunks_and_resume_restores_them(swift, swift_store, own_copy, damage):
    """Each damaged chunk is named; all together are restored, byte for byte as written."""
    for chunk, fragment in SPOT.items():
        damage(own_copy / chunk)
        answer = program("check", own_copy, "--deep")
        assert answer.status == 1
        assert fragment in answer.out, chunk
        shutil.copy(swift_store / chunk, own_copy / chunk)
    assert program("check", own_copy, "--deep").status == 0
    for chunk in SPOT:
        damage(own_copy / chunk)
    answer = resume(swift, own_copy)
    assert answer.status == 0, answer.err
    assert archive_bytes(own_copy) == archive_bytes(swift_store)
    assert damaged_chunks(own_copy) == []


@pytest.mark.long
def test_any_flipped_byte_of_a_chunk_is_found(own_copy):
    """Each byte of a table's chunk, which no manifest holds: its checksum does."""
    path = own_copy / "dac_north" / "c.0"
    whole = path.read_bytes()
    for place in range(len(whole)):
        content = bytearray(whole)
        content[place] ^= 1 << (place % 8)
        path.write_bytes(content)
        assert any("dac_north" in line for line in damaged_chunks(own_copy)), place


@pytest.mark.damages_archive
@pytest.mark.parametrize("deep", [False, True])
def test_check_of_an_archive_of_an_earlier_minor_version_looks_at_the_chunks_of_its_profiles(own_copy, deep):
    set_attributes(own_copy, {"schema_version": "1.8"})
    shutil.rmtree(own_copy / "dac_north_filter")
    consolidate(own_copy)
    options = ["--deep"] if deep else []
    answer = program("check", own_copy, *options)
    assert (answer.status, answer.out.count("\n")) == (0, 1)
    assert "the archive has schema version 1.8, and this program's is " in answer.out
    assert "it can be opened, studied and reported, but not resumed or appended to; no chunk of its pro" in answer.out
    assert "3 of 3 profiles committed" in answer.out
    chunk = own_copy / "series" / "B_cu" / "c.1.0"
    if deep:
        flip(chunk)
    else:
        chunk.unlink()
    answer = program("check", own_copy, *options)
    assert answer.status == 1
    fault = "damaged" if deep else "missing"
    assert f"profile 2, series/B_cu: the chunk is {fault}; resume it with the version of gliderhpc that" in answer.out


def test_a_chunk_that_should_not_be_there_is_found(own_copy):
    chunk = own_copy / "observed" / "water_density" / "c.1.0"
    assert not chunk.exists()
    shutil.copy(own_copy / "observed" / "depth" / "c.1.0", chunk)
    assert damaged_chunks(own_copy) == [
        "profile 2, observed/water_density: there should be no chunk; run-mission --resume repairs it"
    ]


def test_resume_says_how_many_for_which_reason(swift, own_copy):
    ArchiveRows(own_copy).begin(0)
    flip(own_copy / "state" / "u" / "c.1.0")
    answer = resume(swift, own_copy)
    assert "1 profile is valid; to be computed: 1 missing, 1 damaged" in answer.err
    assert "profile 2, state/u: the chunk is damaged; it will be recomputed" in answer.err
    assert "3 of 3 profiles done (1 of them in an earlier run)" in answer.out


def test_only_the_last_manifests_are_read_where_only_the_last_profiles_are_checked(own_copy):
    """A watch checks the last dives; the time to read all manifests would grow with the mission."""
    inputs = {index: commit.inputs for index, commit in read_commits(own_copy).items()}
    numbers = read_profiles(own_copy)
    (own_copy / "commits" / "manifest" / "c.0").write_bytes(b"damaged")
    assert check_profiles(own_copy, numbers, inputs).outstanding == {0: "damaged"}
    last = check_profiles(own_copy, numbers, inputs, check_last=1)
    assert (last.outstanding, set(last.valid)) == ({}, set(inputs))
    assert last.valid[0] == committed_rows(own_copy)[0]
    changed = inputs | {0: inputs[0] | {"record": "another"}}
    assert check_profiles(own_copy, numbers, changed, check_last=1).outstanding == {0: "damaged"}


def test_partial_chunks_of_a_killed_writer_are_removed(swift, swift_store, own_copy):
    (own_copy / "series" / "B_cu" / "c.1.0123456789abcdef0123456789abcdef.partial").write_bytes(b"half a chunk")
    ArchiveRows(own_copy).begin(1)
    assert resume(swift, own_copy).status == 0
    assert archive_bytes(own_copy) == archive_bytes(swift_store)


def test_resume_removes_nothing_else(swift, own_copy):
    """Files and folders of others that end like those of a killed writer are theirs."""
    folder = own_copy / "series" / "B_cu"
    mine = [folder / "notes.partial", folder / "backup.partial" / "data.csv", folder / "c.1.5f3a.partial"]
    mine[1].parent.mkdir()
    for file in mine:
        file.write_text("mine")
    assert resume(swift, own_copy).status == 0
    assert [file.read_text() for file in mine] == ["mine"] * 3


def test_the_table_is_true_of_what_is_pending(own_copy, swift):
    """A resumed run that is stopped at once leaves no row of a profile that is to be recomputed."""
    ArchiveRows(own_copy).begin(1)

    @contextmanager
    def stops():
        executor = SerialExecutor()
        executor.stream = interrupted
        yield executor

    def interrupted(*_):
        raise KeyboardInterrupt

    from gliderhpc.mission.planning import prepare_mission
    from gliderhpc.mission.run import Existing, run_mission
    from gliderhpc.mission.settings import MissionSettings
    from gliderhpc.observations import open_observations
    from gliderhpc.platform import read_platform

    with open_observations(swift) as observations:
        prepared = prepare_mission(observations, read_platform("petrel-l"), MissionSettings())
        with pytest.raises(KeyboardInterrupt):
            run_mission(prepared, own_copy, stops, existing=Existing.RESUME)
    with xr.open_datatree(own_copy, engine="zarr") as tree:
        table = tree.to_dataset().load()
    assert list(table["status"].values) == ["done", "pending", "done"]
    assert np.isnan(table["dac_north"].values[1])
    assert np.isnan(table["run_seconds"].values[1])


@pytest.mark.damages_archive
@pytest.mark.parametrize(
    "place", ["series/B_cu", "series", "profile", "status", "commits/marker", "windows/start", "series/sample", ""]
)
def test_damaged_metadata_is_named_and_mended(own_copy, swift, swift_store, place):
    """All chunks are intact, and the schema is known: nothing is recomputed."""
    metadata = own_copy / place / "zarr.json"
    metadata.write_bytes(metadata.read_bytes()[:-20])
    answer = program("check", own_copy)
    assert answer.status in (1, 2)
    assert place.partition("/")[0] in answer.out + answer.err
    answer = resume(swift, own_copy)
    assert answer.status == 0
    assert f"{place or '/'}: the metadata is damaged; it is written again from the schema" in answer.err
    assert "3 profiles are valid; nothing to compute" in answer.err
    assert as_stored(own_copy) == as_stored(swift_store)


def as_stored(store):
    """Content of an archive's files, its metadata as JSON: the order of the root's attributes is not promised."""
    contents = archive_bytes(store)
    return contents | {name: json.loads(text) for name, text in contents.items() if name.endswith("zarr.json")}


@pytest.mark.parametrize("number", range(6))
def test_a_flipped_bit_of_metadata_is_mended(own_copy, swift, swift_store, number):
    """Wherever it is, in a file that still reads as JSON or not."""
    rng = np.random.default_rng(number)
    files = sorted((own_copy / "state").glob("*/zarr.json"))
    metadata = files[rng.integers(len(files))]
    content = bytearray(metadata.read_bytes())
    content[rng.integers(len(content))] ^= 1 << rng.integers(7)
    metadata.write_bytes(content)
    assert resume(swift, own_copy).status == 0
    assert archive_bytes(own_copy) == archive_bytes(swift_store)


def test_another_wording_of_a_description_is_no_damage(own_copy, swift, swift_store):
    """An earlier program with the same schema wrote it: the archive is complete, resumed in silence, and compared."""
    group = zarr.open_group(own_copy, mode="r+", use_consolidated=False)
    for name in ("series/B_cu", "max_depth"):
        group[name].attrs["long_name"] = "as described before"
    consolidate(own_copy)
    before = archive_bytes(own_copy)
    answer = program("check", own_copy)
    assert answer.status == 0, answer.out
    answer = resume(swift, own_copy)
    assert "metadata" not in answer.err
    assert archive_bytes(own_copy) == before
    assert program("compare", own_copy, swift_store).status == 0


# What readers see


@pytest.mark.damages_archive
def test_a_chunk_that_is_missing_is_not_missing_values(own_copy, tmp_path):
    """Zarr alone reads it as fill; every command that reads it names it, and its remedy."""
    (own_copy / "series" / "B_cu" / "c.1.0").unlink()
    line = "profile 2, series/B_cu: the chunk is missing; run-mission --resume repairs it"
    for command in (["check", own_copy], ["info", own_copy]):
        answer = program(*command)
        assert answer.status == 1
        assert line in answer.out + answer.err
    for command in (
        ["report", own_copy, "--out", tmp_path / "report", "--profile", 2],
        ["analyze", own_copy, "reconstruction", "--workers", 0, "--out", tmp_path / "figures"],
    ):
        answer = program(*command)
        assert answer.status in (1, 2)
        assert line in answer.out + answer.err


def test_a_chunk_from_elsewhere_is_damage(own_copy):
    """Its checksum is right; its digest is not the one that the manifest holds."""
    shutil.copy(own_copy / "series" / "B_cu" / "c.0.0", own_copy / "series" / "B_cu" / "c.1.0")
    with (
        open_mission(own_copy) as tree,
        pytest.raises(InputError, match=r"profile 2, series/B_cu: the chunk is damaged"),
    ):
        tree["series"].ds["B_cu"].load()


def test_the_table_is_what_was_committed(own_copy, swift_store):
    """After SIGKILL the table is behind, and a chunk of it may be lost; readers see the committed profiles."""
    for name in ("status", "dac_north", "start_time"):
        (own_copy / name / "c.0").unlink()
    with xr.open_datatree(own_copy, engine="zarr") as plain:
        assert set(plain["status"].values) == {"pending"}
    with open_mission(own_copy) as tree, open_mission(swift_store) as sound:
        for name in ("status", "dac_north", "start_time"):
            xr.testing.assert_identical(tree[name].load(), sound[name].load())
    assert "3 done" in program("info", own_copy).out
    answer = program("check", own_copy)
    assert answer.status == 1
    assert "profile 1, dac_north: the table has nan, but the commit" in answer.out


def test_a_study_uses_what_was_committed_before_a_run_was_killed(own_copy):
    (own_copy / "status" / "c.0").unlink()
    answer = program("analyze", own_copy, "currents", "--workers", 0)
    assert answer.status == 0, answer.err
    with open_mission(own_copy) as tree:
        assert "pending" not in "".join(tree["currents"]["message"].values)


def test_an_intact_archive_opens_as_plain_xarray_opens_it(swift_store):
    with xr.open_datatree(swift_store, engine="zarr") as plain, open_mission(swift_store) as tree:
        for node in plain.subtree:
            xr.testing.assert_identical(tree[node.path].to_dataset().load(), node.to_dataset().load())


def test_many_damages_are_summed_up(own_copy):
    for chunk in own_copy.glob("state/*/c.1.0"):
        chunk.unlink()
    answer = program("check", own_copy, "--deep")
    assert answer.status == 1
    (line,) = [line for line in answer.out.splitlines() if line.startswith("profile 2")]
    assert "chunks are missing or damaged (state/" in line
    assert line.endswith(", ...); run-mission --resume repairs it")


# One run at a time


def test_a_second_run_is_refused(swift, own_copy):
    with locked(own_copy):
        answer = resume(swift, own_copy)
        assert answer.status == 2
        assert "another run is writing it (process" in answer.line
        assert str(os.getpid()) in answer.line
        answer = program("analyze", own_copy, "reconstruction", "--workers", 0)
        assert answer.status == 2
        assert "another run is writing it" in answer.line
    assert resume(swift, own_copy).status == 0


def _lock_of(path, **changes):
    with locked(path):
        content = json.loads(path.with_name(path.name + SUFFIX).read_text())
    return json.dumps(content | changes)


ODD_LOCKS = {
    "empty": b"",
    "binary": bytes(range(256)),
    "nested": b"[" * 5000,
    "huge": b"{" + b" " * 10_000_000,
    "another's": b'{"host": [1], "process": "x", "since": 5, "token": {}}',
    "a number": b"17",
}


@pytest.mark.parametrize("name", ODD_LOCKS)
def test_a_lock_with_unknown_content_is_taken_over_only_when_stale(tmp_path, name):
    archive = tmp_path / "a.zarr"
    lock = archive.with_name("a.zarr" + SUFFIX)
    lock.write_bytes(ODD_LOCKS[name])
    with pytest.raises(InputError, match=r"another run is writing it .*or remove .*a\.zarr\.lock"), locked(archive):
        pass
    long_ago = time.time() - 1e6
    os.utime(lock, (long_ago, long_ago))
    with locked(archive) as token:
        assert json.loads(lock.read_text())["token"] == token
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("make", ["mkdir", "dangling", "linked", "fifo"])
def test_a_lock_that_is_no_file_is_named(tmp_path, make):
    archive = tmp_path / "a.zarr"
    lock = archive.with_name("a.zarr" + SUFFIX)
    if make == "mkdir":
        lock.mkdir()
    elif make == "fifo":
        os.mkfifo(lock)
    else:
        target = tmp_path / "elsewhere"
        lock.symlink_to(target)
        if make == "linked":
            target.write_text("{}")
    with (
        pytest.raises(
            InputError, match=r"a\.zarr\.lock: is not a lock of gliderhpc but a folder, link or device; remove it"
        ),
        locked(archive),
    ):
        pass


def test_a_lock_that_cannot_be_written_is_explained(tmp_path, monkeypatch):
    """`analyze` of an archive in a folder of another user advised an option that it does not have."""

    def refused(lock, content):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(FileLock, "create", refused)
    message = r"a\.zarr: cannot be written \(Permission denied\); give an archive in a folder that you may write to"
    with pytest.raises(InputError, match=message), locked(tmp_path / "a.zarr"):
        pass


def test_a_lock_that_two_other_runs_took_meanwhile_is_left_to_the_last(tmp_path, monkeypatch):
    ours = FileLock(tmp_path / "a.lock")
    (tmp_path / "a.lock").write_bytes(b"second")
    read = FileLock.read

    def taken_again(lock):
        (tmp_path / "a.lock").write_bytes(b"third")
        return read(lock)

    monkeypatch.setattr(FileLock, "read", taken_again)
    ours.release(b"first")
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == {"a.lock": b"third"}


def test_the_lock_of_a_run_that_was_killed_is_taken_over(tmp_path):
    archive = tmp_path / "a.zarr"
    lock = archive.with_name("a.zarr" + SUFFIX)
    lock.write_text(_lock_of(archive, process=2**22 + 1))
    with locked(archive):
        assert json.loads(lock.read_text())["process"] == os.getpid()
    assert not lock.exists()
    lock.write_text(_lock_of(archive, host="elsewhere"))
    with pytest.raises(InputError, match="on elsewhere since"), locked(archive):
        pass
    long_ago = time.time() - 3600.0
    os.utime(lock, (long_ago, long_ago))
    with locked(archive):
        assert json.loads(lock.read_text())["host"] != "elsewhere"


def test_jobs_of_an_ended_run_write_nothing(tmp_path):
    archive = tmp_path / "a.zarr"
    with locked(archive) as token:
        check_held(archive, token)
    with pytest.raises(RunStoppedError, match="the run of this job has ended"):
        check_held(archive, token)
    with locked(archive), pytest.raises(RunStoppedError):
        check_held(archive, token)
    check_held(archive, None)
