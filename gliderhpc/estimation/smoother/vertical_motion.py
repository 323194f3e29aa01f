r"""Vertical motion of the water during a dive, as errors of the measured depth.

Water that moves vertically carries the glider along, which adds to its depth rate without a force. The record shows
how much: in each leg the depth rate of a steady glide in still water, at the measured attitude and ballast, differs
from the measured one by the water's velocity, and by errors of the hull, which hardly vary within a leg. If the
difference varies by more than in still water, and the rest of the record does not contradict such a motion
(`is_probable`), the water's vertical velocity becomes one more unknown of the dive. It is linear between knots, with
the prior of an exponentially correlated process. Its integral is the displacement

.. math:: \zeta(t) = \sum_k z_k(t) \, \eta_k,

with constant, independent errors :math:`\eta_k`. The measured depth less this displacement is that of a glider in water
at rest.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gliderhpc.estimation.preparation import PreparedProfile, recorded_samples
from gliderhpc.estimation.steady_balance import MeasuredAttitude
from gliderhpc.estimation.still_water_glide import still_water_glide

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

CORRELATION_TIME = 300.0
"""Correlation time of the water's vertical velocity, s; periods of internal waves are 10 minutes and longer."""

MIN_MOTION = 0.003
"""Smallest variation of the depth rate (m/s) that is attributed to the water. Without vertical motion it is 0.0002 to
0.001 on twins with shear, gusts, fouling, or a wrong hull."""

_LOG_ODDS = 3.0
"""Logarithm of the prior odds of motion where the depth rate varies: internal waves are the usual reason."""

_SPACING, _MAX_KNOTS = 150.0, 23
"""Smallest distance of two knots, s, and largest number of knots."""

_AVERAGED = 60.0
"""Shortest interval over which the depth rate is determined, s."""
_MIN_SAMPLES = 4
"""Smallest number of samples for a depth rate."""
MIN_DEPTH = 5.0
"""Minimum depth of samples that are used, m; above, waves act on the glider, and its tail may be out of the water."""
SETTLING_TIME = 20.0
"""Time after the vibration set that is left out, s: the hull is still approaching its new glide."""
_MIN_RATES = 6
"""Smallest number of depth rates in a leg."""
_LINE = 2
"""Number of constants of a straight line."""


@dataclass(frozen=True, eq=False)
class DepthRates:
    """Depth rates of a profile over ``k`` intervals of steady glide.

    Attributes
    ----------
    time, depth : (k,), (k,)
        Middle of each interval, s, and depth, m.
    measured, still, noise : (k,), (k,), (k,)
        Measured depth rate, that of a steady glide in still water, and the standard deviation of the former, m/s.
    """

    time: Array
    depth: Array
    measured: Array
    still: Array
    noise: Array

    def variation(self) -> tuple[float, float]:
        """Variation of measured minus still-water depth rate (m/s), and the share of the water's motion that is in it.

        The variation is the root mean square about straight lines over depth, one for the dive and one for the climb,
        which absorb the errors of the hull and a part of the motion. Both are zero without enough depth rates.
        """
        squares, expected, freedom = 0.0, 0.0, 0
        for leg in (self.still > 0.0, self.still < 0.0):
            if leg.sum() < _MIN_RATES:
                continue
            line = np.linalg.qr(np.vander(self.depth[leg], _LINE))[0]
            apart = np.eye(len(line)) - line @ line.T
            left = apart @ (self.measured - self.still)[leg]
            squares += float(left @ left - np.diag(apart) @ self.noise[leg] ** 2)
            expected += float(np.sum(apart * correlation(self.time[leg])))
            freedom += len(line) - _LINE
        if not freedom:
            return 0.0, 0.0
        return float(np.sqrt(max(squares, 0.0) / freedom)), float(np.sqrt(expected / freedom))


def correlation(time: Array) -> Array:
    """Correlation matrix of the water's vertical velocity at some times, s."""
    return np.asarray(np.exp(-np.abs(time[:, None] - time) / CORRELATION_TIME))


class MotionPrior(NamedTuple):
    """Vertical motion of the water before a dive is smoothed.

    Attributes
    ----------
    deviation : float
        Standard deviation of its velocity, m/s; zero for water that does not move vertically.
    log_odds : float
        Logarithm of the odds of motion; infinite if it is certain.
    """

    deviation: float
    log_odds: float = math.inf


STILL = MotionPrior(0.0)
"""Water that does not move vertically."""


def motion_prior(profile: PreparedProfile) -> MotionPrior:
    """Return the motion that the depth rates of a profile suggest.

    A slow record hardly distinguishes motion from slow forces, so both are among the unknowns wherever the depth rate
    varies. A choice between the two by their evidence was wrong in three of four dives of twins in internal waves.
    """
    return MotionPrior(motion_deviation(profile), math.inf if profile.is_slow else _LOG_ODDS)


def motion_deviation(profile: PreparedProfile) -> float:
    """Standard deviation of the water's vertical velocity that the record suggests, m/s; zero if it shows no motion."""
    variation, share = depth_rates(profile).variation()
    return variation / share if variation > MIN_MOTION else 0.0


def depth_rates(profile: PreparedProfile) -> DepthRates:
    """Determine the depth rates over successive intervals of steady glide."""
    series = profile.series
    rows = np.flatnonzero(recorded_samples(series) & np.isfinite(series.measurements).all(axis=1))
    interval = max(_AVERAGED, _MIN_SAMPLES * series.sample_interval)
    usable = _undisturbed(profile)[rows] & (series.measurements[rows, 3] > MIN_DEPTH)
    number = np.floor(series.time[rows] / interval).astype(np.int64)
    parts = [rows[part] for part in _parts(number, usable)]
    lines = [_straight_lines(series.time[part], series.measurements[part]) for part in parts]
    if not lines:
        return DepthRates(*(np.empty(0) for _ in range(5)))
    mean, slope, lever = (np.array(column) for column in zip(*lines, strict=True))
    attitude = MeasuredAttitude(mean[:, 0], mean[:, 1], slope[:, 2], mean[:, 3])
    middle = np.array([part[len(part) // 2] for part in parts])
    bodies = profile.bodies[np.minimum(middle, len(profile.bodies) - 1)]
    still = still_water_glide(profile.glider, bodies, attitude).depth_rate
    gliding = np.isfinite(still)
    noise = profile.glider.platform.sensors.depth_noise / lever
    columns = (series.time[middle], mean[:, 3], slope[:, 3], still, noise)
    return DepthRates(*(column[gliding] for column in columns))


def _undisturbed(profile: PreparedProfile) -> Mask:
    """Mask of the steps in steady glide, settled after the actuators' motion."""
    reach = round(SETTLING_TIME / profile.series.step)
    count = np.cumsum(profile.vibrating)
    before = np.concatenate([np.zeros(reach, dtype=count.dtype), count[:-reach]])[: len(count)]
    return np.asarray((count == before) & (profile.series.weights > 0.0))


def _parts(number: NDArray[np.int64], usable: Mask) -> list[NDArray[np.int64]]:
    """Positions of the samples of each interval that is usable as a whole and has enough samples."""
    edges = np.concatenate([[0], np.flatnonzero(np.diff(number)) + 1, [len(number)]])
    parts = [np.arange(*pair) for pair in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True)]
    return [part for part in parts if len(part) >= _MIN_SAMPLES and usable[part].all()]


def _straight_lines(time: Array, values: Array) -> tuple[Array, Array, float]:
    """Means and slopes of values over time, and the root of the sum of the squared times from their mean."""
    lever = time - time.mean()
    squares = float(lever @ lever)
    return values.mean(axis=0), lever @ values / squares, float(np.sqrt(squares))


def is_probable(score: Array, information: Array, others: Array, log_odds: float) -> bool:
    """Return whether motion is more probable than its absence, in which forces alone vary the depth rate.

    Parameters
    ----------
    score, information : (q+k,), (q+k, q+k)
        Score of, and information on, ``q`` other errors and the ``k`` errors of the motion, with unit deviations.
    others : (q, q)
        Covariance of the other errors before the dive.
    log_odds : float
        Logarithm of the odds of motion before the dive.

    Notes
    -----
    Forces that vary slowly change the depth rate as well, but they also pitch the glider and take time to act. The log
    evidence ``g' (1 + C I)^-1 C g / 2 - log det (1 + C I) / 2`` with the motion among the unknowns is compared with
    that without it.
    """
    count = len(others)
    everything = np.eye(len(score))
    everything[:count, :count] = others
    still = _log_evidence(score[:count], information[:count, :count], others)
    return _log_evidence(score, information, everything) - still > -log_odds


def _log_evidence(score: Array, information: Array, covariance: Array) -> float:
    spread = np.eye(len(score)) + covariance @ information
    gained = score @ np.linalg.solve(spread, covariance @ score)
    return float(0.5 * gained - 0.5 * np.linalg.slogdet(spread)[1])


def displacements(time: Array, deviation: float) -> Array:
    """Displacements ``(n, k)`` of the water downwards at times ``(n,)``, m, by independent errors of unit deviation.

    The displacement is zero at the first time (s), and the water's velocity has the `deviation`, m/s. Without one there
    are no errors, ``k = 0``.
    """
    return deviation * displacement_basis(time) if deviation > 0.0 else np.zeros((len(time), 0))


def displacement_basis(time: Array) -> Array:
    """Displacements ``(n, k)`` as in `displacements`, for a deviation of 1 m/s."""
    count = int(np.clip(np.ceil((time[-1] - time[0]) / _SPACING), 1, _MAX_KNOTS - 1)) + 1
    knots = np.linspace(time[0], time[-1], count)
    velocity = np.column_stack([np.interp(time, knots, unit) for unit in np.eye(count)])
    moved = 0.5 * np.diff(time)[:, None] * (velocity[1:] + velocity[:-1])
    displaced = np.concatenate([np.zeros((1, count)), np.cumsum(moved, axis=0)])
    return np.asarray(displaced @ np.linalg.cholesky(correlation(knots)))
