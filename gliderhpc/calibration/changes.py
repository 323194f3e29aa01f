"""Changes of the hull among the dives of a calibration, whose result is then a mean of several hulls."""

from dataclasses import dataclass

from gliderhpc.flight.hull_parameters import HullParameter
from gliderhpc.mission_hull.estimate import ProfileTerm
from gliderhpc.mission_hull.joint_change import JointChange
from gliderhpc.mission_hull.single_changes import PROBABLE
from gliderhpc.platform import Platform
from gliderhpc.studies.hull import HullSettings, MissionTerms, combine_terms, joint_in_units
from gliderhpc.surfacing.recent_hull import read_joint_change

MIN_ON_EACH_SIDE = 3
"""Minimum number of dives before and after a step. A few dives in rougher water, at one end, can resemble one."""


@dataclass(frozen=True, eq=False)
class DiveInformation:
    """Information of a calibration's dives on the hull.

    Attributes
    ----------
    platform : Platform
        Hull from which the errors are measured.
    parameters : tuple of HullParameter
        Errors of the hull and the records.
    terms : tuple of ProfileTerm
        The dives' information on them, about the hull found.
    """

    platform: Platform
    parameters: tuple[HullParameter, ...]
    terms: tuple[ProfileTerm, ...]


def describe_change(dives: DiveInformation) -> str:
    """Return a warning if the hull has probably changed among the dives (as in study ``hull``); otherwise ""."""
    terms = tuple(sorted(dives.terms, key=lambda term: term.time))
    mission = MissionTerms(dives.platform, dives.parameters, terms, without=())
    hull, _, joint = combine_terms(mission, HullSettings())
    if joint is None or joint.probability < PROBABLE or _is_at_one_end(joint, len(terms)):
        return ""
    values = zip(dives.parameters, hull.smoothed[0].mean.tolist(), strict=True)
    first = {p.key: p.moved(dives.platform, steps) for p, steps in values}
    found = read_joint_change(joint_in_units(mission, hull, joint), dives.parameters, first, len(terms))
    return (
        f"the hull changed among these dives, {found.course}, with probability {found.probability:.3f}, {found.cause}; "
        "the result is a mean over all of them: calibrate those before and after the change separately (`profiles`)"
    )


def _is_at_one_end(change: JointChange, dives: int) -> bool:
    """Return whether only a few dives at one end differ from the others; a gradual change has no dives before it."""
    _, onset, _ = change.onset
    before = onset if change.step_probability > 0.5 else dives
    return min(before, dives - onset) < MIN_ON_EACH_SIDE
