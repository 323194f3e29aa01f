"""Errors of the model that all profiles have in common, in the rounds by which whole dives determine the hull.

Rounded angles, actuators that do not lag as in the model, and noise unlike the prior's change the scores of all
profiles in the same direction, and more profiles do not average them out. The terms of sway, roll and yaw suffer most:
where the water turns the glider, their score is computed about the path of a filter (`information_path`).
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gliderhpc.calibration.glides.segment_errors import LATERAL
from gliderhpc.calibration.settings import RoundSettings
from gliderhpc.flight.hull_parameters import ACTUATOR_LAG, HullParameter

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


def inflation_ratios(parameters: Sequence[HullParameter], profiles: int, settings: RoundSettings) -> Array:
    """Ratio ``(p, p)`` of the variance of the summed score to the sum of the stated variances, by pairs of parameters.

    Notes
    -----
    The errors that ``n`` profiles share add ``n misfit`` times the stated variance, and ``n turning_misfit`` times more
    among the terms of sway, roll, yaw and the actuators' lag.
    """
    turning = np.isin([parameter.key for parameter in parameters], TURNING_MOTION)
    both_turning = np.outer(turning, turning)
    return np.asarray(1.0 + profiles * (settings.misfit + settings.turning_misfit * both_turning))


def with_inflated_variance(score: Array, information: Array, ratios: Array) -> tuple[Array, Array]:
    """Score and information of a profile, reduced by the variance of errors that all profiles have in common.

    Parameters
    ----------
    score, information : (p,), (p, p)
        Score ``g`` and information ``I`` of the profile.
    ratios : (p, p)
        Ratios of `inflation_ratios`.

    Notes
    -----
    Let ``V`` be the information times the ratios, entry by entry. A score ``g = I eta + e`` whose error has the
    variance ``V`` gives ``I V^-1 g`` and ``I V^-1 I``. For one ratio ``d`` these are ``g / d`` and ``I / d``.
    """
    gain = information @ np.linalg.pinv(information * ratios, rcond=_SINGULAR, hermitian=True)
    reduced = gain @ information
    return np.asarray(gain @ score), np.asarray(0.5 * (reduced + reduced.T))
