"""The turn test: a gain of the speed and an offset of the compass, from currents that are similar between profiles.

When a glider changes course between profiles, an error of its own speed or heading turns with it and a current does not
(Todd, Rudnick, Sherman, Owens & George 2017, J. Atmos. Oceanic Technol. 34, 309-333). In the sum over the mission the
current is modelled as a mean plus a first-order Gauss-Markov departure, in addition to the hull's errors.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from pydantic import Field

from gliderhpc.estimation.settings import Settings
from gliderhpc.mission_hull.gaussian_chain import Array, Gaussian, Information, Transition

UNKNOWNS = 4
"""Mean and departure of the current, north and east each, after the hull's errors."""

_SECONDS_PER_DAY = 86400.0


class TurnTestSettings(Settings):
    """Settings of the turn test: changes of the current from profile to profile."""

    use: bool = Field(False, description="whether currents are used, assumed to be similar from profile to profile")
    deviation: float = Field(
        0.1, gt=0, description="standard deviation of a profile's current about the mission's mean, m/s"
    )
    time: float = Field(1.0, gt=0, description="correlation time of these departures from the mean, days")
    mean: float = Field(0.3, gt=0, description="plausible standard deviation of the mean, m/s")


@dataclass(frozen=True, eq=False)
class ProfileCurrent:
    """Estimated depth-averaged current of a profile.

    Attributes
    ----------
    velocity : (2,)
        Current, north and east, m/s, with the hull about which the profile was smoothed.
    sensitivity : (2, p)
        Derivative of the mean velocity through the water with respect to the hull's errors, m/s per plausible
        deviation; the estimated current changes by the opposite amount.
    covariance : (2, 2)
        Covariance of all errors except the hull's: those of the fixes and of the smoother's displacement, m2/s2.
    """

    velocity: Array
    sensitivity: Array
    covariance: Array

    def information(self, point: Array) -> Information:
        """Information on eta, mean and departure of the current, from a profile smoothed about a point (p,).

        Notes
        -----
        The velocity is ``mean + departure + D (eta - point)`` plus an error. With the errors eta instead of the point,
        the hull moves faster by the last term. The estimated current contains this motion.
        """
        design = np.hstack([self.sensitivity, np.eye(2), np.eye(2)])
        measured = self.velocity + self.sensitivity @ point
        weighed = np.linalg.solve(self.covariance, np.column_stack([design, measured]))
        vector, matrix = design.T @ weighed[:, -1], design.T @ weighed[:, :-1]
        constant = -0.5 * float(measured @ weighed[:, -1]) - 0.5 * float(np.linalg.slogdet(self.covariance)[1])
        return Information(vector, 0.5 * (matrix + matrix.T), constant - float(np.log(2.0 * np.pi)))


def with_current(prior: Gaussian, settings: TurnTestSettings) -> Gaussian:
    """Prior of the hull's errors (p,), extended by the current's unknowns."""
    current = np.repeat([settings.mean**2, settings.deviation**2], 2)
    return Gaussian(
        np.concatenate([prior.mean, np.zeros(UNKNOWNS)]), scipy.linalg.block_diag(prior.covariance, np.diag(current))
    )


def changes_with_current(changes: Sequence[Transition], seconds: Array, settings: TurnTestSettings) -> list[Transition]:
    """Changes between profiles, extended by the current: the mean is constant, the departure decays with time."""
    extended = []
    for change, time in zip(changes, seconds, strict=True):
        # Accurate for short times too, where 1 - decay**2 would suffer from cancellation.
        ratio = time / (settings.time * _SECONDS_PER_DAY)
        added = settings.deviation**2 * -np.expm1(-2.0 * ratio)
        extended.append(
            Transition(
                np.concatenate([change.decay, np.repeat([1.0, np.exp(-ratio)], 2)]),
                np.concatenate([change.variance, np.repeat([0.0, added], 2)]),
            )
        )
    return extended


def extended_information(term: Information) -> Information:
    """Information of a profile's records on the hull, extended by the current's unknowns without any information."""
    return Information(
        np.concatenate([term.vector, np.zeros(UNKNOWNS)]),
        scipy.linalg.block_diag(term.matrix, np.zeros((UNKNOWNS, UNKNOWNS))),
        term.constant,
    )
