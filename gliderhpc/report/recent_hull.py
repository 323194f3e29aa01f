"""Hull over the latest dives, and its changes since the first of them."""

import math
from dataclasses import dataclass

from gliderhpc.archive.profile import done_profiles
from gliderhpc.archive.reader import Archive
from gliderhpc.studies.hull import (
    HullSettings,
    MissionDives,
    agreeing_dives,
    change_in_units,
    combine_dives,
    read_dives,
)
from gliderhpc.tuning.hull_changes import HullChange
from gliderhpc.tuning.mission_hull import MissionHull

_DIVES = 100
"""Maximum number of dives that are combined; without a limit, the computing time would grow with the mission."""


@dataclass(frozen=True)
class RecentChange:
    """Change of one number of the platform file over the dives so far, in its unit.

    Attributes
    ----------
    parameter, meaning, unit : str
        Key in the platform file, its meaning, and its unit.
    first : float
        Value at the first of the dives.
    probability : float
        Probability that the number has changed since.
    change, change_std : float
        Size of the change, if there was one, and its standard deviation.
    since : int
        Number of the first dive after the change, median.
    dives : int
        Number of dives used.
    """

    parameter: str
    meaning: str
    unit: str
    first: float
    probability: float
    change: float
    change_std: float
    since: int
    dives: int

    def probability_above(self, part: float) -> float:
        """Return the probability that the number grew by more than a fraction of its value at the first dive."""
        beyond = (self.change - part * abs(self.first)) / self.change_std
        return self.probability * 0.5 * math.erfc(-beyond / math.sqrt(2.0))


@dataclass(frozen=True, eq=False)
class RecentHull:
    """Hull from the latest dives up to one.

    Attributes
    ----------
    mission : MissionDives
        The dives and their information.
    found : MissionHull
        Sum of the information.
    changes : dict of int to HullChange or None
        Change of each parameter that may change, by its position.
    warning : str
        Reason to doubt the values, if the depth rate of the steady glides gives one; otherwise empty.
    """

    mission: MissionDives
    found: MissionHull
    changes: dict[int, HullChange | None]
    warning: str = ""


def recent_hull(archive: Archive, number: int) -> RecentHull | None:
    """Combine the latest dives up to a profile; None if none of them has information on the hull."""
    mission = read_dives(archive, [each for each in done_profiles(archive) if each <= number][-_DIVES:])
    if not mission.dives:
        return None
    settings = HullSettings()
    mission, check = agreeing_dives(archive, mission, robust=settings.robust)
    return RecentHull(mission, *combine_dives(mission, settings), "" if check is None else check.warning)


def hull_changes(hull: RecentHull) -> tuple[RecentChange, ...]:
    """Return the changes shown by the dives; empty if they are too few to show a change."""
    mission, found = hull.mission, hull.found
    changes = []
    for i, change in hull.changes.items():
        if change is None:
            continue
        one, values = mission.parameters[i], change_in_units(mission, found, i, change)
        first = one.moved(mission.platform, float(found.smoothed[0].mean[i]))
        changes.append(
            RecentChange(
                one.key,
                one.meaning,
                one.unit,
                first,
                values["change_probability"],
                values["change_total"],
                values["change_total_std"],
                int(values["onset"]),
                len(mission.dives),
            )
        )
    return tuple(changes)
