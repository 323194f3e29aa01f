"""Errors of the model that all dives of a mission have in common, and the information of a dive that remains.

Rounded angles, actuators that lag in another way than the model's, and noise unlike the prior's change the scores of
all dives in the same direction, and more dives do not average them out. The terms of sway, roll and yaw suffer most:
where the water turns the glider, their score is computed about the path of a filter (`information_path`).
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gliderhpc.flight.hull_parameters import ACTUATOR_LAG, HullParameter
from gliderhpc.tuning.rounds import RoundSettings
from gliderhpc.tuning.segment_errors import LATERAL

Array = NDArray[np.float64]

TURNING_MOTION = (
    *LATERAL,
    "viscous.K_p",
    "viscous.K_delta",
    "added_mass.1",
    "added_inertia.0",
    "added_inertia.2",
    ACTUATOR_LAG,
)
"""Keys of the terms of sway, roll and yaw, and of the actuators' lag."""

_SINGULAR = 1e-12
"""Ratio to the largest eigenvalue below which a combination of the errors has no information."""


def inflation_ratios(parameters: Sequence[HullParameter], dives: int, settings: RoundSettings) -> Array:
    """Ratio ``(p, p)`` of the variance of the summed score to the sum of the stated variances, by pairs of parameters.

    Notes
    -----
    The errors that ``n`` dives share add ``n misfit`` times the stated variance, and ``n turning_misfit`` times more
    among the terms of sway, roll, yaw and the actuators' lag.
    """
    turning = np.isin([parameter.key for parameter in parameters], TURNING_MOTION)
    among = np.outer(turning, turning)
    return np.asarray(1.0 + dives * (settings.misfit + settings.turning_misfit * among))


def with_inflated_variance(score: Array, information: Array, ratios: Array) -> tuple[Array, Array]:
    """Score and information of a dive, reduced by the variance of errors that all dives have in common.

    Parameters
    ----------
    score, information : (p,), (p, p)
        Score ``g`` and information ``I`` of the dive.
    ratios : (p, p)
        Ratios of `inflation_ratios`.

    Notes
    -----
    Let ``V`` be the information times the ratios, entry by entry. A score ``g = I eta + e`` whose error has the
    variance ``V`` gives ``I V^-1 g`` and ``I V^-1 I``. For one ratio ``d`` these are ``g / d`` and ``I / d``.
    """
    gain = information @ np.linalg.pinv(information * ratios, rcond=_SINGULAR, hermitian=True)
    left = gain @ information
    return np.asarray(gain @ score), np.asarray(0.5 * (left + left.T))
