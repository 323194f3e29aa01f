r"""Displacement through the water expected of the next dive, from those of the dives so far.

A glider that corrects its heading for the current, as most do, changes its displacement against the change of the
current that it has just measured. With the displacement :math:`d_n` of dive n, which lasts :math:`T_n`, and its
depth-averaged current :math:`u_n`, the next dive is expected to have

.. math:: d_{n+1} = d_n - k \, T_n (u_n - u_{n-1}),

where the gain k is estimated from the dives so far: 0 for a constant heading, 1 for a constant course over ground.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_COMPARED = 20
"""Maximum number of the latest changes from dive to dive that are used."""

_PRIOR_DIFFERENCES, _PRIOR_FRACTION = 3, 0.1
"""Number of prior changes assumed in addition, and their size as a fraction of the displacement."""

_UNEXPECTED = 1.5
"""Mean square of the prior changes relative to that of the changes so far, where these are larger than a prior one: a
few changes of heading say little about the size and direction of the next one."""

_GAIN = 0.5
"""Prior standard deviation of the gain about zero."""


def expected_displacements(displacements: Array, currents: Array, durations: Array) -> Array:
    """Return for each dive the displacement expected of the one after it.

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
    (n, 2) array
        Row n is the displacement expected of dive n + 1, m.
    """
    corrections = np.zeros_like(displacements)
    corrections[1:] = -durations[1:, None] * np.diff(currents, axis=0)
    return displacements + _gain(np.diff(displacements, axis=0)[1:], corrections[1:-1], displacements) * corrections


def _gain(changes: Array, corrections: Array, displacements: Array) -> float:
    """Return the gain, between 0 and 1, with which the changes of displacement follow complete corrections."""
    changes, corrections = changes[-_COMPARED:], corrections[-_COMPARED:]
    squares = np.sum(changes**2) + _prior_squares(displacements)
    variance = squares / (2 * (len(changes) + _PRIOR_DIFFERENCES))
    precision = np.sum(corrections**2) + variance / _GAIN**2
    return float(np.clip(np.sum(changes * corrections) / precision, 0.0, 1.0)) if precision > 0.0 else 0.0


def displacement_scatter(displacements: Array, expected: Array) -> Array:
    """Return the mean square (2, 2) of the latest differences from the expected displacements (m2).

    Parameters
    ----------
    displacements, expected : (n, 2) arrays
        Displacements through the water, and those that `expected_displacements` returns, m.

    Notes
    -----
    The prior changes are equally probable in all directions. They are as large as usual, or half as large again as
    those so far, whichever is more: of a glider that turns at every dive, the next dive may go anywhere.
    """
    differences = (displacements[1:] - expected[:-1])[-_COMPARED:]
    prior_squares = _prior_squares(displacements)
    if len(differences):
        mean_square = float(np.sum(differences**2)) / len(differences)
        prior_squares = max(prior_squares, _PRIOR_DIFFERENCES * _UNEXPECTED * mean_square)
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


def _prior_squares(displacements: Array) -> float:
    """Return the sum of the squared lengths (m2) of the prior changes."""
    return _PRIOR_DIFFERENCES * _PRIOR_FRACTION**2 * float(displacements[-1] @ displacements[-1])
