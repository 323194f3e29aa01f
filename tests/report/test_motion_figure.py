"""Profile page: the numbers on it are those of the archive."""

from contextlib import contextmanager

import numpy as np
import pytest
from support.archives import (
    CHANNELS,
    EVERY,
    STEP,
    STEPS,
    TRACKED,
    Content,
    put_profile,
    put_table_rows,
    start_of,
    true_disturbances,
    truth_of,
    write_archive,
    write_truth_file,
)

from gliderhpc.archive.mission import open_mission
from gliderhpc.archive.profile import read_profile_data
from gliderhpc.errors import InputError
from gliderhpc.mission.executors import SerialExecutor
from gliderhpc.mission.planning import prepare_mission
from gliderhpc.mission.run import run_mission
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.observations import open_observations
from gliderhpc.observations.truth import read_profile_truth, truth_path
from gliderhpc.platform import read_platform
from gliderhpc.report.accuracy import accuracy_table, tracking_rmse
from gliderhpc.report.motion_figure import axis_limits, motion_figure, outside_axis
from gliderhpc.simulator import read_scenario, simulate_mission

PNG = b"\x89PNG"
MINUTES = STEP * np.arange(STEPS + 1) / 60.0


@contextmanager
def serially():
    yield SerialExecutor()


def drawn(tmp_path, content, truth=None):
    with open_mission(write_archive(tmp_path / "twin.zarr", content)) as archive:
        return motion_figure(archive, content.number, truth)


def panels(figure):
    return {axes.get_label(): axes for axes in figure.axes}


def line(axes, label):
    return next(line for line in axes.lines if line.get_label() == label)


def shades(axes):
    return {artist.get_label(): artist for artist in axes.collections}


def words(figure):
    return "\n".join(text.get_text() for text in figure.texts)


def notes(axes):
    return "\n".join(text.get_text() for text in axes.texts)


@pytest.fixture(scope="module")
def truth(tmp_path_factory):
    path = tmp_path_factory.mktemp("truth") / "twin.truth.nc"
    return read_profile_truth(write_truth_file(path, truth_of(1, true_disturbances(1))), 1)


def test_every_panel_shows_the_archives_numbers(tmp_path):
    content = Content(1)
    content.adjoint *= 1.5
    content.prior *= 0.5
    content.measured += 0.25
    axes = panels(drawn(tmp_path, content))
    assert tuple(axes) == TRACKED + CHANNELS
    for channel, name in enumerate(CHANNELS):
        for label, values in (("adjoint", content.adjoint), ("filter", content.prior)):
            curve = line(axes[name], label)
            np.testing.assert_allclose(curve.get_xdata(), MINUTES, atol=1e-6)
            np.testing.assert_allclose(curve.get_ydata()[:-1], values[:, channel], rtol=1e-6)
    for column, name in enumerate(TRACKED):
        for label, values in (("measured", content.measured), ("reconstructed", content.reconstructed)):
            curve = line(axes[name], label)
            np.testing.assert_allclose(curve.get_xdata(), MINUTES[::EVERY], atol=1e-6)
            difference = curve.get_ydata() - values[:, column]
            if name == "heading":
                difference = np.mod(difference + 180.0, 360.0) - 180.0
            np.testing.assert_allclose(difference, 0.0, atol=1e-4)


def test_a_changed_value_changes_its_line_alone(tmp_path):
    content = Content(1)
    before = panels(drawn(tmp_path, content))
    content.adjoint[120, CHANNELS.index("B_cv")] += 0.5
    content.prior[130, CHANNELS.index("B_cr")] += 0.5
    content.reconstructed[140, TRACKED.index("pitch")] += 0.5
    content.measured[150, TRACKED.index("depth")] += 0.5
    changed = {}
    for panel, axes in panels(drawn(tmp_path, content)).items():
        for curve in axes.lines:
            old, new = line(before[panel], curve.get_label()).get_ydata(), curve.get_ydata()
            where = np.flatnonzero(~np.isclose(old, new, rtol=0.0, atol=0.0, equal_nan=True))
            changed |= {(panel, curve.get_label()): where.tolist()} if where.size else {}
    assert changed == {
        ("B_cv", "adjoint"): [120],
        ("B_cr", "filter"): [130],
        ("pitch", "reconstructed"): [140],
        ("depth", "measured"): [150],
    }


def test_truth_is_drawn_where_it_is_known(tmp_path, truth):
    content = Content(1)
    content.adjoint[:, 5] += 0.1
    axes = panels(drawn(tmp_path, content, truth))
    for channel, name in enumerate(CHANNELS):
        curve = line(axes[name], "truth")
        np.testing.assert_allclose(curve.get_ydata()[:-1], true_disturbances(1)[:, channel], atol=1e-5)
        assert curve.is_dashed()
    assert "adjoint 0.100, r = 1.00; filter 0.000" in notes(axes["B_cr"])
    without = panels(drawn(tmp_path, content))
    assert not any(curve.get_label() == "truth" for axes in without.values() for curve in axes.lines)
    assert "RMSE" not in notes(without["B_cr"])


def test_the_smoother_is_drawn_with_its_band(tmp_path):
    path = write_archive(tmp_path / "twin.zarr", Content(1), Content(2))
    clock = start_of(2).astype("int64") / 1e9 + STEP * EVERY * np.arange(STEPS // EVERY + 1)
    smoothed = {name: 0.1 * channel + np.sin(clock / 30.0) for channel, name in enumerate(CHANNELS)}
    deviation = {f"{name}_std": np.full(len(clock), 0.05) for name in CHANNELS}
    still = {name: np.zeros(len(clock)) for name in TRACKED}
    put_profile(path, 1, "smoothed", {"time": clock, **still, **smoothed, **deviation})
    put_profile(path, 1, "state", {"time": clock, **still, **{name: 2.0 * std for name, std in deviation.items()}})
    put_table_rows(path, {1: {"dac_north_smoothed": 0.1, "dac_north_smoothed_std": 0.003, "dac_east_smoothed": -0.2,
                                "dac_east_smoothed_std": 0.004}})  # fmt: skip
    with open_mission(path) as archive:
        without, figure = (motion_figure(archive, number, None) for number in (1, 2))
    assert not any(curve.get_label() == "smoother" for axes in without.axes for curve in axes.lines)
    assert "smoother" not in words(without)
    assert not any(axes.collections for axes in without.axes)
    for name, axes in panels(figure).items():
        if name in CHANNELS:
            curve = line(axes, "smoother").get_ydata()
            np.testing.assert_allclose(curve[:STEPS:EVERY], smoothed[name][:-1], atol=1e-6)
            (band,) = [patch for patch in axes.collections if patch.get_alpha() == 0.3]
            assert np.ptp(band.get_paths()[0].vertices[:, 1]) == pytest.approx(np.ptp(curve[:-1]) + 0.1, abs=1e-3)
            (band,) = [patch for patch in axes.collections if patch.get_alpha() == 0.15]
            adjoint = line(axes, "adjoint").get_ydata()[:-1]
            assert np.ptp(band.get_paths()[0].vertices[:, 1]) == pytest.approx(np.ptp(adjoint) + 0.2, abs=1e-3)
    assert "north +0.100 ± 0.003, east −0.200 ± 0.004 m/s (from the smoother)" in words(figure)
    assert {"adjoint, 68 %", "smoother, 68 %"} < {text.get_text() for text in figure.legends[0].get_texts()}


def test_the_axes_contain_wide_bands(tmp_path):
    """Bands far wider than the curves filled their panels, so that their width could not be read."""
    path = write_archive(tmp_path / "twin.zarr", Content(1))
    clock = start_of(1).astype("int64") / 1e9 + STEP * EVERY * np.arange(STEPS // EVERY + 1)
    values = {name: np.sin(clock / 30.0) for name in CHANNELS}
    deviation = {f"{name}_std": np.full(len(clock), 20.0) for name in CHANNELS}
    put_profile(path, 0, "state", {"time": clock, **dict.fromkeys(TRACKED, 0.0 * clock), **deviation})
    put_profile(path, 0, "smoothed", {"time": clock, **dict.fromkeys(TRACKED, 0.0 * clock), **values, **deviation})
    with open_mission(path) as archive:
        figure = motion_figure(archive, 1, None)
    for name, axes in panels(figure).items():
        if name in CHANNELS:
            low, high = axes.get_ylim()
            bands = [patch for patch in axes.collections if patch.get_alpha() in (0.3, 0.15)]
            edges = np.concatenate([band.get_paths()[0].vertices[:, 1] for band in bands])
            assert len(bands) == 2
            assert low < edges.min() < -19.0 < 19.0 < edges.max() < high


def test_the_truth_of_another_profile_is_refused(tmp_path, truth):
    with pytest.raises(InputError, match="another mission"):
        drawn(tmp_path, Content(2), truth)


def test_vibration_is_shaded_in_every_panel(tmp_path):
    content = Content(1)
    content.quality[600:900] |= 1 | 32
    content.quality[2400:2401] |= 1
    axes = panels(drawn(tmp_path, content))
    for panel in axes.values():
        assert set(shades(panel)) == {"vibration"}
        extents = [path.get_extents() for path in shades(panel)["vibration"].get_paths()]
        assert [(box.x0, box.x1) for box in extents] == [
            pytest.approx((1.0, 1.5), abs=1e-6), pytest.approx((4.0, 4.0 + STEP / 60.0), abs=1e-6),
        ]  # fmt: skip
    assert not any(shades(panel) for panel in panels(drawn(tmp_path, Content(1))).values())


def test_gaps_and_windows_that_failed_are_distinguished(tmp_path):
    content = Content(1)
    content.quality[600:900] |= 2
    content.quality[1200:1500] |= 4 | 64
    figure = drawn(tmp_path, content)
    expected = {"gap_in_the_record", "prior_used_because_the_window_failed", "window_not_converged"}
    assert all(set(shades(axes)) == expected for axes in figure.axes)
    legend = [text.get_text() for text in figure.legends[0].get_texts()]
    assert {"gap in the record", "window failed, filter used", "window not converged"} < set(legend)
    assert "actuators moving" not in legend


def test_every_axis_has_a_unit_and_all_share_time(tmp_path):
    figure = drawn(tmp_path, Content(1))
    units = ["(°)"] * 3 + ["(m)"] + ["(N)"] * 3 + ["(N m)"] * 3
    for axes, unit in zip(figure.axes, units, strict=True):
        assert unit in axes.get_ylabel()
        assert axes.get_xlim() == figure.axes[-1].get_xlim() == pytest.approx((0.0, STEP * STEPS / 60.0))
    assert figure.axes[-1].get_xlabel() == "minutes since 2024-01-01 01:00:00 UTC"
    bottom, top = panels(figure)["depth"].get_ylim()
    assert bottom > top


def test_heading_runs_on_through_north(tmp_path):
    content = Content(1)
    content.measured[50, 2] = np.nan
    content.reconstructed[:, 2] = np.mod(content.reconstructed[:, 2] + 0.5, 360.0)
    axes = panels(drawn(tmp_path, content))["heading"]
    measured, reconstructed = (line(axes, label).get_ydata() for label in ("measured", "reconstructed"))
    assert np.isnan(measured[50])
    assert measured[-1] == pytest.approx(380.0, abs=1e-3)
    np.testing.assert_allclose(reconstructed - (350.0 + np.arange(301) / 10.0), 0.5, atol=1e-3)
    assert "0.500°" in notes(axes)


def test_residuals_are_those_of_the_table(tmp_path):
    content = Content(1)
    content.measured += np.random.default_rng(1).normal(scale=0.3, size=content.measured.shape)
    path = write_archive(tmp_path / "twin.zarr", content)
    with open_mission(path) as archive:
        axes, expected = panels(motion_figure(archive, 1, None)), tracking_rmse(read_profile_data(archive, 1))
    for name, value in zip(TRACKED, expected, strict=True):
        assert f"{value:.3f}" in notes(axes[name])


def test_values_outside_the_axis_are_noted(tmp_path):
    content = Content(1)
    content.adjoint[600:900, 4] = -40.0
    content.quality[600:900] |= 1
    axes = panels(drawn(tmp_path, content))
    low, high = axes["B_cq"].get_ylim()
    assert -1.5 < low < -1.0 < 1.0 < high < 1.5
    assert notes(axes["B_cq"]) == "outside the axis: adjoint to −40 N m"
    assert notes(axes["B_cp"]) == ""


def test_axis_limits():
    steady = np.ones(10_000, bool)
    signal = np.sin(np.arange(10_000.0))
    spike = signal.copy()
    spike[5] = 100.0
    impulse = signal.copy()
    impulse[5] = 3.0
    low, high = axis_limits([spike], steady)
    assert -1.3 < low < -1.0 < 1.0 < high < 1.3, "one wild value does not flatten the rest"
    assert axis_limits([impulse], steady)[1] > 3.0, "an impulse is not cut"
    assert axis_limits([impulse, np.full(10_000, np.nan)], steady)[1] > 3.0
    assert axis_limits([signal, spike], ~steady)[1] > 1.0, "without steady glide everything counts"
    low, high = axis_limits([np.zeros(10_000)], steady)
    assert low <= -0.01 < 0.01 <= high
    assert outside_axis({"a": signal, "b": 5.0 * signal}, (-2.0, 5.0), "N") == "outside the axis: b to −5 N"
    assert outside_axis({"a": signal}, (-2.0, 2.0), "N") == ""


def test_the_title_names_the_profile_and_its_accuracy(tmp_path, truth):
    content = Content(1, table={"message": "gaps totalling 12 s were ignored"})
    figure = drawn(tmp_path, content, truth)
    for part in (
        "cost $1 and $2 · petrel-l · profile 1", "preset recommended", "20 windows, 95.0% converged",
        "depth-averaged current 0.221 m/s towards 298°: north +0.103 ± 0.050, east −0.196 ± 0.060 m/s "
        "(from the adjoint)",
        "true current 0.224 m/s towards 297°: north +0.100, east −0.200 m/s  (error 0.0050 m/s)",
        "note: gaps totalling 12 s",
    ):  # fmt: skip
        assert part in words(figure)
    figure.savefig(tmp_path / "dollars.png", dpi=20)
    content.table["dac_north"] = np.nan
    assert "depth-averaged current unknown" in words(drawn(tmp_path, content))
    assert "true current" not in words(drawn(tmp_path, content))


def test_only_finished_profiles_are_drawn(tmp_path):
    contents = [Content(1), Content(2, table={"status": "failed", "message": "all pitch is missing"})]
    contents += [Content(3, table={"status": "pending"}), Content(12)]
    path = write_archive(tmp_path / "twin.zarr", *contents)
    with open_mission(path) as archive, pytest.raises(InputError, match=r"profile 2 is failed.*all pitch is missing"):
        motion_figure(archive, 2, None)


@pytest.mark.compiled
def test_a_simulated_profile_from_record_to_page(tmp_path):
    platform, records, store = read_platform("petrel-l"), tmp_path / "twin.nc", tmp_path / "twin.zarr"
    scenario = read_scenario({"profiles": 1, "depth": 40.0, "steering": {"interval": 120.0}})
    simulate_mission(platform, records, scenario=scenario, seed=1)
    with open_observations(records) as observations:
        run_mission(prepare_mission(observations, platform, MissionSettings()), store, serially)
    with open_mission(store) as archive:
        motion_figure(archive, 1, read_profile_truth(truth_path(records), 1)).savefig(tmp_path / "page.png")
        assert (tmp_path / "page.png").read_bytes().startswith(PNG)
        rows = {row.quantity: row for row in accuracy_table(archive, truth_path(records))}
    assert rows["B_cr"].adjoint.correlation > 0.95
    assert rows["B_cr"].adjoint.rmse < rows["B_cr"].prior.rmse
    assert rows["depth"].adjoint.rmse < 0.05
