"""The iterated smoother of a whole profile: disturbances and motion from past and future samples, with uncertainties.

`run_smoother` poses a profile's problem, estimates its noise from a segment, and iterates passes. This is the
Gauss-Newton iteration for the maximum a posteriori (MAP) problem of `gliderhpc.estimation.smoother.problem`: every pass
linearises the flight model about the smoothed trajectory of the previous pass. By default, an additional term makes the
result the mean of the posterior rather than its most probable trajectory (docs/smoother.md).
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gliderhpc.errors import ProfileError
from gliderhpc.estimation.filter import FilterEstimate
from gliderhpc.estimation.preparation import PreparedProfile
from gliderhpc.estimation.settings import EstimationSettings, SmootherSettings, smoother_passes
from gliderhpc.estimation.smoother.estimate import LastPass, SmoothedEstimate, displacement, filter_fallback
from gliderhpc.estimation.smoother.noise import (
    HeavyTails,
    NoiseModel,
    NoiseScale,
    noise_sums,
    standardised_noise,
)
from gliderhpc.estimation.smoother.problem import (
    Damping,
    RollingGusts,
    Sweeps,
    Trajectory,
    pose_problem,
    starting_trajectory,
    unscaled_channels,
)
from gliderhpc.estimation.smoother.steered_run import find_gusts, run_along
from gliderhpc.flight.glider import SENSED
from gliderhpc.kernels.parameters import Hull
from gliderhpc.kernels.smoother_memory import Backward, SmootherProblem
from gliderhpc.observations.dive_phases import stationary_points
from gliderhpc.outcomes import Outcome
from gliderhpc.vocabulary import CHANNELS

Array = NDArray[np.float64]

_FRACTIONS = (1.0, 0.5, 0.25, 0.125)
"""Fractions of a pass's move that are tried."""
_FRACTIONS_WITH_NOISE = _FRACTIONS[:2]
"""Fractions that are tried together with the updated noise, in one sweep."""
_PENALTY = 1.5
"""Ratio of a defect's weight to the largest costate of its state; above 1 the merit has the MAP problem's minimum."""
_ACCEPTED_MOVE = 1.0
"""Largest remaining move, in standard deviations, with which an iteration that ended early still gives an estimate."""
_NEGLIGIBLE_VARIANCE_CHANGE = 0.1
"""Relative change of a variance of the noise below which the noise is not updated."""
_ROUNDING = 1e-11
"""Relative increase of the merit that is attributed to rounding."""
_SEGMENT = (0.15, 0.4)
"""Segment of a profile, by fractions of its steps, from which its noise is first estimated: usually steady descent."""
_LONGEST_SEGMENT = 1200.0
"""Longest duration of that segment, s; a longer one would hardly determine the noise better."""
_SEGMENT_PASSES = 3
"""Largest number of passes over that segment: the passes over the whole profile update its noise anyway."""
_SIMPLER_METHODS: dict[str, dict[str, bool | str]] = {
    "the noise is the prior's, not fitted to the dive": {"adaptive": False},
    "the estimate is the most probable path, not the mean": {"estimate": "mode"},
}
"""Changes of the settings, by description, that are tried one after another if there is no estimate."""
_HEADING_AND_DEPTH = [2, 5]
"""Indices of these states of eq. 16."""
_RECORD_ERRORS = (ProfileError, ArithmeticError, np.linalg.LinAlgError)
"""Errors that a record may cause in the smoother; any other error is a fault of the program."""


def run_smoother(
    profile: PreparedProfile, filtered: FilterEstimate, settings: EstimationSettings, noise_factor: Array | float = 1.0
) -> SmoothedEstimate:
    """Smooth one filtered profile.

    If there is no estimate with noise adapted to the profile, the prior's noise is used; then the most probable path
    in place of the mean, since the shift from the path to the mean can diverge in a gap of all records about the
    inflection, where the actuators' moves look slow. If this fails too, the outcome is not usable, and the values are
    the filter's.

    Parameters
    ----------
    profile, filtered : PreparedProfile, FilterEstimate
        Profile on its steps, and the filter's estimate.
    settings : EstimationSettings
        Settings, of which ``step``, ``filter`` and ``smoother`` are used.
    noise_factor : (6,) array or float
        Factor on the prior's noise, estimated from the mission's other profiles.
    """
    smoothed = _smoothed_or_filtered(profile, filtered, settings, noise_factor)
    if smoothed.outcome.usable:
        return smoothed
    for description, change in _SIMPLER_METHODS.items():
        options = settings.smoother.model_copy(update=change)
        if options != settings.smoother:
            changed = settings.model_copy(update={"smoother": options})
            simpler = _smoothed_or_filtered(profile, filtered, changed, noise_factor)
            if simpler.outcome.usable:
                return replace(simpler, simplified=description)
    return smoothed


def _smoothed_or_filtered(
    profile: PreparedProfile, filtered: FilterEstimate, settings: EstimationSettings, noise_factor: Array | float
) -> SmoothedEstimate:
    try:
        smoothed = _smoothed(profile, filtered, settings, noise_factor)
    except _RECORD_ERRORS as error:
        return replace(filter_fallback(filtered), failure=str(error))
    if smoothed.outcome.usable:
        return smoothed
    fallback = filter_fallback(filtered)
    return replace(fallback, passes=smoothed.passes, movement=smoothed.movement, outcome=smoothed.outcome)


def _smoothed(
    profile: PreparedProfile, filtered: FilterEstimate, settings: EstimationSettings, noise_factor: Array | float
) -> SmoothedEstimate:
    """Smooth a profile, from the filter's path or, for a slow record, about a run of the model.

    The filter's path through the turns of a slow record is wrong by far more than the smoothed one: by a heave force of
    several newtons on twins with the true hull. A linearisation about it leaves half of this error. A run that is
    steered along a first smoothed path contains neither, and its linearisation is used instead.
    """
    start = starting_trajectory(filtered)
    gusts = find_gusts(profile, start)
    smoothed = _smoothed_from(start, profile, filtered, settings, noise_factor, gusts)
    run = _run_for_slow_record(profile, smoothed, settings.smoother)
    if run is None:
        return smoothed
    try:
        about_run = _smoothed_from(run, profile, filtered, settings, noise_factor, gusts)
    except _RECORD_ERRORS:
        return smoothed
    # With a part of its move only, the path is still between the run and its estimate.
    if about_run.damped or not about_run.outcome.usable:
        return smoothed
    return replace(about_run, passes=smoothed.passes + about_run.passes)


def _run_for_slow_record(
    profile: PreparedProfile, smoothed: SmoothedEstimate, settings: SmootherSettings
) -> Trajectory | None:
    """Return the run about which a slow record is smoothed once more; None for other records, or if no run fits.

    Heading and depth are those of the smoothed path. The run's heading lags behind in turns, by whole turns in spirals,
    and the distance made good would be linearised about another direction.
    """
    passes = smoother_passes(profile.glider.platform, settings, profile.series.attitude_interval)
    is_single = settings.max_passes is None and passes == 1
    if not (is_single and smoothed.outcome.usable and smoothed.last_pass):
        return None
    run = run_along(profile, smoothed.path(smoothed.last_pass.problem.decay))
    if run is not None:
        run.states[:, _HEADING_AND_DEPTH] = smoothed.states[:, _HEADING_AND_DEPTH]
    return run


def _smoothed_from(
    start: Trajectory, profile: PreparedProfile, filtered: FilterEstimate, settings: EstimationSettings,
    noise_factor: Array | float, gusts: RollingGusts | None,
) -> SmoothedEstimate:  # fmt: skip
    """Pose the problem, estimate the noise from a segment, and iterate from a path."""
    hull, platform, gate = profile.glider.hull, profile.glider.platform, settings.filter.gate
    passes = smoother_passes(platform, settings.smoother, profile.series.attitude_interval)
    options = settings.smoother.model_copy(update={"max_passes": passes})
    if stationary_points(profile.series).any():
        # Drag vanishes with the square of the speed: about rest, the mean's second-order shift of the path diverges.
        options = options.model_copy(update={"estimate": "mode"})
    problem, scale = pose_problem(profile, filtered, settings, noise_factor, gusts=gusts)
    models: list[NoiseModel] = [scale] if options.adaptive else []
    if options.degrees_of_freedom is not None:
        channels = tuple(list(CHANNELS).index(name) for name in options.heavy_tailed)
        steps = max(1, round(profile.series.sample_interval / profile.series.step))
        models.append(HeavyTails(problem.noise.copy(), options.degrees_of_freedom, channels, steps))
    if options.adaptive and options.max_passes != 1:
        problem.noise[:] = noise_from_segment(hull, problem, start, scale, options, gate)
    smoothed = iterate_passes(
        hull, problem, start, options, gate=gate, noise_models=models, reference_steps=scale.reference_steps
    )
    return replace(smoothed, noise_factor=scale.factors(problem.noise), unscaled=unscaled_channels(gusts))


def noise_from_segment(
    hull: Hull, problem: SmootherProblem, start: Trajectory, scale: NoiseScale, settings: SmootherSettings, gate: float
) -> Array:
    """Estimate the variances ``(n, 6)`` of a profile's noise from a segment, before the passes over the whole profile.

    Every change of the noise requires passes, which take less time over a segment. The passes over the whole profile
    update the noise where it differs.
    """
    first, stop = (int(fraction * len(problem.noise)) for fraction in _SEGMENT)
    stop = min(stop, first + round(_LONGEST_SEGMENT / problem.step))
    steps, rows = slice(first, stop), slice(first, stop + 1)
    segment = problem._replace(
        bodies=problem.bodies[steps],
        noise=problem.noise[steps].copy(),
        fed=problem.fed[rows],
        measured=problem.measured[rows],
        variance=problem.variance[rows].copy(),
        damping=np.empty(6),
        mean=np.concatenate([start.states[first, SENSED], np.zeros(6)]),
    )
    segment_scale, segment_start = scale.for_segment(steps), Trajectory(start.states[rows], start.disturbances[rows])
    passes = min(settings.max_passes or _SEGMENT_PASSES, _SEGMENT_PASSES)
    smoothed = iterate_passes(
        hull, segment, segment_start, settings.model_copy(update={"max_passes": passes}), gate=gate,
        noise_models=[segment_scale], reference_steps=segment_scale.reference_steps,
    )  # fmt: skip
    if not smoothed.outcome.usable:
        return np.asarray(problem.noise)
    return scale.scaled(segment_scale.factors(segment.noise))


def iterate_passes(
    hull: Hull,
    problem: SmootherProblem,
    start: Trajectory,
    settings: SmootherSettings,
    *,
    gate: float = np.inf,
    noise_models: Sequence[NoiseModel] = (),
    reference_steps: NDArray[np.bool_] | None = None,
) -> SmoothedEstimate:
    """Iterate passes over a profile until nothing moves by more than the tolerance.

    Parameters
    ----------
    hull, problem : Hull, SmootherProblem
        The problem; the first pass widens its variances where needed, and the noise models update its noise.
    start : Trajectory
        Trajectory of the first linearisation; its X and Y are replaced.
    settings : SmootherSettings
        Tolerance, largest number of passes (unset: unlimited), and mean or mode.
    gate : float
        Innovation, in standard deviations, beyond which the first pass widens a variance; infinite by default.
    noise_models : sequence of NoiseModel
        Models that adapt the noise to the passes; none by default.
    reference_steps : (n,) mask, optional
        Steps by which the consistency of the noise is judged; all by default.
    """
    nominal, noise = problem.variance.copy(), problem.noise.copy()
    sweeps = Sweeps(hull, problem, mean=settings.estimate == "mean")
    iteration = _Iteration(
        sweeps,
        start,
        settings,
        gate,
        noise_models,
        np.ones(len(noise), bool) if reference_steps is None else reference_steps,
    )
    outcome = iteration.run()
    iterate, linear = iteration.iterate, iteration.linear
    values = problem.fed[:, None] & np.isfinite(problem.measured)
    return SmoothedEstimate(
        states=iterate.trajectory.states,
        states_std=_at_steps(sweeps.rows, _state_deviations(linear)),
        disturbances=iterate.trajectory.disturbances[:-1],
        disturbances_std=_at_steps(sweeps.rows, _disturbance_deviations(linear))[:-1],
        standardised_noise=standardised_noise(linear, problem.noise),
        displacement=displacement(iterate.trajectory.states),
        displacement_covariance=linear.displacement,
        cost=float(iterate.costs.sum()),
        passes=iteration.passes,
        damped=iteration.damped,
        movement=iteration.movement,
        noise_factor=np.median(problem.noise / noise, axis=0),
        used=int(values.sum()),
        widened=int((values & (problem.variance > nominal)).sum()),
        outcome=outcome,
        last_pass=LastPass(problem, linear.noise_mean, linear.noise_resolved),
    )


class _Iteration:
    """Passes over a profile until convergence, with moves damped where necessary."""

    def __init__(
        self, sweeps: Sweeps, start: Trajectory, settings: SmootherSettings, gate: float, models: Sequence[NoiseModel],
        reference_steps: NDArray[np.bool_],
    ) -> None:  # fmt: skip
        self._sweeps, self._settings, self._models, self._reference_steps = sweeps, settings, models, reference_steps
        self._damping = Damping(sweeps.problem)
        self.iterate = sweeps.forward(start, gate)
        self.passes = self.damped = 0
        # Whether there was no move since the damping was released: releasing it again would repeat the same passes.
        self._released = False
        self.movement = np.inf
        # Share of the log determinant that is consistent with the profile's own noise.
        self.share = 1.0
        # Variances of the noise before their last change.
        self._previous: Array | None = None
        self._cap = np.inf if settings.max_passes is None else settings.max_passes
        self.linear = self._pass()

    def run(self) -> Outcome:
        """Iterate; at the end nothing is damped, and variances are the problem's own."""
        if self._cap == 1:
            return self._make_single_move()
        outcome = self._iterate()
        if self._damping.active:
            self._damping.set(0.0)
            self.iterate = self._sweeps.forward(self.iterate.trajectory)
            self.linear = self._pass()
        if outcome is Outcome.CONVERGED:
            self.iterate = self._sweeps.run(self._moved(1.0))
        # An iteration that would still move by a standard deviation, or is not finite, has no estimate.
        return outcome if self.movement <= _ACCEPTED_MOVE else Outcome.DIVERGED

    def _make_single_move(self) -> Outcome:
        """Make as much of the only pass's move as can be flown; the rest is added to the uncertainty."""
        for fraction in _FRACTIONS:
            trial = self._sweeps.forward(self._moved(fraction))
            if np.isfinite(trial.merit(np.zeros_like(trial.defects), 0.0)):
                self.damped += fraction < 1.0
                remaining = (1.0 - fraction) * self.linear.correction
                self.iterate, self.linear = trial, self.linear._replace(correction=remaining)
                return Outcome.ITERATION_LIMIT
        return Outcome.DIVERGED

    def _moved(self, fraction: float) -> Trajectory:
        """Trajectory moved by a fraction of the last pass's correction."""
        return self._sweeps.moved(self.iterate.trajectory, self.linear, fraction)

    def _iterate(self) -> Outcome:
        while self.passes < self._cap:
            noise = self._updated_noise()
            if self.movement <= self._settings.tolerance and noise is self._sweeps.problem.noise:
                if not self._damping.active:
                    return Outcome.CONVERGED
                if self._released:
                    return Outcome.STALLED
                self._released = True
                self._damping.set(0.0)
                self.iterate = self._sweeps.forward(self.iterate.trajectory)
            else:
                self._move(noise)
            if self._damping.exhausted:
                return Outcome.STALLED
            self.linear = self._pass()
        return Outcome.ITERATION_LIMIT

    def _pass(self) -> Backward:
        linear = self._sweeps.backward(self.iterate.trajectory)
        if len(linear.mean_shift) and not self._damping.active:
            # For the next pass: this one used the mean shift about the previous trajectory.
            self.share = consistency(linear, self._sweeps.problem.noise, self._reference_steps)
            self._sweeps.mean_shift[:] = self.share * linear.mean_shift
        self.movement = _movement(linear)
        self.passes += 1
        return linear

    def _updated_noise(self) -> Array:
        """Variances of the noise for the next pass: the array in use, unless a variance has changed.

        Once the trajectory no longer moves, a variance whose change would reverse the previous one is changed by half
        as much (of its logarithm), since alternating changes overshoot their limit.
        """
        used: Array = self._sweeps.problem.noise
        noise = used
        # Damped rows would seem better resolved than they are by the record.
        for model in () if self._damping.active else self._models:
            noise = model.updated(noise, self.linear)
        if self._previous is not None and noise is not used and self.movement <= self._settings.tolerance:
            reverses = (noise - used) * (used - self._previous) < 0.0
            noise = np.where(reverses, np.sqrt(noise * used), noise)
        return noise if np.max(np.abs(noise / used - 1.0)) > _NEGLIGIBLE_VARIANCE_CHANGE else used

    def _move(self, noise: Array) -> None:
        """Move the trajectory by the largest fraction of the pass's correction that lowers the merit; else damp more.

        The merit is the cost plus the weighted absolute defects. The weight of each state exceeds its largest costate,
        which is the Lagrange multiplier of the defects. Sufficiently short moves then always decrease the merit, and a
        trajectory of least merit has no defects.
        """
        weights = _PENALTY * self.linear.steepest
        if noise is not self._sweeps.problem.noise and any(
            self._move_with_noise(noise, weights, f) for f in _FRACTIONS_WITH_NOISE
        ):
            return
        trajectory, strength = self.iterate.trajectory, self._damping.strength
        if self._damping.active:
            self._damping.loosen()
            self.iterate = self._sweeps.forward(trajectory)
        merit = self.iterate.merit(weights, self.share)
        limit = merit + _ROUNDING * abs(merit)
        for fraction in _FRACTIONS:
            trial = self._sweeps.forward(self._moved(fraction))
            if trial.merit(weights, self.share) <= limit:
                self.iterate, self._released = trial, False
                self.damped += fraction < 1.0
                if noise is not self._sweeps.problem.noise:
                    self._previous = self._sweeps.problem.noise.copy()
                    self._sweeps.problem.noise[:] = noise
                    self.iterate = self._sweeps.forward(self.iterate.trajectory)
                return
        self.damped += 1
        self._damping.set(strength)
        self._damping.tighten()
        self.iterate = self._sweeps.forward(trajectory)

    def _move_with_noise(self, noise: Array, weights: Array, fraction: float) -> bool:
        """Make a fraction of the move and change the noise in one sweep, if the merit without determinant decreases.

        The determinants before and after the move cannot be compared, since they belong to different noise.
        """
        problem, used = self._sweeps.problem, self._sweeps.problem.noise.copy()
        problem.noise[:] = noise
        trial = self._sweeps.forward(self._moved(fraction))
        if trial.with_noise(problem, used).merit(weights, 0.0) < self.iterate.merit(weights, 0.0):
            self.iterate, self._released, self._previous = trial, False, used
            self.damped += fraction < 1.0
            return True
        problem.noise[:] = used
        return False


def consistency(linear: Backward, noise: Array, reference_steps: NDArray[np.bool_]) -> float:
    """Ratio of the smoothed noise's normalised squares to the number of resolved values; at most one.

    Both are summed over the reference steps ``reference_steps``. If nothing is resolved in them, the ratio is one.
    """
    squares, resolved = (float(np.sum(channels)) for channels in noise_sums(linear, noise, reference_steps))
    return min(1.0, squares / resolved) if resolved > 0.0 else 1.0


def _movement(linear: Backward) -> float:
    """Root mean square of the move in standard deviations; NaN if the pass is not finite."""
    variance = np.hstack([linear.state_variance, linear.disturbance_variance])
    square = linear.correction**2
    known = variance > 0.0
    if not (np.isfinite(square).all() and np.isfinite(variance).all()):
        return float("nan")
    return float(np.sqrt(np.mean(square[known] / variance[known]))) if known.any() else 0.0


def _state_deviations(linear: Backward) -> Array:
    """Standard deviations ``(s+1, 12)``; the last pass's move of a state is added as uncertainty."""
    deviations = np.empty((len(linear.state_variance), 12))
    deviations[:, SENSED] = np.sqrt(linear.state_variance + linear.correction[:, :10] ** 2)
    deviations[:, 3:5] = np.sqrt(linear.track_variance)
    return deviations


def _disturbance_deviations(linear: Backward) -> Array:
    """Standard deviations ``(s+1, 6)``; the last pass's move is added as uncertainty."""
    return np.asarray(np.sqrt(linear.disturbance_variance + linear.correction[:, 10:] ** 2))


def _at_steps(rows: NDArray[np.int64], values: Array) -> Array:
    """Interpolate values ``(s+1, c)`` of the rows between segments linearly to all rows ``(n+1, c)``."""
    all_rows = np.arange(rows[-1] + 1)
    return np.column_stack([np.interp(all_rows, rows, column) for column in values.T])
