"""Mission from end to end: content of the archive, inputs that determine it, resuming and repeating."""

import re
import shutil
from contextlib import contextmanager
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
import xarray as xr
import zarr
from support.archives import clear_marker, write_profile
from support.missions import (
    CHANNELS,
    WHOLE,
    archive_bytes,
    changed_observations,
    profile_series,
    program,
    samples_of,
    with_xarray_alone,
)

from gliderhpc.errors import InputError
from gliderhpc.estimation import engines
from gliderhpc.estimation import profile as estimation
from gliderhpc.estimation.current_errors import CurrentErrors
from gliderhpc.estimation.currents import surface_drift
from gliderhpc.estimation.lanes import LaneBatch
from gliderhpc.estimation.preparation import prepare_profile, vibration_set
from gliderhpc.estimation.quality import implausible_motion, longest_run, quality_flags, remarks
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.flight.glider import Glider
from gliderhpc.flight.hull_parameters import with_covariance
from gliderhpc.kernels.elementwise import LANES
from gliderhpc.mission import jobs
from gliderhpc.mission.executors import SerialExecutor, local_executor
from gliderhpc.mission.jobs import MAX_BATCH, batch_sizes
from gliderhpc.mission.local_workers import default_workers
from gliderhpc.mission.planning import plan_mission, prepare_mission
from gliderhpc.mission.run import Existing, MissionResult, _advise_to_tune, _warn_about_unused_settings, run_mission
from gliderhpc.mission.settings import MissionSettings, build_settings, parse_assignments
from gliderhpc.observations import Fix, open_observations
from gliderhpc.observations.profile_numbers import as_ranges, select_profiles
from gliderhpc.observations.truth import read_profile_truth, truth_path
from gliderhpc.outcomes import Outcome
from gliderhpc.platform import DisturbancePrior, read_platform
from gliderhpc.platform_sections import CalibrationErrors
from gliderhpc.store_schema import ArchiveRows, check_archive, committed_rows, read_commits, set_attributes
from gliderhpc.vocabulary import QUALITY

pytestmark = [pytest.mark.compiled, pytest.mark.usefixtures("unchecked_records")]

PETREL = read_platform("petrel-l")


@pytest.fixture
def archive(brief_store):
    with xr.open_datatree(brief_store, engine="zarr") as tree:
        yield tree


@pytest.fixture
def own_copy(swift_store, tmp_path):
    """Return a copy of the swift mission's archive that may be changed."""
    return shutil.copytree(swift_store, tmp_path / "copy.zarr")


# Content of the archive


def test_the_archive_keeps_to_its_schema(brief_store):
    assert check_archive(brief_store) == []


def test_every_profile_is_done_and_says_how(archive, brief):
    table = archive.to_dataset().load()
    assert list(table["profile"].values) == [1, 2, 3]
    assert list(table["status"].values) == ["done"] * 3
    assert (table["converged_fraction"].values >= 0.9).all()
    assert (table["window_count"].values > 20).all()
    assert (table["iterations_median"].values >= 0).all()
    windows = archive["windows"].ds
    assert int(windows["iterations"].sum()) > 0
    assert (windows["evaluations"].where(windows["start"] >= 0, 1) >= 1).all()
    assert (table["run_seconds"].values > 0.0).all()
    assert (table["max_depth"].values > 40.0).all()
    assert (np.diff(table["elapsed_days"].values) > 0.0).all()
    assert table["elapsed_days"].values[0] == 0.0
    with open_observations(brief) as observations:
        for number in (1, 2, 3):
            row = table.sel(profile=number)
            assert row["start_time"].values == observations.start_time(number)
            assert row["duration"] == observations.duration(number)
            assert row["sample_count"] == observations.sample_count(number)


def test_the_table_says_which_disturbance_prior_stands(archive, rough_store):
    with xr.open_datatree(rough_store, engine="zarr") as tree:
        rough = tree.to_dataset().load()
    usual = archive.to_dataset()["disturbance_prior"]
    for variable in (usual, rough["disturbance_prior"]):
        assert variable.attrs["flag_values"] == [0, 1]
        assert variable.attrs["flag_meanings"] == "usual rough_water"
    assert usual.values.tolist() == [0, 0, 0]
    assert rough["disturbance_prior"].values.tolist() == [1]
    assert "gust prior" in str(rough["message"].values[0])
    assert check_archive(rough_store) == []


def test_root_attributes_say_what_was_done_to_what(archive, brief):
    with open_observations(brief) as observations:
        assert archive.attrs["observations_digest"] == observations.digest()
    assert archive.attrs["observations"] == brief.name
    assert archive.attrs["platform"] == PETREL.model_dump(mode="json")
    assert archive.attrs["settings"] == MissionSettings().model_dump(mode="json")
    assert archive.attrs["engine"] == "lanes"
    assert archive.attrs["step"] == 0.1


def test_time_depth_and_record_are_the_observations(archive, brief):
    """Records are one second apart from the first observation, in degrees; rows end with NaN."""
    with open_observations(brief) as observations:
        record = observations.profile(2)
    observed, state = (archive[group].ds.sel(profile=2).load() for group in ("observed", "state"))
    n = len(record.time)
    for name in ("roll", "pitch", "heading"):
        np.testing.assert_allclose(observed[name].values[:n], np.degrees(getattr(record, name)), atol=1e-4)
    np.testing.assert_allclose(observed["depth"].values[:n], record.depth, atol=1e-4)
    np.testing.assert_allclose(observed["ballast_volume"].values[: n - 1], record.ballast_volume[:-1] * 1e6, atol=5.0)
    assert np.isnan(observed["pitch"].values[n:]).all()
    assert np.isnan(state["u"].values[n:]).all()
    np.testing.assert_array_equal(
        state["time"].values[:n], record.epoch + (record.time * 1e9).astype("timedelta64[ns]")
    )
    series = archive["series"].ds.sel(profile=2).load()
    np.testing.assert_allclose(series["depth"].values[: 10 * (n - 1) + 1 : 10], record.depth, atol=1e-4)
    steps = np.diff(series["time"].values[: 10 * (n - 1) + 1])
    np.testing.assert_allclose(steps / np.timedelta64(1, "ns"), 1e8, atol=1e3)


def test_xarray_alone_answers(brief_store, archive):
    code = """
import json, numpy as np, xarray as xr
tree = xr.open_datatree(sys.argv[1], engine="zarr", chunks={})
series = tree["series"].ds
one = series.B_cr.sel(profile=2)
band = series.B_cu.where((series.depth >= 10.0) & (series.depth <= 30.0))
mean = band.mean(["profile", "sample"])
lazy = mean.chunks is not None
table = tree.to_dataset()[["status", "message", "start_time", "dac_north", "dac_east"]].to_dataframe()
bare = [f"{group.path}:{name}" for group in tree.subtree for name, variable in group.ds.data_vars.items()
        if not variable.attrs.get("long_name")
        or not (variable.attrs.get("units") or variable.encoding.get("units"))]
print(json.dumps({
    "imported": "gliderhpc" in sys.modules and sys.modules["gliderhpc"] is not None,
    "lazy": bool(lazy),
    "mean": float(mean.compute()),
    "peak": float(abs(one).max().compute()),
    "table": {int(k): [r.status, float(r.dac_north), float(r.dac_east)] for k, r in table.iterrows()},
    "groups": sorted(node.path for node in tree.subtree),
    "bare": bare,
}))
"""
    answer = with_xarray_alone(code, brief_store)
    assert not answer["imported"]
    assert answer["lazy"]
    assert answer["bare"] == []
    series = archive["series"].ds.load()
    inside = (series["depth"].values >= 10.0) & (series["depth"].values <= 30.0)
    assert answer["mean"] == pytest.approx(float(np.nanmean(series["B_cu"].values[inside])), rel=1e-4)
    assert answer["peak"] == pytest.approx(float(np.nanmax(np.abs(series["B_cr"].values[1]))))
    table = archive.to_dataset().load()
    for number in (1, 2, 3):
        row = table.sel(profile=number)
        assert answer["table"][str(number)] == ["done", float(row["dac_north"]), float(row["dac_east"])]
    assert {"/", "/series", "/prior", "/state", "/observed", "/windows", "/drift_current"} <= set(answer["groups"])


def test_currents_and_fixes_of_the_table(archive, brief):
    table = archive.to_dataset().load()
    drift = archive["drift_current"].ds.load()
    with open_observations(brief) as observations:
        for number in (1, 2, 3):
            row, truth = table.sel(profile=number), read_profile_truth(truth_path(brief), number)
            record = observations.profile(number)
            for end in ("entry", "exit"):
                fix: Fix = getattr(record, f"{end}_fix")
                assert row[f"{end}_latitude"] == fix.latitude
                assert row[f"{end}_longitude"] == fix.longitude
                assert abs(row[f"{end}_time"].values - fix.time) < np.timedelta64(1, "ms")
            error = np.hypot(row["dac_north"] - truth["current_north"], row["dac_east"] - truth["current_east"])
            # Errors of 5 m in the fixes over nine minutes alone give 0.01 m/s.
            assert error < 0.04
            covariance = [
                [row["dac_north_std"] ** 2, row["dac_covariance"]],
                [row["dac_covariance"], row["dac_east_std"] ** 2],
            ]
            assert np.linalg.eigvalsh(np.array(covariance, dtype=float)).min() >= -1e-12
            assert row["dac_north_std"] > 0.0
            # The nearest fixes are 30 s before and after the dive.
            surfaces = {"entry": record.surface_fixes_before, "exit": record.surface_fixes_after}
            for end, fixes in surfaces.items():
                drifted = surface_drift(fixes)
                share = 30.0 * drifted.weight(CurrentErrors())
                assert float(row[f"{end}_surface_time"]) == pytest.approx(share, abs=1.0)
                found = [float(row[f"{end}_surface_{along}"]) for along in ("north", "east")]
                np.testing.assert_allclose(found, share * drifted.velocity, atol=0.5)
            cycles = drift.sel(profile=number).dropna("segment")
            assert cycles.sizes["segment"] == 1
            assert float(cycles["north"][0]) == pytest.approx(float(row["dac_north"]))
            assert float(cycles["start"][0]) == 0.0


# Quality flags


def test_quality_flags_say_what_they_mean(archive, brief):
    settings = EstimationSettings()
    series = profile_series(brief, 2, settings)
    n = len(series.time)
    flags = archive["series"].ds["quality"].sel(profile=2).values[:n].astype(int)
    observed = archive["observed"].ds.sel(profile=2).load()

    def flagged(name):
        return flags & QUALITY.meanings[name] > 0

    np.testing.assert_array_equal(flagged("vibration"), vibration_set(PETREL, series))
    assert 0 < flagged("vibration").sum() < n / 2
    rotated = np.abs(series.controls[:, 1]) > np.radians(1.0)
    np.testing.assert_array_equal(flagged("battery_rotated")[:-1], rotated)
    assert rotated.any()
    depth = observed["depth"].values[~np.isnan(observed["depth"].values)]
    turn = 10 * int(np.argmax(depth))
    climbing = flagged("climbing")
    assert not climbing[: turn - 300].any()
    assert climbing[turn + 300 : -50].all()
    for name in (
        "gap_in_the_record", "prior_used_because_the_window_failed", "implausible_self_motion", "window_not_converged",
    ):  # fmt: skip
        assert not flagged(name).any()


@pytest.fixture(scope="module")
def estimated(brief):
    settings = EstimationSettings()
    return estimation.estimate_profile(prepare_profile(Glider(PETREL), profile_series(brief, 1, settings)), settings)


def test_implausible_motion_is_flagged_and_reported_after_a_minute(estimated):
    assert remarks(PETREL, estimated) == []
    quiet = np.flatnonzero(~estimated.vibrating)
    # The longest stretch of steady glide contains a minute.
    breaks = np.flatnonzero(np.diff(quiet) > 1)
    stretches = np.split(quiet, breaks + 1)
    longest = max(stretches, key=len)
    assert len(longest) > 700
    for seconds, reported in ((50, False), (65, True)):
        states = estimated.solution.states.copy()
        rows = longest[: 10 * seconds]
        states[rows, 8] = states[rows, 6] * np.tan(np.radians(16.0))
        corrupted = replace(estimated, solution=replace(estimated.solution, states=states))
        np.testing.assert_array_equal(np.flatnonzero(implausible_motion(corrupted)), rows)
        flagged = quality_flags(corrupted) & QUALITY.meanings["implausible_self_motion"] > 0
        np.testing.assert_array_equal(np.flatnonzero(flagged), rows)
        assert any("implausible for 65 s" in line for line in remarks(PETREL, corrupted)) is reported
    assert any(line.endswith("calibrate the hull") for line in remarks(PETREL, corrupted))
    errors = CalibrationErrors(parameters=("viscous.K_D0",), deviation=(1.0,), correlation=((),))
    found = remarks(with_covariance(PETREL, errors), corrupted)
    assert any(line.endswith("calibrate on profiles like this one, then tune the prior") for line in found), (
        "it is calibrated already"
    )


def test_a_profile_that_is_one_window_is_reported(estimated):
    assert not any("shorter than a window" in line for line in remarks(PETREL, estimated))
    single = replace(estimated.solution, windows=estimated.solution.windows[:1])
    found = remarks(PETREL, replace(estimated, solution=single))
    assert any("is shorter than a window and is a single one: give a shorter window.length" in line for line in found)


@pytest.mark.parametrize(("share", "marked"), [(0.05, False), (0.5, True)])
def test_windows_that_mostly_fail_are_reported_with_their_reason(estimated, share, marked):
    windows = list(estimated.solution.windows)
    failed = max(1, round(share * len(windows)))
    windows[:failed] = [replace(window, outcome=Outcome.ITERATION_LIMIT) for window in windows[:failed]]
    solution = replace(estimated.solution, windows=tuple(windows))
    calm = np.zeros_like(estimated.vibrating)
    lines = remarks(PETREL, replace(estimated, solution=solution, profile=replace(estimated.profile, vibrating=calm)))
    assert [f"{failed} of {len(windows)} windows did not converge ({failed} at the iteration limit)" in line
            for line in lines] == [True] * marked  # fmt: skip
    vibrating = remarks(
        PETREL, replace(estimated, solution=solution, profile=replace(estimated.profile, vibrating=~calm))
    )
    assert any("where the actuators move between samples" in line for line in vibrating) is marked


@pytest.mark.parametrize(("u", "plausible"), [(0.04, False), (0.06, True), (1.4, True), (1.6, False), (np.nan, False)])
def test_speeds_that_are_plausible(estimated, u, plausible):
    states = estimated.solution.states.copy()
    states[100, 6:9] = u, 0.0, 0.0
    corrupted = replace(estimated, solution=replace(estimated.solution, states=states))
    assert implausible_motion(corrupted)[100] != plausible


def test_longest_run():
    mask = np.array([1, 1, 0, 1, 1, 1, 0, 0, 1], dtype=bool)
    assert longest_run(mask, 0.5) == 1.5
    assert longest_run(np.zeros(5, dtype=bool), 0.5) == 0.0
    assert longest_run(np.ones(5, dtype=bool), 0.5) == 2.5


def _sabotage(monkeypatch, engine):
    """Make the third window of a profile diverge: its start is NaN."""
    calls = []

    def corrupted(data, start):
        # The compilation of the kernels before the run solves shorter windows.
        calls.append(len(data.bodies) == 300)
        return np.full_like(start, np.nan) if calls[-1] and sum(calls) == 3 else start

    if engine == "lanes":
        load = LaneBatch.load
        monkeypatch.setattr(LaneBatch, "load", lambda batch, lane, task: load(batch, lane, (task[0], corrupted(*task))))
    else:
        solve = engines.solve_window
        monkeypatch.setattr(
            engines, "solve_window", lambda data, start, settings: solve(data, corrupted(data, start), settings)
        )


@pytest.mark.parametrize("engine", ["lanes", "scipy"])
def test_a_bad_window_costs_no_profile(brief, tmp_path, monkeypatch, engine):
    """A profile's third window diverges: the prior is used there, marked and reported, and the rest continues."""
    _sabotage(monkeypatch, engine)
    store = tmp_path / "sabotaged.zarr"
    answer = program("run-mission", brief, *WHOLE, "--store", store, "--profiles", 1, "--engine", engine)
    assert answer.status == 0
    with xr.open_datatree(store, engine="zarr") as tree:
        row = tree.to_dataset().sel(profile=1).load()
        assert row["status"] == "done"
        assert "1 of " in str(row["message"].values)
        assert Outcome.DIVERGED.sentence in str(row["message"].values)
        windows = tree["windows"].ds.sel(profile=1).load()
        assert windows["outcome"].values[2] == Outcome.DIVERGED
        assert (windows["outcome"].values[3:8] == Outcome.CONVERGED).all()
        assert windows["start"].values[3] == windows["stop"].values[2]
        assert np.isfinite(row["dac_north"])
        span = slice(int(windows["start"][2]), int(windows["stop"][2]))
        series, prior = (tree[group].ds.sel(profile=1).load() for group in ("series", "prior"))
        for name in CHANNELS:
            np.testing.assert_array_equal(series[name].values[span], prior[name].values[span])
        flags = series["quality"].values.astype(int)
        failed = flags & QUALITY.meanings["prior_used_because_the_window_failed"] > 0
        np.testing.assert_array_equal(np.flatnonzero(failed), np.arange(span.start, span.stop))
        assert (flags[span] & QUALITY.meanings["window_not_converged"] > 0).all()


def test_a_gap_in_the_record_is_masked_reported_and_bridged(brief, tmp_path):
    def punch(content):
        rows = samples_of(content, 2)[200:280]
        for name in ("roll", "pitch", "heading"):
            content[name].values[rows] = np.nan

    path = changed_observations(brief, tmp_path / "gap.nc", punch)
    store = tmp_path / "gap.zarr"
    assert program("run-mission", path, *WHOLE, "--store", store).status == 0
    with xr.open_datatree(store, engine="zarr") as tree:
        table = tree.to_dataset().load()
        assert list(table["status"].values) == ["done"] * 3
        assert "gaps totalling 81 s" in str(table["message"].sel(profile=2).values)
        assert str(table["message"].sel(profile=1).values) == ""
        series = tree["series"].ds.sel(profile=2).load()
        n = np.isfinite(series["depth"].values).sum()
        gap = series["quality"].values[:n].astype(int) & QUALITY.meanings["gap_in_the_record"] > 0
        np.testing.assert_array_equal(np.flatnonzero(gap), np.arange(1991, 2800))
        assert np.isfinite(series["B_cr"].values[: n - 1]).all()
        assert np.isnan(tree["observed"].ds["pitch"].sel(profile=2).values[200:280]).all()
        assert np.isfinite(table["dac_north"].sel(profile=2))


# Nothing but the observations decides


def test_the_truth_is_never_read(swift, swift_store, tmp_path):
    """The file without its truth gives the same archive byte for byte, except for durations."""
    alone = tmp_path / swift.name
    shutil.copy(swift, alone)
    assert truth_path(swift).exists()
    assert not truth_path(alone).exists()
    store = tmp_path / "alone.zarr"
    assert program("run-mission", alone, *WHOLE, "--store", store).status == 0
    assert archive_bytes(store) == archive_bytes(swift_store)
    assert len(archive_bytes(store)) > 100


def test_the_number_of_workers_changes_nothing(swift, swift_store, tmp_path):
    store = tmp_path / "parallel.zarr"
    answer = program("run-mission", swift, "--platform", "petrel-l", "--store", store, "--workers", 2)
    assert answer.status == 0, answer.err
    assert all(" INFO profile " in line for line in answer.err.splitlines())
    assert archive_bytes(store) == archive_bytes(swift_store)
    assert len(committed_rows(store)) == 3


def test_each_profile_is_committed_and_reported_when_it_is_done(swift, swift_store, tmp_path):
    """Even in one process, where all profiles are one batch, none waits for the others; the archive is the same."""
    store, committed = tmp_path / "one-by-one.zarr", []
    with open_observations(swift) as observations:
        run_mission(
            prepare_mission(observations, PETREL, MissionSettings()), store, partial(local_executor, 0),
            on_result=lambda done: committed.append((done.number, len(read_commits(store)))),
        )  # fmt: skip
    assert sorted(number for number, _ in committed) == [1, 2, 3]
    assert [count for _, count in committed] == [1, 2, 3]
    assert archive_bytes(store) == archive_bytes(swift_store)


def test_partial_files_of_a_killed_worker_are_removed_at_the_end_of_the_run(swift, swift_store, tmp_path):
    """The file has a temporary name of zarr; another worker has since written the chunk."""
    store = tmp_path / "stray.zarr"
    stray = store / "observed" / "ballast_volume" / f"c.5.{'0a' * 16}.partial"
    with open_observations(swift) as observations:
        prepared = prepare_mission(observations, PETREL, MissionSettings())
        run_mission(prepared, store, partial(local_executor, 0), on_result=lambda done: stray.touch())
    assert archive_bytes(store) == archive_bytes(swift_store)


def test_a_batch_that_ends_in_an_error_is_tried_again_but_for_what_is_done(swift, tmp_path, monkeypatch):
    """Profiles that were committed before the error are neither computed nor reported twice."""
    finish, calls = jobs._BatchRunner.finish, []

    def fails_once(self, work, estimate):
        calls.append(work.number)
        if len(calls) == 2:
            raise RuntimeError("no luck")
        finish(self, work, estimate)

    monkeypatch.setattr(jobs._BatchRunner, "finish", fails_once)
    reported = []
    with open_observations(swift) as observations:
        result = run_mission(
            prepare_mission(observations, PETREL, MissionSettings()), tmp_path / "again.zarr",
            partial(local_executor, 0), on_result=lambda done: reported.append(done.number),
        )  # fmt: skip
    assert result.failed == ()
    assert sorted(reported) == [1, 2, 3]
    assert len(calls) == 4, "one failure, and the first profile is not done again"
    assert calls.count(calls[0]) == 1


def test_a_profile_does_not_depend_on_the_others(swift, swift_store, tmp_path):
    store = tmp_path / "one.zarr"
    assert program("run-mission", swift, *WHOLE, "--store", store, "--profiles", "2").status == 0
    with xr.open_datatree(store, engine="zarr") as one, xr.open_datatree(swift_store, engine="zarr") as whole:
        assert list(one["profile"].values) == [2]
        ours, theirs = (tree["series"].ds["B_cr"].sel(profile=2).values for tree in (one, whole))
        np.testing.assert_array_equal(ours, theirs[: len(ours)])
        ours, theirs = (tree.to_dataset().sel(profile=2).drop_vars("run_seconds").load() for tree in (one, whole))
        xr.testing.assert_identical(ours.drop_attrs(), theirs.drop_attrs())


# Interrupted, resumed, replaced


def test_resume_does_what_is_missing_and_nothing_else(swift, swift_store, own_copy):
    clear_marker(own_copy, 1)
    write_profile(own_copy, 1, "series", {"B_cr": np.full(10, 99.0)})
    unchanged = {
        path: path.stat().st_mtime_ns for path in own_copy.glob("series/B_cr/c.*") if not path.name.startswith("c.1.")
    }
    assert len(unchanged) == 2
    answer = program("run-mission", swift, *WHOLE, "--store", own_copy, "--resume")
    assert answer.status == 0, answer.err
    assert "3 of 3 profiles done (2 of them in an earlier run)" in answer.out
    assert "profile 2 done" in answer.err
    assert "profile 1 done" not in answer.err
    assert archive_bytes(own_copy) == archive_bytes(swift_store)
    assert all(path.stat().st_mtime_ns == then for path, then in unchanged.items())


def test_resume_of_a_finished_mission_does_nothing(swift, swift_store, own_copy):
    answer = program("run-mission", swift, *WHOLE, "--store", own_copy, "--resume")
    assert answer.status == 0
    assert "done in" not in answer.err
    assert archive_bytes(own_copy, ()) == archive_bytes(swift_store, ())


def test_an_interrupted_run_is_whole_and_can_be_finished(swift, swift_store, tmp_path):
    class Interrupted(SerialExecutor):
        workers = 3

        def stream(self, function, jobs):
            yield from super().stream(function, jobs[:1])
            raise KeyboardInterrupt

    @contextmanager
    def interrupted():
        yield Interrupted()

    store = tmp_path / "interrupted.zarr"
    with open_observations(swift) as observations, pytest.raises(KeyboardInterrupt):
        run_mission(prepare_mission(observations, PETREL, MissionSettings()), store, interrupted)
    with xr.open_datatree(store, engine="zarr") as tree:
        assert list(tree["status"].values) == ["done", "pending", "pending"]
        np.testing.assert_array_equal(tree["disturbance_prior"].values, [0.0, np.nan, np.nan])
        assert np.isfinite(tree["series"].ds["B_cr"].sel(profile=1).values[:100]).all()
        assert np.isnan(tree["series"].ds["B_cr"].sel(profile=2).values).all()
    assert program("run-mission", swift, *WHOLE, "--store", store, "--resume").status == 0
    assert archive_bytes(store) == archive_bytes(swift_store)


def test_resume_refuses_other_profiles(swift, swift_store, own_copy):
    answer = program("run-mission", swift, *WHOLE, "--store", own_copy, "--resume", "--profiles", "1")
    assert answer.status == 2
    assert "was made for other profiles" in answer.err
    assert archive_bytes(own_copy, ()) == archive_bytes(swift_store, ())


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (("--set", "optimizer.max_iterations=7"), "other settings"),
        (("--set", "platform.mass.total=88.1"), "another platform"),
    ],
)
def test_resume_recomputes_what_was_made_from_other_inputs(swift, own_copy, tmp_path, arguments, reason):
    """The archive then equals that of a run with the other inputs, including its attributes."""
    answer = program("run-mission", swift, *WHOLE, "--store", own_copy, "--resume", *arguments)
    assert answer.status == 0, answer.err
    assert f"0 profiles are valid; to be computed: 3 made with {reason}" in answer.err
    store = tmp_path / "again.zarr"
    assert program("run-mission", swift, *WHOLE, "--store", store, *arguments).status == 0
    assert archive_bytes(own_copy) == archive_bytes(store)
    assert program("compare", own_copy, store).status == 0


def test_resume_recomputes_the_profiles_whose_record_has_changed(swift, own_copy, tmp_path):
    def nudge(content):
        content["pitch"].values[samples_of(content, 2)[100]] += 0.1

    other = changed_observations(swift, tmp_path / swift.name, nudge)
    answer = program("run-mission", other, *WHOLE, "--store", own_copy, "--resume")
    assert answer.status == 0, answer.err
    assert "2 profiles are valid; to be computed: 1 made with another record" in answer.err
    with open_observations(other) as observations:
        assert xr.open_datatree(own_copy, engine="zarr").attrs["observations_digest"] == observations.digest()
    store = tmp_path / "again.zarr"
    assert program("run-mission", other, *WHOLE, "--store", store).status == 0
    assert archive_bytes(own_copy) == archive_bytes(store)


def test_archives_of_the_same_file_under_two_names_are_equal(swift_store, own_copy):
    set_attributes(own_copy, {"observations": "renamed.nc"})
    assert program("compare", swift_store, own_copy).status == 0
    set_attributes(own_copy, {"observations_digest": "0" * 64})
    answer = program("compare", swift_store, own_copy)
    assert answer.status == 1
    assert "renamed.nc" in answer.out


@pytest.mark.damages_archive
def test_resume_refuses_an_archive_of_another_schema(swift, own_copy):
    set_attributes(own_copy, {"schema_version": "1.0"})
    answer = program("run-mission", swift, *WHOLE, "--store", own_copy, "--resume")
    assert answer.status == 2
    assert "another schema version" in answer.line


def test_resume_tries_failed_profiles_again_and_leaves_done_ones(swift, tmp_path):
    """A profile that failed by chance succeeds the second time; here, the marker is changed to a failure."""
    store = tmp_path / "failed.zarr"
    with open_observations(swift) as observations:
        prepared = prepare_mission(observations, PETREL, MissionSettings())
        run_mission(prepared, store, lambda: local_executor(0))
        rows, commit = ArchiveRows(store), read_commits(store)[2]
        rows.begin(2)
        rows.commit(2, {"status": "failed", "message": "no reason"}, commit.inputs, "2026-01-01T00:00:00Z")
        result = run_mission(prepared, store, lambda: local_executor(0), existing=Existing.RESUME)
    assert result.reused == (1, 2)
    assert result.failed == ()
    assert committed_rows(store)[2]["status"] == "done"


@pytest.fixture
def earlier(swift, tmp_path):
    """Return the swift mission's file without its last profile."""

    def first_two(content):
        begin = samples_of(content, 3)[0]
        return content.isel(time=slice(0, begin), fix=content["fix_time"].values < content["time"].values[begin])

    return changed_observations(swift, tmp_path / "earlier.nc", first_two)


@pytest.mark.long
def test_append_adds_what_the_file_has_gained(swift, swift_store, earlier, tmp_path):
    store = tmp_path / "growing.zarr"
    assert program("run-mission", earlier, *WHOLE, "--store", store).status == 0
    assert program("analyze", store, "reconstruction", "--workers", 0).status == 0
    answer = program("run-mission", swift, *WHOLE, "--store", store, "--resume")
    assert answer.status == 2
    assert "add new ones with --append" in answer.err
    answer = program("run-mission", swift, *WHOLE, "--store", store, "--append")
    assert answer.status == 0, answer.err
    assert "2 profiles are valid; to be computed: 1 missing" in answer.err
    assert "profile 3 done" in answer.err
    assert "profile 2 done" not in answer.err
    assert program("check", store, "--deep").status == 0
    assert program("compare", store, swift_store).status == 0
    with xr.open_datatree(store, engine="zarr") as tree:
        assert list(tree["reconstruction"]["profile"].values) == [1, 2, 3]
        assert tree["reconstruction"].attrs["outdated"] == "made before 1 profile was recomputed or added"
        assert np.isfinite(tree["reconstruction"].ds["steady_pitch"].sel(profile=2))
        assert np.isnan(tree["reconstruction"].ds["steady_pitch"].sel(profile=3))
    assert "made before 1 profile" in " ".join(program("info", store).out.split())
    answer = program("run-mission", swift, *WHOLE, "--store", store, "--append")
    assert "3 profiles are valid; nothing to compute" in answer.err


@pytest.fixture
def other_fixes(swift, tmp_path):
    """Observation file of the swift mission with another fix after its last dive, and the archive of a fresh run."""

    def move_the_last(content):
        content["fix_latitude"].values[-1] += 2e-4

    path, whole = changed_observations(swift, tmp_path / "fixes.nc", move_the_last), tmp_path / "whole.zarr"
    assert program("run-mission", path, *WHOLE, "--store", whole).status == 0
    return path, whole


def test_other_fixes_change_the_currents_alone(other_fixes, swift_store, tmp_path, monkeypatch):
    """Nothing is inverted again, and the archive is that of a fresh run."""
    path, whole = other_fixes
    store = tmp_path / "amended.zarr"
    shutil.copytree(swift_store, store)

    def estimates(profiles, *_, **__):
        assert list(profiles) == []
        return iter(())

    monkeypatch.setattr("gliderhpc.mission.jobs.estimate_profiles", estimates)
    answer = program("run-mission", path, *WHOLE, "--store", store, "--resume")
    assert answer.status == 0, answer.err
    assert "2 profiles are valid; to be computed: 1 made with other fixes" in answer.err
    assert "profile 3: only its fixes have changed" in answer.err
    assert program("check", store, "--deep").status == 0
    assert program("compare", store, whole).status == 0
    assert program("compare", store, swift_store).status == 1
    again = program("run-mission", path, *WHOLE, "--store", store, "--resume")
    assert "3 profiles are valid; nothing to compute" in again.err


def test_a_fix_that_is_gone_takes_its_current_along(swift, swift_store, tmp_path):
    """The current, the drift of its cycles and the columns of that fix are missing, as in a fresh run."""
    path, whole, store = tmp_path / "gone.nc", tmp_path / "whole.zarr", tmp_path / "amended.zarr"
    with xr.open_dataset(swift, decode_times=False) as content:
        content.isel(fix=content["fix_time"].values <= content["time"].values[-1]).to_netcdf(path)
    assert program("run-mission", path, *WHOLE, "--store", whole).status == 0
    shutil.copytree(swift_store, store)
    answer = program("run-mission", path, *WHOLE, "--store", store, "--resume")
    assert answer.status == 0, answer.err
    assert "profile 3: only its fixes have changed" in answer.err
    assert program("check", store, "--deep").status == 0
    assert program("compare", store, whole).status == 0
    with xr.open_datatree(store, engine="zarr") as tree:
        assert np.isnan(tree["dac_north"].sel(profile=3))
        assert np.isnan(tree["drift_current"]["north"].sel(profile=3)).all()


def test_stored_tracks_of_another_form_are_not_used(other_fixes, swift_store, tmp_path):
    path, whole = other_fixes
    store = tmp_path / "foreign.zarr"
    shutil.copytree(swift_store, store)
    commit = read_commits(store)[2]
    rows = ArchiveRows(store)
    rows.begin(2)
    rows.commit(2, commit.row, commit.inputs, "2026-01-01T00:00:00Z", extra={"other": 1}, amended=commit.manifest)
    answer = program("run-mission", path, *WHOLE, "--store", store, "--resume")
    assert answer.status == 0, answer.err
    assert "its currents cannot be updated" in answer.err
    assert program("compare", store, whole).status == 0


def test_a_run_that_ends_before_the_currents_are_derived_leaves_the_profile_missing(
    other_fixes, swift_store, tmp_path, monkeypatch
):
    path, whole = other_fixes
    store = tmp_path / "stopped.zarr"
    shutil.copytree(swift_store, store)
    with monkeypatch.context() as patch:
        patch.setattr("gliderhpc.mission.run.profile_results", lambda *_: iter(()))
        program("run-mission", path, *WHOLE, "--store", store, "--resume")
    assert set(read_commits(store)) == {0, 1}
    assert program("run-mission", path, *WHOLE, "--store", store, "--resume").status == 0
    assert program("compare", store, whole).status == 0


def test_a_damaged_profile_with_other_fixes_is_inverted_again(other_fixes, swift_store, tmp_path):
    path, whole = other_fixes
    store = tmp_path / "damaged.zarr"
    shutil.copytree(swift_store, store)
    (store / "series" / "B_cu" / "c.2.0").unlink()
    answer = program("run-mission", path, *WHOLE, "--store", store, "--resume")
    assert answer.status == 0, answer.err
    assert program("check", store, "--deep").status == 0
    assert program("compare", store, whole).status == 0


def test_rows_grow_with_a_longer_profile(swift, tmp_path):
    """The archive of a shorter profile has shorter rows; rows of a longer profile continue in further chunks."""

    def shorten_the_first(content):
        content["profile"].values[samples_of(content, 1)[-30:]] = 0

    path = changed_observations(swift, tmp_path / "uneven.nc", shorten_the_first)
    store, whole = tmp_path / "grown.zarr", tmp_path / "whole.zarr"
    assert program("run-mission", path, *WHOLE, "--store", store, "--profiles", "1").status == 0
    answer = program("run-mission", path, *WHOLE, "--store", store, "--append", "--profiles", "1:2")
    assert answer.status == 0, answer.err
    assert "1 profile is valid; to be computed: 1 missing" in answer.err
    assert program("run-mission", path, *WHOLE, "--store", whole, "--profiles", "1:2").status == 0
    assert program("check", store, "--deep").status == 0
    assert program("compare", store, whole).status == 0
    assert (store / "series" / "B_cu" / "c.1.1").exists()
    assert not (whole / "series" / "B_cu" / "c.1.1").exists()


def test_append_refuses_what_is_no_continuation(swift, own_copy):
    answer = program("run-mission", swift, *WHOLE, "--store", own_copy, "--append", "--profiles", "2:3")
    assert answer.status == 2
    assert "append only adds profiles after number 3" in answer.line


def test_compare_says_what_differs(swift_store, own_copy):
    assert program("compare", swift_store, own_copy).status == 0
    series = zarr.open_group(own_copy, mode="r+")["series"]
    rows = ArchiveRows(own_copy)
    commit, depth = read_commits(own_copy)[1], series["depth"][1]
    rows.begin(1)
    rows.write(1, "series", {"depth": depth + 1.0})
    rows.commit(1, dict(commit.row), commit.inputs, "2026-01-01T00:00:00Z")
    set_attributes(own_copy, {"engine": "scipy"})
    answer = program("compare", swift_store, own_copy)
    assert answer.status == 1
    assert "engine: lanes and scipy" in answer.out
    assert "series/depth: differs in 1 profile (2), by 1 at most" in answer.out
    assert "series/B_cu: differs in 1 profile (2), " in answer.out
    assert "values missing in only one of the two" in answer.out
    assert "2 profiles are the same" in answer.out


def test_overwrite_starts_again_and_nothing_else_does(swift, own_copy):
    before = archive_bytes(own_copy, ())
    answer = program("run-mission", swift, *WHOLE, "--store", own_copy, "--profiles", "2")
    assert answer.status == 2
    assert "this archive exists; finish it with --resume or start again with --overwrite" in answer.line
    assert archive_bytes(own_copy, ()) == before
    answer = program("run-mission", swift, *WHOLE, "--store", own_copy, "--profiles", "2", "--overwrite")
    assert answer.status == 0
    with xr.open_datatree(own_copy, engine="zarr") as tree:
        assert list(tree["profile"].values) == [2]


# Planning


@pytest.mark.parametrize(
    ("text", "chosen"),
    [
        (None, (1, 2, 3, 18, 19, 20, 68)),
        ("18:20,68", (18, 19, 20, 68)),
        ("68, 1", (1, 68)),
        ("4:18", (18,)),
        ("18-20", (18, 19, 20)),
    ],
)
def test_profiles_are_chosen_by_numbers_and_ranges(text, chosen):
    available = [68, 1, 2, 3, 18, 19, 20]
    assert select_profiles(available, text) == chosen
    assert select_profiles(available, as_ranges(chosen)) == chosen


@pytest.mark.parametrize(
    "text", ["", "a", "1:", "3-", "3-2", "5:1", "4", "4:9", "1,,2", "-1", pytest.param("1" * 5000, id="digits")]
)
def test_profiles_that_cannot_be_chosen(text):
    with pytest.raises(InputError, match="`profiles="):
        select_profiles([1, 2, 3, 18], text)


def test_a_range_of_profiles_that_runs_backwards_is_named():
    with pytest.raises(InputError, match="`profiles=1,3:2`: the range 3:2 runs backwards: write 2:3"):
        select_profiles([1, 2, 3], "1,3:2")


def test_a_dry_run_reports_the_size_and_writes_nothing(brief, brief_store, tmp_path):
    store = tmp_path / "dry.zarr"
    answer = program("run-mission", brief, *WHOLE, "--store", store, "--dry-run")
    assert answer.status == 0
    assert answer.out.startswith("3 profiles, 0.")
    assert all(word in answer.out for word in ("min on", "of memory per worker", "of disk"))
    assert not store.exists()


def test_the_plan_follows_engine_and_batch(brief):
    """More profiles at a time need more memory; the engine determines the time and the number of profiles."""
    with open_observations(brief) as observations:
        plan = replace(plan_mission(observations, MissionSettings(), (1, 2, 3)), longest=100_000)
    whole = replace(plan, profiles=tuple(range(1, 566)), steps=56_800_000)

    def figure_of(text, unit):
        return float(re.search(rf"([\d.]+) {unit}", text)[1])

    lanes, scipy = (
        whole.describe(MissionSettings(engine=engine), 2) for engine in ("lanes", "scipy")
    )  # fmt: skip
    assert figure_of(lanes, "min on") < figure_of(scipy, "min on")
    assert figure_of(lanes, "GB of memory") == pytest.approx(0.32 + 1e-4 * (2 * LANES * 300 + 4500), abs=0.01)
    assert figure_of(scipy, "GB of memory") == pytest.approx(0.32 + 1e-4 * (300 + 4500), abs=0.01)
    few = plan.describe(MissionSettings(), 2)
    assert figure_of(few, "GB of memory") == pytest.approx(0.32 + 1e-4 * (2 * 300 + 4500), abs=0.01)
    assert "on 2 workers" in few
    assert "on 1 worker, " in replace(plan, profiles=(1,)).describe(MissionSettings(), 8)


@pytest.mark.parametrize(("profiles", "workers"), [(565, 2), (565, 16), (64, 16), (64, 4), (6, 2), (3, 8), (1, 1)])
@pytest.mark.parametrize("engine", ["lanes", "scipy"])
def test_workers_end_at_about_the_same_time(profiles, workers, engine):
    """Batches that are taken in turn keep every worker busy until few profiles are left."""
    sizes = batch_sizes(MissionSettings(engine=engine), profiles, workers)
    assert sum(sizes) == profiles
    assert sizes == sorted(sizes, reverse=True)
    assert max(sizes) <= MAX_BATCH[engine]
    busy = [0] * workers
    for size in sizes:
        busy[busy.index(min(busy))] += size
    assert max(busy) - min(busy) <= 1


def test_batches_fill_the_lanes_while_there_is_enough_to_do():
    sizes = batch_sizes(MissionSettings(), 565, 16)
    assert all(size >= LANES for size in sizes if sum(sizes[sizes.index(size) :]) > 16 * LANES)
    assert batch_sizes(MissionSettings(), 0, 4) == []


def test_the_planned_sizes_match_the_archive(brief, archive):
    with open_observations(brief) as observations:
        plan = plan_mission(observations, MissionSettings(), (1, 2, 3))
    assert plan.sizes["sample"] == archive["series"].sizes["sample"] == plan.longest + 1
    assert plan.sizes["window"] == archive["windows"].sizes["window"]
    assert (archive["window_count"].values <= plan.sizes["window"]).all()
    finite = np.isfinite(archive["series"].ds["depth"].values).sum()
    assert finite == plan.steps + 3


def test_default_workers_are_the_cores_at_hand():
    assert default_workers() >= 1


# Settings


def test_assignments_reach_their_settings():
    settings, platform = parse_assignments(["window.length=60", "platform.buoyancy.neutral_volume=-215", "step = 0.2"])
    assert platform == {"buoyancy.neutral_volume": "-215"}
    built = build_settings({"preset": "paper"}, settings)
    assert (built.preset, built.window.length, built.step) == ("paper", 60.0, 0.2)
    assert built.window.cost_threshold == 0.2
    assert build_settings({}, {"max_gap": "null"}).max_gap is None


@pytest.mark.parametrize(
    ("assignment", "message"),
    [
        (
            "windows.length=60",
            r"no such setting, did you mean 'window\.length'\?; the settings of window are [^;]*window\.length",
        ),
        ("window=60", "no such setting"),
        ("window.length=true", "length is true, but must be a number"),
        ("window.length=-1", "greater than 0"),
        ("window.length=long", "valid number"),
        ("window.length=.nan", "finite number"),
        ("window.length=[1", "neither a number nor a word"),
        ("step=0.3", "less than or equal to 0.25"),
        ("output_interval=0.25", "multiple of step"),
        ("optimizer.max_iterations=2.5", "valid integer"),
        ("preset=best", "'recommended' or 'paper'"),
        ("engine=ipopt", "'lanes', 'scipy' or 'fortran'"),
    ],
)
def test_assignments_that_cannot_be_used(assignment, message):
    settings, _ = parse_assignments([assignment])
    with pytest.raises(InputError, match=message) as refusal:
        build_settings({}, settings)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize("text", ["window.length", "=3", ""])
def test_assignments_need_a_key_and_a_value(text):
    with pytest.raises(InputError, match="KEY=VALUE"):
        parse_assignments([text])


@pytest.mark.parametrize(("unlike", "converged", "advised"), [(3, 0.6, True), (2, 0.6, False), (3, 1.0, False)])
def test_a_mission_in_rough_water_is_advised_to_tune_its_prior(caplog, unlike, converged, advised):
    """Rough water: the usual prior fits few profiles, few windows converge, and the hull has no prior of its own."""
    caplog.set_level("INFO")
    rows = {
        n: {"status": "done", "disturbance_prior": int(n <= unlike), "converged_fraction": converged}
        for n in range(1, 5)
    }
    _advise_to_tune(read_platform("petrel-l"), MissionResult(rows=rows | {5: {"status": "failed"}}))
    assert ("in 3 of 4 profiles the usual disturbance prior does not fit; `gliderhpc tune`" in caplog.text) is advised
    prior = DisturbancePrior(deviation=(0.1,) * 6, correlation_time=(60.0,) * 6)
    caplog.clear()
    _advise_to_tune(read_platform("petrel-l").model_copy(update={"prior": prior}), MissionResult(rows=rows))
    assert not caplog.messages


def test_settings_of_passes_that_are_not_made_are_warned_of(caplog):
    """Slow records of a hull without its own prior are smoothed in one pass."""
    settings = build_settings({}, {"smoother.tolerance": "0.01"})
    _warn_about_unused_settings(read_platform("petrel-l"), settings)
    _warn_about_unused_settings(read_platform("seaglider"), build_settings({}, {}))
    assert not caplog.messages
    _warn_about_unused_settings(read_platform("seaglider"), settings)
    assert caplog.messages[0].startswith("smoother.tolerance: no effect, because the smoother does not iterate")
