"""The dive's maximum a posteriori problem: its measurements, its priors, its start, and the sweeps that solve it.

Unknown are the initial state and the six disturbances, first-order Gauss-Markov sequences that the flight model turns
into the trajectory. Which samples count, and with what variance, is fixed before the iteration, so that the problem is
well defined: those of the record that the filter neither gated nor restarted at, their variances widened once, where
the first pass finds an innovation beyond the filter's gate, until it stands at the gate. Two effects that the filter
neglects are included, as intervals would be too narrow without: rounded samples repeat their error as they repeat
their value, and the actuators' records may lag.
"""

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from gliderhpc.estimation.filter import INITIAL_DEVIATION, FilterEstimate
from gliderhpc.estimation.glide_angle import flight_guesses
from gliderhpc.estimation.measurements import recorded_samples, repetitions, sample_variance
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.estimation.smoother.noise import NoiseScale, actuation_noise
from gliderhpc.estimation.window_problem import flyable
from gliderhpc.flight.glider import SENSED, Glider
from gliderhpc.kernels import smoother as kernel
from gliderhpc.kernels.filter import GATED, RESET
from gliderhpc.kernels.parameters import Hull
from gliderhpc.kernels.smoother_memory import (
    DEFECTS,
    LOG_DETERMINANT,
    Backward,
    Dive,
    allocate_backward,
    allocate_block,
    allocate_checkpoints,
    allocate_information,
)
from gliderhpc.observations.resample import ProfileSeries
from gliderhpc.platform import DisturbancePrior, Platform
from gliderhpc.vocabulary import CHANNELS

Array = NDArray[np.float64]

_INTERPOLATED = 0.5
"""Part of a sample interval to which the time of an actuator's move is known."""


@dataclass(frozen=True, eq=False)
class Trajectory:
    """A trajectory and its disturbances; the disturbances need not lead to the trajectory.

    Attributes
    ----------
    states : (n+1, 12)
        Eq. 16, SI and rad.
    disturbances : (n+1, 6)
        N and N m; row k acts on the step from row k, the last row on none.
    """

    states: Array
    disturbances: Array


_SHARED = 1.0 / 3.0
"""Share of a run of equal samples whose rounding error is taken to be the same: intervals of the pitching moment then
have their nominal coverage on twins (docs/smoother.md)."""


def pose_dive(
    glider: Glider, series: ProfileSeries, bodies: Array, vibrating: NDArray[np.bool_], estimate: FilterEstimate,
    prior: DisturbancePrior, settings: EstimationSettings,
) -> tuple[Dive, NoiseScale]:  # fmt: skip
    """Pose the problem of one profile; with it comes what its noise consists of.

    Parameters
    ----------
    glider, series : Glider, ProfileSeries
        The hull and the record on ``n`` steps.
    bodies : (n, 11)
        Mass properties from `Glider.bodies`.
    vibrating : (n+1,)
        The vibration set: steps that start in it add more noise, as in the filter.
    estimate : FilterEstimate
        Says which samples were rejected.
    prior : DisturbancePrior
        Stationary deviation and correlation time of the disturbances.
    settings : EstimationSettings
        Uses ``step``, ``filter`` and ``smoother``.
    """
    measured = np.where(recorded_samples(series)[:, None], series.measurements, np.nan)
    measured[_rejected(estimate, settings)] = np.nan
    deviation, time = np.array(prior.deviation), np.array(prior.correlation_time)
    scale = _noise_scale(series, bodies, vibrating, estimate, prior, settings)
    first = flight_guesses(glider.platform, series)[0, SENSED]
    dive = Dive(
        bodies=np.ascontiguousarray(bodies),
        step=settings.step,
        fed=np.isfinite(measured).any(axis=1),
        measured=measured,
        variance=_variance(glider.platform, measured),
        mean=np.concatenate([first, np.zeros(6)]),
        deviation=np.concatenate([INITIAL_DEVIATION, deviation]),
        decay=np.exp(-settings.step / time),
        noise=scale.prior + scale.actuators,
        damping=np.full(6, np.inf),
        mean_shift=np.zeros((len(bodies) + 1, 16)),
    )
    return dive, scale


def _noise_scale(
    series: ProfileSeries, bodies: Array, vibrating: NDArray[np.bool_], estimate: FilterEstimate,
    prior: DisturbancePrior, settings: EstimationSettings,
) -> NoiseScale:  # fmt: skip
    """Noise of the disturbances by the prior and for the actuators' sake; the arguments are those of `pose_dive`."""
    deviation, time = np.array(prior.deviation), np.array(prior.correlation_time)
    # Exact for long correlation times too, where 1 - decay**2 would cancel.
    added = deviation**2 * -np.expm1(-2.0 * settings.step / time)
    factor = np.where(vibrating[:-1], settings.filter.vibration_noise_factor, 1.0)
    lag = max(settings.smoother.actuator_lag, _INTERPOLATED * series.sample_interval)
    actuators = actuation_noise(bodies, estimate.states[:-1, :2], lag, settings.step)
    usual = ~vibrating[:-1] & ~actuators.any(axis=1)
    heavy = settings.smoother.heavy_tailed if settings.smoother.degrees_of_freedom is not None else ()
    channels = tuple(i for i, name in enumerate(CHANNELS) if name not in heavy)
    return NoiseScale(factor[:, None] * added, actuators, usual, channels)


def _rejected(estimate: FilterEstimate, settings: EstimationSettings) -> NDArray[np.bool_]:
    """Rows ``(n+1,)`` at which the filter gated or restarted, and those as near to them as it is fed a slow record."""
    reach = round(0.5 * settings.filter.feed_interval / settings.step)
    rejected = estimate.events & (GATED | RESET) > 0
    return scipy.ndimage.maximum_filter1d(rejected, 2 * reach + 1) if rejected.any() else rejected


def _variance(platform: Platform, measured: Array) -> Array:
    """Variances ``(n+1, 4)``; those of an attitude that repeats itself grow, for its rounding error is no new one.

    Of an angle that stands still all rounding errors of a run are the same, of one that passes through hardly any.
    """
    variance = np.tile(sample_variance(platform), (len(measured), 1))
    rows = np.flatnonzero(np.isfinite(measured).any(axis=1))
    for channel in range(3):
        variance[rows, channel] *= 1.0 + _SHARED * (repetitions(measured[rows, channel]) - 1)
    return variance


def starting_trajectory(estimate: FilterEstimate) -> Trajectory:
    """Trajectory that the iteration begins with: the filter's estimate, its heading without jumps by whole turns."""
    states = estimate.states.copy()
    states[:, 2] = np.unwrap(states[:, 2])
    return Trajectory(states, estimate.disturbances.copy())


@dataclass(frozen=True, eq=False)
class Iterate:
    """Trajectory that a pass was linearised about, and its cost.

    Attributes
    ----------
    trajectory : Trajectory
        The trajectory.
    costs : (3,)
        Of initial state, measurements and noise.
    log_determinant : float
        Half the logarithm of the Hessian's determinant, where the mean is wanted; else zero.
    defects : (10,)
        Sums of the sensed states' absolute defects.
    """

    trajectory: Trajectory
    costs: Array
    log_determinant: float
    defects: Array

    def merit(self, weights: Array, share: float) -> float:
        """Merit to be minimised, the defects weighed by ``weights`` and the log determinant by ``share``.

        Infinite for a trajectory that is not finite or cannot be flown.
        """
        value = float(self.costs.sum() + share * self.log_determinant + weights @ self.defects)
        return value if np.isfinite(value) and flyable(self.trajectory.states[:, SENSED]) else np.inf


class Sweeps:
    """The two sweeps of a pass, in buffers of their own."""

    def __init__(
        self, hull: Hull, dive: Dive, rows: tuple[int, ...] = (), *, mean_shift_every: int | None = None
    ) -> None:
        steps = len(dive.bodies)
        self.dive = dive
        self._hull = hull
        self._block, self._checkpoints = allocate_block(), allocate_checkpoints(steps)
        self._information = allocate_information()
        self._tally = np.zeros(LOG_DETERMINANT + 1)
        self._mean = mean_shift_every is not None
        self._backward = allocate_backward(steps, rows, every=mean_shift_every)

    def forward(self, trajectory: Trajectory, gate: float = np.inf) -> Iterate:
        """Filter about a trajectory; X and Y of the trajectory are replaced by the displacement along it."""
        kernel.forward(
            self._hull, self.dive, trajectory.states, trajectory.disturbances, gate, self._block, self._checkpoints,
            self._tally,
        )  # fmt: skip
        log_determinant = float(self._tally[LOG_DETERMINANT]) if self._mean else 0.0
        return Iterate(
            trajectory, self._tally[:DEFECTS].copy(), log_determinant, self._tally[DEFECTS:LOG_DETERMINANT].copy()
        )

    def backward(self, trajectory: Trajectory) -> Backward:
        """Smooth about the trajectory of the last forward sweep; the next backward sweep overwrites the result."""
        kernel.backward(
            self._hull, self.dive, trajectory.states, trajectory.disturbances, self._block, self._checkpoints,
            self._tally, *self._information, self._backward,
        )  # fmt: skip
        return self._backward
