"""Path of linearisation in quiet water: a run of the model without the sensors' noise, and the bias that it removes."""

import numpy as np
import pytest

from gliderhpc.estimation.filter import run_filter
from gliderhpc.estimation.preparation import controls_of, on_steps, prepare_profile
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.estimation.smoother import information
from gliderhpc.estimation.smoother.information import smoothed_dive_information
from gliderhpc.estimation.smoother.iterate import smooth_dive
from gliderhpc.estimation.smoother.problem import Trajectory
from gliderhpc.estimation.smoother.quiet_path import quiet_path
from gliderhpc.flight.glider import SENSED, Glider
from gliderhpc.platform import read_platform
from gliderhpc.simulator import simulate_profile
from gliderhpc.simulator.scenario import load_scenario
from gliderhpc.twins.cases import with_white_errors

pytestmark = pytest.mark.compiled

HULL = read_platform("petrel-l")
SETTINGS = EstimationSettings(step=0.25)


def smoothed_dive(scenario):
    """Return a dive of 60 m of the true hull on its steps, its estimate, and the smoothed path."""
    record, _ = simulate_profile(HULL, scenario.replaced({"depth": 60.0}), 3)
    profile = prepare_profile(Glider(HULL), on_steps(record, SETTINGS, HULL))
    smoothed = smooth_dive(profile, run_filter(profile, SETTINGS), SETTINGS)
    path = Trajectory(smoothed.states, np.vstack([smoothed.disturbances, smoothed.disturbances[-1]]))
    return profile, smoothed, path


@pytest.fixture(scope="module")
def calm():
    return smoothed_dive(with_white_errors(load_scenario("calm")))


def test_the_run_is_a_trajectory_near_the_smoothed_path(calm):
    profile, _, path = calm
    run = quiet_path(profile, path)
    controls = controls_of(HULL, profile.series)[:, :4]
    again = profile.glider.simulate(run.states[0], controls, run.disturbances[:-1], profile.series.step)
    np.testing.assert_allclose(again[:, SENSED], run.states[:, SENSED], atol=1e-6)
    apart = (run.states - path.states)[:, SENSED]
    assert np.sqrt(np.mean(apart[:, 7:] ** 2, axis=0)).max() < np.radians(0.1)
    assert np.abs(apart[:, 3]).max() < 2.0
    assert np.abs(apart[:, 4:7]).max() < 0.05


def test_the_run_has_less_noise_than_the_smoothed_path(calm):
    profile, _, path = calm
    run = quiet_path(profile, path)
    steady = ~profile.vibrating[1:-1]
    rough, smooth = (np.std(np.diff(each.states[:, 11], 2)[steady]) for each in (path, run))
    assert smooth < 0.2 * rough


def test_water_that_turns_the_glider_has_none():
    profile, _, path = smoothed_dive(load_scenario("impulses"))
    assert quiet_path(profile, path) is None


def test_damping_is_not_biased_by_the_noise_of_the_sensors(calm, monkeypatch):
    """About the filter's path, yaw damping seems wrong by many of its deviations; about the run it does not."""
    profile, smoothed, _ = calm
    place = [p.key for p in information.hull_parameters(HULL)].index("viscous.K_r")

    def error(found):
        posterior = np.eye(len(found.score)) + found.information
        return np.linalg.solve(posterior, found.score)[place] / np.sqrt(np.linalg.inv(posterior)[place, place])

    with_run = error(smoothed_dive_information(profile, smoothed, smoothed.last_pass, SETTINGS))
    monkeypatch.setattr(information, "quiet_path", lambda *_: None)
    without = error(smoothed_dive_information(profile, smoothed, smoothed.last_pass, SETTINGS))
    assert without > 3.0
    assert abs(with_run) < 2.0
