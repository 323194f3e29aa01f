"""Rounds by which a mission's profiles determine its hull: settings, and errors of the model common to all profiles.

Rounded angles, actuators that do not lag as in the model, and noise unlike the prior's change the scores of all
profiles in the same direction, and more profiles do not average them out. The terms of sway, roll and yaw suffer most:
where the water turns the glider, their score is computed about the path of a filter (`information_path`).
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from gliderhpc.estimation.priors import SLOW_SENSORS_PRIOR
from gliderhpc.estimation.settings import Settings
from gliderhpc.flight.hull_parameters import ACTUATOR_LAG, HullParameter
from gliderhpc.platform import Platform
from gliderhpc.tuning.segment_errors import LATERAL

Array = NDArray[np.float64]

USUAL_ROUNDS = 8
"""Maximum number of rounds for hulls with fast sensors, if the setting does not give one."""


class RoundSettings(Settings):
    """Settings of the rounds over the profiles, which start from the trim in steady glides."""

    most: int | None = Field(
        None,
        ge=0,
        description="largest number of rounds; 0: only the fit of the steady glides; unset: 8 for hulls with a sample "
        "interval of at most 2 s, else 0",
    )
    tolerance: float = Field(
        0.1, gt=0, description="the rounds end at a largest move smaller than this, in plausible deviations"
    )
    misfit: float = Field(
        1.0,
        ge=0,
        description="variance of the errors common to all profiles, relative to the variance stated by one profile",
    )
    turning_misfit: float = Field(
        6.0,
        ge=0,
        description="the same, in addition, for the terms of sway, roll and yaw and the lag of the actuators",
    )
    step: float = Field(0.25, ge=1e-3, le=0.25, description="integration step of the rounds, s")
    robust: bool = Field(
        True, description="whether scatter between the profiles reduces their weight, and that of outliers further"
    )

    def largest_number(self, platform: Platform) -> int:
        """Largest number of rounds for a hull.

        By default slow records have none: on real missions of such gliders, rounds led to worse currents than the fit
        of the steady glides (docs/calibration.md).
        """
        if self.most is not None:
            return self.most
        return USUAL_ROUNDS if platform.sensors.sample_interval <= SLOW_SENSORS_PRIOR else 0


# Errors of the model that all profiles have in common

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
