"""Hull over the latest dives: its changes since the first of them, and its trim in pilots' units."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from gliderhpc.archive.profile import done_profiles
from gliderhpc.archive.reader import Archive
from gliderhpc.findings.formatting import with_deviation
from gliderhpc.flight.hull_parameters import ONLY_IN_MANOEUVRES, HullParameter
from gliderhpc.mission_hull.estimate import MissionHull
from gliderhpc.mission_hull.joint_change import JointChange
from gliderhpc.mission_hull.single_changes import POSSIBLE, PROBABLE, ErrorChange
from gliderhpc.platform import Platform
from gliderhpc.studies.hull import (
    HullSettings,
    MissionTerms,
    agreeing_terms,
    change_in_units,
    combine_terms,
    joint_in_units,
    read_terms,
)
from gliderhpc.surfacing.message import HullChange, JointHullChange, JointPart, Trim

IMPLAUSIBLE = 3.0
"""Distance from the platform file, in plausible deviations, beyond which something other than the hull is wrong."""

UNDETERMINED = 0.9
"""Remaining fraction of the plausible deviation at or above which the dives do not determine a parameter."""

_FIFTH = 0.2

_DIVES = 100
"""Maximum number of dives that are combined; without a limit, the computing time would grow with the mission."""


@dataclass(frozen=True, eq=False)
class RecentHull:
    """Hull from the latest dives up to one.

    Attributes
    ----------
    mission : MissionTerms
        The dives and their information.
    combined : MissionHull
        Sum of the information.
    changes : dict of int to `gliderhpc.mission_hull.single_changes.ErrorChange` or None
        Change of each parameter that may change, by its position.
    warning : str
        Warnings about the values: where the depth rate of the steady glides contradicts them, and where they are too
        far from the platform file; otherwise empty.
    joint : JointChange, optional
        Change of any of these parameters; None with too few dives.
    """

    mission: MissionTerms
    combined: MissionHull
    changes: dict[int, ErrorChange | None]
    warning: str = ""
    joint: JointChange | None = None


def recent_hull(archive: Archive, number: int) -> RecentHull | None:
    """Combine the latest dives up to a profile; None if none of them has information on the hull."""
    mission = read_terms(archive, [done for done in done_profiles(archive) if done <= number][-_DIVES:])
    if not mission.terms:
        return None
    settings = HullSettings()
    mission, check = agreeing_terms(archive, mission, robust=settings.robust)
    combined, changes, joint = combine_terms(mission, settings)
    last = dict(zip((p.key for p in mission.parameters), combined.smoothed[-1].mean.tolist(), strict=True))
    warnings = ("" if check is None else check.warning, implausible_warning(last))
    return RecentHull(mission, combined, changes, "; ".join(filter(None, warnings)), joint)


def implausible_warning(steps: Mapping[str, float]) -> str:
    """Warn of values too far from the platform file to be errors of the hull; empty if there are none.

    Parameters without effect on straight steady glide do not count: they collect the errors of fast motion in records
    that hardly resolve it, and ballast and trim do not depend on them.

    Parameters
    ----------
    steps : mapping of str to float
        Differences from the platform file, in plausible deviations, by parameter.
    """
    far = ", ".join(
        f"{key} by {value:+.1f}"
        for key, value in steps.items()
        if abs(value) > IMPLAUSIBLE and key not in ONLY_IN_MANOEUVRES
    )
    if not far:
        return ""
    return (
        f"too far from the platform file to be values of the hull, in plausible deviations: {far}; something "
        "else has the same effect in every dive, so do not use these values for ballasting or trim; changes during "
        "the mission remain valid"
    )


def hull_changes(hull: RecentHull) -> tuple[HullChange, ...]:
    """Return the changes shown by the dives; empty if they are too few to show a change."""
    mission, combined = hull.mission, hull.combined
    changes = []
    for i, change in hull.changes.items():
        if change is None:
            continue
        parameter, values = mission.parameters[i], change_in_units(mission, combined, i, change)
        first = parameter.moved(mission.platform, float(combined.smoothed[0].mean[i]))
        probability, total, std = (values[f"change_{name}"] for name in ("probability", "total", "total_std"))
        changes.append(
            HullChange(
                parameter=parameter.key,
                meaning=parameter.meaning,
                unit=parameter.unit,
                first=first,
                probability=probability,
                change=total,
                change_std=std,
                since=int(values["onset"]),
                dives=len(mission.terms),
                above_20_percent=probability * probability_above(_FIFTH * abs(first), total, std),
            )
        )
    return tuple(changes)


def joint_change(hull: RecentHull) -> JointHullChange | None:
    """Return the change of any of the parameters that may change; None with too few dives."""
    return None if hull.joint is None else describe_joint_change(hull.mission, hull.combined, hull.joint)


def describe_joint_change(mission: MissionTerms, combined: MissionHull, joint: JointChange) -> JointHullChange:
    """Return the change of any of the parameters with texts, given the dives and their sum."""
    first = {
        p.key: p.moved(mission.platform, float(eta))
        for p, eta in zip(mission.parameters, combined.smoothed[0].mean, strict=True)
    }
    found = joint_in_units(mission, combined, joint)
    return read_joint_change(found, mission.parameters, first, len(mission.terms))


def read_joint_change(
    found: Mapping[str, Any], parameters: Sequence[HullParameter], first: Mapping[str, float], dives: int
) -> JointHullChange:
    """Return the change of any parameter with texts, from attribute `gliderhpc.studies.hull.JOINT`.

    Parameters
    ----------
    found : mapping
        The attribute.
    parameters : sequence of HullParameter
        Parameters of the hull.
    first : mapping of str to float
        Their values at the first dive, by key.
    dives : int
        Number of dives used.
    """
    by_key = {p.key: p for p in parameters}
    parts = tuple(
        JointPart(
            parameter=part["parameter"],
            meaning=by_key[part["parameter"]].meaning,
            included=part["included"],
            size=size_text(by_key[part["parameter"]], first[part["parameter"]], part["change"], part["change_std"])
            if "change" in part
            else "",
        )
        for part in found["parts"]
    )
    return JointHullChange(
        probability=found["probability"],
        since=found["onset"],
        since_low=found["onset_low"],
        since_high=found["onset_high"],
        step_probability=found["step_probability"],
        combination_probability=found["combination_probability"],
        parts=parts,
        dives=dives,
    )


def size_text(p: HullParameter, first: float, total: float, std: float) -> str:
    """Return a change with its standard deviation, of a factor in per cent of its first value, else in its unit."""
    if p.factor:
        return f"{100.0 * total / first:+.1f} % (± {100.0 * std / abs(first):.1f} %)"
    return f"{with_deviation(total, std)} {p.unit}"


MUST_BE_CONFIRMED = "only the last dive shows it, which is often an effect of the water; the next dive must confirm it"
"""Remark on a change that begins with the last dive."""


def joint_sentence(joint: JointHullChange, *, named: bool, last: int) -> str:
    """Return a sentence on the change of any parameter.

    Parameters
    ----------
    joint : JointHullChange
        The change.
    named : bool
        Whether the parameters that have changed are found one by one, so that the combination need not be named.
    last : int
        Number of the last dive.
    """
    subject, probability = "hull as a whole", f"(probability {joint.probability:.3f})"
    if joint.probability < POSSIBLE:
        return f"{subject}: no change detected (probability {joint.probability:.2f})"
    if named:
        return f"{subject}: changed {joint.course} {probability}, as found for single parameters"
    possibly = "" if joint.probability >= PROBABLE else " possibly"
    line = f"{subject}: something has{possibly} changed {joint.course} {probability}; {joint.cause}"
    if joint.is_shown_only_by(last):
        return f"{line}; {MUST_BE_CONFIRMED}"
    return line if possibly else f"{line}; calibrate the dives before and after separately"


def probability_above(limit: float, mean: float, std: float) -> float:
    """Return the probability that a normally distributed value is larger than a limit; a certain value's is 0 or 1."""
    return float(mean > limit) if std == 0.0 else 0.5 * math.erfc((limit - mean) / std / math.sqrt(2.0))


@dataclass(frozen=True)
class PilotUnit:
    """A quantity that a pilot can change or correct: one number of the platform file in another unit.

    Attributes
    ----------
    parameter : str
        Key in the platform file.
    quantity, unit : str
        Name of the quantity, and its unit.
    scale : float
        Factor from the unit of the platform file; negative for ballast, as a hull of larger neutral volume is heavier.
    remark : str
        Condition under which the quantity applies; empty if there is none.
    """

    parameter: str
    quantity: str
    unit: str
    scale: float
    remark: str = ""


def pilot_units(platform: Platform) -> tuple[PilotUnit, ...]:
    """Return the quantities of a hull that a pilot can change or correct."""
    density, difference = platform.buoyancy.water_density, "last dive minus platform file"
    condition = f"in water of {density:g} kg/m3, to float as the platform file states"
    return (
        PilotUnit("buoyancy.neutral_volume", f"neutral oil volume, {difference}", "cm3", 1.0),
        PilotUnit("buoyancy.neutral_volume", "equivalent ballast to add", "g", -1e-3 * density, condition),
        PilotUnit("position.battery", f"battery zero, {difference}", "mm", 1e3),
        PilotUnit("sensors.pitch_offset", f"offset of the pitch, {difference}", "degree", 1.0),
        PilotUnit("sensors.roll_offset", f"offset of the roll, {difference}", "degree", 1.0),
        PilotUnit("sensors.heading_offset", f"offset of the heading, {difference}", "degree", 1.0),
    )


def trim_of(hull: RecentHull) -> Iterator[Trim]:
    """Yield the quantities whose deviation, after a calibration and the dives, is below `UNDETERMINED`."""
    mission, last = hull.mission, hull.combined.smoothed[-1]
    positions = {p.key: i for i, p in enumerate(mission.parameters)}
    for quantity in pilot_units(mission.platform):
        i = positions.get(quantity.parameter)
        if i is None or last.std[i] >= UNDETERMINED:
            continue
        p, steps = mission.parameters[i], float(last.mean[i])
        moved = p.moved(mission.platform, steps) - p.value(mission.platform)
        std = float(last.std[i]) * abs(p.slope(mission.platform, steps))
        yield Trim(
            parameter=p.key,
            quantity=quantity.quantity,
            unit=quantity.unit,
            difference=quantity.scale * moved,
            difference_std=abs(quantity.scale) * std,
            steps=steps,
        )
