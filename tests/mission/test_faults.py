"""Premature ends: killed workers and schedulers, interrupted runs, full disks, failing estimators."""

import errno
import os
import re
import signal
import subprocess
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from support.missions import DIPS, WHOLE, archive_bytes, estimate, program

from benchmarks.clusters import (
    forking,
    freeze_when,
    killing_workers,
    running_cluster,
    signal_group,
    start_program,
    wait_until,
)
from gliderhpc.errors import InputError, RunStoppedError
from gliderhpc.mission import cluster as clusters
from gliderhpc.mission.cluster import ClusterAddress, cluster_executor
from gliderhpc.mission.executors import local_executor
from gliderhpc.mission.lock import lock_name
from gliderhpc.mission.planning import prepare_mission
from gliderhpc.mission.run import Existing, run_mission
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.observations import open_observations
from gliderhpc.platform import read_platform
from gliderhpc.simulator import simulate_mission
from gliderhpc.store_schema import check_archive, damaged_chunks, read_commits

pytestmark = [pytest.mark.compiled, pytest.mark.usefixtures("unchecked_records")]

PETREL = read_platform("petrel-l")
COUNT = DIPS.profiles


@pytest.fixture(scope="module")
def dips(tmp_path_factory):
    """Return the observation file of ten short profiles."""
    return simulate_mission(PETREL, tmp_path_factory.mktemp("dips") / "dips.nc", scenario=DIPS, seed=5).path


@pytest.fixture(scope="module")
def undisturbed(dips):
    """Return their archive from an undisturbed run."""
    store = dips.with_name("undisturbed.zarr")
    assert estimate(dips, store, "recommended").failed == ()
    return store


def assert_whole(store, undisturbed):
    """Assert that the archive equals the undisturbed one byte for byte, with every profile once."""
    assert archive_bytes(store) == archive_bytes(undisturbed)
    with xr.open_datatree(store, engine="zarr") as tree:
        assert list(tree["profile"].values) == list(range(1, COUNT + 1))
        assert list(tree["status"].values) == ["done"] * COUNT
    assert check_archive(store) == []
    assert damaged_chunks(store) == []
    assert not store.with_name(store.name + ".lock").exists()


def committed(store):
    """Count committed profiles from the names of their markers, which is fast."""
    return sum(path.suffix != ".partial" for path in (store / "commits" / "marker").glob("c.*"))


def run_on(cluster, dips, store, *, existing=Existing.REFUSE, patience=60.0):
    """Run the mission from this process on a cluster."""
    address = ClusterAddress(file=cluster.file, patience=patience)
    needed = (dips, Path(lock_name(store)))
    with open_observations(dips) as opened:
        prepared = prepare_mission(opened, PETREL, MissionSettings())
        return run_mission(prepared, store, lambda: cluster_executor(address, needed), existing=existing)


# Workers and schedulers


@pytest.mark.long
@pytest.mark.parametrize("seed", [1, 2])
def test_workers_killed_at_random_change_nothing(dips, undisturbed, tmp_path, seed):
    store = tmp_path / "killed.zarr"
    with running_cluster() as cluster:
        wait_until(cluster.file.exists)
        with killing_workers(cluster, seed, kills=3, between=(0.7, 2.0)) as killed:
            result = run_on(cluster, dips, store)
    assert killed
    assert result.failed == ()
    assert_whole(store, undisturbed)


@pytest.mark.long
def test_a_scheduler_that_is_killed_stops_the_run_and_resume_finishes_it(dips, undisturbed, tmp_path):
    store = tmp_path / "orphaned.zarr"
    with running_cluster() as cluster:
        wait_until(cluster.file.exists)
        run = start_program(
            "run-mission", dips, "--platform", "petrel-l", "--store", store, "--scheduler-file", cluster.file
        )
        wait_until(lambda: committed(store))
        cluster.scheduler.kill()
        _, err = run.communicate(timeout=300)
    assert run.returncode == 1
    assert (
        f"the scheduler at {cluster.address} has stopped or cannot be reached; the results so far are saved; "
        "finish it with --resume" in err
    )
    assert "Traceback" not in err
    answer = program("run-mission", dips, *WHOLE, "--store", store, "--resume")
    assert answer.status == 0
    assert_whole(store, undisturbed)


@pytest.mark.long
def test_a_cluster_whose_workers_are_all_gone_stops_the_run(dips, tmp_path):
    store = tmp_path / "alone.zarr"
    with running_cluster(workers=1) as cluster:
        wait_until(cluster.file.exists)

        def kill_the_last(_):
            cluster.workers[0].kill()

        address = ClusterAddress(file=cluster.file, patience=2.0)
        with open_observations(dips) as opened:
            prepared = prepare_mission(opened, PETREL, MissionSettings(engine="scipy"))
            with pytest.raises(RunStoppedError, match="has had no worker for 2 s"):
                run_mission(prepared, store, lambda: cluster_executor(address), on_result=kill_the_last)
    with xr.open_datatree(store, engine="zarr") as tree:
        assert "done" in tree["status"].values
        assert "pending" in tree["status"].values


@pytest.mark.long
def test_a_worker_lost_while_it_compiles_is_not_waited_for(dips):
    def lost():
        os.kill(os.getpid(), signal.SIGKILL)

    with running_cluster(workers=2) as cluster:
        wait_until(cluster.file.exists)
        address = ClusterAddress(file=cluster.file, patience=5.0)
        with cluster_executor(address, (dips,), warm=lost) as executor:
            (attempt,) = executor.attempts(str, [5])
    assert attempt.result == "5"


def _dies_on(number, run):
    """Return a job that kills its worker at one profile, as a lack of memory would."""

    def job(batch):
        if number in [one for one, _ in batch.profiles]:
            os.kill(os.getpid(), signal.SIGKILL)
        return run(batch)

    return job


@pytest.mark.long
# Dask's warnings at the restart of a worker would otherwise end the process that starts it.
@pytest.mark.filterwarnings("ignore")
def test_a_profile_that_kills_its_workers_is_given_up_alone(dips, tmp_path, monkeypatch):
    from gliderhpc.mission import jobs, local_workers

    monkeypatch.setattr(jobs, "batch_results", _dies_on(5, jobs.batch_results))
    # Half a dozen processes, each of which would spend its life on imports.
    monkeypatch.setattr(local_workers, "_CONTEXT", forking())
    store = tmp_path / "poison.zarr"
    with open_observations(dips) as opened:
        prepared = prepare_mission(opened, PETREL, MissionSettings(), (4, 5, 6))
        result = run_mission(prepared, store, lambda: local_executor(2))
    assert result.failed == (5,)
    with xr.open_datatree(store, engine="zarr") as tree:
        assert list(tree["status"].values) == ["done", "failed", "done"]
        message = str(tree["message"].sel(profile=5).values)
    assert re.fullmatch(r"the worker was killed or ran out of memory [1-4] times", message)
    assert damaged_chunks(store) == []


# Estimators that fail, disks that are full


def test_an_estimator_that_fails_costs_its_profile_alone(dips, tmp_path, monkeypatch, caplog):
    from gliderhpc.mission import jobs

    whole = jobs.derive_and_write

    def failing(rows, index, *rest):
        if index == 1:
            raise FloatingPointError("the gain is singular")
        return whole(rows, index, *rest)

    monkeypatch.setattr(jobs, "derive_and_write", failing)
    store = tmp_path / "failing.zarr"
    answer = program("run-mission", dips, *WHOLE, "--store", store, "--profiles", "4:6")
    assert answer.status == 1
    assert "1 failed: 5" in answer.out
    with xr.open_datatree(store, engine="zarr") as tree:
        assert list(tree["status"].values) == ["done", "failed", "done"]
        assert str(tree["message"].sel(profile=5).values) == "FloatingPointError: the gain is singular"
    assert "each will be retried on its own" in answer.err
    assert "Traceback" in answer.err
    monkeypatch.setattr(jobs, "derive_and_write", whole)
    answer = program("run-mission", dips, *WHOLE, "--store", store, "--profiles", "4:6", "--resume")
    assert answer.status == 0
    assert "2 profiles are valid; to be computed: 1 failed before" in answer.err
    assert "profile 4 done" not in answer.err


@pytest.mark.long
def test_a_full_disk_stops_the_run_and_resume_finishes_it(dips, undisturbed, tmp_path, monkeypatch):
    from gliderhpc.mission import jobs

    whole, written = jobs.derive_and_write, []

    def filling(rows, index, *rest):
        written.append(index)
        if len(written) > 4:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "series/B_cu/c.3.0")
        return whole(rows, index, *rest)

    monkeypatch.setattr(jobs, "derive_and_write", filling)
    store = tmp_path / "full.zarr"
    answer = program("run-mission", dips, *WHOLE, "--store", store)
    assert answer.status == 1
    assert answer.err.splitlines()[-1] == (
        "gliderhpc: no space left to write series/B_cu/c.3.0; free some space and finish it with --resume"
    )
    assert "Traceback" not in answer.err
    monkeypatch.setattr(jobs, "derive_and_write", whole)
    answer = program("run-mission", dips, *WHOLE, "--store", store, "--resume")
    assert answer.status == 0
    assert f"4 profiles are valid; to be computed: {COUNT - 4} missing" in answer.err
    assert_whole(store, undisturbed)


@pytest.fixture
def small_disk(tmp_path):
    """Mount a separate file system of 4 MB."""
    folder = tmp_path / "small"
    folder.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=4m", "tmpfs", str(folder)], capture_output=True, check=False
    )
    if mounted.returncode:
        pytest.skip("no file system can be mounted here; the injected error replaces it")
    yield folder
    subprocess.run(["umount", "-l", str(folder)], check=True)


@pytest.mark.long
def test_a_disk_that_is_really_full(dips, undisturbed, small_disk):
    store, log = small_disk / "small.zarr", small_disk / "run.log"
    ballast = small_disk / "ballast"
    ballast.write_bytes(bytes(2_000_000))
    answer = program("run-mission", dips, *WHOLE, "--store", store, "--log-file", log)
    assert answer.status == 1
    assert "no space left to write" in answer.err.splitlines()[-1]
    assert "Traceback" not in answer.err
    ballast.unlink()
    subprocess.run(["mount", "-o", "remount,size=64m", str(small_disk)], check=True)
    assert program("run-mission", dips, *WHOLE, "--store", store, "--resume").status == 0
    assert_whole(store, undisturbed)


# Interrupted


@pytest.mark.parametrize(
    ("number", "seed"),
    [
        pytest.param(signal.SIGINT, 11, marks=pytest.mark.long),
        pytest.param(signal.SIGTERM, 12, marks=pytest.mark.long),
        pytest.param(signal.SIGKILL, 13, marks=pytest.mark.long),
    ],
    ids=str,
)
def test_interrupted_at_random_and_resumed(dips, undisturbed, tmp_path, number, seed):
    """Send Ctrl-C to the group, SIGTERM to the program, or SIGKILL, after a random number of commits.

    The workers end after their present profile; some profiles therefore remain, however fast the workers are.
    """
    store = tmp_path / "interrupted.zarr"
    run = start_program(
        "run-mission", dips, "--platform", "petrel-l", "--store", store, "--workers", 1, "--engine", "lanes"
    )
    enough = np.random.default_rng(seed).integers(1, COUNT // 2)
    wait_until(lambda: run.poll() is not None or (store / "zarr.json").exists())
    freeze_when(run, lambda: committed(store) >= enough)
    if number == signal.SIGINT:
        signal_group(run, number)
    else:
        run.send_signal(number)
    signal_group(run, signal.SIGCONT)
    _, err = run.communicate(timeout=300)
    if number != signal.SIGKILL:
        assert run.returncode == 130, err
        assert "interrupted; the archive is intact, finish it with --resume" in err
        assert "Traceback" not in err
        assert not store.with_name(store.name + ".lock").exists()
    assert 0 < len(read_commits(store)) < COUNT
    assert program("run-mission", dips, *WHOLE, "--store", store, "--resume").status == 0
    assert_whole(store, undisturbed)


# Clusters that cannot be used


def test_a_scheduler_that_is_not_there(dips, tmp_path, monkeypatch):
    monkeypatch.setattr(clusters, "_CONNECT_TIMEOUT", 0.5)
    answer = program(
        "run-mission",
        dips,
        "--platform",
        "petrel-l",
        "--store",
        tmp_path / "a.zarr",
        "--scheduler",
        "tcp://127.0.0.1:9",
    )
    assert answer.status == 2
    assert "tcp://127.0.0.1:9: no Dask scheduler answers there" in answer.err.splitlines()[-1]
    answer = program(
        "run-mission", dips, "--platform", "petrel-l", "--store", tmp_path / "b.zarr", "--scheduler-file",
        tmp_path / "none.json",
    )  # fmt: skip
    assert answer.status == 2
    assert "none.json: no such file" in answer.err.splitlines()[-1]


def test_a_worker_of_another_version_is_named(monkeypatch):
    class Client:
        def run(self, function, on_error):
            return {"tcp://b:2": function(), "tcp://a:1": function() | {"numpy": "1.0"}}

    with pytest.raises(InputError, match=r"worker tcp://a:1: has numpy 1\.0, but this process has \d"):
        clusters.check_versions(Client())

    class Bare:
        def run(self, function, on_error):
            return {"tcp://c:3": ModuleNotFoundError("No module named 'gliderhpc'")}

    with pytest.raises(InputError, match=r"worker tcp://c:3: cannot run gliderhpc .*No module named"):
        clusters.check_versions(Bare())


def test_workers_that_do_not_see_the_files_are_named(dips, tmp_path):
    with running_cluster(workers=1) as cluster:
        wait_until(cluster.file.exists)
        with (
            pytest.raises(InputError, match=r"absent.nc: worker tcp://.* on .* cannot see this file"),
            cluster_executor(ClusterAddress(file=cluster.file), (dips, tmp_path / "absent.nc")),
        ):
            pass


@pytest.mark.long
def test_a_study_runs_on_the_cluster_too(undisturbed, tmp_path):
    import shutil

    store = shutil.copytree(undisturbed, tmp_path / "studied.zarr")
    with running_cluster(workers=1) as cluster:
        wait_until(cluster.file.exists)
        answer = program("analyze", store, "reconstruction", "--profiles", "1:2", "--scheduler", cluster.address)
    assert answer.status == 0, answer.err
    assert check_archive(store) == []
    assert damaged_chunks(store) == []
