"""Windows: lengths, handover (eq. 38, Algorithm 1), and solution by the engine."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from pydantic import ValidationError
from support.missions import profile_series, replaced
from support.posed_windows import PETREL, STEP, glide_of, impulse, posed_dive, window_data

from gliderhpc.estimation.engines import WindowProblem, solve_window
from gliderhpc.estimation.preparation import prepare_profile
from gliderhpc.estimation.priors import default_prior
from gliderhpc.estimation.profile import estimate_profile
from gliderhpc.estimation.resample import on_steps
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.estimation.window_plan import WindowPlan, plan_windows, transform_scale
from gliderhpc.estimation.windows import (
    StartingPath,
    WindowSolution,
    pose_windows,
    solve_profile,
    starting_disturbance,
)
from gliderhpc.flight.glider import SENSED, Glider
from gliderhpc.outcomes import Outcome
from gliderhpc.platform import DisturbancePrior, read_platform
from gliderhpc.simulator import load_scenario, simulate_profile

pytestmark = pytest.mark.compiled

GLIDER = Glider(PETREL)
DIVE = glide_of(PETREL)

# Lengths and thresholds


@pytest.mark.parametrize(
    ("interval", "length", "margin", "threshold"),
    [(1.0, 30.0, 10.0, 0.2), (5.0, 30.0, 10.0, 0.2), (6.0, 36.0, 12.0, 0.24), (20.0, 120.0, 40.0, 0.8)],
)
def test_windows_follow_the_sensors(interval, length, margin, threshold):
    settings = EstimationSettings()
    assert settings.window_length(interval) == length
    assert settings.window_margin(interval) == pytest.approx(margin)
    assert settings.cost_threshold(interval) == pytest.approx(threshold)
    plan = plan_windows(settings, interval)
    assert (plan.length, plan.margin) == (round(length / STEP), round(margin / STEP))
    assert plan.cost_threshold == pytest.approx(threshold)


def test_window_settings_that_are_given_apply_to_every_sample_interval():
    settings = EstimationSettings.model_validate({"window": {"length": 60.0, "margin": 5.0, "cost_threshold": 0.1}})
    for interval in (1.0, 20.0):
        assert settings.window_length(interval) == 60.0
        assert settings.window_margin(interval) == 5.0
        assert settings.cost_threshold(interval) == pytest.approx(0.2)


def test_windows_are_whole_records_and_move_on():
    """A window starts at a stored record, for any requested length, and the next one starts later."""
    settings = EstimationSettings.model_validate({"window": {"length": 24.7, "margin": 24.6}, "output_interval": 2.0})
    plan = plan_windows(settings, 1.0)
    assert plan.length % 20 == plan.margin % 20 == 0
    assert 0 < plan.margin < plan.length <= 247


def test_a_margin_as_long_as_its_window_is_refused():
    with pytest.raises(ValidationError, match="must be shorter than the window"):
        EstimationSettings.model_validate({"window": {"length": 20.0, "margin": 20.0}})


def test_scale_of_the_transform():
    """It is ``s = deviation sqrt(min(1, 2 T_seg / correlation time))`` (docs/theory/estimate.md), not with `paper`."""
    prior = DisturbancePrior(
        deviation=(0.4, 0.3, 0.2, 0.1, 0.15, 1.0), correlation_time=(3600.0, 240.0, 60.0, 30.0, 3600.0, 59.0)
    )
    expected = [0.4 * np.sqrt(60.0 / 3600.0), 0.3 * 0.5, 0.2, 0.1, 0.15 * np.sqrt(60.0 / 3600.0), 1.0]
    np.testing.assert_allclose(transform_scale(prior, 30.0, EstimationSettings()), expected)
    longer = EstimationSettings.model_validate({"window": {"length": 120.0}})
    assert plan_windows(longer, 1.0, prior).scale[1] == pytest.approx(0.3)
    np.testing.assert_array_equal(transform_scale(prior, 30.0, EstimationSettings(preset="paper")), np.ones(6))


def test_scale_of_a_hull_without_a_prior_is_about_the_prototypes():
    scale = transform_scale(default_prior(PETREL), 30.0, EstimationSettings())
    np.testing.assert_allclose(scale[[0, 2, 4, 5]], [0.05, 0.05, 0.02, 1.0], rtol=0.05)
    assert (scale[[1, 3]] <= 0.05).all()


def test_windows_start_from_the_filter_and_its_slow_lateral_part(twin):
    settings = EstimationSettings()
    estimate = estimate_profile(prepare_profile(GLIDER, profile_series(twin, 1, settings)), settings)
    prior, series = estimate.filtered, estimate.series
    paper = starting_disturbance(prior, series, EstimationSettings(preset="paper"))
    recommended = starting_disturbance(prior, series, settings)
    filtered = prior.disturbances[:-1]
    for start in (paper, recommended):
        np.testing.assert_array_equal(start[:, [0, 2, 4]], filtered[:, [0, 2, 4]])
    assert not paper[:, [1, 3, 5]].any()
    middle = slice(5000 - 600, 5000 + 601)
    np.testing.assert_allclose(recommended[5000, [1, 3, 5]], filtered[middle][:, [1, 3, 5]].mean(axis=0), atol=1e-9)
    assert recommended[:, 5].std() < 0.5 * filtered[:, 5].std()


def test_windows_of_a_slow_record_start_from_the_smoothed_disturbance():
    """From the filter's, they kept a heave force of newtons after turns in gusts, on the true hull."""
    hull, settings = read_platform("slocum"), EstimationSettings(step=0.25)
    record, truth = simulate_profile(hull, load_scenario("paper").replaced({"depth": 150.0, "depth_spread": 0.0}), 2)
    profile = prepare_profile(Glider(hull), on_steps(record, settings, hull))
    time = profile.series.time[:-1]
    steady = ~profile.vibrating[:-1] & (time > 60.0) & (time < truth.time[-1])
    true = truth.disturbances[np.minimum((time / truth.step).astype(int), len(truth.disturbances) - 1), 2]
    errors = {}
    for start in ("smoothed", "prior"):
        solution = estimate_profile(profile, settings.model_copy(update={"start": start})).solution
        assert solution.from_smoothed == (start == "smoothed")
        errors[start] = np.sqrt(np.mean((solution.disturbances[:, 2] - true)[steady] ** 2))
    assert errors["smoothed"] < 0.5 * errors["prior"]


def test_windows_of_a_slow_record_that_was_smoothed_in_a_single_pass_start_from_the_filter():
    hull, settings = read_platform("slocum"), EstimationSettings(step=0.25)
    record, _ = simulate_profile(hull, load_scenario("calm").replaced({"depth": 100.0, "depth_spread": 0.0}), 1)
    once = settings.model_copy(update={"smoother": settings.smoother.model_copy(update={"max_passes": 1})})

    def starts_from_smoothed(platform, chosen):
        return estimate_profile(
            prepare_profile(Glider(platform), on_steps(record, chosen, platform)), chosen
        ).solution.from_smoothed

    assert starts_from_smoothed(hull, settings)
    assert not starts_from_smoothed(hull, once)


def test_windows_of_a_path_start_from_its_states_in_fast_records_alone():
    problem = dive_problem(700)
    path = StartingPath(problem.start, problem.filtered.states)
    posed = [
        pose_windows(replace(problem.profile, series=replace(problem.profile.series, attitude_interval=interval)),
                     problem.filtered, EstimationSettings(), path)
        for interval in (1.0, 20.0)
    ]  # fmt: skip
    assert [each.path is None for each in posed] == [False, True]
    assert all(each.from_smoothed and each.start is path.disturbances for each in posed)


# Handover, with a scripted solver


class Scripted:
    """Solver that returns one script entry per window: (cost, outcome); the disturbance is the window's number."""

    def __init__(self, *script):
        self._script = itertools.chain(script, itertools.repeat((0.0, Outcome.CONVERGED)))
        self.starts = []
        self.states0 = []
        self.scales = []

    def __call__(self, data, start):
        cost, outcome = next(self._script)
        self.starts.append(start.copy())
        self.states0.append(data.state0.copy())
        self.scales.append(data.scale)
        number = len(self.starts)
        disturbances = np.full((len(data.bodies), 6), 1e-4 * number)
        problem = WindowProblem(data)
        problem.evaluate((disturbances / data.scale).ravel())
        return WindowSolution(disturbances, problem.states, cost, 1e-4, 5, 7, outcome)


def _raw_controls(steps):
    return np.tile([DIVE.battery_position, 0.0, _volume(DIVE), 0.0], (steps, 1))


def _volume(glide):
    buoyancy = PETREL.buoyancy
    return buoyancy.neutral_volume_m3 - glide.net_mass / buoyancy.water_density


def dive_problem(steps, plan=None, *, vibrating=(), gap=None):
    controls = np.tile(DIVE.control, (steps, 1))
    states = GLIDER.simulate(DIVE.state, controls, np.zeros((steps, 6)), STEP)
    mask = np.zeros(steps + 1, dtype=bool)
    mask[list(vibrating)] = True
    weights = np.ones(steps + 1)
    if gap is not None:
        weights[gap] = 0.0
    # A filter whose track has drifted sideways, which is common; the dive must not jump to it.
    filtered = states + np.array([0, 0, 0, 50.0, -80.0, 0.01, 0.001, 0, 0, 0, 0, 0])
    return posed_dive(
        GLIDER, controls, states[:, [0, 1, 2, 5]].copy(), weights, filtered, fallback=0.02,
        start=np.full((steps, 6), 0.5), plan=plan or PLAN, vibrating=mask,
    )  # fmt: skip


PLAN = WindowPlan(length=300, margin=100, cost_threshold=0.2)


def spans(solution):
    return [(window.start, window.stop, window.retracted) for window in solution.windows]


def test_every_good_window_is_retracted_and_the_last_may_be_shorter():
    solution = solve_profile(dive_problem(1000), Scripted())
    assert spans(solution) == [
        (0, 300, True), (200, 500, True), (400, 700, True), (600, 900, True), (800, 1000, False),
    ]  # fmt: skip
    assert len(solution.windows) <= PLAN.max_windows(1000)


def test_the_next_solution_replaces_the_overlap():
    solution = solve_profile(dive_problem(700), Scripted())
    expected = np.repeat([1, 2, 3], [200, 200, 300])
    np.testing.assert_array_equal(solution.source + 1, expected)
    np.testing.assert_allclose(solution.disturbances, np.repeat(1e-4 * expected[:, None], 6, axis=1))


@pytest.mark.parametrize(
    ("cost", "vibrating", "retracted"),
    [
        (0.19, (), True),
        (0.2, (), False),
        (0.5, (), False),
        (0.19, (300,), False),
        (0.19, (299, 301), True),
        (0.5, (300,), False),
    ],
)
def test_retraction_needs_a_low_cost_and_a_quiet_end(cost, vibrating, retracted):
    solution = solve_profile(dive_problem(600, vibrating=vibrating), Scripted((cost, Outcome.CONVERGED)))
    assert solution.windows[0].retracted is retracted
    assert solution.windows[1].start == (200 if retracted else 300)


@pytest.mark.parametrize("outcome", [Outcome.ITERATION_LIMIT, Outcome.STALLED])
def test_a_usable_solution_stands_though_it_did_not_converge(outcome):
    solution = solve_profile(dive_problem(600), Scripted((0.1, outcome)))
    assert solution.windows[0].retracted
    assert (solution.disturbances[:200] == 1e-4).all()


SHORT = WindowPlan(length=100, margin=30, cost_threshold=0.07, scale=(0.5,) * 6)
SPLIT = replace(PLAN, shorter=SHORT)


def test_a_window_that_does_not_converge_is_solved_again_shorter():
    """It starts from the same state, with the scale of the shorter length; the next one is long again."""
    solver = Scripted((0.1, Outcome.CONVERGED), (0.1, Outcome.ITERATION_LIMIT), (0.05, Outcome.CONVERGED))
    solution = solve_profile(dive_problem(1000, SPLIT), solver)
    assert spans(solution) == [(0, 300, True), (200, 300, True), (270, 570, True), (470, 770, True), (670, 970, True),
                               (870, 1000, False)]  # fmt: skip
    assert {window.outcome for window in solution.windows} == {Outcome.CONVERGED}
    np.testing.assert_array_equal(solver.states0[1], solver.states0[2])
    assert [len(start) for start in solver.starts[:4]] == [300, 300, 100, 300]
    assert [scale[0] for scale in solver.scales[:4]] == [1.0, 1.0, 0.5, 1.0]


@pytest.mark.parametrize("outcome", [Outcome.ITERATION_LIMIT, Outcome.STALLED, Outcome.DIVERGED])
def test_windows_stay_short_until_one_converges(outcome):
    failures = [(0.05, outcome)] * 4
    solution = solve_profile(dive_problem(700, SPLIT), Scripted(*failures))
    assert [stop - start for start, stop, _ in spans(solution)][:5] == [100, 100, 100, 100, 300]
    assert [window.outcome for window in solution.windows[:4]] == [outcome] * 3 + [Outcome.CONVERGED]


def test_longer_windows_are_tried_less_often_the_oftener_they_fail():
    """They are tried after one, four, sixteen short windows that converge: a record on which they fail costs little."""
    converged, failed = (0.5, Outcome.CONVERGED), (0.5, Outcome.ITERATION_LIMIT)
    solver = Scripted(failed, converged, failed, *[converged] * 4, failed, *[converged] * 16, failed)
    solve_profile(dive_problem(3000, SPLIT), solver)
    lengths = [300, 100, 300, *[100] * 4, 300, *[100] * 16, 300]
    assert [len(start) for start in solver.starts[: len(lengths)]] == lengths


@pytest.mark.parametrize(("cost", "usable"), [(0.1, True), (0.3, True), (50.0, False)])
def test_a_window_that_did_not_converge_stands_unless_the_filter_follows_the_record_better(cost, usable):
    problem = dive_problem(600)
    problem.filtered.states[:301, 5] += 0.11  # 0.43 m2 s over the window
    solution = solve_profile(problem, Scripted((cost, Outcome.STALLED)))
    assert solution.windows[0].outcome is (Outcome.STALLED if usable else Outcome.DIVERGED)
    assert (solution.disturbances[:200] == (1e-4 if usable else problem.filtered.disturbances[:200])).all()


def test_only_windows_that_follow_slow_sensors_may_be_shortened():
    prior = DisturbancePrior(deviation=(0.1,) * 6, correlation_time=(240.0, 3600.0, 3600.0, 60.0, 60.0, 10.0))
    settings = EstimationSettings()
    plan, lengths = plan_windows(settings, 30.0, prior), []
    while plan is not None:
        lengths.append((plan.length, plan.margin))
        if plan.shorter is not None:
            assert plan.shorter.cost_threshold < plan.cost_threshold
        last, plan = plan, plan.shorter
    assert lengths == [(1800, 600), (900, 300), (450, 150), (300, 100)]
    np.testing.assert_allclose(last.scale, 0.1 * np.sqrt([0.25, 1 / 60, 1 / 60, 1.0, 1.0, 1.0]))
    assert plan_windows(settings, 5.0, prior).shorter is None
    as_set = EstimationSettings.model_validate({"window": {"length": 180.0}})
    assert plan_windows(as_set, 30.0, prior).shorter is None


def test_states_follow_from_the_stitched_disturbance():
    """Each sample's state, including X and Y, is that of the window whose solution is used there."""
    problem = dive_problem(700)
    solver = Scripted((0.1, Outcome.CONVERGED), (0.5, Outcome.CONVERGED))
    solution = solve_profile(problem, solver)
    assert spans(solution) == [(0, 300, True), (200, 500, False), (500, 700, False)]
    np.testing.assert_array_equal(solver.states0[1], solution.states[200, SENSED])
    controls = np.tile(DIVE.control, (700, 1))
    whole = GLIDER.simulate(problem.filtered.states[0], controls, solution.disturbances, STEP)
    np.testing.assert_allclose(solution.states, whole, atol=1e-9)
    assert abs(solution.states[-1, 3] - solution.states[0, 3]) > 5.0


@pytest.mark.parametrize("outcome", [Outcome.DIVERGED, Outcome.NO_DATA])
def test_a_failed_window_leaves_the_prior_and_hands_over_the_filters_state(outcome):
    problem = dive_problem(1000)
    solver = Scripted((0.1, Outcome.CONVERGED), (0.0, outcome))
    solution = solve_profile(problem, solver)
    assert spans(solution)[:3] == [(0, 300, True), (200, 500, False), (500, 800, True)]
    assert solution.windows[1].outcome is outcome
    np.testing.assert_array_equal(solution.disturbances[200:500], problem.filtered.disturbances[200:500])
    assert (solution.disturbances[:200] == 1e-4).all()
    np.testing.assert_array_equal(solver.states0[2], problem.filtered.states[500, SENSED])


def test_the_track_is_continuous_through_a_failed_window():
    problem = dive_problem(1000)
    solution = solve_profile(problem, Scripted((0.1, Outcome.CONVERGED), (0.0, Outcome.DIVERGED)))
    moved = np.linalg.norm(np.diff(solution.states[:, 3:5], axis=0), axis=1)
    assert moved.max() < 2.0 * np.median(moved)
    inside = np.diff(solution.states[200:501, 3:5], axis=0)
    np.testing.assert_allclose(inside, np.diff(problem.filtered.states[200:501, 3:5], axis=0), atol=1e-12)


def test_a_window_without_a_measured_sample_is_not_solved():
    solver = Scripted()
    solution = solve_profile(dive_problem(900, gap=slice(200, 520)), solver)
    outcomes = [window.outcome for window in solution.windows]
    assert outcomes[:3] == [Outcome.CONVERGED, Outcome.NO_DATA, Outcome.CONVERGED]
    assert spans(solution)[1] == (200, 500, False)
    assert np.isnan(solution.windows[1].cost)
    assert len(solver.starts) == len(solution.windows) - 1


# The engine


def test_the_engine_finds_an_impulse():
    solution = solve_window(window_data(disturbance=impulse()), np.zeros((300, 6)), EstimationSettings())
    assert solution.outcome is Outcome.CONVERGED
    assert solution.gradient_norm <= 5e-4
    # No later sample determines the disturbance at the very end of the window.
    error = (solution.disturbances - impulse())[:250, 5]
    assert np.sqrt(np.mean(error**2)) < 0.15
    assert solution.evaluations >= solution.iterations > 0


def test_a_start_that_cannot_be_flown_diverges():
    start = np.full((300, 6), 1e6)
    solution = solve_window(window_data(), start, EstimationSettings())
    assert solution.outcome is Outcome.DIVERGED
    assert not solution.outcome.usable
    assert solution.evaluations == 1


def test_a_start_that_ends_beyond_the_models_domain_diverges():
    """It is finite, but nose up past the vertical, and not a trajectory to start from."""
    start = np.zeros((300, 6))
    start[:, 4] = 40.0
    data = window_data()
    problem = WindowProblem(data)
    cost, _ = problem.evaluate((start / data.scale).ravel())
    assert np.isfinite(cost)
    assert not problem.flyable()
    assert solve_window(data, start, EstimationSettings()).outcome is Outcome.DIVERGED


def test_a_start_that_rolls_faster_than_a_turn_a_second_diverges():
    """Its pitch and speed are a glider's, but no glider rolls like this, and the next step may not be finite."""
    start = np.zeros((300, 6))
    start[:, 3] = 60.0 * np.sign(np.sin(0.6 * np.arange(300)))
    data = window_data()
    problem = WindowProblem(data)
    problem.evaluate((start / data.scale).ravel())
    assert np.abs(problem.states[:, 1]).max() < 0.8
    assert np.abs(problem.states[:, 4:7]).max() < 1.0
    assert not problem.flyable()
    assert solve_window(data, start, EstimationSettings()).outcome is Outcome.DIVERGED


@pytest.mark.parametrize("factor", [1e4, 1e5, 1e6])
@pytest.mark.parametrize("seed", range(3))
def test_a_trial_step_that_blows_up_is_shortened(factor, seed):
    """With such a wrong scale the first step leaves the model's domain; the result is flyable and not worse."""
    scale = factor * np.array([0.05, 0.05, 0.05, 0.05, 0.02, 1.0])
    data = window_data(disturbance=impulse(), scale=scale, seed=seed)
    start = np.zeros(1800)
    problem = WindowProblem(data)
    cost0, gradient = problem.evaluate(start)
    problem.evaluate(start - gradient / np.linalg.norm(gradient))
    assert not problem.flyable(), "the first trial step of L-BFGS must be one that blows up"
    solution = solve_window(data, np.zeros((300, 6)), EstimationSettings())
    assert solution.outcome.usable
    assert np.isfinite(solution.disturbances).all()
    assert solution.cost <= cost0
    assert WindowProblem(data).evaluate((solution.disturbances / scale).ravel())[0] == pytest.approx(solution.cost)
    assert np.abs(solution.states[:, 1]).max() < np.pi / 2.0


def test_masked_samples_do_not_count():
    """Arbitrary values with zero weight change nothing at all."""
    data = window_data(disturbance=impulse())
    data.weights[100:180] = 0.0
    corrupted = replace(data, measurements=data.measurements.copy())
    corrupted.measurements[100:180] += 1e3
    clean, dirty = (solve_window(one, np.zeros((300, 6)), EstimationSettings()) for one in (data, corrupted))
    np.testing.assert_array_equal(clean.disturbances, dirty.disturbances)
    assert clean.cost == dirty.cost


def test_a_gap_leaves_finite_results(twin):
    """Windows inside two minutes without a record have no data; the rest of the profile is unchanged."""
    settings = EstimationSettings(start="prior")
    series = profile_series(twin, 1, settings)
    weights = series.weights.copy()
    weights[8000:9201] = 0.0
    index = series.sample_index[(series.sample_index < 8000) | (series.sample_index > 9200)]
    whole = estimate_profile(prepare_profile(GLIDER, series), settings)
    with_gap = replaced(series, weights=weights, sample_index=index, gap_seconds=120.0)
    gappy = estimate_profile(prepare_profile(GLIDER, with_gap), settings)
    assert np.isfinite(gappy.solution.disturbances).all()
    assert np.isfinite(gappy.solution.states).all()
    outcomes = [window.outcome for window in gappy.solution.windows]
    assert Outcome.NO_DATA in outcomes
    assert Outcome.DIVERGED not in outcomes
    np.testing.assert_array_equal(gappy.solution.disturbances[:7000], whole.solution.disturbances[:7000])
    # Windows re-converge: ten minutes later the two differ only by where the windows begin.
    later = slice(15000, -1)
    difference = (gappy.solution.disturbances - whole.solution.disturbances)[later]
    assert np.sqrt(np.mean(difference[:, 5] ** 2)) < 0.05
