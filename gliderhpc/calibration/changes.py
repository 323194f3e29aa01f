"""Changes of the hull among the dives of a calibration, whose result is then a mean of several hulls."""

from dataclasses import dataclass

import numpy as np

from gliderhpc.flight.hull_parameters import HullParameter, errors_in_units, stated_covariance, with_covariance
from gliderhpc.mission_hull.gaussian_chain import Array
from gliderhpc.mission_hull.joint_change import JointChange
from gliderhpc.mission_hull.single_changes import PROBABLE
from gliderhpc.platform import Platform
from gliderhpc.studies.hull import HullSettings, MissionTerms, combine_terms
from gliderhpc.surfacing.recent_hull import describe_joint_change

MIN_ON_EACH_SIDE = 3
"""Minimum number of dives before and after a step. A few dives in rougher water, at one end, can resemble one."""


@dataclass(frozen=True, eq=False)
class ChangeAmongDives:
    """Change of the hull among the dives of a calibration.

    Attributes
    ----------
    warning : str
        What has changed, since when, and what to do.
    scatter : (p, p)
        Covariance of the hulls of the dives about their mean, in plausible deviations.
    """

    warning: str
    scatter: Array

    def widened(self, hull: Platform, parameters: tuple[HullParameter, ...]) -> Platform:
        """Return a calibrated hull whose stated errors include the difference of each dive's hull from the mean."""
        covariance = stated_covariance(hull, parameters) + self.scatter
        return with_covariance(hull, errors_in_units(hull, parameters, np.zeros(len(parameters)), covariance))


def find_change(dives: MissionTerms) -> ChangeAmongDives | None:
    """Return the change of the hull among the dives, if there is probably one, as study ``hull`` finds it."""
    hull, _, joint = combine_terms(dives, HullSettings())
    if joint is None or joint.probability < PROBABLE or _is_at_one_end(joint, len(dives.terms)):
        return None
    found = describe_joint_change(dives, hull, joint)
    warning = (
        f"the hull changed among these dives, {found.course}, with probability {found.probability:.3f}, {found.cause}; "
        "or the dives were flown differently (pitch, drive) and the platform file describes the hull less well in one "
        "way than in the other; the result is a mean, and its errors include the change: calibrate the dives before "
        "and after it separately (`profiles`)"
    )
    return ChangeAmongDives(warning, np.cov([dive.mean for dive in hull.smoothed], rowvar=False, bias=True))


def _is_at_one_end(change: JointChange, dives: int) -> bool:
    """Return whether only a few dives at one end differ from the others; a gradual change has no dives before it."""
    _, onset, _ = change.onset
    before = onset if change.step_probability > 0.5 else dives
    return min(before, dives - onset) < MIN_ON_EACH_SIDE
