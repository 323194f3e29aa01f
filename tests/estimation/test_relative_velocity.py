"""Measured velocity relative to the water: validity checks against the record, and effect with a wrong hull."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from support.records import record

import gliderhpc as gh
from gliderhpc.estimation.relative_velocity import USUAL_STD, assess_velocity
from gliderhpc.estimation.resample import resample
from gliderhpc.estimation.smoother.estimate import filter_fallback
from gliderhpc.estimation.smoother.information import (
    RecordErrors,
    Sensitivity,
    marginal_information,
    split_sensitivity,
)
from gliderhpc.estimation.smoother.posterior import with_record_errors
from gliderhpc.flight.hull_parameters import with_values
from gliderhpc.kernels.sensitivity_memory import ErrorInformation
from gliderhpc.observations import open_observations
from gliderhpc.observations.format import VELOCITY, VELOCITY_STD
from gliderhpc.platform import read_platform
from gliderhpc.platform_sections import Uncertainty
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


def _assessed(change=lambda velocity: velocity, std=0.02, n=400):
    velocity, angles, depth, rate, alpha = _glide(n)
    return assess_velocity(
        change(velocity),
        np.full_like(velocity, std),
        angles=angles,
        depth=depth,
        rate=rate,
        usable=np.ones(len(rate), bool),
        attack=alpha,
    )


def _on_the_dive(velocity):
    velocity[len(velocity) // 2 :] = np.nan
    return velocity


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
        lambda v: v + np.array([0.1, 0.0, 0.0]),
        lambda v: np.roll(v, len(v) // 2, axis=0),  # another time
        lambda v: -_on_the_dive(v),  # on one leg alone
        lambda v: v * [1.0, 0.0, 0.0] + np.array([0.1, 0.0, 0.0]),
    ],
)
def test_a_velocity_that_contradicts_the_depth_rate_is_refused(change):
    found = _assessed(change)
    assert found.is_empty
    assert "contradicts the depth rate" in found.refusal


def test_vertical_motion_of_the_water_is_no_contradiction():
    velocity, angles, depth, rate, alpha = _glide()
    found = assess_velocity(
        velocity,
        np.full_like(velocity, 0.02),
        angles=angles,
        depth=depth,
        rate=rate + 0.05,
        usable=np.ones(len(rate), bool),
        attack=alpha,
    )
    assert found.refusal == ""


def test_one_leg_alone_is_judged_too_and_few_samples_are_not_used():
    assert _assessed(_on_the_dive).refusal == ""
    few = _assessed(n=30)
    assert few.is_empty
    assert "too few" in few.refusal


@pytest.mark.parametrize("left", [[np.nan, 1.0, 1.0], [np.nan, np.nan, 1.0], [np.nan, 1.0, np.nan]])
def test_without_the_forward_velocity_the_others_cannot_be_judged(left):
    found = _assessed(lambda v: v * left)
    assert found.is_empty
    assert "too few" in found.refusal


@pytest.mark.parametrize("std", [np.nan, 0.0, -0.1])
def test_a_deviation_that_is_no_positive_number_is_the_usual_one(std):
    assert _assessed(std=std).variance == pytest.approx(USUAL_STD**2)


def test_samples_of_infinite_deviation_are_missing():
    found = _assessed(std=np.inf)
    assert found.is_empty
    assert np.isfinite(found.variance).all()


def test_samples_near_the_surface_are_not_used():
    velocity, angles, _, rate, alpha = _glide()
    depth = np.linspace(0.0, 100.0, len(rate))
    found = assess_velocity(
        velocity,
        np.full_like(velocity, 0.02),
        angles=angles,
        depth=depth,
        rate=rate,
        usable=np.ones(len(rate), bool),
        attack=alpha,
    )
    assert np.isnan(found.values[depth <= 5.0]).all()
    assert np.isfinite(found.values[depth > 5.0]).all()


def test_an_implausible_sideslip_costs_the_lateral_velocity_alone():
    found = _assessed(lambda v: v + np.array([0.0, 0.2, 0.0]))
    assert "lateral" in found.refusal
    assert np.isnan(found.values[:, 1]).all()
    assert np.isfinite(found.values[:, [0, 2]]).all()


def test_samples_that_scatter_more_than_stated_have_less_weight():
    noise = np.random.default_rng(1).normal(0.0, 0.1, (400, 3))
    found = _assessed(lambda v: v + noise)
    assert found.refusal == ""
    np.testing.assert_allclose(np.sqrt(found.variance), 0.1, rtol=0.2)


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
    own, information = marginal_information(ErrorInformation(np.tril(matrix), score, np.zeros(0)), 4)
    whole = np.linalg.inv(matrix + np.eye(6))
    np.testing.assert_allclose(np.linalg.inv(information + np.eye(4)), whole[:4, :4], rtol=1e-12)
    np.testing.assert_allclose(np.linalg.solve(information + np.eye(4), own), (whole @ score)[:4], rtol=1e-12)


def _sensitivity(rng, p):
    shapes = ((2, p), (5, 12, p), (4, 6, p))
    return Sensitivity(*(rng.standard_normal(shape) for shape in shapes))


def test_the_estimate_moves_to_the_mean_of_the_sensor_s_errors():
    """``x + V m`` with variance ``P + V C V'``, of states, disturbances and displacement (docs/smoother.md)."""
    rng = np.random.default_rng(5)
    root = rng.standard_normal((3, 3))
    errors = RecordErrors(rng.standard_normal(3), root @ root.T, _sensitivity(rng, 3))
    smoothed = replace(
        filter_fallback(SimpleNamespace(states=rng.standard_normal((5, 12)), disturbances=rng.standard_normal((5, 6)))),
        states_std=np.ones((5, 12)), disturbances_std=np.ones((4, 6)), displacement_covariance=np.eye(2),
    )  # fmt: skip
    found = with_record_errors(smoothed, errors)
    V = errors.sensitivity
    np.testing.assert_allclose(found.states[3, 6], smoothed.states[3, 6] + V.states[3, 6] @ errors.mean)
    variance = 1.0 + V.disturbances[2, 4] @ errors.covariance @ V.disturbances[2, 4]
    np.testing.assert_allclose(found.disturbances_std[2, 4] ** 2, variance)
    np.testing.assert_allclose(found.displacement, smoothed.displacement + V.displacement @ errors.mean)
    expected = np.eye(2) + V.displacement @ errors.covariance @ V.displacement.T
    np.testing.assert_allclose(found.displacement_covariance, expected)


def _joint(seed):
    """Information, score and sensitivities of three errors of the hull and three others, and the hull's covariance."""
    rng = np.random.default_rng(seed)
    root, spread = rng.standard_normal((12, 6)), rng.standard_normal((3, 3))
    found = ErrorInformation(np.tril(root.T @ root), rng.standard_normal(6), np.zeros(0))
    return found, _sensitivity(rng, 6), spread @ spread.T


def test_the_sensor_s_errors_and_the_hull_s_are_those_of_the_joint_problem():
    """Mean and variance of the moved estimate, as if all six errors were solved for at once."""
    found, V, P = _joint(6)
    by_hull, errors = split_sensitivity(V, found, P)
    matrix = np.tril(found.matrix) + np.tril(found.matrix, -1).T
    before = np.eye(6)
    before[:3, :3] = P
    after = np.linalg.inv(matrix + np.linalg.inv(before))
    np.testing.assert_allclose(errors.mean, (after @ found.score)[3:], rtol=1e-10)
    # Averaged over dives, the hull's errors have the covariance that they had before.
    part = by_hull.states @ P @ by_hull.states.swapaxes(1, 2)
    part = part + V.states[..., 3:] @ errors.covariance @ V.states[..., 3:].swapaxes(1, 2)
    joint = np.block([[P, after[:3, 3:]], [after[3:, :3], after[3:, 3:]]])
    expected = V.states @ joint @ V.states.swapaxes(1, 2)
    np.testing.assert_allclose(np.diagonal(part, axis1=1, axis2=2), np.diagonal(expected, axis1=1, axis2=2), rtol=1e-9)


def test_a_known_hull_leaves_the_errors_of_the_sensor_alone():
    found, V, _ = _joint(7)
    by_hull, errors = split_sensitivity(V, found, np.zeros((3, 3)))
    matrix = np.tril(found.matrix) + np.tril(found.matrix, -1).T
    alone = np.linalg.inv(matrix[3:, 3:] + np.eye(3))
    np.testing.assert_allclose(errors.covariance, alone, rtol=1e-10)
    np.testing.assert_allclose(errors.mean, alone @ found.score[3:], rtol=1e-10)
    np.testing.assert_allclose(by_hull.states, V.states[..., :3] - V.states[..., 3:] @ (alone @ matrix[3:, :3]))


@pytest.mark.parametrize("corrupted", [np.nan, -50.0])
def test_invalid_information_leaves_the_errors_of_the_sensor_unchanged(corrupted):
    matrix = np.eye(6)
    matrix[5, 5] = corrupted
    V = _sensitivity(np.random.default_rng(7), 6)
    by_hull, errors = split_sensitivity(V, ErrorInformation(np.tril(matrix), np.ones(6), np.zeros(0)), np.eye(3))
    np.testing.assert_array_equal(errors.mean, 0.0)
    np.testing.assert_array_equal(errors.covariance, np.eye(3))
    np.testing.assert_array_equal(by_hull.displacement, V.displacement[:, :3])


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


@pytest.mark.long
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
def test_a_run_says_that_the_velocity_is_used(records, without, tmp_path, caplog):
    caplog.set_level("INFO", logger="gliderhpc")
    for path in (records, without):
        gh.run_mission(path, PETREL, tmp_path / f"{path.parent.name}.zarr", profiles=1, workers=0)
        assert ("measured velocity" in caplog.text) == (path is records)
        caplog.clear()


@pytest.mark.compiled
def test_calibration_finds_drag_and_lift(records):
    platform = with_values(WRONG, {}).model_copy(update={"uncertainty": Uncertainty(deviation={"viscous.K_D0": 0.5})})
    calibrated = gh.calibrate(records, platform, workers=0, rounds={"most": 1}, hold_out=4).platform
    # The file keeps the user's plausible deviations; what the mission says is in the covariance.
    assert calibrated.uncertainty.deviation == {"viscous.K_D0": 0.5}
    found = calibrated.viscous
    attack = 0.046**2
    drag = (found.K_D0 + found.K_D * attack) / (PETREL.viscous.K_D0 + PETREL.viscous.K_D * attack)
    assert drag == pytest.approx(1.0, abs=0.05)
    assert pytest.approx(1.0, abs=0.05) == found.K_L / PETREL.viscous.K_L


@pytest.mark.compiled
def test_the_prior_tuned_on_such_records_is_that_without_the_velocity(records, without):
    """Tuning maximises the likelihood of the filter, which does not use the velocity."""
    chosen = {"longest": 150, "max_rounds": 1, "least_noise": 1e-4}
    own, plain = (gh.tune(each, PETREL, profiles=1, tuning=chosen).tuned for each in (records, without))
    assert own.gain > 0.0
    assert own.after != own.before
    assert own.after == plain.after
    assert own.evaluation_after.log_likelihood == plain.evaluation_after.log_likelihood


def test_several_samples_at_a_point_are_averaged():
    time = np.arange(0.0, 60.0, 0.5)
    velocity = np.column_stack([np.arange(len(time)) % 2 * 0.2, *np.zeros((2, len(time)))])
    found = resample(record(time, velocity=velocity), 2.0, 10.0)
    np.testing.assert_allclose(found.velocity[3:-3, 0], 0.1, atol=0.05)
    assert np.isnan(found.velocity_std).all()
