"""Lanes engine: a dive's estimate does not depend on the batch, and a bad dive does not affect its neighbours."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from support.implementations import implementation_named
from support.missions import profile_series, replaced
from support.posed_windows import (
    PETREL,
    SCALE,
    STEP,
    at_rest,
    glide_of,
    impulse,
    posed_dive,
    solve_together,
    window_data,
)

from gliderhpc.errors import ProfileError
from gliderhpc.estimation.engines import FortranRun, WindowProblem, solve_window
from gliderhpc.estimation.lanes import LaneBatch, solve_in_lanes
from gliderhpc.estimation.preparation import prepare_profile
from gliderhpc.estimation.profile import estimate_profiles
from gliderhpc.estimation.settings import EstimationSettings, OptimizerSettings
from gliderhpc.estimation.window_plan import WindowPlan
from gliderhpc.estimation.windows import solve_profile
from gliderhpc.flight.glider import SENSED, Glider
from gliderhpc.kernels.elementwise import LANES
from gliderhpc.kernels.quasi_newton import run_until_done
from gliderhpc.outcomes import Outcome
from gliderhpc.platform import read_platform

pytestmark = pytest.mark.compiled

SETTINGS = EstimationSettings()
HULLS = ("petrel-l", "seawing", "seaglider")
DIVES = max(LANES + 3, 10)
"""Number of dives, larger than that of the lanes: some dives wait until a lane is free."""


def dive(number):
    """Return a dive with its own length, hull, disturbance and window length, and with gaps that empty one window."""
    rng = np.random.default_rng(number)
    platform = read_platform(HULLS[number % len(HULLS)])
    glider, glide = Glider(platform), glide_of(platform)
    steps = 300 + 37 * number
    controls = np.tile(glide.control, (steps, 1))
    truth = np.repeat(rng.normal(size=(steps // 10 + 1, 6)), 10, axis=0)[:steps] * SCALE
    states = glider.simulate(glide.state, controls, truth, STEP)
    measured = states[:, [0, 1, 2, 5]] + rng.normal(size=(steps + 1, 4)) * [5e-4, 5e-4, 5e-4, 0.03]
    weights = np.ones(steps + 1)
    if number % 4 == 1:
        weights[60:200] = 0.0
    plan = WindowPlan(length=60 + 30 * (number % 3), margin=20, cost_threshold=0.2, scale=tuple(SCALE.tolist()))
    return posed_dive(glider, controls, measured, weights, states, fallback=0.01, start=np.zeros((steps, 6)), plan=plan)


@pytest.fixture(scope="module")
def dives():
    return {number: dive(number) for number in range(DIVES)}


@pytest.fixture(scope="module", params=["numba", "fortran"])
def run(request):
    """Return the evaluation of the batch's trials: Numba's kernels, or Fortran's if they are built."""
    if request.param == "numba":
        return run_until_done
    implementation_named("fortran")
    return FortranRun()


@pytest.fixture(scope="module")
def alone(dives, run):
    """Return each dive's solution when it is solved alone."""
    return {number: solved({number: posed}, run)[number] for number, posed in dives.items()}


def solved(dives, run):
    return dict(solve_in_lanes(dives.items(), SETTINGS, run))


def assert_same_bits(solution, expected):
    """Compare everything but the computing time; NaN, the cost of an empty window, is equal to itself."""
    for name in ("disturbances", "states", "source"):
        assert getattr(solution, name).tobytes() == getattr(expected, name).tobytes(), name
    assert list(map(repr, solution.windows)) == list(map(repr, expected.windows))


@pytest.mark.parametrize("count", [1, 3, LANES, DIVES])
@pytest.mark.parametrize("order", ["forwards", "backwards", "shuffled"])
def test_a_dive_does_not_depend_on_what_is_solved_with_it(dives, alone, run, count, order):
    """The bits are the same in any lane, with any neighbours, batch size, or memory that was enlarged."""
    numbers = list(dives)
    if order == "backwards":
        numbers.reverse()
    elif order == "shuffled":
        np.random.default_rng(count).shuffle(numbers)
    for first in range(0, DIVES, count):
        batch = {number: dives[number] for number in numbers[first : first + count]}
        for number, solution in solved(batch, run).items():
            assert_same_bits(solution, alone[number])


def test_dives_are_solved_as_by_the_reference_engine(dives, alone):
    """Windows and outcomes are the same; both engines use the same code for the handover."""
    for number, problem in dives.items():
        expected = solve_profile(problem, partial(solve_window, settings=SETTINGS))
        ours = alone[number]
        assert [(w.start, w.stop, w.outcome) for w in ours.windows] == [
            (w.start, w.stop, w.outcome) for w in expected.windows
        ]
        assert ours.windows[0].outcome is Outcome.CONVERGED


def from_path(problem, **plan):
    """Pose a dive so that its windows start from the filter's states, and change its plan."""
    return replace(problem, path=problem.filtered.states[:, SENSED], plan=replace(problem.plan, **plan))


def one_at_a_time(problem, run, settings):
    """Solve the windows of a dive in turn, in the same lane."""
    batch = LaneBatch(settings, run)

    def solve(data, start):
        batch.load(3, (data, start))
        ((_, solution),) = batch.run()
        return solution

    return solve_profile(problem, solve)


SHORT = WindowPlan(length=30, margin=10, cost_threshold=0.2, scale=tuple(SCALE.tolist()))
HASTY = EstimationSettings(optimizer=OptimizerSettings(max_iterations=9))
"""Windows that may be halved have three iterations, too few for some."""


@pytest.mark.parametrize(
    ("plan", "settings", "retracted", "lengths"),
    [
        ({"cost_threshold": np.inf}, SETTINGS, {True}, 1),
        ({"cost_threshold": 0.0}, SETTINGS, {False}, 1),
        ({"cost_threshold": 0.0055}, SETTINGS, {True, False}, 1),
        ({"shorter": SHORT, "halves_early": True}, HASTY, {True}, 2),
        ({"shorter": replace(SHORT, length=60, scale=(0.5, *SHORT.scale[1:])), "halves_early": True}, HASTY, {True}, 1),
    ],
    ids=["all retracted", "none retracted", "some retracted", "again with a shorter plan", "again with another scale"],
)
def test_windows_solved_ahead_change_nothing(dives, run, plan, settings, retracted, lengths):
    """Each window is solved as if it were alone in the lanes, even if it begins elsewhere than expected."""
    posed = {number: from_path(dives[number], **plan) for number in (6, 7, 9)}
    found = dict(solve_in_lanes(posed.items(), settings, run))
    for number, solution in found.items():
        assert_same_bits(solution, one_at_a_time(posed[number], run, settings))
    windows = found[6].windows[:-1]
    assert {window.retracted for window in windows} == retracted
    assert len({window.stop - window.start for window in windows}) == lengths


def test_dives_are_posed_when_the_lanes_have_room_for_them(dives, run):
    """Windows ahead of one dive fill the lanes until it is nearly solved; a posed dive occupies memory."""
    taken = []

    def posed():
        for number in (6, 7, 9, 6, 7, 9):
            taken.append(number)
            yield number, from_path(dives[number])

    first, _ = next(solve_in_lanes(posed(), SETTINGS, run))
    assert first == 6
    assert len(taken) <= 3


def test_every_kind_of_window_occurs(alone):
    """The tests above cover solved and empty windows, several lengths and several iteration counts."""
    windows = [window for solution in alone.values() for window in solution.windows]
    assert {window.outcome for window in windows} >= {Outcome.CONVERGED, Outcome.NO_DATA}
    assert len({window.stop - window.start for window in windows}) > 3
    assert len({window.iterations for window in windows}) > 3


CORRUPTED = {
    "a measurement": lambda problem: {"profile": with_measurements(problem.profile)},
    "the masses": lambda problem: {"profile": replace(problem.profile, bodies=with_nan(problem.profile.bodies, 150))},
    "the start": lambda problem: {"start": with_nan(problem.start, 150)},
    "a start too far": lambda problem: {"start": problem.start + 1e6},
    "the filter's states": lambda problem: {
        "filtered": replace(problem.filtered, states=with_nan(problem.filtered.states, 0))
    },
}


def with_measurements(profile):
    series = profile.series
    return replace(profile, series=replace(series, measurements=with_nan(series.measurements, 150)))


def with_nan(array, row):
    corrupted = array.copy()
    corrupted[row] = np.nan
    return corrupted


@pytest.mark.parametrize("what", CORRUPTED)
def test_a_diverging_dive_does_not_affect_its_neighbours(dives, alone, run, what):
    """If one dive of the batch diverges, at its start or later, the others have the bits of a run without it."""
    problem = dives[2]
    corrupted = replace(problem, **CORRUPTED[what](problem))
    solutions = solved({**dives, 2: corrupted}, run)
    assert Outcome.DIVERGED in {window.outcome for window in solutions[2].windows}
    for number in dives:
        if number != 2:
            assert_same_bits(solutions[number], alone[number])


@pytest.mark.parametrize("factor", [1e4, 1e5, 1e6])
@pytest.mark.parametrize("seed", range(3))
def test_a_trial_step_that_blows_up_is_shortened(run, factor, seed):
    """A trial outside the model's domain, or with NaN, is never accepted and does not affect the neighbours."""
    wild = window_data(disturbance=impulse(), scale=factor * SCALE, seed=seed)
    calm = window_data(disturbance=impulse(), seed=seed)
    problem = WindowProblem(wild)
    begun, gradient = problem.evaluate(np.zeros(1800))
    problem.evaluate(-gradient / np.linalg.norm(gradient))
    assert not problem.flyable(), "the first trial step must be one that blows up"
    tasks = [(wild, at_rest(wild)), (calm, at_rest(calm))]
    solution, neighbour = solve_together(tasks, SETTINGS, run)
    assert solution.outcome.usable
    assert solution.cost <= begun
    assert np.abs(solution.states[:, 1]).max() < np.pi / 2.0
    assert problem.evaluate((solution.disturbances / wild.scale).ravel())[0] == pytest.approx(solution.cost)
    (expected,) = solve_together(tasks[1:], SETTINGS, run)
    assert neighbour.disturbances.tobytes() == expected.disturbances.tobytes()


def test_a_start_that_rolls_faster_than_a_turn_a_second_diverges(run):
    data = window_data()
    start = np.zeros((300, 6))
    start[:, 3] = 60.0 * np.sign(np.sin(0.6 * np.arange(300)))
    (solution,) = solve_together([(data, start)], SETTINGS, run)
    assert solution.outcome is Outcome.DIVERGED


def test_a_longer_window_makes_room_while_others_are_under_way(run):
    """It does not change a window that is solved at the same time."""
    short = window_data(150, disturbance=impulse()[:150], seed=1)
    long = window_data(disturbance=impulse(), seed=2)
    quick = window_data(20, seed=3)
    expected = [solve_together([(data, at_rest(data))], SETTINGS, run)[0] for data in (short, long)]
    batch = LaneBatch(SETTINGS, run)
    batch.load(1, (short, at_rest(short)))
    batch.load(0, (quick, at_rest(quick)))
    assert [lane for lane, _ in batch.run()] == [0], "the quick window must end first"
    batch.load(0, (long, at_rest(long)))
    solutions = {}
    while len(solutions) < 2:
        solutions.update(batch.run())
    for lane, data in ((1, expected[0]), (0, expected[1])):
        assert data.iterations > 0
        assert solutions[lane].disturbances.tobytes() == data.disturbances.tobytes()
        assert repr(solutions[lane].cost) == repr(data.cost)


def test_a_profile_that_is_refused_leaves_the_others_alone(brief):
    """Its error is returned by its key; the others are the same as without it."""
    series = {number: profile_series(brief, number, SETTINGS) for number in (1, 2, 3)}
    noise = np.random.default_rng(0).normal(size=series[2].measurements.shape)
    bad = replaced(series[2], measurements=series[2].measurements + noise)
    glider = Glider(PETREL)
    tasks = [
        (1, prepare_profile(glider, series[1])),
        (2, prepare_profile(glider, bad)),
        (3, prepare_profile(glider, series[3])),
    ]
    estimates = dict(estimate_profiles(tasks, SETTINGS))
    assert isinstance(estimates[2], ProfileError)
    without = dict(estimate_profiles([tasks[0], tasks[2]], SETTINGS))
    for number in (1, 3):
        assert_same_bits(estimates[number].solution, without[number].solution)
