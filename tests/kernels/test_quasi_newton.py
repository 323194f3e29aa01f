"""L-BFGS in lanes: its directions are those of the textbook, and its descents end like the reference engine's."""

from dataclasses import replace

import numpy as np
import pytest
from support.posed_windows import SCALE, at_rest, solve_together, window_data
from support.sizes import COMPILED, scaled

from gliderhpc.estimation.engines import WindowProblem, solve_window
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.kernels.elementwise import LANES
from gliderhpc.kernels.lane_memory import ENDED, RETURNING, SEARCHING, allocate, load_window
from gliderhpc.kernels.line_search import Search
from gliderhpc.kernels.pairs import combine_pairs
from gliderhpc.kernels.quasi_newton import MAX_TRIES, advance, aim
from gliderhpc.outcomes import Outcome

STEPS = scaled(300, 10)
HISTORY = 4
TOLERANCE = scaled(5e-4, 1e-6)
TIGHT = scaled(1e-5, 1e-7)


def settings_of(**optimizer):
    return EstimationSettings.model_validate({"optimizer": optimizer})


def posed(count=LANES, steps=STEPS):
    """Return long and short windows of a hull under disturbances, and their starts."""
    made = []
    for seed in range(count):
        n = steps if seed % 2 == 0 else steps - steps // (2 + seed)
        truth = 10.0 * np.random.default_rng(seed).normal(size=(n, 6)) * SCALE
        data = window_data(n, disturbance=truth, seed=seed)
        made.append((data, at_rest(data)))
    return made


class Watched:
    """Descents, advanced one round at a time, with every accepted point."""

    def __init__(self, tasks, *, history=HISTORY, tolerance=TIGHT):
        self.memory = allocate(STEPS, history)
        problem, descent, progress = self.memory
        for lane, (data, start) in enumerate(tasks):
            load_window(
                problem, descent, progress, lane, data.hull, data.bodies, data.state0, data.measurements, data.weights,
                data.step, data.scale, start, tolerance * data.step, 200,
            )  # fmt: skip
        self.points = [[] for _ in tasks]
        self.slopes = [[] for _ in tasks]

    def advance(self):
        """Advance one round; return the lanes that continue from a new point."""
        _, descent, progress = self.memory
        before = progress.iterations.copy(), progress.status.copy()
        advance(*self.memory)
        moved = []
        for lane, points in enumerate(self.points):
            at_work = progress.status[lane] == SEARCHING
            if at_work and (progress.iterations[lane] > before[0][lane] or before[1][lane] != SEARCHING):
                points.append(descent.point[..., lane].ravel().copy())
                self.slopes[lane].append(descent.slope[..., lane].ravel().copy())
                moved.append(lane)
        return moved

    def direction(self, lane):
        return self.memory[1].direction[..., lane].ravel()


def two_loops(points, slopes, history):
    """Run Nocedal's recursion on the vectors themselves (1980, Math. Comp. 35, 773-782)."""
    pairs = [
        (after - before, changed - slope)
        for before, after, slope, changed in zip(points, points[1:], slopes, slopes[1:], strict=False)
    ]
    pairs = [(s, y) for s, y in pairs if s @ y > 0.0][-history:]
    q, weights = slopes[-1].copy(), []
    for s, y in reversed(pairs):
        weights.append((s @ q) / (s @ y))
        q -= weights[-1] * y
    if pairs:
        s, y = pairs[-1]
        q *= (s @ y) / (y @ y)
    for (s, y), weight in zip(pairs, reversed(weights), strict=True):
        q += (weight - (y @ q) / (s @ y)) * s
    return -q


def test_directions_are_those_of_the_textbook():
    """The recursion on the products of pairs gives the same as on the pairs; each lane has its own history."""
    watched = Watched(posed(4))
    compared = 0
    for _ in range(scaled(60, 25)):
        for lane in watched.advance():
            points, slopes = watched.points[lane], watched.slopes[lane]
            expected = two_loops(points, slopes, HISTORY)
            error = np.abs(watched.direction(lane) - expected).max()
            assert error < 1e-8 * np.abs(expected).max()
            compared += 1
    counts = [len(points) for points in watched.points]
    assert compared > 20
    assert max(counts) > HISTORY + 2, "the oldest pairs must have been replaced"
    assert len(set(counts)) > 1, "lanes must have gone on at different rounds"


def test_costs_only_fall():
    watched = Watched(posed(2))
    _, _, progress = watched.memory
    values = [progress.value[:2].copy() for _ in range(scaled(40, 15)) if watched.advance()]
    assert len(values) > 5
    assert (np.diff(values, axis=0) <= 0.0).all()


def test_descents_end_where_the_reference_engine_does():
    """Outcomes are equal, iterations similar, and costs equal to a thousandth of the total decrease."""
    settings = settings_of(tolerance=TOLERANCE)
    tasks = posed(scaled(LANES, 3))
    ours, theirs = solve_together(tasks, settings), [solve_window(*task, settings) for task in tasks]
    for (data, start), a, b in zip(tasks, ours, theirs, strict=True):
        begun, _ = WindowProblem(data).evaluate(start.ravel())
        assert a.outcome is b.outcome is Outcome.CONVERGED
        assert a.gradient_norm <= settings.tolerance
        assert abs(a.cost - b.cost) < 1e-3 * (begun - b.cost)
        assert 0 < a.iterations == pytest.approx(b.iterations, rel=0.3, abs=2)


def test_first_iterations_are_those_of_the_reference_engine():
    """Until rounding errors grow, both engines are at the same points."""
    task = posed(1)[0]
    for count in (1, 2, 4):
        settings = settings_of(tolerance=1e-12, max_iterations=count)
        (ours,), theirs = solve_together([task], settings), solve_window(*task, settings)
        assert ours.outcome is theirs.outcome is Outcome.ITERATION_LIMIT
        assert ours.iterations == theirs.iterations == count
        # The reference engine evaluates the start a second time.
        assert ours.evaluations == theirs.evaluations - 1
        np.testing.assert_allclose(ours.disturbances, theirs.disturbances, rtol=1e-6, atol=1e-9)


def test_a_window_that_may_be_halved_has_a_third_of_the_iterations():
    """The windows in the neighbouring lanes have all of them."""
    data, start = posed(1)[0]
    tasks = [(data, start), (replace(data, halves_early=True), start)]
    settings = settings_of(tolerance=1e-12, max_iterations=9)
    for solutions in (solve_together(tasks, settings), [solve_window(*task, settings) for task in tasks]):
        assert [solution.iterations for solution in solutions] == [9, 3]
        assert {solution.outcome for solution in solutions} == {Outcome.ITERATION_LIMIT}
    assert replace(data, halves_early=True).iteration_limit(settings_of(max_iterations=1)) == 1


def test_the_reported_cost_and_gradient_belong_to_the_returned_solution():
    settings = settings_of(tolerance=TOLERANCE)
    for (data, _), solution in zip(posed(2), solve_together(posed(2), settings), strict=True):
        problem = WindowProblem(data)
        cost, _ = problem.evaluate((solution.disturbances / data.scale).ravel())
        assert solution.cost == pytest.approx(cost, rel=1e-9)
        assert solution.gradient_norm == pytest.approx(problem.gradient_norm, rel=1e-5)
        np.testing.assert_allclose(solution.states, problem.states, rtol=1e-9, atol=1e-12)


def test_a_start_within_the_tolerance_is_the_solution():
    data, start = posed(1)[0]
    (solution,) = solve_together([(data, start + 0.01)], settings_of(tolerance=1e3))
    assert solution.outcome is Outcome.CONVERGED
    assert (solution.iterations, solution.evaluations) == (0, 1)
    np.testing.assert_allclose(solution.disturbances, 0.01, rtol=1e-14)


def test_a_tolerance_beyond_rounding_stalls():
    """No further decrease can be found; the last point, minimal up to rounding, is returned."""
    data = window_data(2, disturbance=np.full((2, 6), 0.1) * SCALE)
    (solution,) = solve_together([(data, at_rest(data))], settings_of(tolerance=1e-300, max_iterations=5000))
    at_start, _ = WindowProblem(data).evaluate((at_rest(data) / data.scale).ravel())
    assert solution.outcome is Outcome.STALLED
    assert solution.cost < 1e-15 * at_start


def until_two_pairs(watched):
    """Advance until lane 0 has two pairs and is within a search."""
    _, _, progress = watched.memory
    for _ in range(15):
        watched.advance()
        if progress.pairs[0] == 2:
            return progress
    raise AssertionError("lane 0 never stored two pairs")


@pytest.mark.parametrize("curvature", [-1e9, np.nan], ids=["uphill", "no number"])
def test_a_direction_of_no_use_is_formed_again(curvature):
    """Its lane discards its pairs and uses the steepest descent; the other lanes keep their directions."""
    watched = Watched(posed(3))
    progress = until_two_pairs(watched)
    _, descent, _ = watched.memory
    before = descent.direction.copy()
    progress.curvature[0] = curvature
    descent.aiming[0] = [1.0] + [0.0] * (LANES - 1)
    combine_pairs(descent, progress)
    assert aim(descent, progress)
    assert progress.pairs[0] == 0
    combine_pairs(descent, progress)
    assert not aim(descent, progress)
    np.testing.assert_array_equal(watched.direction(0), -watched.slopes[0][-1])
    np.testing.assert_array_equal(descent.direction[..., 1:], before[..., 1:])


def spoil_search(progress):
    """Change lane 0 as if its last point were far lower, and its present trial the last of the search."""
    search = progress.search[0]
    progress.value[0] = -1e3
    for name in ("value0", "best_value", "other_value"):
        search[Search._fields.index(name)] = -1e3
    progress.tries[0] = MAX_TRIES - 1


def test_a_search_that_fails_starts_again_and_then_returns():
    """If no step decreases the cost, pairs are discarded; if steepest descent fails too, the last point is returned."""
    watched = Watched(posed(2))
    progress = until_two_pairs(watched)
    problem, descent, _ = watched.memory
    point = descent.point[..., 0].copy()
    spoil_search(progress)
    watched.advance()
    assert (progress.pairs[0], progress.status[0]) == (0, SEARCHING)
    np.testing.assert_array_equal(watched.direction(0), -watched.slopes[0][-1])
    spoil_search(progress)
    watched.advance()
    assert progress.status[0] == RETURNING
    watched.advance()
    assert progress.status[0] == ENDED
    np.testing.assert_array_equal(descent.point[..., 0], point)
    np.testing.assert_allclose(problem.trial[..., 0], point.reshape(-1, 6) * SCALE, rtol=1e-15)
    assert progress.status[1] == SEARCHING


@pytest.mark.skipif(not COMPILED, reason="NumPy warns of numbers too large")
def test_a_start_that_cannot_be_flown_diverges():
    data, start = posed(1)[0]
    solution, neighbour = solve_together([(data, start + 1e6), (data, start)], EstimationSettings())
    assert solution.outcome is Outcome.DIVERGED
    assert (solution.iterations, solution.evaluations) == (0, 1)
    assert np.isnan(solution.cost)
    assert neighbour.outcome is Outcome.CONVERGED
