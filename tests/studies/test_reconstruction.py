"""Study `reconstruction`: known residuals, lags and impulses are recovered; the command from archive to files."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from support.archives import (
    CHANNELS,
    STEP,
    STEPS,
    Content,
    put_profile,
    put_table_rows,
    start_of,
    true_disturbances,
    truth_of,
    write_archive,
    write_profile,
    write_truth_file,
)
from support.missions import program
from support.shown import check_figure_follows, check_shown_as_left, shown_after

from gliderhpc.archive.mission import open_for_reading, open_mission
from gliderhpc.archive.profile import read_profile_data
from gliderhpc.errors import InputError
from gliderhpc.flight.glider import Glider
from gliderhpc.observations import open_observations
from gliderhpc.observations.truth import read_profile_truth, truth_path
from gliderhpc.store_schema import check_archive, create_study, write_table_rows
from gliderhpc.studies.archived import chosen_profiles, platform_of, series_of, states_of
from gliderhpc.studies.library.filter_comparison import (
    YAW,
    channel_table,
    estimators,
    find_lag,
    impulse_rows,
    impulse_table,
    regime_row,
    stored_yaw,
    true_yaw,
    truth_columns,
    truth_rows,
)
from gliderhpc.studies.library.tracks import anchored_tracks, motions_of
from gliderhpc.studies.reconstruction import (
    open_loop_residual,
    open_loop_row,
    steady_segment,
    tracking_row,
)

TIME = STEP * np.arange(STEPS + 1)
ALL = np.ones(STEPS + 1, dtype=bool)


def read(tmp_path, content):
    with open_mission(write_archive(tmp_path / "a.zarr", content)) as archive:
        return read_profile_data(archive, content.number)


def pulse(time, width=2.0, height=1.0):
    return height * np.exp(-0.5 * ((TIME - time) / width) ** 2)


def test_residuals_over_steady_glide_and_vibration_are_separated(tmp_path):
    content = Content(1)
    content.quality[1000:1500] = 1
    content.measured += [0.1, 0.2, -0.3, 0.4]
    content.measured[100:150] += [0.9, 0.8, -0.7, 0.6]
    content.measured[:60] += 50.0
    row = tracking_row(read(tmp_path, content))
    assert [row[f"steady_{name}"] for name in ("roll", "pitch", "heading", "depth")] == pytest.approx(
        [0.1, 0.2, 0.3, 0.4], abs=1e-4
    )
    assert [row[f"vibration_{name}"] for name in ("roll", "pitch", "heading", "depth")] == pytest.approx(
        [1.0, 1.0, 1.0, 1.0], abs=1e-4
    )


def test_the_steady_segment_is_the_first_that_is_long_enough(tmp_path):
    content = Content(1)
    content.quality[1200] = 1
    data = read(tmp_path, content)
    assert steady_segment(data, 50.0) == (60, 110)
    assert steady_segment(data, 100.0) == (121, 221)
    assert steady_segment(data, 200.0) is None


def test_a_delayed_and_weakened_copy_is_found():
    leader = pulse(100.0) - pulse(180.0, 3.0, 0.7)
    follower = 0.5 * np.roll(leader, 23) + 0.2
    lag = find_lag(follower, leader, ALL, STEP)
    assert lag.seconds == pytest.approx(2.3)
    assert lag.gain == pytest.approx(0.5, abs=1e-3)
    assert lag.correlation == pytest.approx(1.0, abs=1e-3)
    ahead = find_lag(leader, follower, ALL, STEP)
    assert ahead.seconds == pytest.approx(-2.3)


def test_series_without_a_lag_within_reach_have_no_correlation_peak():
    assert np.isnan(find_lag(TIME, np.zeros(STEPS + 1), ALL, STEP).gain)
    drift = find_lag(0.5 * TIME**2, TIME**2, ALL, STEP)
    assert drift.gain == pytest.approx(0.5, abs=1e-6)
    behind = find_lag(np.roll(pulse(100.0), 450), pulse(100.0), ALL, STEP)
    assert abs(behind.correlation) < 0.05, "45 s are beyond the longest lag that is sought"


def test_impulses_are_found_when_and_as_high_as_they_are(tmp_path):
    content = Content(1)
    content.adjoint[:] = content.prior[:] = 0.0
    content.adjoint[:, YAW] = (pulse(100.0) - pulse(200.0))[:-1]
    content.prior[:, YAW] = 0.6 * (pulse(101.5) - pulse(201.5))[:-1]
    truth = impulses_of([100.0, 200.0, 250.0, 255.0, 20.0], [1.0, -1.0, 1.0, 1.0, 1.0])
    rows = pd.DataFrame(impulse_rows(read(tmp_path, content), truth))
    assert rows.time.tolist() == [100.0, 200.0], "impulses too near one another or not in steady glide do not count"
    assert rows.amplitude.tolist() == [1.0, -1.0]
    np.testing.assert_allclose(rows.adjoint_delay, 0.0, atol=0.06)
    np.testing.assert_allclose(rows.prior_delay, 1.5, atol=0.06)
    np.testing.assert_allclose(rows.adjoint_ratio, 1.0, atol=1e-3)
    np.testing.assert_allclose(rows.prior_ratio, 0.6, atol=1e-3)


def impulses_of(times, amplitudes):
    instants = start_of(1) + (np.array(times) * 1e9).astype("timedelta64[ns]")
    return xr.Dataset(
        {"impulse_amplitude": ("impulse", amplitudes), "impulse_width": ("impulse", np.full(len(times), 2.0))},
        {"impulse_time": ("impulse", instants)},
    )


def test_lag_and_gain_a_channel_against_the_truth(tmp_path):
    content = Content(1)
    content.prior = 0.5 * np.roll(true_disturbances(1), 12, axis=0)
    true = true_disturbances(1)
    true[:, 1] = 0.0
    truth = read_profile_truth(write_truth_file(tmp_path / "t.nc", truth_of(1, true)), 1)
    rows = pd.DataFrame(truth_rows(read(tmp_path, content), truth)).set_index(["channel", "estimator"])
    assert "B_cv" not in rows.index.get_level_values(0), "a channel that is zero has nothing to follow"
    assert rows.loc[("B_cr", "adjoint"), "lag"] == pytest.approx(0.0)
    assert rows.loc[("B_cr", "adjoint"), "gain"] == pytest.approx(1.0, abs=1e-5)
    assert rows.loc[("B_cr", "prior"), "lag"] == pytest.approx(1.2)
    assert rows.loc[("B_cr", "prior"), "gain"] == pytest.approx(0.5, abs=1e-3)


@pytest.mark.damages_archive
@pytest.mark.parametrize("times", [[100.0, 200.0], [100.0], []])
def test_comparisons_with_the_truth_are_stored_and_read_back(tmp_path, times):
    content = Content(1)
    content.prior = 0.5 * np.roll(content.adjoint, 12, axis=0)
    store = write_archive(tmp_path / "a.zarr", content)
    file = write_truth_file(tmp_path / "t.nc", truth_of(1, true_disturbances(1)))
    truth = read_profile_truth(file, 1).drop_dims("impulse").merge(impulses_of(times, [1.0] * len(times)))
    with open_for_reading(store) as archive:
        data = read_profile_data(archive, 1)
    create_study(
        store, "reconstruction", {"impulse": 2}, labels={"channel": CHANNELS, "estimator": estimators("adjoint")}
    )  # fmt: skip
    write_table_rows(store, {0: truth_columns(data, truth, 2)}, "reconstruction")
    with open_for_reading(store) as archive:
        assert stored_yaw(archive, data) is None
    write_profile(store, 0, "reconstruction", {"B_cr_truth": true_yaw(data, truth)})
    with open_for_reading(store) as archive:
        pd.testing.assert_frame_equal(channel_table(archive, [1]), pd.DataFrame(truth_rows(data, truth)))
        impulses = impulse_table(archive, [1])
        np.testing.assert_allclose(stored_yaw(archive, data), true_yaw(data, truth), rtol=1e-6)
    assert len(impulses) == len(times)
    if times:
        pd.testing.assert_frame_equal(impulses, pd.DataFrame(impulse_rows(data, truth)))


def test_regimes_are_distinguished_by_the_batterys_rotation(tmp_path):
    content = Content(1)
    content.adjoint[:] = 0.0
    content.adjoint[:, YAW] = (3.0 * pulse(100.0))[:-1]
    content.adjoint[1800:, YAW] = 0.1 * np.sin(TIME[1800:-1] / 8.0)
    content.quality[1800:] = 16
    row = regime_row(read(tmp_path, content))
    assert row["rotated_fraction"] == pytest.approx(0.5, abs=1e-3)
    assert row["yaw_adjoint_resting_peak"] == pytest.approx(3.0, abs=1e-3)
    assert row["yaw_adjoint_resting_kurtosis"] > 10.0
    assert row["yaw_adjoint_rotated_peak"] < 0.25
    assert row["yaw_adjoint_rotated_kurtosis"] < 3.0
    assert row["yaw_adjoint_resting_fast"] > row["yaw_adjoint_rotated_fast"]


def test_only_finished_profiles_can_be_chosen(tmp_path):
    contents = [Content(number) for number in (1, 2, 5, 7, 9)]
    contents[1].table["status"] = "failed"
    with open_mission(write_archive(tmp_path / "a.zarr", *contents)) as archive:
        assert chosen_profiles(archive, None) == (1, 5, 7, 9)
        assert chosen_profiles(archive, None, quick=True) == (1, 5, 7)
        assert chosen_profiles(archive, "5:9", quick=True) == (5, 7, 9)
        with pytest.raises(InputError, match="no profile 2"):
            chosen_profiles(archive, "2")
        with pytest.raises(InputError, match="platform cannot be read by this version"):
            platform_of(archive)


@pytest.mark.compiled
def test_the_archive_alone_flies_as_the_run_did(recommended, twin):
    with open_mission(recommended) as archive:
        platform = platform_of(archive)
        profiles = [read_profile_data(archive, number) for number in (1, 2, 3, 4)]
    glider = Glider(platform)
    data = next(profile for profile in profiles if steady_segment(profile) is not None)
    segment = steady_segment(data)
    residual = open_loop_residual(data, glider, data.disturbances, *segment)
    row = open_loop_row(data, glider)
    assert row["open_loop_adjoint_roll"] == pytest.approx(np.sqrt(np.mean(residual[:, 0] ** 2)))
    assert row["open_loop_adjoint_heading"] < 0.3
    assert row["open_loop_adjoint_depth"] < 0.1
    assert row["open_loop_prior_heading"] > 3.0 * row["open_loop_adjoint_heading"]
    states = states_of(data)
    np.testing.assert_allclose(np.degrees(states[:, 1]), data.reconstructed[:, 1])
    series = series_of(data, platform)
    with open_observations(twin) as observations:
        record = observations.profile(data.number)
    known = np.searchsorted(series.time, record.time[10:-10])
    np.testing.assert_allclose(series.measurements[known, 3], record.depth[10:-10], atol=0.05)
    np.testing.assert_allclose(series.controls[known, 2], record.ballast_volume[10:-10], atol=5e-6)


@pytest.mark.compiled
def test_tracks_close_on_the_fixes(recommended):
    with open_mission(recommended) as archive:
        data, platform = read_profile_data(archive, 2), platform_of(archive)
        motions = motions_of(data, platform)
        tracks = anchored_tracks(archive, data, motions.estimate, motions.glide_angle)
        assert anchored_tracks(archive, without_fix(data), motions.estimate, motions.glide_angle) is None
    table = data.table
    drift = np.array([table["dac_north"], table["dac_east"]])
    adrift = {end: np.array([table[f"{end}_surface_{a}"] for a in ("north", "east")]) for end in ("entry", "exit")}
    wait = tracks.fix_time[1] - data.record_time[-1] - table["exit_surface_time"]
    for track in (tracks.estimate, tracks.glide_angle):
        np.testing.assert_allclose(track[-1] + wait * drift + adrift["exit"], tracks.fixes[1], atol=0.02 * wait + 2.0)
    lead = -tracks.fix_time[0] - table["entry_surface_time"]
    np.testing.assert_allclose(tracks.estimate[0], lead * drift + adrift["entry"], atol=2.0)
    assert np.linalg.norm(adrift["entry"]) > 0.0
    assert tracks.spread < 30.0


def without_fix(data):
    return replace(data, table={**data.table, "exit_time": np.datetime64("NaT", "ns")})


@pytest.fixture(scope="module")
def studied(brief, brief_store, tmp_path_factory):
    """Copy of the brief mission's archive, output of the command, and folder of its files."""
    folder = tmp_path_factory.mktemp("studied")
    store = folder / "brief.zarr"
    shutil.copytree(brief_store, store)
    answer = program(
        "analyze", store, "reconstruction", "--workers", 0, "--quick", "--observations", brief, "--truth",
        truth_path(brief),
    )  # fmt: skip
    return store, answer, folder / "brief-studies" / "reconstruction"


@pytest.mark.compiled
def test_the_verb_leaves_group_files_and_table(studied):
    store, answer, files = studied
    assert answer.status == 0, answer.err
    assert check_archive(store) == []
    assert sorted(path.name for path in files.iterdir()) == [
        "channels.csv", "figure_2.png", "figure_3.png", "impulses.csv", "profiles.csv", "reconstruction.json",
        "recovery.png",
    ]  # fmt: skip
    for text in ("tracking RMSE, steady glide, roll", "2.40", "k_z = 0", "600 s of uninterrupted steady glide"):
        assert text in answer.out
    with xr.open_datatree(store, engine="zarr") as tree:
        group, table = tree["reconstruction"].ds.load(), tree.ds.load()
    assert np.isfinite(group.steady_roll.values).all()
    np.testing.assert_allclose(group.vibration_fraction, table.vibration_fraction)
    np.testing.assert_allclose(group.iterations_median, table.iterations_median)
    inverted = np.isfinite(group.no_slope_steady_depth.values)
    assert inverted.tolist() == [True, False, False], "a quick study inverts one profile again"
    assert -0.012 < float(group.no_slope_heave_slope[0]) < 0.002
    assert float(group.filter_seconds[0]) > 0.0
    content = json.loads((files / "reconstruction.json").read_text())
    assert any(row["quantity"].startswith("yaw impulses") for row in content["comparisons"])
    assert set(pd.read_csv(files / "channels.csv").channel) <= set(CHANNELS)


@pytest.mark.compiled
def test_the_study_is_shown_from_the_archive_alone(studied, tmp_path):
    store, _, files = studied
    before = check_shown_as_left(store, "reconstruction", files, tmp_path / "out")

    def change(copy):
        gain = np.full((len(CHANNELS), 2), 0.5)
        put_table_rows(copy, {0: {"steady_roll": 7.0, "truth_gain": gain}}, "reconstruction")
        put_profile(copy, 0, "reconstruction", {"B_cr_truth": np.ones(400)})

    after = shown_after(store, "reconstruction", tmp_path, change)
    assert [row["steady_roll"] == 7.0 for row in after.tables["profiles"]] == [True, False, False]
    assert {row["gain"] for row in after.tables["channels"] if row["profile"] == 1} == {0.5}
    for stem in ("figure_3", "recovery"):
        check_figure_follows(before, after, stem)


@pytest.mark.long
@pytest.mark.compiled
@pytest.mark.usefixtures("undrawn_studies")
def test_without_observations_the_second_inversion_is_left_out(studied, tmp_path):
    store = tmp_path / "brief.zarr"
    shutil.copytree(studied[0], store)
    few = [f"--set={key}=1" for key in ("nulls.noise_only", "nulls.model_error", "nulls.gaussian")]
    few += ["--set=intermittency.surrogates=5", "--set=intermittency.block_draws=50", "--set=spectra.draws=20"]
    answer = program(
        "analyze", store, "all", "--workers", 0, "--profiles", "1", "--quick", *few, "--out", tmp_path / "out"
    )
    assert answer.status == 0, answer.err
    assert "no --observations given" in answer.out
    assert "reanalysis left out: needs --model" in answer.err
    files = {path.name for path in (tmp_path / "out" / "reconstruction").iterdir()}
    assert files == {"figure_2.png", "figure_3.png", "profiles.csv", "reconstruction.json"}
    with xr.open_datatree(store, engine="zarr") as tree:
        assert np.isnan(tree["reconstruction"].ds.steady_roll.sel(profile=2).item())


@pytest.mark.compiled
def test_unusable_inputs_are_refused(studied, twin, tmp_path):
    store = studied[0]
    other = program("analyze", store, "reconstruction", "--workers", 0, "--observations", twin)
    assert other.status == 2
    assert "is not the file that the archive was made from" in other.line
    absent = program("analyze", tmp_path / "no.zarr", "reconstruction")
    assert absent.status == 2
    assert "no such archive" in absent.line
    missing = program("analyze", store, "reconstruction", "--workers", 0, "--profiles", "9")
    assert missing.status == 2
    assert "no profile 9" in missing.line
