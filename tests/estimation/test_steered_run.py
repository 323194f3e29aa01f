"""Path of linearisation without the sensors' noise: a run of the model, and the bias that it removes."""

import numpy as np
import pytest

from gliderhpc.estimation.filter import run_filter
from gliderhpc.estimation.preparation import controls_of, on_steps, prepare_profile
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.estimation.smoother import information
from gliderhpc.estimation.smoother.information import smoothed_dive_information
from gliderhpc.estimation.smoother.iterate import smooth_dive
from gliderhpc.estimation.smoother.problem import Trajectory
from gliderhpc.estimation.smoother.steered_run import steered_run
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
    run = steered_run(profile, path)
    controls = controls_of(HULL, profile.series)[:, :4]
    again = profile.glider.simulate(run.states[0], controls, run.disturbances[:-1], profile.series.step)
    np.testing.assert_allclose(again[:, SENSED], run.states[:, SENSED], atol=1e-6)
    apart = (run.states - path.states)[:, SENSED]
    assert np.sqrt(np.mean(apart[:, 7:] ** 2, axis=0)).max() < np.radians(0.1)
    assert np.abs(apart[:, 3]).max() < 2.0
    assert np.abs(apart[:, 4:7]).max() < 0.05


def test_the_run_has_less_noise_than_the_smoothed_path(calm):
    profile, _, path = calm
    run = steered_run(profile, path)
    steady = ~profile.vibrating[1:-1]
    rough, smooth = (np.std(np.diff(each.states[:, 11], 2)[steady]) for each in (path, run))
    assert smooth < 0.2 * rough


def test_water_that_turns_the_glider_has_none():
    profile, _, path = smoothed_dive(load_scenario("impulses"))
    assert steered_run(profile, path) is None


def errors_about(path, profile, smoothed, monkeypatch):
    """Errors of a dive's estimate of its true hull over their deviations, about the run or the filter's path."""
    with monkeypatch.context() as patch:
        if path == "filter":
            patch.setattr(information, "steered_run", lambda *_: None)
        found = smoothed_dive_information(profile, smoothed, smoothed.last_pass, SETTINGS)
    posterior = np.eye(len(found.score)) + found.information
    errors = np.linalg.solve(posterior, found.score) / np.sqrt(np.diag(np.linalg.inv(posterior)))
    return dict(zip(found.names, errors, strict=True))


def test_damping_is_not_biased_by_the_noise_of_the_sensors(calm, monkeypatch):
    """About the filter's path, yaw damping seems wrong by many of its deviations; about the run it does not."""
    profile, smoothed, _ = calm
    assert errors_about("filter", profile, smoothed, monkeypatch)["viscous.K_r"] > 3.0
    assert abs(errors_about("run", profile, smoothed, monkeypatch)["viscous.K_r"]) < 2.0


def test_gusts_and_shear_are_not_taken_for_another_hull(monkeypatch):
    """They roll the glider as no noise of the disturbances does; the run's derivatives do not contain them."""
    profile, smoothed, path = smoothed_dive(load_scenario("paper").replaced({"depth_spread": 5.0}))
    assert steered_run(profile, path) is not None
    about_filter, about_run = (
        np.array(list(errors_about(way, profile, smoothed, monkeypatch).values())) for way in ("filter", "run")
    )
    assert np.abs(about_filter).max() > 3.0
    assert np.abs(about_run).max() < 2.0
    assert np.sqrt(np.mean(about_run**2)) < 0.3 * np.sqrt(np.mean(about_filter**2))
