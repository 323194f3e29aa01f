"""Line search (Moré and Thuente, 1994): strong Wolfe conditions, known minimisers, and the trials of L-BFGS-B."""

import math

import numpy as np
import pytest
from scipy.optimize import minimize

from gliderhpc.kernels.line_search import (
    CONTINUE,
    CURVATURE,
    DECREASE,
    EXHAUSTED,
    FOUND,
    LONGEST,
    advance_search,
    start_search,
)

TRIES = 20


def search(function, slope, step):
    """Return the trial steps of a search from zero, and its result."""
    state, verdict, trials = start_search(function(0.0), slope(0.0), step), CONTINUE, []
    while verdict == CONTINUE and len(trials) < TRIES:
        trials.append(state.step)
        state, verdict = advance_search(state, function(state.step), slope(state.step))
    return trials, verdict


def assert_strong_wolfe(function, slope, step):
    """Assert eqs. 1.1 and 1.2 of Moré and Thuente."""
    assert function(step) <= function(0.0) + DECREASE * step * slope(0.0)
    assert abs(slope(step)) <= CURVATURE * abs(slope(0.0))


def _rational(beta=2.0):
    return lambda t: -t / (t * t + beta), lambda t: (t * t - beta) / (t * t + beta) ** 2


def _quintic(beta=0.004):
    return (
        lambda t: (t + beta) ** 5 - 2.0 * (t + beta) ** 4,
        lambda t: 5.0 * (t + beta) ** 4 - 8.0 * (t + beta) ** 3,
    )


def _wavy(beta=0.01, waves=39.0):
    """Return the function of eq. 5.3: a kink, rounded over 2 beta about 1, with superposed waves."""
    half = math.pi / 2.0

    def kinked(t):
        if t <= 1.0 - beta:
            return 1.0 - t
        return t - 1.0 if t >= 1.0 + beta else (t - 1.0) ** 2 / (2.0 * beta) + beta / 2.0

    def bent(t):
        return float(np.clip((t - 1.0) / beta, -1.0, 1.0))

    wave = 2.0 * (1.0 - beta) / (waves * math.pi)
    return (
        lambda t: kinked(t) + wave * math.sin(waves * half * t),
        lambda t: bent(t) + (1.0 - beta) * math.cos(waves * half * t),
    )


PAPER = {"eq. 5.1": _rational(), "eq. 5.2": _quintic(), "eq. 5.3": _wavy()}


@pytest.mark.parametrize("step", [1e-3, 1e-1, 1e1, 1e3])
@pytest.mark.parametrize("name", PAPER)
def test_the_papers_functions(name, step):
    """Search the functions of section 5 from four first trials each; a narrow interval may end at the lowest trial."""
    function, slope = PAPER[name]
    trials, verdict = search(function, slope, step)
    if verdict == FOUND:
        assert_strong_wolfe(function, slope, trials[-1])
    else:
        assert verdict == EXHAUSTED
        assert function(trials[-1]) == min(map(function, trials))
    assert function(trials[-1]) < function(0.0)


def _random_functions(count):
    """Draw sums of waves and a wide parabola, downhill at zero."""
    rng = np.random.default_rng(0)
    while count > 0:
        height, pace = np.exp(rng.normal(size=(2, 6)))
        terms = list(zip(height, pace, rng.uniform(0.0, 2.0 * math.pi, 6), strict=True))

        def function(t, terms=terms):
            return sum(a * math.sin(w * t + p) for a, w, p in terms) + 0.05 * t * t

        def slope(t, terms=terms):
            return sum(a * w * math.cos(w * t + p) for a, w, p in terms) + 0.1 * t

        if slope(0.0) < 0.0:
            count -= 1
            yield function, slope, 10.0 ** rng.uniform(-3.0, 3.0)


def test_random_functions():
    """A step reported as found satisfies the conditions; nearly every search finds one."""
    verdicts = []
    for function, slope, step in _random_functions(500):
        trials, verdict = search(function, slope, step)
        verdicts.append(verdict)
        if verdict == FOUND:
            assert_strong_wolfe(function, slope, trials[-1])
    assert verdicts.count(FOUND) >= 490


def _first_search_of_scipy(function, slope):
    """Return the points of L-BFGS-B's first search, for a function of one unknown from zero."""
    points = []

    def both(x):
        points.append(float(x[0]))
        return function(points[-1]), np.array([slope(points[-1])])

    minimize(both, np.zeros(1), jac=True, method="L-BFGS-B", options={"maxiter": 1, "gtol": 0.0, "ftol": 0.0})
    assert points[0] == 0.0
    return np.array(points[1:])


def _along_the_steepest_descent(function, slope, unit):
    """Return the points of our search of the same function, in units of ``unit``, from a first step of length one."""
    steepest = -unit * slope(0.0)
    trials, _ = search(
        lambda t: function(unit * steepest * t), lambda t: steepest * unit * slope(unit * steepest * t), 1.0 / steepest
    )
    points = steepest * np.array(trials)
    return points[np.append(True, np.diff(points) != 0.0)]


def test_trials_are_those_of_the_reference_engine():
    lengths = []
    for function, slope, unit in _random_functions(200):
        theirs = _first_search_of_scipy(
            lambda x, f=function, unit=unit: f(unit * x), lambda x, g=slope, unit=unit: unit * g(unit * x)
        )
        np.testing.assert_allclose(_along_the_steepest_descent(function, slope, unit), theirs, rtol=1e-9)
        lengths.append(len(theirs))
    assert max(lengths) > 5


@pytest.mark.parametrize("minimiser", [1e-3, 0.4, 1.0, 30.0, 1e4])
def test_a_parabola_is_met_at_its_lowest(minimiser):
    """The interpolation from a trial beyond the minimiser is exact."""
    trials, verdict = search(lambda t: (t - minimiser) ** 2, lambda t: 2.0 * (t - minimiser), 40.0 * minimiser)
    assert verdict == FOUND
    assert trials[-1] == pytest.approx(minimiser, rel=1e-9)


def test_a_trial_beyond_the_domain_comes_back():
    """A steep, high wall at every trial beyond one makes the search end before it."""

    def function(t):
        return (t - 2.0) ** 2 if t < 1.0 else 1e6

    def slope(t):
        return 2.0 * (t - 2.0) if t < 1.0 else 1e6

    trials, verdict = search(function, slope, 50.0)
    assert verdict == FOUND
    assert trials[0] > 1.0 > trials[-1]


def test_a_bottomless_slope_is_followed_to_the_longest_step():
    trials, verdict = search(lambda t: -t, lambda t: -1.0, 1.0)
    assert verdict == EXHAUSTED
    assert trials[-1] == LONGEST
    assert np.all(np.diff(trials) > 0.0)


def test_a_slope_that_lies_is_given_up():
    """The function rises everywhere, contrary to its slope; no step is found, however short."""
    trials, verdict = search(lambda t: t, lambda t: -1.0, 1.0)
    assert verdict != FOUND
    assert trials[-1] < 0.1 * trials[0]


@pytest.mark.parametrize("rubbish", [math.nan, math.inf])
def test_a_value_that_is_no_number_is_never_found(rubbish):
    state = start_search(1.0, -1.0, 1.0)
    _, verdict = advance_search(state, rubbish, -0.1)
    assert verdict != FOUND
