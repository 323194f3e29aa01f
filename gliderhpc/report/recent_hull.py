"""Hull over the latest dives, and its changes since the first of them."""

import math
from dataclasses import dataclass

from gliderhpc.archive.profile import done_profiles
from gliderhpc.archive.reader import Archive
from gliderhpc.report.surfacing_message import HullChange
from gliderhpc.studies.hull import (
    HullSettings,
    MissionDives,
    agreeing_dives,
    change_in_units,
    combine_dives,
    read_dives,
)
from gliderhpc.tuning.hull_changes import HullChange as FoundChange
from gliderhpc.tuning.mission_hull import MissionHull

_FIFTH = 0.2

_DIVES = 100
"""Maximum number of dives that are combined; without a limit, the computing time would grow with the mission."""


@dataclass(frozen=True, eq=False)
class RecentHull:
    """Hull from the latest dives up to one.

    Attributes
    ----------
    mission : MissionDives
        The dives and their information.
    found : MissionHull
        Sum of the information.
    changes : dict of int to `gliderhpc.tuning.hull_changes.HullChange` or None
        Change of each parameter that may change, by its position.
    warning : str
        Reason to doubt the values, if the depth rate of the steady glides gives one; otherwise empty.
    """

    mission: MissionDives
    found: MissionHull
    changes: dict[int, FoundChange | None]
    warning: str = ""


def recent_hull(archive: Archive, number: int) -> RecentHull | None:
    """Combine the latest dives up to a profile; None if none of them has information on the hull."""
    mission = read_dives(archive, [each for each in done_profiles(archive) if each <= number][-_DIVES:])
    if not mission.dives:
        return None
    settings = HullSettings()
    mission, check = agreeing_dives(archive, mission, robust=settings.robust)
    return RecentHull(mission, *combine_dives(mission, settings), "" if check is None else check.warning)


def hull_changes(hull: RecentHull) -> tuple[HullChange, ...]:
    """Return the changes shown by the dives; empty if they are too few to show a change."""
    mission, found = hull.mission, hull.found
    changes = []
    for i, change in hull.changes.items():
        if change is None:
            continue
        one, values = mission.parameters[i], change_in_units(mission, found, i, change)
        first = one.moved(mission.platform, float(found.smoothed[0].mean[i]))
        probability, total, std = (values[f"change_{name}"] for name in ("probability", "total", "total_std"))
        changes.append(
            HullChange(
                parameter=one.key,
                meaning=one.meaning,
                unit=one.unit,
                first=first,
                probability=probability,
                change=total,
                change_std=std,
                since=int(values["onset"]),
                dives=len(mission.dives),
                above_20_percent=probability * probability_above(_FIFTH * abs(first), total, std),
            )
        )
    return tuple(changes)


def probability_above(limit: float, mean: float, std: float) -> float:
    """Return the probability that a normally distributed value is larger than a limit."""
    return 0.5 * math.erfc((limit - mean) / std / math.sqrt(2.0))
