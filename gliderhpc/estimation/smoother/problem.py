"""The maximum a posteriori problem of a profile: measurements, priors, start, and the sweeps that solve it.

The unknowns are the initial state and the six disturbances, first-order Gauss-Markov sequences from which the flight
model computes the trajectory. The samples used and their variances are fixed before the iteration, which makes the
problem well defined. The samples are those of the record at which the filter neither gated nor restarted. Where the
first pass finds an innovation beyond the filter's gate, the variance is widened once until the innovation is at the
gate. Two effects that the filter neglects are included, because the intervals would be too narrow without them: rounded
samples repeat their error together with their value, and the actuators' records may lag. A third, gusts from the side,
is included because the speed would be wrong without it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from gliderhpc.estimation.filter import INITIAL_DEVIATION, FilterEstimate
from gliderhpc.estimation.joining import flyable
from gliderhpc.estimation.preparation import PreparedProfile, recorded_values, repetitions
from gliderhpc.estimation.priors import smoother_prior, with_lateral_gusts
from gliderhpc.estimation.self_motion import first_guess
from gliderhpc.estimation.sensor_noise import sample_variance
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.estimation.smoother.noise import NoiseScale, actuation_noise
from gliderhpc.flight.glider import SENSED
from gliderhpc.kernels import smoother as kernel
from gliderhpc.kernels.filter import GATED, RESET
from gliderhpc.kernels.parameters import Hull
from gliderhpc.kernels.smoother_allocation import (
    allocate_backward,
    allocate_block,
    allocate_costate,
    allocate_segments,
    allocate_tape,
)
from gliderhpc.kernels.smoother_memory import DEFECTS, LOG_DETERMINANT, Backward, SmootherProblem
from gliderhpc.kernels.smoother_path import move_path
from gliderhpc.platform import DisturbancePrior
from gliderhpc.vocabulary import CHANNELS

Array = NDArray[np.float64]

_INTERPOLATED = 0.5
"""Fraction of the interval between its records to which the time of an actuator's move is known."""
_LONGEST_GAP = 40.0
"""Longest gap (s) of the actuators' records in which a move may be at any time; with longer ones, passes diverge."""
_SEGMENT_DURATION = 0.5
"""Longest segment (s); the mean shifts of its steps are summed and applied in one row (docs/smoother.md)."""
_SEGMENTS_PER_MEAN_SHIFT = 5
"""Number of segments with a common mean shift, an odd number; one for each segment would take half of a pass's time."""
_SWAY, _YAW = (list(CHANNELS).index(name) for name in ("B_cv", "B_cr"))
_GUST_FACTORS = np.array([3000.0, 1.0, 1.0, 1.0])
"""Factors on the variances of roll, pitch, heading and depth where gusts roll the glider."""
_SHARED = 1.0 / 3.0
"""Share of a run of equal samples whose rounding error is assumed to be common; with this value, intervals of the
pitching moment have their nominal coverage on twins (docs/smoother.md)."""


@dataclass(frozen=True, eq=False)
class Trajectory:
    """A trajectory and disturbances, which need not produce that trajectory.

    Attributes
    ----------
    states : (n+1, 12)
        States of eq. 16, SI and rad.
    disturbances : (n+1, 6)
        Disturbances, N and N m; row k acts on the step from row k, the last row on none.
    """

    states: Array
    disturbances: Array


class RollingGusts(NamedTuple):
    """Gusts that roll the glider."""

    with_bursts: bool
    """True if yaw moments also turn it, in bursts with quiet stretches between."""


def pose_problem(
    profile: PreparedProfile, filtered: FilterEstimate, settings: EstimationSettings, noise_factor: Array | float = 1.0,
    *, gusts: RollingGusts | None = None,
) -> tuple[SmootherProblem, NoiseScale]:  # fmt: skip
    """Pose the problem of one profile, and separate its noise into that of the prior and that of the actuators.

    Parameters
    ----------
    profile : PreparedProfile
        Hull and record on ``n`` steps; steps that start in the vibration set add more noise, as in the filter.
    filtered : FilterEstimate
        Filter's estimate, which determines the rejected samples and the smoother's prior (`smoother_prior`).
    settings : EstimationSettings
        Settings, of which ``step``, ``filter`` and ``smoother`` are used.
    noise_factor : (6,) array or float
        Factor on the variances of the prior's noise.
    gusts : RollingGusts, optional
        Gusts that roll the glider (`gliderhpc.estimation.smoother.steered_run.find_gusts`).

    Notes
    -----
    Gusts from the side change the side force and the moments together, within seconds. With the usual prior, in which
    these are slow and independent, the roll caused by gusts would appear to determine speed and lift: on twins in gusts
    with the true hull, the error of the speed would be 0.023 m/s. In gusts the side force therefore follows them, and
    the roll has a larger variance; the error is then 0.004 m/s. The noise of the side force is not scaled to the
    profile, since the record hardly resolves it. Nor is that of the yaw moment if yaw moments also act in bursts: the
    scale would reflect the quiet stretches, and the bursts would then bias the speed.
    """
    series, platform = profile.series, profile.glider.platform
    prior = smoother_prior(platform, filtered.prior, series.attitude_interval, profile.driving_weight)
    if gusts:
        prior = with_lateral_gusts(prior)
    measured = np.where(recorded_values(series), series.measurements, np.nan)
    measured[_rejected(filtered, settings)] = np.nan
    variance = _variance(sample_variance(platform, series), measured) * (_GUST_FACTORS if gusts else 1.0)
    if profile.velocity is not None and not profile.velocity.is_empty:
        measured = np.hstack([measured, profile.velocity.values])
        variance = np.hstack([variance, profile.velocity.variance])
    deviation, time = np.array(prior.deviation), np.array(prior.correlation_time)
    scale = _noise_scale(profile, filtered, prior, settings, noise_factor, unscaled=unscaled_channels(gusts))
    first = first_guess(platform, series)
    problem = SmootherProblem(
        bodies=np.ascontiguousarray(profile.bodies),
        step=settings.step,
        fed=np.isfinite(measured).any(axis=1),
        measured=measured,
        variance=variance,
        mean=np.concatenate([first, np.zeros(6)]),
        deviation=np.concatenate([INITIAL_DEVIATION, deviation]),
        decay=np.exp(-settings.step / time),
        noise=scale.prior + scale.actuators,
        # Set by the iteration.
        damping=np.empty(6),
    )
    return problem, scale


def _noise_scale(
    profile: PreparedProfile, filtered: FilterEstimate, prior: DisturbancePrior, settings: EstimationSettings,
    noise_factor: Array | float, *, unscaled: tuple[int, ...],
) -> NoiseScale:  # fmt: skip
    """Noise of the disturbances from the prior and from the actuators."""
    deviation, time = np.array(prior.deviation), np.array(prior.correlation_time)
    # Accurate for long correlation times too, where 1 - decay**2 would suffer from cancellation.
    added = deviation**2 * -np.expm1(-2.0 * settings.step / time)
    factor = np.where(profile.vibrating[:-1], settings.filter.vibration_noise_factor, 1.0)
    interval = np.full(len(profile.bodies), profile.series.sample_interval)
    if profile.series.control_interval is not None:
        interval = np.maximum(interval, np.minimum(profile.series.control_interval, _LONGEST_GAP))
    lag = np.maximum(settings.smoother.actuator_lag, _INTERPOLATED * interval)
    actuators = actuation_noise(profile.bodies, filtered.states[:-1, :2], lag, settings.step)
    reference_steps = ~profile.vibrating[:-1] & ~actuators.any(axis=1)
    heavy = settings.smoother.heavy_tailed if settings.smoother.degrees_of_freedom is not None else ()
    channels = tuple(i for i, name in enumerate(CHANNELS) if name not in heavy and i not in unscaled)
    mission_factor = np.where(np.isin(range(len(CHANNELS)), unscaled), 1.0, noise_factor)
    return NoiseScale(mission_factor * (factor[:, None] * added), actuators, reference_steps, channels)


def unscaled_channels(gusts: RollingGusts | None) -> tuple[int, ...]:
    """Channels whose noise is not scaled to the profile (`pose_problem`)."""
    if gusts is None:
        return ()
    return (_SWAY, _YAW) if gusts.with_bursts else (_SWAY,)


def _rejected(filtered: FilterEstimate, settings: EstimationSettings) -> NDArray[np.bool_]:
    """Mask ``(n+1,)`` of rows within half a feed interval of those at which the filter gated or restarted."""
    reach = round(0.5 * settings.filter.feed_interval / settings.step)
    rejected = filtered.events & (GATED | RESET) > 0
    return scipy.ndimage.maximum_filter1d(rejected, 2 * reach + 1) if rejected.any() else rejected


def _variance(sample_variances: Array, measured: Array) -> Array:
    """Variances ``(n+1, 4)``; those of repeated angles are larger, because their rounding error is repeated as well.

    The rounding errors of a run of equal values are the same if the angle is constant, and differ if it changes slowly.
    """
    variance = np.tile(sample_variances, (len(measured), 1))
    rows = np.flatnonzero(np.isfinite(measured).any(axis=1))
    for channel in range(3):
        variance[rows, channel] *= 1.0 + _SHARED * (repetitions(measured[rows, channel]) - 1)
    return variance


def starting_trajectory(filtered: FilterEstimate) -> Trajectory:
    """Initial trajectory of the iteration: the filter's estimate, with a heading without jumps by whole turns."""
    states = filtered.states.copy()
    states[:, 2] = np.unwrap(states[:, 2])
    return Trajectory(states, filtered.disturbances.copy())


@dataclass(frozen=True, eq=False)
class Iterate:
    """Trajectory about which a pass was linearised, and its cost.

    Attributes
    ----------
    trajectory : Trajectory
        Trajectory of the linearisation.
    costs : (3,)
        Costs of initial state, measurements and noise.
    log_determinant : float
        Half the logarithm of the Hessian's determinant for the estimate of the mean; zero for the mode.
    defects : (10,)
        Sums of the sensed states' absolute defects.
    """

    trajectory: Trajectory
    costs: Array
    log_determinant: float
    defects: Array

    def with_noise(self, problem: SmootherProblem, noise: Array) -> "Iterate":
        """Return the same with the cost of its noise by other variances ``(n, 6)``."""
        disturbances = self.trajectory.disturbances
        added = problem.decay * disturbances[:-1] - disturbances[1:]
        return replace(self, costs=np.array([*self.costs[:2], 0.5 * np.sum(added**2 / noise)]))

    def merit(self, weights: Array, share: float) -> float:
        """Merit to be minimised, with the defects weighted by ``weights`` and the log determinant by ``share``.

        The merit is infinite for a trajectory that is not finite or cannot be flown.
        """
        with np.errstate(over="ignore", invalid="ignore"):
            value = float(self.costs.sum() + share * self.log_determinant + np.sum(weights * self.defects))
        return value if np.isfinite(value) and flyable(self.trajectory.states[:, SENSED]) else np.inf


def steps_per_segment(step: float) -> int:
    """Return the largest number of steps of a segment, for the length of a step (s)."""
    return max(1, round(_SEGMENT_DURATION / step))


def segment_rows(
    problem: SmootherProblem, also: Sequence[int] = (), *, longest: int | None = None
) -> NDArray[np.int64]:
    """Divide a profile into segments: the first row of each, and the last row of the profile.

    Parameters
    ----------
    problem : SmootherProblem
        The profile; no segment has a sample inside.
    also : sequence of int
        Further rows at which a segment begins.
    longest : int, optional
        Largest number of steps of a segment; by default those of half a second.
    """
    longest = steps_per_segment(problem.step) if longest is None else longest
    needed = np.union1d(np.flatnonzero(problem.fed), [0, len(problem.bodies), *also]).astype(np.int64)
    parts = -(-np.diff(needed) // longest)
    inside = np.arange(parts.sum()) - np.repeat(np.cumsum(parts) - parts, parts)
    return np.append(np.repeat(needed[:-1], parts) + longest * inside, needed[-1])


def steps_of_mean_shifts(rows: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return for each segment the number of steps that the mean shift of its first step represents (`Segments`).

    The mean shift of one in five segments is used for all five, unless segments are single steps. It rises and falls
    between samples, which are usually two segments apart; an even number of segments would always sample it at the same
    phase.
    """
    steps = np.diff(rows)
    if steps.max() == 1:
        return steps
    groups = np.arange(0, len(steps), _SEGMENTS_PER_MEAN_SHIFT)
    middle = np.minimum(groups + _SEGMENTS_PER_MEAN_SHIFT // 2, len(steps) - 1)
    result = np.zeros_like(steps)
    result[middle] = np.add.reduceat(steps, groups)
    return result


class Sweeps:
    """The two sweeps of a pass, with buffers of their own.

    Parameters
    ----------
    hull, problem : Hull, SmootherProblem
        The problem.
    rows : sequence of int
        Rows with full covariances.
    mean : bool
        Whether the estimate is the mean in place of the mode.
    longest : int, optional
        Largest number of steps of a segment (`segment_rows`).

    Attributes
    ----------
    rows : (s+1,) int
        First row of each segment, and the last row of the profile.
    mean_shift : (s+1, 16) or (0, 16)
        Gradient of the linear term of the cost in these rows; none for the mode.
    """

    def __init__(
        self,
        hull: Hull,
        problem: SmootherProblem,
        rows: Sequence[int] = (),
        *,
        mean: bool = False,
        longest: int | None = None,
    ) -> None:
        self.problem = problem
        self.rows = segment_rows(problem, rows, longest=longest)
        self.mean_shift = np.zeros((len(self.rows) if mean else 0, 16))
        self._hull = hull
        represented_steps = steps_of_mean_shifts(self.rows) if mean else np.zeros(len(self.rows) - 1, dtype=np.int64)
        self._segments = allocate_segments(self.rows, represented_steps, whole=True)
        self._block, self._costates = allocate_block(), allocate_costate()
        self._tape = allocate_tape(problem.fed[self.rows], represented_steps)
        self._tally = np.zeros(LOG_DETERMINANT + 1)
        self._mean = mean
        self._backward = allocate_backward(len(self.rows) - 1, len(problem.bodies), rows, mean_shift=mean)

    def forward(self, trajectory: Trajectory, gate: float = np.inf) -> Iterate:
        """Filter about a trajectory.

        Rows inside the segments are replaced by the model's run from the segment's first row; X and Y are replaced by
        the displacement along the trajectory.
        """
        kernel.forward(
            self._hull, self.problem, trajectory.states, trajectory.disturbances, self.mean_shift, gate, self._segments,
            self._block, self._tally, self._tape,
        )  # fmt: skip
        return self._iterate_with_costs(trajectory)

    def run(self, trajectory: Trajectory) -> Iterate:
        """Run the model along a trajectory as `forward` does, without filtering; the log determinant stays unknown (0).

        It computes no covariances. A backward sweep needs a forward sweep before it.
        """
        kernel.run_path(
            self._hull, self.problem, trajectory.states, trajectory.disturbances, self._segments, self._tally
        )
        return self._iterate_with_costs(trajectory)

    def _iterate_with_costs(self, trajectory: Trajectory) -> Iterate:
        log_determinant = float(self._tally[LOG_DETERMINANT]) if self._mean else 0.0
        return Iterate(
            trajectory, self._tally[:DEFECTS].copy(), log_determinant, self._tally[DEFECTS:LOG_DETERMINANT].copy()
        )

    def backward(self, trajectory: Trajectory) -> Backward:
        """Smooth about the trajectory of the last forward sweep; the next backward sweep overwrites the result."""
        kernel.backward(
            self._hull, self.problem, trajectory.states, trajectory.disturbances, self.mean_shift, self._segments,
            self._block, self._tape, self._costates, self._backward,
        )  # fmt: skip
        return self._backward

    def moved(self, trajectory: Trajectory, linear: Backward, fraction: float) -> Trajectory:
        """Return the trajectory moved by a fraction of the correction.

        Inside the segments, the disturbances move by the smoothed noise; the states follow in the next forward sweep.
        """
        states, disturbances = trajectory.states.copy(), trajectory.disturbances.copy()
        move_path(self.problem.decay, self.rows, linear.correction, linear.noise_mean, fraction, states, disturbances)
        return Trajectory(states, disturbances)


_FIRST, _WEAKEST, _STRONGEST = 1.0, 0.5, 1e6
"""Strengths of the damping: the first and the smallest one, and that beyond which damping is useless."""
_TIGHTER, _LOOSER = 10.0, 0.1
"""Factors on the strength."""


class Damping:
    """Levenberg-Marquardt damping, used if no fraction of a move lowers the merit: rows stay near the trajectory.

    Notes
    -----
    Near rest the angle of attack varies by tens of degrees within the velocity's uncertainty, and a Gauss-Newton move
    overshoots there, whereas the rest of the profile needs the whole move. Shortening the move would delay the whole
    profile because of a few seconds. Therefore velocities and rates are damped towards the trajectory, with the
    deviations of the initial state's prior over the square root of a strength. Rows that the record determines better
    than that hardly change (Särkkä and Svensson 2020, Levenberg-Marquardt and line-search extended Kalman smoothers,
    ICASSP 2020, 5875-5879).
    """

    def __init__(self, problem: SmootherProblem) -> None:
        self._problem = problem
        self._variance = np.square(problem.deviation[4:10])
        self.set(0.0)

    @property
    def active(self) -> bool:
        """Return whether there is any damping."""
        return self.strength > 0.0

    @property
    def exhausted(self) -> bool:
        """Return whether stronger damping is useless."""
        return self.strength > _STRONGEST

    def set(self, strength: float) -> None:
        """Set the strength of the damping; below the smallest strength there is none."""
        self.strength = strength if strength >= _WEAKEST else 0.0
        self._problem.damping[:] = self._variance / self.strength if self.active else np.inf

    def loosen(self) -> None:
        """Damp less, as after a successful move."""
        self.set(self.strength * _LOOSER)

    def tighten(self) -> None:
        """Damp more, as after an unsuccessful move."""
        self.set(max(self.strength * _TIGHTER, _FIRST))
