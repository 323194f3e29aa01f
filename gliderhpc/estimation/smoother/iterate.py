"""The iterated smoother of a whole dive: disturbances and motion from past and future samples, with uncertainties.

`smooth_dive` poses a profile's problem, estimates its noise from a segment, and iterates passes. This is the
Gauss-Newton iteration for the maximum a posteriori (MAP) problem of `gliderhpc.estimation.smoother.problem`: every pass
linearises the flight model about the smoothed trajectory of the previous pass. By default an additional term leads to
the mean in place of the most probable trajectory (docs/smoother.md).
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
    spent_and_resolved,
    standardised_noise,
)
from gliderhpc.estimation.smoother.problem import (
    Damping,
    Sweeps,
    Trajectory,
    pose_dive,
    starting_trajectory,
    unscaled_channels,
)
from gliderhpc.estimation.smoother.steered_run import find_gusts
from gliderhpc.flight.glider import SENSED
from gliderhpc.kernels.parameters import Hull
from gliderhpc.kernels.smoother_memory import Backward, Dive
from gliderhpc.observations.dive_phases import stationary_points
from gliderhpc.outcomes import Outcome
from gliderhpc.vocabulary import CHANNELS

Array = NDArray[np.float64]

_FRACTIONS = (1.0, 0.5, 0.25, 0.125)
"""Fractions of a pass's move that are tried."""
_AT_ONCE = _FRACTIONS[:2]
"""Fractions that are tried with renewed noise in the same sweep."""
_PENALTY = 1.5
"""Ratio of a defect's weight to the largest costate of its state; above 1 the merit has the MAP problem's minimum."""
_ACCEPTED_MOVE = 1.0
"""Largest remaining move, in standard deviations, with which an iteration that ended early still gives an estimate."""
_NEGLIGIBLE_VARIANCE_CHANGE = 0.1
"""Relative change of a variance of the noise below which the noise is not updated."""
_ROUNDING = 1e-11
"""Relative increase of the merit that is attributed to rounding."""
_SEGMENT = (0.15, 0.4)
"""Part of a dive from which its noise is first estimated: usually steady descent, settled after the surface."""
_LONGEST_SEGMENT = 1200.0
"""Longest duration of that part, s; a longer one would hardly determine the noise better."""
_SEGMENT_PASSES = 3
"""Largest number of passes over that part: the passes over the whole dive update its noise anyway."""
_SIMPLER_METHODS: dict[str, dict[str, bool | str]] = {
    "the noise is the prior's, not fitted to the dive": {"adaptive": False},
    "the estimate is the most probable path, not the mean": {"estimate": "mode"},
}
"""Changes of the settings that are tried in turn where no estimate was found, by their description."""
_KNOWN = (ProfileError, ArithmeticError, np.linalg.LinAlgError)
"""Errors that a record may cause in the smoother; any other error is a fault of the program."""


def smooth_dive(
    profile: PreparedProfile, filtered: FilterEstimate, settings: EstimationSettings, noise_factor: Array | float = 1.0
) -> SmoothedEstimate:
    """Smooth one filtered profile.

    If no estimate is found with noise adapted to the dive, the prior's noise is used, and then the most probable path
    in place of the mean: in a gap of all records about the inflection, the actuators' moves look slow, and the shift
    from the path to the mean can diverge. If this fails too, the outcome is not usable and the values are the filter's.

    Parameters
    ----------
    profile, filtered : PreparedProfile, FilterEstimate
        Profile on its steps, and the filter's estimate.
    settings : EstimationSettings
        Settings, of which ``step``, ``filter`` and ``smoother`` are used.
    noise_factor : (6,) array or float
        Factor on the prior's noise, estimated from the mission's other dives.
    """
    smoothed = _smoothed_or_filtered(profile, filtered, settings, noise_factor)
    if smoothed.outcome.usable:
        return smoothed
    for meaning, change in _SIMPLER_METHODS.items():
        options = settings.smoother.model_copy(update=change)
        if options != settings.smoother:
            changed = settings.model_copy(update={"smoother": options})
            simpler = _smoothed_or_filtered(profile, filtered, changed, noise_factor)
            if simpler.outcome.usable:
                return replace(simpler, simplified=meaning)
    return smoothed


def _smoothed_or_filtered(
    profile: PreparedProfile, filtered: FilterEstimate, settings: EstimationSettings, noise_factor: Array | float
) -> SmoothedEstimate:
    try:
        smoothed = _smoothed(profile, filtered, settings, noise_factor)
    except _KNOWN as error:
        return replace(filter_fallback(filtered), failure=str(error))
    if smoothed.outcome.usable:
        return smoothed
    fallback = filter_fallback(filtered)
    return replace(fallback, passes=smoothed.passes, movement=smoothed.movement, outcome=smoothed.outcome)


def _smoothed(
    profile: PreparedProfile, filtered: FilterEstimate, settings: EstimationSettings, noise_factor: Array | float
) -> SmoothedEstimate:
    """Pose the problem, estimate the noise from a segment, and iterate."""
    hull, platform, gate = profile.glider.hull, profile.glider.platform, settings.filter.gate
    passes = smoother_passes(platform, settings.smoother, profile.series.attitude_interval)
    options = settings.smoother.model_copy(update={"max_passes": passes})
    if stationary_points(profile.series).any():
        # Drag vanishes with the square of the speed: about rest, the mean's second-order shift of the path diverges.
        options = options.model_copy(update={"estimate": "mode"})
    start = starting_trajectory(filtered)
    gusts = find_gusts(profile, start)
    dive, scale = pose_dive(profile, filtered, settings, noise_factor, gusts=gusts)
    models: list[NoiseModel] = [scale] if options.adaptive else []
    if options.degrees_of_freedom is not None:
        channels = tuple(list(CHANNELS).index(name) for name in options.heavy_tailed)
        steps = max(1, round(profile.series.sample_interval / profile.series.step))
        models.append(HeavyTails(dive.noise.copy(), options.degrees_of_freedom, channels, steps))
    if options.adaptive and options.max_passes != 1:
        dive.noise[:] = noise_from_segment(hull, dive, start, scale, options, gate)
    smoothed = iterate_passes(hull, dive, start, options, gate=gate, noise_models=models, usual=scale.usual)
    return replace(smoothed, noise_factor=scale.factors(dive.noise), unscaled=unscaled_channels(gusts))


def noise_from_segment(
    hull: Hull, dive: Dive, start: Trajectory, scale: NoiseScale, settings: SmootherSettings, gate: float
) -> Array:
    """Estimate the variances ``(n, 6)`` of a dive's noise from a segment, before the passes over the whole dive.

    Every change of the noise requires passes, which take less time over a segment. The passes over the whole dive
    update the noise where it differs.
    """
    first, stop = (int(part * len(dive.noise)) for part in _SEGMENT)
    stop = min(stop, first + round(_LONGEST_SEGMENT / dive.step))
    segment, rows = slice(first, stop), slice(first, stop + 1)
    part = dive._replace(
        bodies=dive.bodies[segment], noise=dive.noise[segment].copy(), fed=dive.fed[rows], measured=dive.measured[rows],
        variance=dive.variance[rows].copy(), damping=np.empty(6),
        mean=np.concatenate([start.states[first, SENSED], np.zeros(6)]),
    )  # fmt: skip
    part_scale, part_start = scale.for_segment(segment), Trajectory(start.states[rows], start.disturbances[rows])
    brief = settings.model_copy(update={"max_passes": min(settings.max_passes or _SEGMENT_PASSES, _SEGMENT_PASSES)})
    smoothed = iterate_passes(
        hull, part, part_start, brief, gate=gate, noise_models=[part_scale], usual=part_scale.usual
    )
    return scale.scaled(part_scale.factors(part.noise)) if smoothed.outcome.usable else np.asarray(dive.noise)


def iterate_passes(
    hull: Hull,
    dive: Dive,
    start: Trajectory,
    settings: SmootherSettings,
    *,
    gate: float = np.inf,
    noise_models: Sequence[NoiseModel] = (),
    usual: NDArray[np.bool_] | None = None,
) -> SmoothedEstimate:
    """Iterate passes over a dive until nothing moves by more than the tolerance.

    Parameters
    ----------
    hull, dive : Hull, Dive
        The problem; the first pass widens its variances where needed, and the noise models update its noise.
    start : Trajectory
        Trajectory of the first linearisation; its X and Y are replaced.
    settings : SmootherSettings
        Tolerance, largest number of passes (unset: unlimited), and mean or mode.
    gate : float
        Innovation, in standard deviations, beyond which the first pass widens a variance; infinite by default.
    noise_models : sequence of NoiseModel
        Models that adapt the noise to the passes; none by default.
    usual : (n,) mask, optional
        Steps by which the noise is judged; all by default.
    """
    nominal, noise = dive.variance.copy(), dive.noise.copy()
    sweeps = Sweeps(hull, dive, mean=settings.estimate == "mean")
    iteration = _Iteration(
        sweeps, start, settings, gate, noise_models, np.ones(len(noise), bool) if usual is None else usual
    )
    outcome = iteration.run()
    iterate, linear = iteration.iterate, iteration.linear
    values = dive.fed[:, None] & np.isfinite(dive.measured)
    return SmoothedEstimate(
        states=iterate.trajectory.states,
        states_std=_at_steps(sweeps.rows, _state_deviations(linear)),
        disturbances=iterate.trajectory.disturbances[:-1],
        disturbances_std=_at_steps(sweeps.rows, _disturbance_deviations(linear))[:-1],
        standardised_noise=standardised_noise(linear, dive.noise),
        displacement=displacement(iterate.trajectory.states),
        displacement_covariance=linear.displacement,
        cost=float(iterate.costs.sum()),
        passes=iteration.passes,
        damped=iteration.damped,
        movement=iteration.movement,
        noise_factor=np.median(dive.noise / noise, axis=0),
        used=int(values.sum()),
        widened=int((values & (dive.variance > nominal)).sum()),
        outcome=outcome,
        last_pass=LastPass(dive, linear.noise_mean, linear.noise_resolved),
    )


class _Iteration:
    """Passes over a dive until convergence, with moves damped where necessary."""

    def __init__(
        self, sweeps: Sweeps, start: Trajectory, settings: SmootherSettings, gate: float, models: Sequence[NoiseModel],
        usual: NDArray[np.bool_],
    ) -> None:  # fmt: skip
        self._sweeps, self._settings, self._models, self._usual = sweeps, settings, models, usual
        self._damping = Damping(sweeps.dive)
        self.iterate = sweeps.forward(start, gate)
        self.passes = self.damped = 0
        # Whether the damping was released without a move since: to release it again would repeat the same passes.
        self._released = False
        self.movement = np.inf
        # Share of the log determinant that is consistent with the dive's own noise.
        self.share = 1.0
        # Variances of the noise before they were last changed.
        self._before: Array | None = None
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
                rest = (1.0 - fraction) * self.linear.correction
                self.iterate, self.linear = trial, self.linear._replace(correction=rest)
                return Outcome.ITERATION_LIMIT
        return Outcome.DIVERGED

    def _moved(self, fraction: float) -> Trajectory:
        """Trajectory moved by a fraction of the last pass's correction."""
        return self._sweeps.moved(self.iterate.trajectory, self.linear, fraction)

    def _iterate(self) -> Outcome:
        while self.passes < self._cap:
            noise = self._renewed_noise()
            if self.movement <= self._settings.tolerance and noise is self._sweeps.dive.noise:
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
            self.share = consistency(linear, self._sweeps.dive.noise, self._usual)
            self._sweeps.mean_shift[:] = self.share * linear.mean_shift
        self.movement = _movement(linear)
        self.passes += 1
        return linear

    def _renewed_noise(self) -> Array:
        """Variances of the noise for the next pass: the same array as in use, unless a variance has changed.

        Where nothing else moves any longer, a variance that would turn back is moved by half (of its logarithm):
        alternating changes overshoot their limit.
        """
        used: Array = self._sweeps.dive.noise
        noise = used
        # Damped rows would seem better resolved than they are by the record.
        for model in () if self._damping.active else self._models:
            noise = model.renewed(noise, self.linear)
        if self._before is not None and noise is not used and self.movement <= self._settings.tolerance:
            turns_back = (noise - used) * (used - self._before) < 0.0
            noise = np.where(turns_back, np.sqrt(noise * used), noise)
        return noise if np.max(np.abs(noise / used - 1.0)) > _NEGLIGIBLE_VARIANCE_CHANGE else used

    def _move(self, noise: Array) -> None:
        """Move the trajectory by the pass's correction, or by a fraction that lowers the merit; else damp more.

        The merit is the cost plus the weighted absolute defects. The weight of each state exceeds its largest costate,
        which is the defects' Lagrange multiplier. Short moves then always decrease the merit, and a trajectory of least
        merit has no defects.
        """
        weights = _PENALTY * self.linear.steepest
        if noise is not self._sweeps.dive.noise and any(
            self._move_and_renew_noise(noise, weights, f) for f in _AT_ONCE
        ):
            return
        trajectory, strength = self.iterate.trajectory, self._damping.strength
        if self._damping.active:
            self._damping.loosen()
            self.iterate = self._sweeps.forward(trajectory)
        merit = self.iterate.merit(weights, self.share)
        most = merit + _ROUNDING * abs(merit)
        for fraction in _FRACTIONS:
            trial = self._sweeps.forward(self._moved(fraction))
            if trial.merit(weights, self.share) <= most:
                self.iterate, self._released = trial, False
                self.damped += fraction < 1.0
                if noise is not self._sweeps.dive.noise:
                    self._before = self._sweeps.dive.noise.copy()
                    self._sweeps.dive.noise[:] = noise
                    self.iterate = self._sweeps.forward(self.iterate.trajectory)
                return
        self.damped += 1
        self._damping.set(strength)
        self._damping.tighten()
        self.iterate = self._sweeps.forward(trajectory)

    def _move_and_renew_noise(self, noise: Array, weights: Array, fraction: float) -> bool:
        """Make a fraction of the move and renew the noise in one sweep, if the merit without determinant decreases.

        The determinants before and after the move belong to different noise, so that they cannot be compared.
        """
        dive, used = self._sweeps.dive, self._sweeps.dive.noise.copy()
        dive.noise[:] = noise
        trial = self._sweeps.forward(self._moved(fraction))
        if trial.with_noise(dive, used).merit(weights, 0.0) < self.iterate.merit(weights, 0.0):
            self.iterate, self._released, self._before = trial, False, used
            self.damped += fraction < 1.0
            return True
        dive.noise[:] = used
        return False


def consistency(linear: Backward, noise: Array, usual: NDArray[np.bool_]) -> float:
    """Sum of the smoothed noise's squares over their variances, relative to the number of resolved values; at most one.

    Only steps ``usual`` are used. If nothing is resolved in them, the ratio is one.
    """
    spent, resolved = (float(np.sum(parts)) for parts in spent_and_resolved(linear, noise, usual))
    return min(1.0, spent / resolved) if resolved > 0.0 else 1.0


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
    every = np.arange(rows[-1] + 1)
    return np.column_stack([np.interp(every, rows, column) for column in values.T])
