"""Measured velocity relative to the water: its judgement by the record, and what it gives on a hull that is off."""

import numpy as np
import pytest
import xarray as xr
from support.records import record

import gliderhpc as gh
from gliderhpc.estimation.relative_velocity import USUAL_STD, assess_velocity
from gliderhpc.estimation.smoother.information import on_hull_alone
from gliderhpc.flight.hull_parameters import with_values
from gliderhpc.kernels.sensitivity_memory import Information
from gliderhpc.observations import open_observations
from gliderhpc.observations.format import VELOCITY, VELOCITY_STD
from gliderhpc.observations.resample import resample
from gliderhpc.platform import read_platform
from gliderhpc.simulator import Scenario, simulate_mission

PETREL = read_platform("petrel-l")


# Judgement


def _glide(n=400, speed=0.36, attack=0.046, pitch=0.4):
    """Dive and climb of one speed and angle of attack: velocity, angles, depth, depth rate, angle of attack."""
    sign = np.where(np.arange(n) < n // 2, 1.0, -1.0)
    angles = np.column_stack([np.zeros(n), -sign * pitch])
    alpha = sign * attack
    velocity = speed * np.column_stack([np.cos(alpha), np.zeros(n), np.sin(alpha)])
    rate = -velocity[:, 0] * np.sin(angles[:, 1]) + velocity[:, 2] * np.cos(angles[:, 1])
    return velocity, angles, np.full(n, 50.0), rate, alpha


def _assessed(change=lambda velocity: velocity, std=0.02):
    velocity, angles, depth, rate, alpha = _glide()
    return assess_velocity(
        change(velocity), np.full_like(velocity, std), angles, depth, rate, np.ones(len(rate), bool), alpha
    )


def test_a_velocity_that_agrees_with_the_depth_rate_is_used_as_it_is():
    found = _assessed()
    assert found.refusal == ""
    np.testing.assert_array_equal(found.values, _glide()[0])
    np.testing.assert_allclose(found.variance, 4e-4)


@pytest.mark.parametrize(
    "change",
    [
        lambda v: v * [1.0, 1.0, -1.0],  # w upwards
        lambda v: v * [-1.0, 1.0, 1.0],  # u backwards
        lambda v: 2.0 * v,
        lambda v: 0.5 * v,
        lambda v: v + [0.1, 0.0, 0.0],
        lambda v: np.roll(v, len(v) // 2, axis=0),  # another time
    ],
)
def test_a_velocity_that_contradicts_the_depth_rate_is_refused(change):
    found = _assessed(change)
    assert found.is_empty
    assert "contradicts the depth rate" in found.refusal


def test_vertical_motion_of_the_water_is_no_contradiction():
    velocity, angles, depth, rate, alpha = _glide()
    found = assess_velocity(
        velocity, np.full_like(velocity, 0.02), angles, depth, rate + 0.05, np.ones(len(rate), bool), alpha
    )
    assert found.refusal == ""


def test_an_implausible_sideslip_costs_the_lateral_velocity_alone():
    found = _assessed(lambda v: v + [0.0, 0.2, 0.0])
    assert "lateral" in found.refusal
    assert np.isnan(found.values[:, 1]).all()
    assert np.isfinite(found.values[:, [0, 2]]).all()


def test_samples_that_scatter_more_than_stated_have_less_weight():
    noise = np.random.default_rng(1).normal(0.0, 0.1, (400, 3))
    found = _assessed(lambda v: v + noise)
    assert found.refusal == ""
    np.testing.assert_allclose(np.sqrt(found.variance), 0.1, rtol=0.2)


def test_without_a_stated_deviation_there_is_a_usual_one():
    assert _assessed(std=np.nan).variance == pytest.approx(USUAL_STD**2)


def test_fill_values_are_missing_samples():
    def with_fill(velocity):
        velocity[::3] = -32.768
        return velocity

    found = _assessed(with_fill)
    assert found.refusal == ""
    assert np.isnan(found.values[::3]).all()
    assert np.isfinite(found.values[1::3]).all()


def test_the_forward_velocity_alone_is_judged_by_the_hull_s_angle_of_attack():
    assert _assessed(lambda v: v * [1.0, np.nan, np.nan]).refusal == ""
    assert _assessed(lambda v: v * [2.0, np.nan, np.nan]).is_empty


# Information


def test_information_on_the_hull_alone_is_that_with_the_other_errors_integrated_out():
    """The posterior of the first parameters with and without the last ones, which have unit deviations."""
    rng = np.random.default_rng(3)
    root = rng.standard_normal((9, 6))
    matrix, score = root.T @ root, rng.standard_normal(6)
    own, information = on_hull_alone(Information(np.tril(matrix), score, np.zeros(0)), 4)
    whole = np.linalg.inv(matrix + np.eye(6))
    np.testing.assert_allclose(np.linalg.inv(information + np.eye(4)), whole[:4, :4], rtol=1e-12)
    np.testing.assert_allclose(np.linalg.solve(information + np.eye(4), own), (whole @ score)[:4], rtol=1e-12)


# Records


def test_samples_lie_at_the_nearest_points():
    time = np.arange(0.0, 60.0, 1.0)
    velocity = np.full((60, 3), np.nan)
    velocity[7] = (0.3, 0.01, 0.02)
    velocity[20, 0] = 0.31
    found = resample(record(time, velocity=velocity, velocity_std=np.full((60, 3), 0.01)), 0.1, 10.0)
    assert found.velocity.shape == (len(found.time), 3)
    assert set(np.flatnonzero(np.isfinite(found.velocity[:, 0]))) == {70, 200}
    assert set(np.flatnonzero(np.isfinite(found.velocity[:, 1]))) == {70}
    np.testing.assert_array_equal(found.velocity[70], velocity[7])
    np.testing.assert_array_equal(np.isfinite(found.velocity), np.isfinite(found.velocity_std))


def test_a_record_without_velocity_has_none():
    assert resample(record(np.arange(0.0, 60.0, 1.0)), 0.1, 10.0).velocity is None


# A mission with a Doppler profiler

SCENARIO = Scenario().replaced({
    "profiles": 4, "depth": 60.0, "disturbances": {"impulse_interval": None},
    "sensors": {"velocity_deviation": 0.02, "velocity_offset": [0.002, 0.0, -0.002]},
})  # fmt: skip
WRONG = with_values(PETREL, {"viscous.K_D0": 12.0, "viscous.K_L": 360.0})
TILTED = with_values(PETREL, {"sensors.pitch_offset": 2.0})


@pytest.fixture(scope="module")
def records(tmp_path_factory):
    path = tmp_path_factory.mktemp("velocity") / "mission.nc"
    simulate_mission(PETREL, path, scenario=SCENARIO, seed=5)
    return path


@pytest.fixture(scope="module")
def without(records, tmp_path_factory):
    """Return the same records without the velocity."""
    path = tmp_path_factory.mktemp("without") / "mission.nc"
    with xr.open_dataset(records) as content:
        content.drop_vars([*VELOCITY, *VELOCITY_STD]).to_netcdf(path)
    return path


def test_the_file_states_the_velocity_with_its_deviation(records, without):
    with xr.open_dataset(records) as content, xr.open_dataset(records.with_suffix(".truth.nc")) as truth:
        for name, of in zip(VELOCITY, "uvw", strict=True):
            assert content[name].units == "m s-1"
            assert float((content[name] - truth[of]).std()) == pytest.approx(0.02, rel=0.05)
            assert (content[f"{name}_std"] == 0.02).all()
    with open_observations(records) as one, open_observations(without) as other:
        assert one.profile(1).velocity.shape == (one.sample_count(1), 3)
        assert other.profile(1).velocity is None
        assert one.profile_digest(1) != other.profile_digest(1)
        assert one.sample_digests()[1] != other.sample_digests()[1]


def _speed_error(dive, records):
    with xr.open_dataset(records.with_suffix(".truth.nc")) as truth:
        time = dive["smoothed"].ds.time.values.squeeze()
        at = (truth.time.values - np.datetime64("1970-01-01")) / np.timedelta64(1, "s")
        seconds = (time - np.datetime64("1970-01-01")) / np.timedelta64(1, "s")
        true = np.interp(seconds, at, truth.u.values)
    inside = slice(30, -30)
    return (dive["smoothed"].ds.u.values.squeeze() - true)[inside], dive["smoothed"].ds.u_std.values.squeeze()[inside]


@pytest.mark.compiled
def test_the_speed_is_right_where_the_pitch_is_off(records, without):
    error, deviation = _speed_error(gh.invert(records, TILTED, profile=2), records)
    assert np.sqrt(np.mean(error**2)) < 0.006
    # The stated deviation contains the constant error of the sensor, 0.003 m/s by default.
    assert 0.0025 < np.median(deviation) < 0.008
    assert np.mean(np.abs(error) < 1.96 * deviation) > 0.9
    blind, _ = _speed_error(gh.invert(without, TILTED, profile=2), records)
    assert np.sqrt(np.mean(blind**2)) > 3.0 * np.sqrt(np.mean(error**2))


@pytest.mark.compiled
def test_a_contradicting_velocity_is_named_and_changes_nothing(records, without):
    content = xr.open_dataset(records).load()
    content["relative_velocity_w"] *= -1.0
    dive, plain = gh.invert(content, PETREL, profile=1), gh.invert(without, PETREL, profile=1)
    assert "contradicts the depth rate" in str(dive.ds.message.values.squeeze())
    np.testing.assert_array_equal(dive["smoothed"].ds.u.values, plain["smoothed"].ds.u.values)


@pytest.mark.compiled
def test_calibration_finds_drag_and_lift(records):
    found = gh.calibrate(records, WRONG, workers=0, rounds={"most": 1}, hold_out=4).platform.viscous
    attack = 0.046**2
    drag = (found.K_D0 + found.K_D * attack) / (PETREL.viscous.K_D0 + PETREL.viscous.K_D * attack)
    assert drag == pytest.approx(1.0, abs=0.05)
    assert found.K_L / PETREL.viscous.K_L == pytest.approx(1.0, abs=0.05)
