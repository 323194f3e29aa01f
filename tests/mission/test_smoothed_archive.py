"""Smoothed estimate in the archive: stored values, windows that start from it, and studies of it."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
import zarr
from support.archives import put_table_rows
from support.missions import CHANNELS, archive_bytes, profile_series, program

from gliderhpc.archive.mission import open_mission
from gliderhpc.archive.profile import read_profile_data, truth_on_samples
from gliderhpc.errors import ProfileError
from gliderhpc.estimation import profile as estimation
from gliderhpc.estimation.current_errors import CurrentErrors, Drift, current_uncertainty
from gliderhpc.estimation.currents import surface_drift
from gliderhpc.estimation.filter import run_filter
from gliderhpc.estimation.preparation import prepare_profile
from gliderhpc.estimation.profile import estimate_profile, estimate_profiles
from gliderhpc.estimation.quality import remarks
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.estimation.smoother import iterate
from gliderhpc.estimation.smoother.iterate import run_smoother
from gliderhpc.estimation.smoother.posterior import adjoint_deviation
from gliderhpc.flight.glider import Glider
from gliderhpc.mission.profile_rows import STATES, hull_row
from gliderhpc.mission.warm import warm_kernels
from gliderhpc.observations import open_observations
from gliderhpc.observations.truth import read_profile_truth, truth_path
from gliderhpc.outcomes import Outcome
from gliderhpc.platform import read_platform
from gliderhpc.store_schema import OUTCOME, check_archive, consolidate
from gliderhpc.studies.archived import platform_of
from gliderhpc.studies.library.tracks import anchored_tracks, motions_of
from gliderhpc.vocabulary import NOISE_ASSUMPTIONS

pytestmark = pytest.mark.compiled

PETREL = read_platform("petrel-l")
GLIDER = Glider(PETREL)
SETTINGS = EstimationSettings()
EVERY = SETTINGS.steps_per_record
ANGLES = ("roll", "pitch", "heading", "p", "q", "r")


def run(observations, store, *arguments):
    answer = program(
        "run-mission", observations, "--platform", "petrel-l", "--workers", 0, "--store", store, *arguments
    )
    assert answer.status == 0, answer.err
    return answer


@pytest.fixture(scope="module")
def prepared(brief):
    return prepare_profile(GLIDER, profile_series(brief, 1, SETTINGS))


@pytest.fixture(scope="module")
def filtered(prepared):
    return run_filter(prepared, SETTINGS)


@pytest.fixture(scope="module")
def smoothed(prepared, filtered):
    return run_smoother(prepared, filtered, SETTINGS)


@pytest.fixture(scope="module")
def carried(prepared):
    """Return the estimate on the records, with the hull's part of its uncertainty."""
    return estimate_profile(prepared, SETTINGS, with_hull=True)


@pytest.fixture(scope="module")
def group(brief_store):
    with xr.open_datatree(brief_store, engine="zarr") as tree:
        return tree["smoothed"].ds.load()


# Stored values


def test_the_archive_holds_the_smoother_s_records(group, smoothed, carried):
    """Each record contains the state at its time and the disturbance of the step that starts there."""
    row, on_records = group.sel(profile=1), carried.smoothed
    records = len(on_records.states)
    assert smoothed.outcome is Outcome.CONVERGED
    np.testing.assert_array_equal(on_records.states, smoothed.states[::EVERY])
    np.testing.assert_array_equal(on_records.disturbances, smoothed.disturbances[::EVERY])
    assert (on_records.disturbances_std > smoothed.disturbances_std[::EVERY]).all()
    for channel, name in enumerate(CHANNELS):
        for values, stored in (
            (on_records.disturbances, row[name]), (on_records.disturbances_std, row[f"{name}_std"]),
            (on_records.standardised_noise, row[f"{name}_noise"]),
        ):  # fmt: skip
            np.testing.assert_allclose(stored.values[: len(values)], values[:, channel], rtol=1e-6)
    for column, name in enumerate(STATES):
        unit = np.degrees(1.0) if name in ANGLES else 1.0
        value, deviation = unit * on_records.states[:, column], unit * on_records.states_std[:, column]
        off = row[name].values[:records] - value
        off = np.mod(off + 180.0, 360.0) - 180.0 if name == "heading" else off
        np.testing.assert_allclose(off, 0.0, atol=2e-7 * max(1.0, np.abs(value).max()) + 3e-5)
        np.testing.assert_allclose(row[f"{name}_std"].values[:records], deviation, rtol=1e-6)
        assert np.isnan(row[name].values[records:]).all()


def test_the_adjoint_s_deviations_contain_the_smoother_s_and_the_difference(brief_store, carried):
    every, on_records = EVERY, carried.smoothed
    expected = adjoint_deviation(carried.solution, on_records, every, SETTINGS.output_interval)
    assert (expected >= on_records.disturbances_std).all()
    apart = np.mean((carried.solution.disturbances[::every] - on_records.disturbances) ** 2, axis=0)
    gained = np.mean(expected**2 - on_records.disturbances_std**2, axis=0)
    np.testing.assert_allclose(gained, apart, rtol=0.05)
    with xr.open_datatree(brief_store, engine="zarr") as tree:
        row = tree["state"].ds.sel(profile=1).load()
    for channel, name in enumerate(CHANNELS):
        stored = row[f"{name}_std"].values
        np.testing.assert_allclose(stored[: len(expected)], expected[:, channel], rtol=1e-6)
        assert np.isnan(stored[len(expected) :]).all()


def test_intervals_of_the_adjoint_cover_the_truth_at_their_nominal_rate(prepared, brief, brief_store):
    """Windows of preset paper are far from the smoother: its own deviation is too small for them."""
    smoother = SETTINGS.smoother.model_copy(update={"hull": "believed"})
    settings = SETTINGS.model_copy(update={"preset": "paper", "smoother": smoother})
    found = estimate_profile(prepared, settings, with_hull=True)
    with open_mission(brief_store) as archive:
        data = read_profile_data(archive, 1)
        true = truth_on_samples(data, read_profile_truth(truth_path(brief), 1))
    steady = data.steady[:-1:EVERY]
    # The lateral disturbances of this mission are zero but for the yaw's impulses.
    longitudinal = np.ix_(steady, [0, 2, 4])
    error = np.abs(found.solution.disturbances - true[:-1])[::EVERY][longitudinal]
    deviation = adjoint_deviation(found.solution, found.smoothed, EVERY, SETTINGS.output_interval)[longitudinal]
    for width, low, high in ((0.9945, 0.62, 0.8), (1.96, 0.92, 0.99)):
        assert low < np.mean(error < width * deviation) < high
        assert np.mean(error < width * found.smoothed.disturbances_std[longitudinal]) < low - 0.2


def test_records_are_those_of_the_state(group, brief_store):
    with xr.open_datatree(brief_store, engine="zarr") as tree:
        np.testing.assert_array_equal(group["time"].values, tree["state"].ds["time"].values)
    assert (group["heading"].values[np.isfinite(group["heading"])] >= 0.0).all()


def test_the_group_s_table_says_how_it_went(group, smoothed, carried):
    row = group.sel(profile=1)
    assert group["outcome"].attrs["flag_meanings"] == " ".join(OUTCOME.meanings)
    assert group["outcome"].values.tolist() == [0, 0, 0]
    assert row["passes"] == smoothed.passes
    assert row["cost"] == smoothed.cost
    covariance = carried.smoothed.displacement_covariance
    np.testing.assert_allclose(row["displacement_covariance"], covariance[0, 1])
    np.testing.assert_allclose(row["displacement_north_std"] ** 2, covariance[0, 0])
    np.testing.assert_allclose(row["displacement_east_std"] ** 2, covariance[1, 1])
    np.testing.assert_allclose(
        [row["displacement_north"], row["displacement_east"]], smoothed.states[-1, 3:5] - smoothed.states[0, 3:5]
    )


def test_the_current_by_the_smoother(brief_store, brief, group):
    """It follows from displacement, fixes and surface drift, and is within four deviations of the truth."""
    options = CurrentErrors()
    with xr.open_datatree(brief_store, engine="zarr") as tree:
        table = tree.to_dataset().load()
    for number in (1, 2, 3):
        row, of_group = table.sel(profile=number), group.sel(profile=number)
        elapsed = float((row["exit_time"] - row["entry_time"]) / np.timedelta64(1, "s"))
        elapsed -= float(row["entry_surface_time"] + row["exit_surface_time"])
        with open_observations(brief) as observations:
            record = observations.profile(number)
        variance = 0.0
        for end, fixes in (("entry", record.surface_fixes_before), ("exit", record.surface_fixes_after)):
            drift, drift_removed = surface_drift(fixes), float(row[f"{end}_surface_time"])
            carried, rest = drift_removed / drift.duration, drift_removed / drift.weight(options) - drift_removed
            variance += options.fix_error**2 * ((1.0 + carried) ** 2 + carried**2)
            variance += (options.surface_shear * rest) ** 2
        own = np.array([[of_group["displacement_north_std"] ** 2, of_group["displacement_covariance"]],
                        [of_group["displacement_covariance"], of_group["displacement_east_std"] ** 2]])  # fmt: skip
        track = np.array([float(of_group["displacement_north"]), float(of_group["displacement_east"])])
        velocity = np.array([float(row["dac_north_smoothed"]), float(row["dac_east_smoothed"])])
        apart = np.array([float(row["dac_north_filter"]), float(row["dac_east_filter"])]) - velocity
        drift = Drift(velocity, track, elapsed, variance, 0.0, own, apart, with_hull=True)
        terms = current_uncertainty(drift, options)
        assert (terms.axial, terms.magnitude, terms.heading) == (0.0, 0.0, 0.0)
        assert float(row["dac_north_smoothed_std"]) == pytest.approx(np.sqrt(terms.covariance[0, 0]))
        assert float(row["dac_smoothed_covariance"]) == pytest.approx(terms.covariance[0, 1])
        truth = read_profile_truth(truth_path(brief), number)
        for name in ("north", "east"):
            error = float(row[f"dac_{name}_smoothed"] - truth[f"current_{name}"])
            assert abs(error) < 4.0 * float(row[f"dac_{name}_smoothed_std"])
    assert "speed and course" in table["dac_north_smoothed_std"].attrs["long_name"]


def test_the_group_of_the_hull(brief_store, carried, group):
    """It contains the dive's information on its hull, without inactive parameters, and the hull's covariances."""
    with xr.open_datatree(brief_store, engine="zarr") as tree:
        row = tree["hull"].ds.sel(profile=1).load()
    hull = carried.hull
    names = list(hull.information.names)
    acting = row.sel(parameter=names, other_parameter=names)
    np.testing.assert_allclose(acting["score"], hull.information.score)
    np.testing.assert_allclose(acting["information"], hull.information.information)
    for noise, (score, matrix) in zip(NOISE_ASSUMPTIONS, hull.information.others, strict=True):
        np.testing.assert_allclose(acting["score_other"].sel(noise=noise), score)
        np.testing.assert_allclose(acting["information_other"].sel(noise=noise), matrix)
    np.testing.assert_allclose(acting["displacement_sensitivity"], hull.information.displacement)
    np.testing.assert_allclose(acting["estimate_alone_std"], np.sqrt(np.diag(hull.errors.covariance)))
    assert np.isnan(row["score"].sel(parameter="viscous.K_delta"))
    assert float(row["value"].sel(parameter="viscous.K_D0")) == GLIDER.platform.viscous.K_D0
    assert row["variance_share"].sel(quantity="B_cu") > 0.5
    north = float(group["displacement_north_std"].sel(profile=1)) ** 2
    part = float(row["displacement_covariance"].sel(component="north", other_component="north"))
    assert 0.5 * north < part < north


@pytest.mark.parametrize("how", ["not finite", "negative"])
def test_intervals_keep_the_hull_s_part_where_the_dive_says_nothing(prepared, carried, smoothed, monkeypatch, how):
    """The hull's deviations are then those of the platform file, without the information of the dive."""
    real = estimation.smoothed_hull_information

    def lost(*given):
        found = real(*given)
        if how == "not finite":
            return replace(found, score=np.full_like(found.score, np.nan))
        return replace(found, information=found.information - 10.0 * np.eye(len(found.score)))

    monkeypatch.setattr(estimation, "smoothed_hull_information", lost)
    found = estimate_profile(prepared, SETTINGS, with_hull=True)
    assert (found.smoothed.states_std[50:, 6] > carried.smoothed.states_std[50:, 6]).all()
    assert (found.smoothed.states_std[50:, 6] > smoothed.states_std[::EVERY][50:, 6]).all()
    row = hull_row(found.hull)
    assert all(np.isnan(row[name]).all() for name in ("score", "information", "information_other"))
    assert np.isnan(row["estimate_alone_std"]).all()
    assert np.isfinite(row["displacement_covariance"]).all()


def test_a_dive_that_fails_under_another_noise_narrows_its_own_intervals_alone(prepared, carried, monkeypatch):
    real = estimation.smoothed_hull_information

    def corrupted(*given):
        found = real(*given)
        (score, matrix), *others = found.others
        return replace(found, others=((score, matrix - 10.0 * np.eye(len(score))), *others))

    monkeypatch.setattr(estimation, "smoothed_hull_information", corrupted)
    found = estimate_profile(prepared, SETTINGS, with_hull=True)
    np.testing.assert_array_equal(found.smoothed.states_std, carried.smoothed.states_std)
    assert np.isnan(hull_row(found.hull)["score"]).all()


def test_the_published_budget_of_the_current_stays_available(brief, brief_store, tmp_path):
    """It has the published terms, and the smoother's uncertainty without the hull; the currents are the same."""
    store = tmp_path / "published.zarr"
    run(brief, store, "--set", "current.budget=published", "--profiles", "1")
    with xr.open_datatree(store, engine="zarr") as tree, xr.open_datatree(brief_store, engine="zarr") as before:
        table, usual = (one.to_dataset().sel(profile=1).load() for one in (tree, before))
    for name in ("dac_north", "dac_east"):
        assert float(table[name]) == float(usual[name])
        assert float(table[f"{name}_std"]) > 0.05
        assert float(usual[f"{name}_std"]) < 0.04


def test_a_hull_assumed_exact_adds_no_uncertainty(prepared, smoothed):
    smoother = SETTINGS.smoother.model_copy(update={"hull": "believed"})
    found = estimate_profile(prepared, SETTINGS.model_copy(update={"smoother": smoother}), with_hull=True)
    assert found.hull is None
    np.testing.assert_array_equal(found.smoothed.states_std, smoothed.states_std[::EVERY])


def test_the_smoother_leaves_the_adjoint_alone(brief, brief_store):
    """Windows and filter in the archive equal those of a single profile whose smoother computes only a path."""
    alone = estimate_profile(prepare_profile(GLIDER, profile_series(brief, 1, SETTINGS)), SETTINGS)
    assert alone.solution.from_smoothed
    assert alone.hull is None
    with xr.open_datatree(brief_store, engine="zarr") as tree:
        stored, prior = (tree[name].ds.sel(profile=1).load() for name in ("series", "prior"))
    n = len(alone.solution.disturbances)
    for channel, name in enumerate(CHANNELS):
        for values, variable in ((alone.solution.disturbances, stored), (alone.filtered.disturbances, prior)):
            np.testing.assert_array_equal(variable[name].values[:n], values[:n, channel].astype(np.float32))


def test_a_profile_that_cannot_be_smoothed_is_done_all_the_same(brief, tmp_path, monkeypatch):
    def refuse(*_, **__):
        raise ProfileError("nothing to smooth")

    from_prior, store = tmp_path / "prior.zarr", tmp_path / "refused.zarr"
    run(brief, from_prior, "--start", "prior")
    monkeypatch.setattr(iterate, "pose_problem", refuse)
    run(brief, store)
    assert check_archive(store) == []
    with xr.open_datatree(store, engine="zarr") as tree, xr.open_datatree(from_prior, engine="zarr") as before:
        table, row = tree.to_dataset().load(), tree["smoothed"].ds.sel(profile=1).load()
        assert table["status"].values.tolist() == ["done"] * 3
        assert "the smoother has no estimate of this profile (nothing to smooth)" in str(table["message"].values[0])
        assert np.isnan(table["dac_north_smoothed"].values).all()
        assert row["outcome"] == Outcome.DIVERGED
        assert row["passes"] == 0
        prior = tree["prior"].ds["B_cr"].sel(profile=1).values[::EVERY]
        known = np.isfinite(row["B_cr"].values)
        assert known.sum() > 300
        np.testing.assert_array_equal(row["B_cr"].values[known], prior[: len(known)][known])
        assert np.isnan(row["B_cr_std"].values).all()
        assert np.isnan(tree["state"].ds["B_cr_std"].values).all()
        # Without a smoothed disturbance the windows start from the filter's.
        np.testing.assert_array_equal(tree["series"].ds["B_cr"].values, before["series"].ds["B_cr"].values)


def test_a_diverged_smoother_is_reported_in_the_message(prepared, filtered, monkeypatch):
    monkeypatch.setattr("gliderhpc.estimation.smoother.iterate._ACCEPTED_MOVE", 0.0)
    hasty = SETTINGS.model_copy(update={"smoother": SETTINGS.smoother.model_copy(update={"max_passes": 2})})
    hasty = hasty.model_copy(update={"start": "smoothed"})
    corrupted = replace(filtered, disturbances=filtered.disturbances + 0.5)
    starts = []
    monkeypatch.setattr(estimation, "run_filters_around_rests", lambda group, _: (group, [corrupted]))
    invert = estimation.invert_windows
    monkeypatch.setattr(estimation, "invert_windows", lambda *given: starts.append(given[-1]) or invert(*given))
    records = estimate_profile(prepared, hasty).smoothed
    assert records.outcome is Outcome.DIVERGED
    assert np.isnan(records.states_std).all()
    assert starts == [None], "the windows start from the filter's"


def test_a_dive_whose_noise_cannot_be_followed_is_smoothed_with_the_priors(prepared, filtered, monkeypatch):
    pose = iterate.pose_problem

    def only_steady(profile, estimate, settings, factor, **water):
        if settings.smoother.adaptive:
            raise ProfileError("no estimate")
        return pose(profile, estimate, settings, factor, **water)

    monkeypatch.setattr(iterate, "pose_problem", only_steady)
    smoothed = run_smoother(prepared, filtered, SETTINGS)
    assert "noise is the prior's" in smoothed.simplified
    assert smoothed.outcome.usable
    steady = SETTINGS.model_copy(update={"smoother": SETTINGS.smoother.model_copy(update={"adaptive": False})})
    np.testing.assert_array_equal(smoothed.disturbances, run_smoother(prepared, filtered, steady).disturbances)
    monkeypatch.setattr(estimation, "run_filters_around_rests", lambda group, _: (group, [filtered]))
    estimate = estimate_profile(prepared, SETTINGS)
    assert any(
        "the noise is the prior's, not fitted to the dive" in line for line in remarks(GLIDER.platform, estimate)
    )


def test_faults_of_the_program_are_not_hidden(prepared, filtered, monkeypatch):
    def fail(*_, **__):
        raise TypeError("a bug")

    monkeypatch.setattr(iterate, "pose_problem", fail)
    with pytest.raises(TypeError, match="a bug"):
        run_smoother(prepared, filtered, SETTINGS)


def test_only_records_are_stored(prepared):
    """The steps' arrays are freed with the smoother: 160 bytes per record remain of ten times as much."""
    records = estimate_profile(prepared, SETTINGS, with_hull=True).smoothed
    for values in (records.states, records.states_std, records.disturbances, records.disturbances_std):
        assert values.base is None
        assert len(values) <= len(prepared.series.time) // EVERY + 1


def test_the_smoother_s_kernels_are_compiled_beforehand(monkeypatch):
    smoothed = []
    real = estimation.run_smoother
    monkeypatch.setattr(estimation, "run_smoother", lambda *a: smoothed.append(real(*a)) or smoothed[-1])
    warm_kernels()
    assert len(smoothed) == 1
    assert smoothed[0].passes >= 1


# Windows that start from the estimate


@pytest.mark.parametrize("engine", ["lanes", "scipy"])
def test_windows_may_start_from_the_smoothed_disturbance(brief, engine, smoothed):
    series = profile_series(brief, 1, SETTINGS)
    estimates = {}
    for start in ("prior", "smoothed"):
        settings = EstimationSettings(engine=engine, start=start)
        ((_, estimates[start]),) = estimate_profiles([(1, prepare_profile(GLIDER, series))], settings)
    windows = {start: estimate.solution.windows for start, estimate in estimates.items()}
    assert estimates["smoothed"].smoothed is not None
    assert all(window.outcome is Outcome.CONVERGED for window in windows["smoothed"])
    iterations = {start: np.mean([window.iterations for window in of]) for start, of in windows.items()}
    assert iterations["smoothed"] < iterations["prior"]
    nearness = [
        np.abs(estimate.solution.disturbances - smoothed.disturbances).mean(axis=0)[5]
        for estimate in estimates.values()
    ]
    assert nearness[1] < nearness[0], "what the record leaves open stays as it was at the start"


def test_the_start_is_an_option_and_a_setting(brief, tmp_path):
    stores = tmp_path / "flag.zarr", tmp_path / "setting.zarr"
    run(brief, stores[0], "--profiles", 2, "--start", "smoothed")
    run(brief, stores[1], "--profiles", 2, "--set", "start=smoothed")
    assert archive_bytes(stores[0]) == archive_bytes(stores[1])
    attributes = dict(zarr.open_group(stores[0], mode="r").attrs)
    assert (attributes["settings"]["start"], attributes["start"]) == ("smoothed", "smoothed")
    refused = program("run-mission", brief, "--platform", "petrel-l", "--store", stores[0], "--set", "start=truth")
    assert refused.status == 2
    assert "'prior' or 'smoothed'" in refused.line


def test_the_start_follows_the_preset(brief_store):
    chosen = [EstimationSettings(preset=preset, start=start).starts_from for preset in ("recommended", "paper")
              for start in (None, "prior", "smoothed")]  # fmt: skip
    assert chosen == ["smoothed", "prior", "smoothed", "prior", "prior", "smoothed"]
    attributes = dict(zarr.open_group(brief_store, mode="r").attrs)
    assert (attributes["settings"]["start"], attributes["start"]) == (None, "smoothed")


# Studies of the estimate


def test_profile_data_of_either_estimate(brief_store, group):
    with open_mission(brief_store) as archive:
        adjoint, other = (read_profile_data(archive, 1, estimate) for estimate in ("adjoint", "smoothed"))
    row = group.sel(profile=1)
    n = len(adjoint.time) - 1
    np.testing.assert_array_equal(other.time, adjoint.time)
    assert (adjoint.disturbances_std[:n] >= other.disturbances_std[:n] * (1.0 - 1e-6)).all()
    with xr.open_datatree(brief_store, engine="zarr") as tree:
        stored = tree["state"].ds["B_cr_std"].sel(profile=1).values
    np.testing.assert_array_equal(adjoint.disturbances_std[:n:EVERY, 5], stored[: len(range(0, n, EVERY))])
    for data in (adjoint, other):
        assert np.isfinite(data.disturbances[:n]).all()
        assert np.isnan(data.disturbances[n]).all()
    for channel, name in enumerate(CHANNELS):
        known = np.isfinite(row[name].values)
        np.testing.assert_allclose(
            other.disturbances[:n:EVERY, channel], row[name].values[known][: len(range(0, n, EVERY))], rtol=1e-12
        )
        assert (other.disturbances_std[:n, channel] > 0.0).all()
    np.testing.assert_allclose(other.residuals, adjoint.residuals, atol=2.0)
    assert not np.array_equal(other.residuals, adjoint.residuals)


def test_the_smoothed_track_closes_on_the_fixes(brief_store):
    with open_mission(brief_store) as archive:
        data = read_profile_data(archive, 1, "smoothed")
        motions = motions_of(data, platform_of(archive))
        tracks = anchored_tracks(archive, data, motions.estimate, motions.glide_angle)
    velocity = (tracks.estimate[-1] - tracks.estimate[0] - motions.estimate.total) / data.record_time[-1]
    table = data.table
    before, after = (
        np.array([table[f"{end}_surface_{along}"] for along in ("north", "east")]) for end in ("entry", "exit")
    )
    lead = data.record_time[0] - tracks.fix_time[0] - table["entry_surface_time"]
    wait = tracks.fix_time[1] - data.record_time[-1] - table["exit_surface_time"]
    assert np.linalg.norm(before) > 0.0
    np.testing.assert_allclose(tracks.estimate[0], before + lead * velocity, atol=1e-6)
    np.testing.assert_allclose(tracks.estimate[-1] + wait * velocity + after, tracks.fixes[1], atol=1e-6)


@pytest.fixture
def own_copy(brief_store, tmp_path):
    return shutil.copytree(brief_store, tmp_path / "copy.zarr")


@pytest.mark.long
def test_studies_of_both_estimates_do_not_mix(own_copy, brief):
    """The files of both exist together; the group is replaced, and the command reports it."""
    adjoint = program("analyze", own_copy, "reconstruction", "--workers", 0, "--quick")
    truth = truth_path(brief)
    other = program(
        "analyze", own_copy, "reconstruction", "--workers", 0, "--quick", "--estimate", "smoothed", "--truth", truth,
        "--observations", brief,
    )  # fmt: skip
    assert (adjoint.status, other.status) == (0, 0), other.err
    assert "replaces" not in adjoint.out
    assert "held the study of the adjoint estimate; this one replaces it" in other.out
    assert "compared with the adjoint, so there is none here" in other.out
    assert "smoother" in other.out
    assert "smoother" not in adjoint.out
    assert check_archive(own_copy) == []
    with xr.open_datatree(own_copy, engine="zarr") as tree:
        study = tree["reconstruction"].ds.load()
    assert study.attrs["estimate"] == "smoothed"
    assert np.isfinite(study["yaw_smoothed_resting_std"].values).all()
    assert np.isnan(study["yaw_adjoint_resting_std"].values).all()
    folder = own_copy.with_name("copy-studies")
    contents = {
        name: json.loads((folder / name / "reconstruction.json").read_text())
        for name in ("reconstruction", "reconstruction-smoothed")
    }
    assert [content["facts"]["estimate"] for content in contents.values()] == ["adjoint", "smoothed"]
    again = program("analyze", own_copy, "reconstruction", "--workers", 0, "--quick")
    assert "held the study of the smoothed estimate" in again.out


@pytest.mark.damages_archive
def test_the_adjoint_of_an_earlier_archive_has_no_deviations(own_copy):
    root = zarr.open_group(own_copy, mode="r+", use_consolidated=False)
    for name in CHANNELS:
        del root[f"state/{name}_std"]
    consolidate(own_copy)
    with open_mission(own_copy) as archive:
        assert np.isnan(read_profile_data(archive, 1).disturbances_std).all()


@pytest.mark.damages_archive
def test_an_archive_without_a_smoothed_estimate_is_refused(own_copy):
    root = zarr.open_group(own_copy, mode="r+", use_consolidated=False)
    del root["smoothed"]
    consolidate(own_copy)
    answer = program("analyze", own_copy, "reconstruction", "--workers", 0, "--estimate", "smoothed")
    assert answer.status == 2
    assert "no group 'smoothed'; run the mission again" in answer.line


def test_profiles_without_a_smoother_are_named(own_copy):
    put_table_rows(own_copy, {1: {"smoothed/outcome": OUTCOME.meanings["diverged"]}})
    answer = program("analyze", own_copy, "reconstruction", "--workers", 0, "--estimate", "smoothed", "--quick")
    assert answer.status == 0
    assert "where the smoother has no estimate, that of the filter is used: profile 2" in answer.out
