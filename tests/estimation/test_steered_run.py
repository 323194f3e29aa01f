"""Run of the model along a path: linearisation without sensor noise, and the biases that this removes."""

from dataclasses import replace

import numpy as np
import pytest

from gliderhpc.estimation.filter import run_filter
from gliderhpc.estimation.preparation import controls_of, prepare_profile
from gliderhpc.estimation.resample import on_steps
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.estimation.smoother import information, iterate, steered_run
from gliderhpc.estimation.smoother.information import smoothed_hull_information
from gliderhpc.estimation.smoother.iterate import run_smoother
from gliderhpc.estimation.smoother.problem import RollingGusts, Trajectory, starting_trajectory
from gliderhpc.estimation.smoother.steered_run import find_gusts, information_path
from gliderhpc.flight.glider import SENSED, Glider
from gliderhpc.flight.hull_parameters import ACTUATOR_LAG, hull_parameters, moved_platform, with_values
from gliderhpc.flight.steady_glide import glides_stably
from gliderhpc.kernels.follow import follow
from gliderhpc.platform import read_platform
from gliderhpc.simulator import Scenario, load_scenario, simulate_profile
from gliderhpc.twins.cases import with_white_errors

pytestmark = pytest.mark.compiled

HULL = read_platform("petrel-l")
SETTINGS = EstimationSettings(step=0.25)
STILL = SETTINGS.model_copy(update={"smoother": SETTINGS.smoother.model_copy(update={"vertical_motion": 0.0})})
"""The same for water that does not move vertically, to which the slow forces below would otherwise be attributed."""


def flown_dive(scenario, seed=3, depth=60.0, hull=HULL):
    """Return a dive of the true hull on its steps, the filter's estimate, and the truth."""
    record, truth = simulate_profile(hull, scenario.replaced({"depth": depth}), seed)
    profile = prepare_profile(Glider(hull), on_steps(record, SETTINGS, hull))
    return profile, run_filter(profile, SETTINGS), truth


def smoothed_profile(scenario):
    """Return a dive on its steps, its estimate, and the smoothed path."""
    profile, filtered, _ = flown_dive(scenario)
    smoothed = run_smoother(profile, filtered, SETTINGS)
    path = Trajectory(smoothed.states, np.vstack([smoothed.disturbances, smoothed.disturbances[-1]]))
    return profile, smoothed, path


@pytest.fixture(scope="module")
def calm():
    return smoothed_profile(with_white_errors(load_scenario("calm")))


def run_of(profile, path):
    """Return the run along the path of a dive for which the filter's path is not needed."""

    def unexpected():
        raise AssertionError("the run does not follow the glider")

    return information_path(profile, path, unexpected)


def test_run_is_a_trajectory_near_the_smoothed_path(calm):
    profile, _, path = calm
    run = run_of(profile, path)
    controls = controls_of(HULL, profile.series)[:, :4]
    again = profile.glider.simulate(run.states[0], controls, run.disturbances[:-1], profile.series.step)
    np.testing.assert_allclose(again[:, SENSED], run.states[:, SENSED], atol=1e-6)
    apart = (run.states - path.states)[:, SENSED]
    assert np.sqrt(np.mean(apart[:, 7:] ** 2, axis=0)).max() < np.radians(0.1)
    assert np.abs(apart[:, 3]).max() < 2.0
    assert np.abs(apart[:, 4:7]).max() < 0.05


def test_run_has_less_noise_than_the_smoothed_path(calm):
    profile, _, path = calm
    run = run_of(profile, path)
    steady = ~profile.vibrating[1:-1]
    rough, smooth = (np.std(np.diff(each.states[:, 11], 2)[steady]) for each in (path, run))
    assert smooth < 0.2 * rough


def test_in_water_that_turns_the_glider_only_the_turns_are_those_of_the_filter():
    profile, _, path = smoothed_profile(load_scenario("impulses"))
    filtered = Trajectory(path.states + 0.001, path.disturbances + 0.001)
    found = information_path(profile, path, lambda: filtered)
    turning, gliding = [0, 2, 7, 9, 11], [1, 5, 6, 8, 10]
    np.testing.assert_array_equal(found.states[:, turning], filtered.states[:, turning])
    np.testing.assert_array_equal(found.disturbances[:-1, 1::2], filtered.disturbances[:-1, 1::2])
    assert not np.isclose(found.states[1:, gliding], filtered.states[1:, gliding], rtol=1e-9).any(axis=1).all()
    steady = ~profile.vibrating[:-1]
    assert np.std(found.disturbances[:-1][steady, 0]) < 0.5 * np.std(path.disturbances[:-1][steady, 0])


def test_no_run_represents_a_dive_whose_speed_it_does_not_keep(calm):
    profile, _, path = calm
    fast = path.states.copy()
    fast[:, 6] *= 2.0
    filtered = Trajectory(path.states + 0.001, path.disturbances)
    assert information_path(profile, Trajectory(fast, path.disturbances), lambda: filtered) is filtered


def test_a_run_in_which_any_state_diverges_is_not_used(calm, monkeypatch):
    """The speed can stay finite while the roll diverges; the information about such a run was not finite."""
    profile, _, path = calm

    def diverging(hull, bodies, disturbances, step, turning_rate, gliding_rate, states):
        follow(hull, bodies, disturbances, step, turning_rate, gliding_rate, states)
        states[len(states) // 2 :, 0] = np.inf

    monkeypatch.setattr(steered_run, "follow", diverging)
    assert steered_run.run_along(profile, path) is None
    filtered = Trajectory(path.states + 0.001, path.disturbances)
    assert information_path(profile, path, lambda: filtered) is filtered


def errors_about(path, profile, smoothed, monkeypatch):
    """Errors of a dive's estimate of its true hull over their deviations, about the run or the filter's path."""
    with monkeypatch.context() as patch:
        if path == "filter":
            patch.setattr(information, "information_path", lambda *given: given[-1]())
        found = smoothed_hull_information(profile, smoothed, smoothed.last_pass, STILL)
    posterior = np.eye(len(found.score)) + found.information
    errors = np.linalg.solve(posterior, found.score) / np.sqrt(np.diag(np.linalg.inv(posterior)))
    return dict(zip(found.names, errors, strict=True))


def test_a_slow_surge_force_is_not_taken_for_drag(monkeypatch):
    """About the filter's path, forces that vary within ten minutes to forty reduce the drag."""
    slow = {"disturbances": {"slow_rms": [0.25, 0.0, 0.0, 0.0, 0.0, 0.0], "impulse_interval": None}}
    errors = {"filter": [], "run": []}
    for seed in (1, 2, 3):
        profile, filtered, _ = flown_dive(load_scenario("impulses").replaced(slow), seed, depth=200.0)
        smoothed = run_smoother(profile, filtered, SETTINGS)
        for way, found in errors.items():
            found.append(errors_about(way, profile, smoothed, monkeypatch)["viscous.K_D0"])
    assert np.mean(errors["filter"]) < -1.5
    assert abs(np.mean(errors["run"])) < 0.5 * abs(np.mean(errors["filter"]))


def test_damping_is_not_biased_by_the_noise_of_the_sensors(calm, monkeypatch):
    """About the filter's path, yaw damping seems wrong by many of its deviations; about the run it does not."""
    profile, smoothed, _ = calm
    assert errors_about("filter", profile, smoothed, monkeypatch)["viscous.K_r"] > 3.0
    assert abs(errors_about("run", profile, smoothed, monkeypatch)["viscous.K_r"]) < 2.0


def test_gusts_and_shear_are_not_taken_for_another_hull(monkeypatch):
    """They roll the glider as no noise of the disturbances does; the run's derivatives do not contain them."""
    profile, smoothed, path = smoothed_profile(load_scenario("paper").replaced({"depth_spread": 5.0}))
    run_of(profile, path)
    about_filter, about_run = (
        np.array(list(errors_about(way, profile, smoothed, monkeypatch).values())) for way in ("filter", "run")
    )
    assert np.abs(about_filter).max() > 3.0
    assert np.abs(about_run).max() < 2.0
    assert np.sqrt(np.mean(about_run**2)) < 0.3 * np.sqrt(np.mean(about_filter**2))


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("calm", None),
        ("impulses", None),
        ("paper", RollingGusts(False)),
        ("harsh", RollingGusts(False)),
        ("demo", RollingGusts(True)),
    ],
)
@pytest.mark.parametrize("seed", [1, 3])
def test_gusts_impulses_and_both_together_are_distinguished(name, expected, seed):
    profile, filtered, _ = flown_dive(load_scenario(name).replaced({"depth_spread": 5.0}), seed, depth=100.0)
    assert find_gusts(profile, starting_trajectory(filtered)) == expected


@pytest.mark.parametrize("seed", range(3))
def test_a_wrong_hull_is_not_taken_for_gusts(seed):
    """In calm water, a hull with plausible errors in roll and turn terms does not look as if gusts rolled it."""
    rng, keys = np.random.default_rng(seed), ("K_p", "K_r", "K_MR", "K_MY", "K_beta", "added_inertia", "hull", "eccen")
    lateral = [p for p in hull_parameters(HULL) if any(key in p.key for key in keys)]
    hull = moved_platform(HULL, lateral, rng.standard_normal(len(lateral)))
    record, _ = simulate_profile(HULL, load_scenario("calm").replaced({"depth": 60.0, "depth_spread": 0.0}), 3)
    profile = prepare_profile(Glider(hull), on_steps(record, SETTINGS, hull))
    assert find_gusts(profile, starting_trajectory(run_filter(profile, SETTINGS))) is None


GUSTS = {"disturbances": {"slow_rms": [0.03, 0.0, 0.05, 0.0, 0.01, 0.0], "impulse_interval": None}}


def another_petrel(seed):
    """Return a hull that differs from the shipped one by its plausible deviations, and glides."""
    rng, parameters = np.random.default_rng(seed), [p for p in hull_parameters(HULL) if "sensors" not in p.key]
    while not glides_stably(Glider(hull := moved_platform(HULL, parameters, rng.standard_normal(len(parameters))))):
        pass
    return hull


@pytest.mark.parametrize("errors", [lambda scenario: scenario, with_white_errors])
@pytest.mark.parametrize(("rms", "expected"), [(0.0, None), (0.007, RollingGusts(False)), (0.02, RollingGusts(False))])
def test_gusts_of_millimetres_per_second_are_found_on_any_hull(rms, expected, errors):
    """The difference of the path's roll rates from those of a run did not show them on most hulls."""
    scenario = errors(Scenario().replaced({**GUSTS, "gusts": {"kind": "gaussian", "rms": rms}}))
    for hull in (HULL, another_petrel(1), another_petrel(2), read_platform("seawing")):
        profile, filtered, _ = flown_dive(scenario, seed=1, depth=100.0, hull=hull)
        assert find_gusts(profile, starting_trajectory(filtered)) == expected


@pytest.mark.long
def test_gusts_do_not_bias_the_speed_of_hulls_unlike_the_shipped_ones():
    """Each hull is known exactly. With a hundredth of the roll's weight in place of 1/3000, errors were doubled."""
    scenarios = {
        "weak": Scenario().replaced({**GUSTS, "gusts": {"kind": "gaussian", "rms": 0.005}}),
        "paper": load_scenario("paper").replaced({"depth_spread": 0.0}),
        "demo": load_scenario("demo").replaced({"depth_spread": 0.0}),
    }
    biases, ratios = [], []
    for hull in (HULL, *map(another_petrel, (1, 2, 3, 5, 7, 8))):
        for scenario in scenarios.values():
            profile, filtered, truth = flown_dive(scenario, seed=1, depth=100.0, hull=hull)
            found, time = run_smoother(profile, filtered, SETTINGS), profile.series.time
            steady = ~profile.vibrating & (time > 60.0) & (time < truth.time[-1] - 30.0)
            error = (found.states[:, 6] - np.interp(time, truth.time, truth.states[:, 6]))[steady].mean()
            biases.append(error)
            ratios.append(error / found.states_std[steady, 6].mean())
    assert np.sqrt(np.mean(np.square(biases))) < 0.006
    assert np.sqrt(np.mean(np.square(ratios))) < 1.0


def test_a_slow_record_does_not_show_gusts():
    profile, filtered, _ = flown_dive(load_scenario("paper").replaced({"depth_spread": 5.0}))
    slow = replace(profile, series=replace(profile.series, sample_interval=4.0))
    assert find_gusts(slow, starting_trajectory(filtered)) is None


@pytest.mark.parametrize(("name", "seeds"), [("paper", (1, 2, 5)), ("demo", (1, 3, 4))])
def test_roll_in_gusts_does_not_bias_the_smoothed_speed(name, seeds, monkeypatch):
    """Without the priors for gusts the smoothed speed of the true hull is wrong; with impulses, the usual factors too.

    In gusts alone the prior of the side force and the variance of the roll are the usual ones; in gusts with impulses
    (demo), the noise of the yaw moment has the factor of its quiet stretches.
    """
    same = {"depth_spread": 0.0, "coefficients": {"spread": 0.0}}
    dives = [flown_dive(load_scenario(name).replaced(same), seed, depth=100.0) for seed in seeds]

    def error():
        squares = []
        for profile, filtered, truth in dives:
            found, time = run_smoother(profile, filtered, SETTINGS), profile.series.time
            steady = ~profile.vibrating & (time > 60.0) & (time < truth.time[-1])
            squares.append(np.mean((found.states[:, 6] - np.interp(time, truth.time, truth.states[:, 6]))[steady] ** 2))
        return np.sqrt(np.mean(squares))

    found = error()
    monkeypatch.setattr(iterate, "find_gusts", lambda *_: RollingGusts(False) if name == "demo" else None)
    assert found < 0.006
    assert found < 0.5 * error()


def test_the_side_force_of_gusts_lies_in_its_intervals():
    """In gusts with impulses as well (demo): 68 % intervals hold 0.6 or more of the truth, which varies too fast."""
    profile, filtered, truth = flown_dive(load_scenario("demo").replaced({"depth_spread": 0.0}), 1, depth=100.0)
    found, time = run_smoother(profile, filtered, SETTINGS), profile.series.time[:-1]
    steady = ~profile.vibrating[:-1] & (time > 60.0) & (time < truth.time[-1])
    sway = np.interp(time, truth.step * np.arange(len(truth.disturbances)), truth.disturbances[:, 1])
    apart = np.abs(found.disturbances[:, 1] - sway)[steady]
    assert np.mean(apart < found.disturbances_std[:, 1][steady]) > 0.6


# Slow records


def slow_errors(name, path, monkeypatch):
    """Errors over deviations of a slow record's estimate of its true hull, about a run or about the filter's path."""
    scenario = load_scenario(name).replaced({"depth_spread": 5.0})
    hull = with_values(read_platform("slocum"), {ACTUATOR_LAG: scenario.actuation.lag})
    profile, filtered, _ = flown_dive(scenario, 4, depth=200.0, hull=hull)
    smoothed = run_smoother(profile, filtered, SETTINGS)
    return np.array(list(errors_about(path, profile, smoothed, monkeypatch).values()))


def test_swings_of_the_pitch_between_slow_samples_do_not_bias_the_hull(monkeypatch):
    """The prior of slow sensors lets the pitch swing between the samples; the filter's path contains such swings."""
    about_filter, about_run = (slow_errors("calm", path, monkeypatch) for path in ("filter", "run"))
    assert np.abs(about_filter).max() > 1.0
    assert np.abs(about_run).max() < 0.3


def test_gusts_that_a_slow_record_does_not_resolve_do_not_bias_the_hull(monkeypatch):
    """They roll the glider within a sample interval: the roll would be taken for the hull."""
    errors = slow_errors("paper", "run", monkeypatch)
    monkeypatch.setattr(information, "_without_turning", lambda problem: problem)
    with_turning = slow_errors("paper", "run", monkeypatch)
    assert np.abs(errors).max() < 1.0
    assert np.abs(with_turning).max() > 2.0
