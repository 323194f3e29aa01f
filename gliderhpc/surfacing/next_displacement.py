r"""Displacement through the water expected of the next dive, from those of the dives so far.

The next dive may be like the last one, but gliders also steer several courses in turn, as on a zigzag or around a
square. It is therefore predicted by several patterns:

- like the dive k before it, for k of 1 (the last dive) to 4: up to four courses in turn;
- like the last dive, after another turn like the last one;
- on any course: the mean of the dives so far, with their scatter.

A glider that corrects its heading for the current, as most do, changes its displacement against the change of the
current that it has measured in the meantime. With the displacement :math:`d_n` of dive n, which lasts :math:`T_n`, and
its depth-averaged current :math:`u_n`, the next dive is expected to have, if it is like the dive k before,

.. math:: d_{n+1} = d_{n+1-k} - g \, T_n (u_n - u_{n-k}),

where the gain g is estimated from the dives so far: 0 for a constant heading, 1 for a constant course over ground. All
displacements are scaled to the duration of the last dive.

The prediction is the average of the patterns, weighted by the posterior probabilities that the dives so far give them.
A pattern is judged by its errors of velocity, because it does not predict the duration of a dive. Their size is
unknown, and a small fraction of the dives departs from the pattern, on any course.
"""

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_COMPARED = 20
"""Maximum number of the latest differences between flown and expected displacements that are used."""

_PRIOR_DIFFERENCES, _PRIOR_FRACTION = 3, 0.1
"""Number of prior differences assumed in addition, and their size as a fraction of the displacement."""

_GAIN = 0.5
"""Prior standard deviation of the gain about zero."""

_SIZES = (0.05, 0.1, 0.2, 0.4)
"""Equally probable sizes (root mean square) of a pattern's errors, as fractions of the speed."""

_DEPARTURE = 0.1
"""Probability that a dive departs from its pattern."""

_SLOWEST = 1e-3
"""Minimum of the mean speed, m/s; a glider that does not move has none."""


class _Pattern(NamedTuple):
    """A pattern of courses.

    Attributes
    ----------
    probability : float
        Prior probability.
    sizes : tuple of float
        Equally probable sizes of its errors, as fractions of the speed.
    fraction : float
        Size of the prior differences of displacement, as a fraction of the displacement.
    back : int or None
        Number of dives over which the current's change is corrected; None without a correction.
    follow : callable
        Returns for velocities (n, 2) those expected after each of them, (n, 2), without correction; NaN where unknown.
    """

    probability: float
    sizes: tuple[float, ...]
    fraction: float
    back: int | None
    follow: Callable[[Array], Array]


def _like_dive_before(back: int) -> Callable[[Array], Array]:
    """Return the rule by which a dive is like the one `back` dives before it."""

    def follow(velocities: Array) -> Array:
        expected = np.full_like(velocities, np.nan)
        expected[back - 1 :] = velocities[: max(len(velocities) - back + 1, 0)]
        return expected

    return follow


def _another_turn(velocities: Array) -> Array:
    course = np.arctan2(velocities[:, 1], velocities[:, 0])
    speed, following = np.hypot(*velocities.T), course + np.diff(course, prepend=np.nan)
    return np.asarray(speed[:, None] * np.column_stack([np.cos(following), np.sin(following)]))


def _any_course(velocities: Array) -> Array:
    """Return the posterior mean of the velocities, whose mean is zero before the first dive."""
    return np.asarray(np.cumsum(velocities, axis=0) / (2.0 + np.arange(len(velocities)))[:, None])


_PATTERNS = (
    _Pattern(0.85, _SIZES, _PRIOR_FRACTION, 1, _like_dive_before(1)),
    _Pattern(0.04, _SIZES, _PRIOR_FRACTION, 2, _like_dive_before(2)),
    _Pattern(0.02, _SIZES, _PRIOR_FRACTION, 3, _like_dive_before(3)),
    _Pattern(0.02, _SIZES, _PRIOR_FRACTION, 4, _like_dive_before(4)),
    _Pattern(0.04, _SIZES, _PRIOR_FRACTION, 1, _another_turn),
    _Pattern(0.03, (1.0,), 1.0, None, _any_course),
)

_RECENT = _COMPARED + 5
"""Number of the latest dives that are used: each of those compared has the four before it."""


class _Expectation(NamedTuple):
    """Log of a pattern's posterior probability (not normalised), with its mean (2,) and covariance (2, 2)."""

    log_weight: float
    mean: Array
    covariance: Array


def expected_displacement(displacements: Array, currents: Array, durations: Array) -> tuple[Array, Array]:
    """Return the displacement expected of the next dive, and the covariance of its error.

    Parameters
    ----------
    displacements : (n, 2) array
        Displacements through the water, north and east, m, in order of time.
    currents : (n, 2) array
        Depth-averaged currents, north and east, m/s.
    durations : (n,) array
        Durations of the dives, s.

    Returns
    -------
    mean, covariance : (2,), (2, 2) arrays
        Mean (m) and covariance (m2) over the patterns, including the differences between their predictions.
    """
    recent = (values[-_RECENT:] for values in (displacements, currents, durations))
    found = list(_expectations(*recent))
    log_weights = np.array([each.log_weight for each in found])
    weights = np.exp(log_weights - log_weights.max())
    weights /= weights.sum()
    means = np.array([each.mean for each in found])
    mean = weights @ means
    away = means - mean
    covariances = np.array([each.covariance for each in found])
    return mean, np.tensordot(weights, covariances, 1) + away.T @ (weights[:, None] * away)


def _expectations(displacements: Array, currents: Array, durations: Array) -> Iterator[_Expectation]:
    """Yield the expectation of each pattern that the dives are enough for."""
    velocities = displacements / durations[:, None]
    speed = max(float(np.sqrt(np.mean(np.sum(velocities[-_COMPARED:] ** 2, axis=1)))), _SLOWEST)
    length = max(float(np.hypot(*displacements[-1])), _SLOWEST * float(durations[-1]))
    for pattern in _PATTERNS:
        expected = pattern.follow(velocities)
        if pattern.back is not None:
            expected = expected + _corrections(velocities, expected, currents, pattern.back, speed)
        errors = np.hypot(*(velocities[1:] - expected[:-1])[-_COMPARED:].T) / speed
        known = np.isfinite(errors)
        # The scatter of a pattern that has not predicted any dive yet is not known, unless it needs one dive only.
        if known.any() or np.isfinite(expected[0, 0]):
            following = expected * durations[:, None]
            differences = (displacements[1:] - following[:-1])[-_COMPARED:][known]
            yield _Expectation(
                math.log(pattern.probability) + _log_density(errors, pattern.sizes),
                following[-1],
                _scatter(differences, _PRIOR_DIFFERENCES * (pattern.fraction * length) ** 2),
            )


def _corrections(velocities: Array, expected: Array, currents: Array, back: int, speed: float) -> Array:
    """Return the corrections (n, 2) of expected velocities for the current's change over `back` dives; zero if unknown.

    The gain is that with which the flown velocities differed from the expected ones.
    """
    complete = np.full_like(currents, np.nan)
    complete[back:] = currents[:-back] - currents[back:]
    return _gain(velocities[1:] - expected[:-1], complete[:-1], speed) * np.nan_to_num(complete)


def _gain(changes: Array, corrections: Array, speed: float) -> float:
    """Return the gain, between 0 and 1, with which the changes of velocity follow complete corrections."""
    known = np.isfinite(changes[:, 0]) & np.isfinite(corrections[:, 0])
    changes, corrections = changes[known][-_COMPARED:], corrections[known][-_COMPARED:]
    squares = np.sum(changes**2) + _PRIOR_DIFFERENCES * (_PRIOR_FRACTION * speed) ** 2
    precision = np.sum(corrections**2) + squares / (2 * (len(changes) + _PRIOR_DIFFERENCES)) / _GAIN**2
    return float(np.clip(np.sum(changes * corrections) / precision, 0.0, 1.0))


def _log_density(errors: Array, sizes: tuple[float, ...]) -> float:
    """Return the log density of a pattern's errors, whose size is one of several.

    Parameters
    ----------
    errors : (n,) array
        Sizes of the errors of velocity, north and east, relative to the speed; NaN where there is no prediction, as in
        a dive that departs from the pattern.
    sizes : tuple of float
        Equally probable root mean squares of the errors.

    Notes
    -----
    With size s, a dive follows the pattern with the density ``exp(-(e / s)^2) / (pi s^2)``. A dive on any course has
    the mean logarithm of this density with size one, ``-1 - log(pi)``.
    """
    square = np.array(sizes)[:, None] ** 2
    follows = np.exp(-(errors**2) / square) / (math.pi * square)
    departs = math.exp(-1.0) / math.pi
    density = np.where(np.isfinite(errors), (1.0 - _DEPARTURE) * follows + _DEPARTURE * departs, departs)
    return float(np.logaddexp.reduce(np.sum(np.log(density), axis=1)) - math.log(len(sizes)))


def _scatter(differences: Array, prior_squares: float) -> Array:
    """Return the mean square (2, 2) of differences, and of the prior ones, which may have any direction."""
    total = differences.T @ differences + 0.5 * prior_squares * np.eye(2)
    return np.asarray(total / (len(differences) + _PRIOR_DIFFERENCES))


def planned_scatter(displacements: Array, planned: Array) -> Array:
    """Return the covariance (2, 2) of the next displacement about one whose heading is planned (m2).

    Along the heading it is the mean square of the latest changes of the displacements' lengths, across it that of a
    prior change: sideslip, and errors of compass and steering.

    Parameters
    ----------
    displacements : (n, 2) array
        Displacements through the water so far, north and east, m.
    planned : (2,) array
        Planned displacement, m; not zero.
    """
    changes = np.diff(np.hypot(*displacements.T))[-_COMPARED:]
    prior = (_PRIOR_FRACTION * float(np.hypot(*planned))) ** 2
    along = (float(changes @ changes) + _PRIOR_DIFFERENCES * prior) / (len(changes) + _PRIOR_DIFFERENCES)
    direction = planned / np.hypot(*planned)
    return np.asarray(prior * np.eye(2) + (along - prior) * np.outer(direction, direction))
