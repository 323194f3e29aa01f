"""Study `vertical`: filter, glide in still water, rising water recovered on a twin, errors, and the command."""

import json
import math
import shutil
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
import yaml
import zarr
from scipy.optimize import brentq
from support.archives import put_table_rows, write_unestimated
from support.missions import changed_observations, program
from support.shown import check_figure_follows, check_shown_as_left, shown_after

from gliderhpc.archive.mission import open_mission
from gliderhpc.archive.profile import read_profile_data
from gliderhpc.calibration.glides.fit import calibrate_on_glides
from gliderhpc.calibration.glides.search import CalibrationVerdict
from gliderhpc.calibration.settings import CalibrateSettings
from gliderhpc.errors import InputError
from gliderhpc.estimation.steady_balance import MeasuredAttitude, SteadyMotion, steady_balances
from gliderhpc.estimation.steady_segments import steady_segments
from gliderhpc.estimation.still_water_glide import still_water_glide
from gliderhpc.flight.glider import Glider, load_platform
from gliderhpc.flight.hull_parameters import with_covariance, with_values
from gliderhpc.flight.steady_glide import steady_glide
from gliderhpc.observations import open_observations
from gliderhpc.observations.truth import read_profile_truth, truth_path
from gliderhpc.platform import platform_yaml, read_platform
from gliderhpc.platform_sections import CalibrationErrors
from gliderhpc.simulator import read_scenario, simulate_mission
from gliderhpc.store_schema import check_archive, consolidate
from gliderhpc.studies.library.vertical_velocity import (
    WINDOW,
    depth_rate_filter,
    glide_parameters,
    half_power,
    hull_errors,
    transfer,
    vertical_velocity,
)
from gliderhpc.studies.vertical import LEVELS, difference_row, legs_row, truth_row

pytestmark = pytest.mark.compiled

PETREL = read_platform("petrel-l")
GLIDER = Glider(PETREL)
PARAMETERS = glide_parameters(by_density=False)
KEYS = [parameter.key for parameter in PARAMETERS]

# The filter

TIME = np.arange(0.0, 2000.0, 1.0)
ALL = np.ones(len(TIME), dtype=bool)


@pytest.mark.parametrize("cycles", [0.1, half_power(), 1.0])
def test_the_filter_attenuates_a_sinusoid_by_its_transfer_function(cycles):
    frequency = 2.0 * math.pi * cycles / WINDOW
    found = depth_rate_filter(TIME, ALL).slopes(np.sin(frequency * TIME) / frequency)
    whole = np.isfinite(found)
    np.testing.assert_allclose(found[whole], transfer(cycles) * np.cos(frequency * TIME[whole]), atol=0.02)
    assert whole.tolist() == ((TIME >= WINDOW / 2) & (TIME[-1] - WINDOW / 2 >= TIME)).tolist()


def test_the_transfer_function_is_one_half_in_power_at_the_stated_frequency():
    assert transfer(half_power()) ** 2 == pytest.approx(0.5)


def test_a_rate_and_its_integral_come_out_alike_at_uneven_samples():
    time = np.cumsum(np.random.default_rng(0).uniform(3.0, 6.0, 400))
    rate_filter = depth_rate_filter(time, np.ones(400, dtype=bool))
    rate = np.column_stack([0.1 + 1e-4 * time, -0.2 + 0.0 * time])
    integral = np.column_stack([0.1 * time + 5e-5 * time**2, -0.2 * time])
    np.testing.assert_allclose(rate_filter.filtered(rate), rate_filter.slopes(integral), atol=1e-9)
    assert np.isfinite(rate_filter.slopes(time)).sum() > 370


def test_noise_is_that_of_the_sensor():
    rate_filter = depth_rate_filter(TIME, ALL)
    drawn = rate_filter.slopes(np.random.default_rng(0).normal(0.0, 0.03, (len(TIME), 200)))
    np.testing.assert_allclose(drawn[1000].std(), rate_filter.noise(0.03)[1000], rtol=0.15)
    assert rate_filter.noise(0.03)[1000] == pytest.approx(0.03 * math.sqrt(12.0 / 61.0) / 61.0, rel=0.01)


def test_unusable_samples_and_long_pauses_break_the_record():
    usable = ALL.copy()
    usable[700] = False
    rate_filter = depth_rate_filter(TIME, usable)
    assert not np.isfinite(rate_filter.slopes(TIME))[670:731].any()
    assert np.isfinite(rate_filter.slopes(TIME))[[669, 731]].all()
    late = np.where(TIME > 1200.0, TIME + 10.0, TIME)
    assert np.flatnonzero(~np.isfinite(depth_rate_filter(late, ALL).slopes(TIME)))[30:-30].tolist() == [
        *range(1171, 1231)
    ]


def test_slopes_are_those_of_straight_lines_through_the_samples_in_a_window():
    rng = np.random.default_rng(5)
    time = 1e5 + np.cumsum(rng.uniform(2.0, 9.0, 60)) + np.repeat([0.0, 500.0], [40, 20])
    usable, values = rng.random(60) > 0.05, rng.standard_normal(60)
    found = depth_rate_filter(time, usable)
    stretch = np.cumsum(~usable) + 1000 * (np.arange(60) >= 40)
    for row, (instant, slope) in enumerate(zip(time, found.with_truncated_windows(values), strict=True)):
        near = usable & (stretch == stretch[row]) & (np.abs(time - instant) <= found.window / 2.0)
        fitted = usable[row] and near.sum() > 2
        expected = np.polyfit(time[near] - instant, values[near], 1)[0] if fitted else 0.0
        assert slope == pytest.approx(expected, abs=1e-12)
    assert len(depth_rate_filter(np.zeros(0), np.zeros(0, dtype=bool)).slopes(np.zeros(0))) == 0


def test_slow_sensors_have_a_longer_window():
    time = np.arange(0.0, 4000.0, 20.0)
    assert depth_rate_filter(time, np.ones(len(time), dtype=bool)).window == pytest.approx(80.0)


# The glide in still water


def gliding(net_mass, degrees, depth=50.0):
    glide = steady_glide(GLIDER, net_mass, math.radians(degrees), depth)
    return glide, GLIDER.bodies([glide.control])


def attitude(pitch, roll=0.0, turn=0.0, depth=50.0):
    return MeasuredAttitude(*(np.atleast_1d(np.radians(x)) for x in (roll, pitch, turn)), np.array([depth]))


@pytest.mark.parametrize(("net_mass", "degrees"), [(0.35, -23.0), (-0.3, 30.0), (0.2, -18.5)])
def test_straight_and_level_it_is_the_steady_glide(net_mass, degrees):
    glide, bodies = gliding(net_mass, degrees)
    found = still_water_glide(GLIDER, bodies, attitude(degrees))
    assert found.depth_rate[0] == pytest.approx(glide.depth_rate, abs=1e-8)
    assert found.speed[0] == pytest.approx(glide.speed, abs=1e-8)


def test_the_still_water_glide_balances_when_rolled_and_turning():
    _, bodies = gliding(0.35, -23.0)
    measured = attitude(-23.0, roll=20.0, turn=0.8)
    found = still_water_glide(GLIDER, bodies, measured)
    level = still_water_glide(GLIDER, bodies, attitude(-23.0))
    motion = SteadyMotion(measured.roll, measured.pitch, measured.turn_rate, measured.depth, found.depth_rate)
    (balance,) = steady_balances([GLIDER], [bodies], motion)
    assert balance.errors[0, 0] == pytest.approx(0.0, abs=1e-7)
    assert 1e-4 < abs(found.depth_rate[0] - level.depth_rate[0]) < 0.02


def test_there_is_no_glide_nose_up_while_heavy_nor_too_flat_nor_where_nothing_was_measured():
    _, bodies = gliding(0.35, -23.0)
    for pitch in (23.0, -3.0, np.nan):
        assert np.isnan(still_water_glide(GLIDER, bodies, attitude(pitch)).depth_rate[0])


def balance_of_2010(weight, pitch, viscous):
    """Speed and upward velocity by eqs. 8 to 11 of Merckelbach et al. (2010), coefficients over the squared speed.

    With the angle of attack a counted positive with the pitch: ``K_L a tan(theta + a) = K_D0 + K_D a^2`` and
    ``U^2 = (F_B - F_g) sin(theta + a) / (K_D0 + K_D a^2)``.
    """
    sign = math.copysign(1.0, pitch)
    drag = lambda a: viscous.K_D0 + viscous.K_D * a**2  # noqa: E731 - as short as the paper's
    a = brentq(lambda a: drag(a) - viscous.K_L * a * math.tan(abs(pitch) + a), 0.0, math.radians(8.0))
    speed = math.sqrt(abs(weight) * math.sin(abs(pitch) + a) / drag(a))
    return speed, sign * speed * math.sin(abs(pitch) + a)


@pytest.mark.parametrize("name", ["petrel-l", "slocum", "seaglider", "seaexplorer"])
def test_the_published_steady_balance_gives_the_same(name):
    platform = read_platform(name)
    glider = Glider(platform)
    for net_mass, degrees in ((0.3, -26.0), (-0.2, 24.0)):
        glide = steady_glide(glider, net_mass, math.radians(degrees))
        bodies = glider.bodies([glide.control])
        measured = attitude(degrees, depth=0.0)
        found = still_water_glide(glider, bodies, measured)
        weight = glider.net_weight(bodies, measured.depth)[0]
        speed, upward = balance_of_2010(weight, math.radians(degrees), platform.viscous)
        assert found.speed[0] == pytest.approx(speed, rel=1e-7)
        assert found.depth_rate[0] == pytest.approx(-upward, rel=1e-7)


# Water that rises and sinks in the simulator

STILL = {"slow_rms": [0.0] * 6, "impulse_interval": None}
WAVES = read_scenario({
    "name": "waves", "profiles": 10, "depth": 120.0, "disturbances": STILL,
    "vertical": {"rms": 0.015, "periods": [300.0, 1200.0]}, "steering": {"interval": 200.0, "longest_turn": 150.0},
})  # fmt: skip


def test_rising_water_carries_the_glider_and_leaves_its_motion_through_the_water(tmp_path):
    short = {"profiles": 1, "depth": 60.0}
    calm = WAVES.replaced({**short, "vertical": {}})
    paths = [
        simulate_mission(PETREL, tmp_path / f"{scenario.name}{i}.nc", scenario=scenario, seed=4).path
        for i, scenario in enumerate((calm, WAVES.replaced(short)))
    ]
    still, risen = (read_profile_truth(truth_path(path), 1) for path in paths)
    # Until shortly before the one that the water has carried deeper turns.
    n = 180
    up = risen["water_up"].values[: n + 1].astype(float)
    carried = np.concatenate([[0.0], np.cumsum(0.5 * (up[1:] + up[:-1]))])
    difference = still["depth"].values[: n + 1] - risen["depth"].values[: n + 1]
    assert np.abs(carried).max() > 0.5
    np.testing.assert_allclose(difference, carried, atol=0.02 + 0.02 * np.abs(carried).max())
    np.testing.assert_allclose(still["u"].values[:n], risen["u"].values[:n], atol=2e-3)
    assert not still["water_up"].values.any()


# The velocity found again


@pytest.fixture(scope="module")
def waves(tmp_path_factory):
    """Mission of a hull that is not petrel-l, in water that rises and sinks; petrel-l calibrated on eight profiles."""
    truth = with_values(PETREL, {
        "buoyancy.neutral_volume": PETREL.buoyancy.neutral_volume + 60.0,
        "viscous.K_D0": 1.2 * PETREL.viscous.K_D0, "viscous.K_L": 0.9 * PETREL.viscous.K_L,
    })  # fmt: skip
    path = simulate_mission(truth, tmp_path_factory.mktemp("waves") / "waves.nc", scenario=WAVES, seed=1).path
    settings = CalibrateSettings()
    with open_observations(path) as opened:
        segments = steady_segments(opened, PETREL, range(1, 9), settings, settings.steady)
    return path, calibrate_on_glides(PETREL, segments, segments.empty(), settings.calibration)


def velocities(path, store, platform, number):
    with open_mission(write_unestimated(store, path, platform)) as archive:
        data = read_profile_data(archive, number)
    return data, vertical_velocity(data, platform)


@pytest.mark.long
@pytest.mark.parametrize("number", [9, 10])
def test_a_known_velocity_is_found_within_its_stated_error(waves, tmp_path, number):
    """Two profiles that the calibration has not seen; without it the hull's error is thirteen times the water's."""
    path, found = waves
    truth = read_profile_truth(truth_path(path), number)
    row = truth_row(*velocities(path, tmp_path / "a.zarr", found.platform, number), truth)
    assert row["error_rms"] < 0.0035
    assert row["error_normalised"] < 1.5
    assert row["truth_correlation"] > 0.97
    data, uncalibrated = velocities(path, tmp_path / "b.zarr", PETREL, number)
    wrong = truth_row(data, uncalibrated, truth)
    assert wrong["error_rms"] > 0.01
    assert wrong["error_normalised"] < 1.0, "plausible deviations are as wide as a hull may be off"


def test_velocities_stand_at_samples_in_undisturbed_flight_alone(waves, tmp_path):
    path, found = waves

    def changed(content):
        mine = np.flatnonzero(content["profile"].values == 9)
        keep = np.ones(content.sizes["time"], dtype=bool)
        keep[mine] = np.arange(len(mine)) % 4 == 0
        content["depth"][mine[800:920]] = np.nan
        return content.isel(time=keep)

    sparse = changed_observations(path, tmp_path / "sparse.nc", changed)
    data, velocity = velocities(sparse, tmp_path / "a.zarr", found.platform, 9)
    time = data.record_time[velocity.record]
    assert set(np.unique(np.diff(time)).tolist()) <= {4.0, 124.0, 120.0, 128.0}
    assert not np.isfinite(velocity.water)[(time > 800 - 30) & (time < 920 + 30)].any()
    vibrating = data.record_time[data.on_records(data.flagged("vibration"))]
    used = time[np.isfinite(velocity.water)]
    assert min(np.abs(used - moment).min() for moment in vibrating[vibrating > 100.0]) >= 30.0
    assert velocity.attitude.depth[np.isfinite(velocity.water)].min() > 5.0


@pytest.mark.long
def test_each_numbers_effect_is_what_moving_it_does(waves, tmp_path):
    path, found = waves
    data, nominal = velocities(path, tmp_path / "a.zarr", found.platform, 9)
    for i, parameter in enumerate(PARAMETERS):
        moved = with_values(found.platform, {parameter.key: parameter.moved(found.platform, 0.1)})
        change = vertical_velocity(data, moved).water - nominal.water
        np.testing.assert_allclose(change, 0.1 * nominal.by_hull[:, i], atol=3e-4 + 0.1 * np.nanmax(np.abs(change)))


def test_means_and_differences_follow_the_hull(waves, tmp_path):
    """Oil that is not there makes the water seem to rise on both legs; too much drag, on dives to sink."""
    path, found = waves
    data, nominal = velocities(path, tmp_path / "a.zarr", found.platform, 9)
    row, levels = legs_row(nominal), difference_row(nominal)
    volume = found.platform.buoyancy.neutral_volume
    heavy = vertical_velocity(data, with_values(found.platform, {"buoyancy.neutral_volume": volume + 20.0}))
    assert legs_row(heavy)["mean_dive"] > row["mean_dive"]
    assert legs_row(heavy)["mean_climb"] > row["mean_climb"]
    draggy = vertical_velocity(data, with_values(found.platform, {"viscous.K_D0": 1.3 * found.platform.viscous.K_D0}))
    assert difference_row(draggy)["difference"] < levels["difference"] - 0.01
    assert 0 < levels["levels"] <= LEVELS
    assert row["mean_std_dive"] < 0.005 < legs_row(replace(nominal, errors=hull_errors(PETREL)))["mean_std_dive"]
    assert row["mean_square"] < legs_row(heavy)["mean_square"]


# What a calibration says of its errors


def test_the_platform_file_carries_the_calibrations_errors(waves):
    found = waves[1]
    stated = found.platform.calibration
    assert type(found.platform).model_validate(yaml.safe_load(platform_yaml(found.platform))) == found.platform
    deviation = dict(zip(stated.parameters, np.sqrt(np.diag(stated.covariance)), strict=True))
    checked = 0
    for one in found.parameters:
        key = one.parameter.key
        if one.verdict is CalibrationVerdict.ESTIMATED and not one.parameter.factor:
            half = 0.5 * (one.interval[1] - one.interval[0])
            assert 1.959964 * deviation[key] == pytest.approx(half, rel=1e-4)
            checked += 1
        elif one.verdict is not CalibrationVerdict.ESTIMATED:
            assert deviation[key] == pytest.approx(abs(one.parameter.slope(PETREL, 0.0)), rel=1e-5)
    assert checked > 3
    assert np.linalg.eigvalsh(stated.covariance / np.outer(*[list(deviation.values())] * 2)).min() > -1e-5


def test_uncalibrated_parameters_have_their_plausible_deviation():
    one = with_covariance(
        with_values(PETREL, {"buoyancy.neutral_volume": 10.0}),
        CalibrationErrors(
            parameters=("viscous.K_D0", "buoyancy.neutral_volume"),
            deviation=(0.1 * PETREL.viscous.K_D0, 2.0), correlation=((), (0.5,)),
        ),
    )  # fmt: skip
    errors = hull_errors(one)
    volume, drag, lift = (KEYS.index(key) for key in ("buoyancy.neutral_volume", "viscous.K_D0", "viscous.K_L"))
    spread = {key: PARAMETERS[KEYS.index(key)].spread(PETREL) for key in KEYS}
    assert errors.calibrated
    assert errors.covariance[drag, drag] == pytest.approx((0.1 / spread["viscous.K_D0"]) ** 2)
    assert errors.covariance[volume, volume] == pytest.approx((2.0 / spread["buoyancy.neutral_volume"]) ** 2)
    assert errors.covariance[volume, drag] == pytest.approx(
        0.5 * math.sqrt(errors.covariance[drag, drag] * errors.covariance[volume, volume])
    )
    assert errors.covariance[lift].tolist() == np.eye(len(KEYS))[lift].tolist()
    assert not hull_errors(PETREL).calibrated


def test_errors_that_do_not_belong_together_are_refused(tmp_path):
    content = yaml.safe_load(platform_yaml(PETREL))
    content["calibration"] = {"parameters": ["viscous.K_D0"], "deviation": [1.0], "correlation": [[0.5]]}
    path = tmp_path / "hull.yaml"
    path.write_text(yaml.safe_dump(content))
    with pytest.raises(InputError, match="needs a deviation and a row of correlations for each of its 1 parameters"):
        load_platform(path)


# The verb


@pytest.fixture(scope="module")
def studied(brief, brief_store, tmp_path_factory):
    """Copy of the brief mission's archive, output of the command, and folder of its files."""
    folder = tmp_path_factory.mktemp("vertical")
    store = folder / "brief.zarr"
    shutil.copytree(brief_store, store)
    answer = program("analyze", store, "vertical", "--workers", 0, "--truth", truth_path(brief))
    return store, answer, folder / "brief-studies" / "vertical"


def test_the_verb_leaves_group_files_and_table(studied):
    store, answer, files = studied
    assert answer.status == 0, answer.err
    assert check_archive(store) == []
    assert sorted(path.name for path in files.iterdir()) == ["profiles.csv", "vertical.json", "vertical.png"]
    for text in ("dives minus climbs at the same depths", "half power at 9.6 mHz", "states no errors of a calibration"):
        assert text in answer.out
    with xr.open_datatree(store, engine="zarr") as tree:
        group, observed = tree["vertical"].ds.load(), tree["observed"].ds.load()
    known = np.isfinite(group.water_up.values)
    assert 0.2 < known.mean() < 0.9
    assert (observed.sampled.values[known] == 1.0).all()
    np.testing.assert_allclose(
        group.water_up.values[known], (group.depth_rate_still - group.depth_rate).values[known], atol=1e-6
    )
    assert (group.water_up_std.values[known] > group.water_up_noise_std.values[known]).all()
    assert group.water_up.attrs["standard_name"] == "upward_sea_water_velocity"
    content = json.loads((files / "vertical.json").read_text())
    assert content["facts"]["hull_errors"] == "plausible deviations"
    assert any(row["quantity"].startswith("against the truth") for row in content["comparisons"])


def test_the_study_is_shown_from_the_archive_alone(studied, tmp_path):
    store, _, files = studied
    before = check_shown_as_left(store, "vertical", files, tmp_path / "out")
    after = shown_after(
        store, "vertical", tmp_path, lambda copy: put_table_rows(copy, {1: {"mean_dive": 0.25}}, "vertical")
    )  # fmt: skip
    assert [row["mean_dive"] == 0.25 for row in after.tables["profiles"]] == [False, True, False]
    assert after.comparisons["vertical"] != before.comparisons["vertical"]
    check_figure_follows(before, after, "vertical")


@pytest.mark.damages_archive
def test_an_archive_without_the_mask_of_samples_is_refused(studied, tmp_path):
    store = tmp_path / "old.zarr"
    shutil.copytree(studied[0], store)
    root = zarr.open_group(str(store), mode="r+", use_consolidated=False)
    del root["observed/sampled"]
    consolidate(store)
    answer = program("analyze", store, "vertical", "--workers", 0)
    assert answer.status == 2
    assert "does not distinguish samples from values interpolated between them; run the mission again" in answer.err


@pytest.mark.long
@pytest.mark.usefixtures("undrawn_studies")
def test_a_hull_that_is_off_is_named(waves, tmp_path):
    path, found = waves
    off = with_values(found.platform, {"viscous.K_D0": 1.5 * found.platform.viscous.K_D0})
    some = ("--workers", 0, "--profiles", "7:10", "--out", tmp_path / "out")
    store = write_unestimated(tmp_path / "off.zarr", path, off)
    answer = program("analyze", store, "vertical", *some)
    assert answer.status == 0, answer.err
    assert "the hull's parameters or the pitch sensor are in error" in answer.out
    sound = write_unestimated(tmp_path / "sound.zarr", path, found.platform)
    answer = program("analyze", sound, "vertical", *some)
    assert answer.status == 0, answer.err
    assert "vertical" in answer.out
    assert "are off" not in answer.out
