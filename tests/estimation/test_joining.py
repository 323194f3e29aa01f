"""Joining windows without seams: blending over overlaps, and one run along the result."""

from dataclasses import replace

import numpy as np
import pytest
from support.posed_windows import PETREL, STEP, glide_of
from test_windows import Scripted, dive_problem, spans

from gliderhpc.estimation import joining
from gliderhpc.estimation.joining import fading
from gliderhpc.estimation.window_plan import WindowPlan
from gliderhpc.estimation.windows import solve_profile
from gliderhpc.flight.glider import SENSED, Glider
from gliderhpc.kernels.follow import follow
from gliderhpc.outcomes import Outcome

GLIDER = Glider(PETREL)
DIVE = glide_of(PETREL)


def path_problem(steps, plan=None, **options):
    """Return a dive whose windows start from the flown path, without disturbance."""
    problem = dive_problem(steps, plan, **options)
    states = problem.filtered.states - np.array([0, 0, 0, 50.0, -80.0, 0.01, 0.001, 0, 0, 0, 0, 0])
    return replace(problem, start=np.zeros((steps, 6)), path=states[:, SENSED], from_smoothed=True)


def flown(states, disturbances, steps):
    """Run the model from the first state under disturbances."""
    return GLIDER.simulate(states[0], np.tile(DIVE.control, (steps, 1)), disturbances, STEP)


def test_weights_of_an_overlap_have_no_kink():
    weights = fading(100)
    assert (weights[0], weights[50], weights[-1]) == (0.0, 0.5, 1.0)
    assert (np.diff(weights) > 0.0).all()
    assert np.diff(weights)[[0, -1]].max() < 0.03 * np.diff(weights).max()


def test_windows_of_a_path_start_from_its_states():
    problem, solver = path_problem(700), Scripted((0.1, Outcome.CONVERGED), (0.5, Outcome.CONVERGED))
    solution = solve_profile(problem, solver)
    assert spans(solution) == [(0, 300, True), (200, 500, False), (500, 700, False)]
    for window, state in zip(solution.windows, solver.states0, strict=True):
        np.testing.assert_array_equal(state, problem.path[window.start])
    assert solution.from_smoothed
    np.testing.assert_array_equal(solution.source, np.repeat([0, 1, 2], [200, 300, 200]))


def test_a_solution_fades_into_the_next_over_their_overlap():
    solution = solve_profile(path_problem(700), Scripted())
    steps = np.abs(np.diff(solution.disturbances, axis=0))
    # The solutions of the windows differ by 1e-4, which would be the step if one simply replaced the other.
    assert steps.max() < 0.2 * 1e-4
    roll = solution.disturbances[:, 3]
    np.testing.assert_allclose(roll[[100, 350, 650]], 1e-4 * np.array([1, 2, 3]), rtol=0.05)
    assert (np.diff(roll[205:295]) > 0.0).all()
    assert roll[250] == pytest.approx(1.5e-4, rel=0.05)


def test_joined_windows_form_a_single_trajectory():
    """States and track follow from the disturbances over the whole dive, including seams without an overlap."""
    solver = Scripted((0.1, Outcome.CONVERGED), (0.5, Outcome.CONVERGED))
    solution = solve_profile(path_problem(700), solver)
    np.testing.assert_allclose(solution.states, flown(solution.states, solution.disturbances, 700), atol=1e-9)


def test_a_failed_window_of_a_path_leaves_the_prior():
    problem = path_problem(1000)
    solution = solve_profile(problem, Scripted((0.1, Outcome.CONVERGED), (0.0, Outcome.DIVERGED)))
    assert spans(solution)[:3] == [(0, 300, True), (200, 500, False), (500, 800, True)]
    np.testing.assert_array_equal(solution.disturbances[200:500], problem.filtered.disturbances[200:500])
    np.testing.assert_array_equal(solution.states[201:500, SENSED], problem.filtered.states[201:500, SENSED])
    np.testing.assert_array_equal(solution.states[500, SENSED], problem.path[500])


def test_a_short_window_inside_an_overlap_leaves_no_step():
    """The window of a shorter plan may end inside the overlap; the earlier solution continues from there."""
    shorter = WindowPlan(length=60, margin=20, cost_threshold=0.2)
    problem = path_problem(700, WindowPlan(length=300, margin=100, cost_threshold=0.2, shorter=shorter))
    solution = solve_profile(problem, Scripted((0.1, Outcome.CONVERGED), (0.3, Outcome.STALLED)))
    assert spans(solution)[1][:2] == (200, 260)
    assert np.isfinite(solution.states).all()
    np.testing.assert_allclose(solution.states, flown(solution.states, solution.disturbances, 700), atol=1e-9)


def test_a_run_that_cannot_be_flown_is_not_used(monkeypatch):
    plain = solve_profile(path_problem(300), Scripted())

    def lost(hull, bodies, b, h, lateral, longitudinal, states):
        states[:] = np.nan

    monkeypatch.setattr(joining, "follow", lost)
    solution = solve_profile(path_problem(300), Scripted())
    assert np.isfinite(solution.states).all()
    np.testing.assert_allclose(solution.states, plain.states, atol=1e-4)


# The run


def steered(offset, rate=0.5, steps=400):
    """Follow a steady glide from a state next to it; return disturbances, states, and those of the glide."""
    controls, path = np.tile(DIVE.control, (steps, 1)), np.empty((steps + 1, 10))
    path[:] = GLIDER.simulate(DIVE.state, controls, np.zeros((steps, 6)), STEP)[:, SENSED]
    states, disturbances = path.copy(), np.zeros((steps, 6))
    states[0] += offset
    follow(GLIDER.hull, GLIDER.bodies(controls), disturbances, STEP, rate, rate, states)
    return disturbances, states, path


def test_a_run_on_its_path_is_not_steered():
    disturbances, states, path = steered(np.zeros(10))
    assert np.abs(disturbances).max() < 1e-9
    np.testing.assert_allclose(states, path, atol=1e-10)


@pytest.mark.parametrize("index", range(10))
def test_a_distance_from_the_path_is_steered_away(index):
    """It decays at 0.5 1/s, or more slowly if the water's forces are larger: two per cent remain after 39 s."""
    offset = np.zeros(10)
    offset[index] = 0.01
    disturbances, states, path = steered(offset)
    assert np.abs(states - path)[390:].max() < 0.02 * 0.01
    twelve = np.zeros(12)
    twelve[SENSED] = states[0]
    own = GLIDER.simulate(twelve, np.tile(DIVE.control, (400, 1)), disturbances, STEP)
    np.testing.assert_allclose(own[:, SENSED], states, atol=1e-10)


def test_the_steering_force_is_that_of_a_critically_damped_oscillator():
    """It is ``M (2 rate dv + rate^2 dx)`` (`steering`), for each channel."""
    offset = np.array([0.01, -0.02, 0.03, 0.5, 0.04, -0.05, 0.06, 0.001, -0.002, 0.003])
    disturbances, states, path = steered(offset)
    rate, hull, apart = 0.5, GLIDER.hull, (states - path)[1]
    inertia = [hull.mass_u, hull.mass_v, hull.mass_w, hull.inertia_p, hull.inertia_q, hull.inertia_r]
    places = np.array([0.0, 0.0, apart[3], *apart[:3]])
    np.testing.assert_allclose(
        disturbances[1], -np.array(inertia) * (2 * rate * apart[4:] + rate**2 * places), rtol=1e-9
    )
