"""Smoother with gaps: samples without one of the measurements, and gaps at the turn."""

from dataclasses import fields, replace

import numpy as np
import pytest

from gliderhpc.estimation.filter import run_filter
from gliderhpc.estimation.preparation import prepare_profile
from gliderhpc.estimation.profile import estimate_profile
from gliderhpc.estimation.quality import remarks
from gliderhpc.estimation.resample import on_steps
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.estimation.smoother.iterate import run_smoother
from gliderhpc.flight.glider import Glider
from gliderhpc.platform import read_platform
from gliderhpc.simulator import load_scenario, simulate_profile

pytestmark = pytest.mark.compiled

PETREL = read_platform("petrel-l")
SETTINGS = EstimationSettings(step=0.25)
IMPULSES = load_scenario("impulses").replaced({"depth": 120.0, "depth_spread": 0.0})


def prepared(record):
    return prepare_profile(Glider(PETREL), on_steps(record, SETTINGS, PETREL))


def smoothed(record):
    profile = prepared(record)
    return run_smoother(profile, run_filter(profile, SETTINGS), SETTINGS)


def about_the_turn(record, within):
    turn = record.time[np.argmax(record.depth)]
    return np.abs(record.time - turn) <= within


def true_displacement(truth, series):
    north, east = (np.interp(series.time[[0, -1]], truth.time, truth.states[:, i]) for i in (3, 4))
    return np.array([north[1] - north[0], east[1] - east[0]])


@pytest.mark.parametrize("seed", [1, 3])
def test_attitude_is_used_where_the_depth_is_missing(seed):
    """Without depth for 200 s about the turn the displacement is known to metres; without all four, to tens of them."""
    record, truth = simulate_profile(PETREL, IMPULSES, seed)
    hidden = about_the_turn(record, 100.0)
    blind = {name: np.where(hidden, np.nan, getattr(record, name)) for name in ("roll", "pitch", "heading", "depth")}
    deaf = replace(record, depth=blind["depth"])
    without_depth, without_all = smoothed(deaf), smoothed(replace(record, **blind))
    spread, wide = (np.sqrt(np.diag(each.displacement_covariance)) for each in (without_depth, without_all))
    assert (spread < 4.0).all()
    assert (spread < 0.3 * wide).all()
    error = without_depth.displacement - true_displacement(truth, prepared(deaf).series)
    assert np.sqrt(error @ np.linalg.solve(without_depth.displacement_covariance, error)) < 4.0


def test_each_sensor_is_used_at_its_own_rate():
    """Depth every four seconds leaves the yaw moment nearly as well known as depth every second."""
    record, truth = simulate_profile(PETREL, IMPULSES, 2)
    rare = replace(record, depth=np.where(np.arange(len(record.time)) % 4 == 0, record.depth, np.nan))
    thinned = replace(record, **{
        field.name: getattr(record, field.name)[::4]
        for field in fields(record) if np.shape(getattr(record, field.name)) == record.time.shape
    })  # fmt: skip

    def error(each):
        profile, found = prepared(each), smoothed(each)
        time = profile.series.time[:-1]
        yaw = np.interp(time, truth.step * np.arange(len(truth.disturbances)), truth.disturbances[:, 5])
        steady = ~profile.vibrating[:-1] & (time > 60.0) & (time < truth.time[-1])
        return np.sqrt(np.mean((found.disturbances[:, 5] - yaw)[steady] ** 2))

    assert error(rare) < 0.5 * error(thinned)


@pytest.mark.long
def test_a_gap_at_the_turn_is_smoothed_by_the_most_probable_path():
    """The most probable path is found where the shift to the mean diverges, and the profile's remarks say so."""
    diverging = []
    for seed in range(1, 7):
        record, _ = simulate_profile(PETREL, IMPULSES, seed)
        kept = ~about_the_turn(record, 60.0)
        columns = {
            field.name: getattr(record, field.name)[kept]
            for field in fields(record) if np.shape(getattr(record, field.name)) == kept.shape
        }  # fmt: skip
        found = smoothed(replace(record, **columns))
        assert found.outcome.usable
        if "most probable path" in found.simplified:
            diverging.append(replace(record, **columns))
    assert diverging
    estimate = estimate_profile(prepared(diverging[0]), SETTINGS)
    assert any("simplified: the estimate is the most probable path" in line for line in remarks(PETREL, estimate))


@pytest.mark.parametrize("seed", [1, 2])
def test_a_move_of_an_actuator_in_a_gap_of_its_record_may_be_anywhere_in_it(seed):
    """Twenty seconds on, twenty off: the speed was wrong by 0.02 m/s with moves as slow as interpolation has them."""
    scenario = load_scenario("calm").replaced({"depth": 100.0, "depth_spread": 0.0})
    record, truth = simulate_profile(PETREL, scenario, seed)
    kept = np.floor(record.time / 20.0) % 2 == 0
    columns = {
        field.name: getattr(record, field.name)[kept]
        for field in fields(record) if np.shape(getattr(record, field.name)) == kept.shape
    }  # fmt: skip
    profile = prepared(replace(record, **columns))
    found, time = run_smoother(profile, run_filter(profile, SETTINGS), SETTINGS), profile.series.time
    steady = ~profile.vibrating & (time > 60.0) & (time < truth.time[-1])
    error = found.states[:, 6] - np.interp(time, truth.time, truth.states[:, 6])
    assert np.sqrt(np.mean(error[steady] ** 2)) < 0.006
