"""GPS fixes from the importers and in an observation file, and displacements on the WGS84 ellipsoid.

The first position after a surfacing can be in error by kilometres, so importers leave out a fix that no drift connects
with its neighbours. The reader of an observation file leaves out a fix where no glider can have been:

- at 0 N, 0 E, which receivers report before they have a position;
- at exactly the position of an earlier surfacing, which is that position reported again (of two such fixes around one
  dive neither is used);
- at a place that would require a speed over ground that no glider reaches in any current.

If two fixes contradict each other, the one that contradicts its other neighbours is left out. If the neighbours do
not decide, both are left out. Fixes of several surfacings stay even where they contradict those before, because a
glider may have been carried to another place. If nothing can have carried it there in the time, only those stay that
are clearly in the majority.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Self

import numpy as np
import numpy.typing as npt
from geographiclib.geodesic import Geodesic

from gliderhpc.observations.dive_phases import describe_surfacing
from gliderhpc.observations.records import Fix, FloatArray, TimeArray
from gliderhpc.observations.regions import wrapped_longitude
from gliderhpc.observations.times import SECOND, plausible_times

Position = tuple[float, float]
"""Latitude and longitude, degree."""


def moved(position: Position, displacement: FloatArray) -> Position:
    """Return the position moved along a WGS84 geodesic by a displacement ``[north, east]`` (m)."""
    north, east = displacement.tolist()
    end = Geodesic.WGS84.Direct(*position, math.degrees(math.atan2(east, north)), math.hypot(north, east))
    return float(end["lat2"]), float(end["lon2"])


def midpoint(first: Position, last: Position) -> Position:
    """Return the midpoint of the WGS84 geodesic between two positions."""
    line = Geodesic.WGS84.InverseLine(*first, *last)
    middle = line.Position(0.5 * line.s13)
    return float(middle["lat2"]), float(middle["lon2"])


MAXIMUM_DRIFT = 3.0
"""Maximum drift of a glider at the surface (m/s): boundary currents reach 2.5 m/s there."""

POSITION_ERROR = 20.0
"""Maximum distance (m) between two fixes of the same place."""

SAME_SURFACING = np.timedelta64(900, "s")
"""Maximum time between two fixes of one surfacing; fixes further apart in time are not compared."""

_METRES_A_DEGREE = 111_195.0


@dataclass(frozen=True, eq=False)
class Fixes:
    """GPS fixes at the surface.

    Attributes
    ----------
    time : (m,) array
        Times of the fixes (UTC), strictly increasing.
    latitude, longitude : (m,) arrays
        Positions in degrees.
    outliers : int
        Number of fixes left out, because no drift connects them with their neighbours.
    """

    time: TimeArray
    latitude: FloatArray
    longitude: FloatArray
    outliers: int = 0

    @classmethod
    def none(cls) -> Self:
        """Return the empty set of fixes of a record without any."""
        return cls(np.zeros(0, "datetime64[ns]"), np.zeros(0), np.zeros(0))

    def where(self, keep: npt.NDArray[np.bool_]) -> "Fixes":
        """Return the fixes selected by a mask."""
        return Fixes(self.time[keep], self.latitude[keep], self.longitude[keep], self.outliers)


def merge_fixes(parts: Sequence[Fixes]) -> Fixes:
    """Put the fixes of several records in time order, without repetitions and outliers.

    The last fix in the record of one dive is usually the first in the record of the next.
    """
    time, place = np.unique(np.concatenate([part.time for part in parts]), return_index=True)
    latitude = np.concatenate([part.latitude for part in parts])[place]
    longitude = np.concatenate([part.longitude for part in parts])[place]
    return drop_outliers(Fixes(time, latitude, longitude))


def drop_outliers(fixes: Fixes) -> Fixes:
    """Leave out the fixes from which none of the two neighbours on either side can be reached."""
    keep = np.array([_is_plausible(fixes, index) for index in range(len(fixes.time))], dtype=bool)
    outliers = int(np.count_nonzero(~keep))
    return Fixes(fixes.time[keep], fixes.latitude[keep], fixes.longitude[keep], outliers)


def _is_plausible(fixes: Fixes, index: int) -> bool:
    others = np.array([i for i in range(index - 2, index + 3) if i != index and 0 <= i < len(fixes.time)], dtype=int)
    apart = np.abs(fixes.time[others] - fixes.time[index])
    others, apart = others[apart <= SAME_SURFACING], apart[apart <= SAME_SURFACING]
    if len(others) == 0:
        return True
    north = fixes.latitude[others] - fixes.latitude[index]
    east = _east(fixes.longitude[others] - fixes.longitude[index], fixes.latitude[index])
    reach = MAXIMUM_DRIFT * (apart / SECOND) + POSITION_ERROR
    return bool(np.any(_METRES_A_DEGREE * np.hypot(north, east) <= reach))


def decimal_degrees(value: FloatArray) -> FloatArray:
    """Decimal degrees from signed degrees and minutes written as DDMM.mmm."""
    degrees = np.trunc(value / 100.0)
    return degrees + (value - 100.0 * degrees) / 60.0


MAX_GROUND_SPEED = 4.0
"""Maximum speed over ground from fix to fix (m/s): 1 m/s through the water, which gliders reach with a thruster, plus
3 m/s of current. Western boundary currents reach 2.5 m/s at the surface, and less on average over the depth of a
dive."""

POSITION_ALLOWANCE = 100.0
"""Distance (m) between two fixes that is allowed even in no time: errors of the receiver, and times rounded to the
minute."""

DIVED, MAX_SURFACED_DEPTH = 10.0, 15.0
"""Depth (m), relative to that at a surfacing, beyond which a glider has dived before or after it; and measured depth of
a surfacing, with the offset of an absolute pressure."""

STALE_AFTER = np.timedelta64(1800, "s")
"""Time after which an exactly repeated position is taken as an old one reported again: at sea nothing stays in place to
a metre. Of such a run of fixes, only those of the first surfacing are used."""

_MAX_CHAIN = 400
"""Maximum number of runs of fixes that are checked together; longer sequences are checked piece by piece."""

MAX_CARRIED_SPEED, CARRIED_ALLOWANCE = 300.0, 50_000.0
"""Maximum speed (m/s) at which a glider is carried, by air, from one place to another between two fixes, and distance
(m) allowed in addition: receivers hold old positions, and clocks are off by minutes."""

CLEAR_MAJORITY = 2
"""Minimum ratio of the fixes that stay to those that contradict them, where nothing can have carried the glider."""

_PROVEN_WEIGHT = 10**9
"""Weight of a run over more than one surfacing; it exceeds the weight of all fixes of the other runs together."""


@dataclass(frozen=True, eq=False)
class SurfaceFixes:
    """Fixes of a file in time order: the usable ones, and those that were left out.

    Attributes
    ----------
    time, latitude, longitude : (m,) arrays
        Times (UTC, ns) and positions (degrees) of the usable fixes.
    left_out : (k,) array
        Times of the omitted fixes that have a plausible time and position.
    reasons : tuple of str
        Reason for the omission of each of these.
    """

    time: TimeArray
    latitude: FloatArray
    longitude: FloatArray
    left_out: TimeArray
    reasons: tuple[str, ...]

    @classmethod
    def none(cls) -> Self:
        """Return the empty set of fixes of a file without any."""
        time = np.zeros(0, dtype="datetime64[ns]")
        return cls(time, np.zeros(0), np.zeros(0), time, ())

    def between(self, first: np.datetime64, last: np.datetime64) -> tuple[Fix, ...]:
        """Return the usable fixes from one time to another, inclusive."""
        start, stop = self._places(self.time, first, last)
        return tuple(Fix(self.time[i], float(self.latitude[i]), float(self.longitude[i])) for i in range(start, stop))

    def reasons_between(self, first: np.datetime64, last: np.datetime64) -> tuple[str, ...]:
        """Return the reasons why fixes from one time to another, inclusive, were left out."""
        start, stop = self._places(self.left_out, first, last)
        return self.reasons[start:stop]

    def notes_inside(self, first: np.datetime64, last: np.datetime64) -> list[str]:
        """Describe usable fixes between the first and the last sample of a profile; empty if there are none."""
        inside = [fix for fix in self.between(first, last) if first < fix.time < last]
        if not inside:
            return []
        return [f"GPS fix at {_clock(inside[0].time)} within the profile: a profile must end at the surface"]

    def notes_between_dives(self, time: TimeArray, depth: FloatArray) -> list[str]:
        """Describe usable fixes at a surfacing between two dives of one profile; empty if there are none.

        Parameters
        ----------
        time, depth : (n,) arrays
            Times and depths (m) of the profile's samples, NaN where missing.
        """
        known = np.isfinite(depth)
        time, depth = time[known], depth[known]
        for fix in self.between(time[0], time[-1]) if len(time) else ():
            place = int(np.searchsorted(time, fix.time))
            here = float(depth[max(place - 1, 0) : place + 1].min())
            deepest = (depth[:place].max(initial=here), depth[place:].max(initial=here))
            if here < MAX_SURFACED_DEPTH and min(deepest) - here > DIVED:
                return [
                    f"GPS fix at {_clock(fix.time)} between two dives of the profile: its current is a mean over these "
                    "dives and the surfacing; give every dive a number of its own"
                ]
        return describe_surfacing((time - time[0]) / SECOND, depth) if len(time) else []

    def cut(self, first: np.datetime64, last: np.datetime64) -> "SurfaceFixes":
        """Return the usable and the omitted fixes from one time to another, inclusive."""
        start, stop = self._places(self.time, first, last)
        begin, end = self._places(self.left_out, first, last)
        return SurfaceFixes(
            self.time[start:stop],
            self.latitude[start:stop],
            self.longitude[start:stop],
            self.left_out[begin:end],
            self.reasons[begin:end],
        )

    def without(self, first: np.datetime64, last: np.datetime64, reason: str) -> "SurfaceFixes":
        """Leave out the usable fixes between two times, exclusive, for a reason."""
        doubted = (self.time > first) & (self.time < last)
        left_out = np.concatenate([self.left_out, self.time[doubted]])
        texts = (f"GPS fix of {_clock(time)} left out: {reason}" for time in self.time[doubted])
        reasons = (*self.reasons, *texts)
        order, keep = np.argsort(left_out, kind="stable"), ~doubted
        return SurfaceFixes(
            self.time[keep],
            self.latitude[keep],
            self.longitude[keep],
            left_out[order],
            tuple(reasons[index] for index in order.tolist()),
        )

    @staticmethod
    def _places(time: TimeArray, first: np.datetime64, last: np.datetime64) -> tuple[int, int]:
        return int(np.searchsorted(time, first, "left")), int(np.searchsorted(time, last, "right"))


def screen_fixes(
    time: TimeArray, latitude: FloatArray, longitude: FloatArray, in_range: npt.NDArray[np.bool_]
) -> SurfaceFixes:
    """Separate the credible fixes from the others.

    Parameters
    ----------
    time, latitude, longitude : (m,) arrays
        Times (UTC) and positions (degrees), in any order; NaT and NaN where missing.
    in_range : (m,) array of bool
        Mask of the fixes whose position is present and on the globe; the others are left out without a reason.
    """
    chosen = np.flatnonzero(in_range & plausible_times(time))
    chosen = chosen[np.argsort(time[chosen], kind="stable")]
    time, latitude, longitude = time[chosen], latitude[chosen], longitude[chosen]
    reasons: dict[int, str] = {}
    for find in (_null_positions, _stale_positions, _unreachable):
        keep = np.array([index for index in range(len(time)) if index not in reasons], dtype=np.int64)
        found = find(time[keep], latitude[keep], longitude[keep])
        reasons |= {int(keep[place]): why for place, why in found.items()}
    usable = np.array([index not in reasons for index in range(len(time))], dtype=bool)
    texts = tuple(f"GPS fix of {_clock(time[index])} left out: {reasons[index]}" for index in sorted(reasons))
    return SurfaceFixes(time[usable], latitude[usable], longitude[usable], time[~usable], texts)


AS_MINUTES = (
    "the fixes agree with each other if they are DDMM.mmm, which within a degree of 0 N, 0 E are plausible degrees: "
    "convert them to decimal degrees"
)


def agree_as_minutes(
    time: TimeArray, latitude: FloatArray, longitude: FloatArray, usable: npt.NDArray[np.bool_]
) -> bool:
    """Return whether most fixes, which contradict each other as decimal degrees, agree if they are read as DDMM.mmm."""
    found = screen_fixes(time, decimal_degrees(latitude), decimal_degrees(longitude), usable)
    return bool(usable.any()) and 2 * len(found.time) > int(usable.sum())


def pair_fault(entry: Fix, exit_: Fix) -> str | None:
    """Describe why the fixes before and after a dive cannot both be right; None if they can.

    A position that is the same to the last digit after a dive is an old position reported again.
    """
    if (entry.latitude, entry.longitude) == (exit_.latitude, exit_.longitude):
        repeated = f"GPS fix of {_clock(exit_.time)}: repeats the position of {_clock(entry.time)} to the last digit"
        return f"{repeated}, although a profile lies between them: neither is used"
    time = np.array([entry.time, exit_.time])
    latitude, longitude = np.array([[fix.latitude, fix.longitude] for fix in (entry, exit_)]).T
    distance = _distances(latitude, longitude)
    elapsed = np.diff(time) / SECOND
    if _reachable(distance, elapsed)[0]:
        return None
    speed = _ground_speed(float(distance[0]), float(elapsed[0]))
    return f"{speed} between the fixes before and after the profile: neither is used"


_GRIDS, _MIN_POSITIONS, _ON_GRID = (0.1, 0.01, 0.001), 6, 0.02
"""Grids (degree) to which positions may have been rounded, minimum number of positions that show it, and maximum
distance from the grid, in its intervals; float32 resolves 0.015 of the finest."""


def rounding_error(latitude: FloatArray, longitude: FloatArray) -> tuple[float, str]:
    """Standard deviation (m) of positions that were rounded to a coarse grid, and a remark; zero and empty otherwise.

    Parameters
    ----------
    latitude, longitude : (m,) arrays
        Positions, degree.
    """
    if len(latitude) < _MIN_POSITIONS or len(np.unique(latitude)) + len(np.unique(longitude)) < 4:
        return 0.0, ""
    for grid in _GRIDS:
        steps = np.concatenate([latitude, longitude]) / grid
        if np.all(np.abs(steps - np.rint(steps)) < _ON_GRID):
            error = grid * _METRES_A_DEGREE / math.sqrt(12.0)
            return error, f"all GPS positions are rounded to {grid:g} degree, so their error is {error:.0f} m or more"
    return 0.0, ""


_MAX_REASONS = 2
"""Maximum number of reasons for omitted fixes that a profile's notes list one by one."""


def describe_fixes(
    before: Sequence[Fix], after: Sequence[Fix], reasons: Sequence[str], limit: np.timedelta64
) -> tuple[str, ...]:
    """Describe why fixes around a profile were left out, and the sides on which none remains within a time limit."""
    more = len(reasons) - _MAX_REASONS
    texts = [*reasons[:_MAX_REASONS], *([f"{more} more fixes left out"] if more > 0 else [])]
    missing = [side for side, fixes in (("before", before), ("after", after)) if not fixes]
    within = f"within {limit / np.timedelta64(1, 'm'):.0f} minutes"
    return (*texts, *([f"no GPS fix {' or '.join(missing)} the profile {within}"] if missing else []))


def _null_positions(time: TimeArray, latitude: FloatArray, longitude: FloatArray) -> dict[int, str]:
    null = np.flatnonzero((latitude == 0.0) & (longitude == 0.0))
    return dict.fromkeys(null.tolist(), "0 N, 0 E, which a receiver reports if it has no position")


def _stale_positions(time: TimeArray, latitude: FloatArray, longitude: FloatArray) -> dict[int, str]:
    """Find fixes that repeat the position of an earlier surfacing to the last digit."""
    if not len(time):
        return {}
    changed = (np.diff(latitude) != 0.0) | (np.diff(longitude) != 0.0)
    run = np.concatenate(([0], np.cumsum(changed)))
    starts = np.flatnonzero(np.concatenate(([True], changed)))
    first, last = starts[run], np.append(starts[1:], len(time))[run] - 1
    stale = np.flatnonzero((time[last] - time[first] > STALE_AFTER) & (time - time[first] > SAME_SURFACING))
    return {int(index): f"it repeats the position of {_clock(time[first[index]])} to the last digit" for index in stale}


def _unreachable(time: TimeArray, latitude: FloatArray, longitude: FloatArray) -> dict[int, str]:
    """Find fixes that no glider can have reached from their neighbours, or left for them."""
    if len(time) < 2:
        return {}
    distance, elapsed = _distances(latitude, longitude), np.diff(time) / SECOND
    breaks = np.flatnonzero(~_reachable(distance, elapsed))
    if not len(breaks):
        return {}
    edges = [0, *(breaks + 1).tolist(), len(time)]
    runs = [(start, stop) for start, stop in pairwise(edges)]
    reasons: dict[int, str] = {}
    for place in range(0, len(runs), _MAX_CHAIN):
        piece = runs[place : place + _MAX_CHAIN]
        for start, stop in _wrong_runs(piece, time, latitude, longitude):
            near = start - 1 if start > 0 else stop - 1
            speed = _ground_speed(float(distance[near]), float(elapsed[near]))
            other = time[start - 1] if start > 0 else time[stop]
            reasons |= dict.fromkeys(range(start, stop), f"{speed} from or to the fix of {_clock(other)}")
    return reasons


def _wrong_runs(
    runs: Sequence[tuple[int, int]], time: TimeArray, latitude: FloatArray, longitude: FloatArray
) -> list[tuple[int, int]]:
    """Find the runs of fixes to leave out; the remaining fixes are consistent, and as many as possible.

    A run over more than one surfacing is proven and stays. If two proven runs contradict each other, the record is from
    two places, and no pair of fixes across the break is used (`pair_fault`). Of the other runs, those stay that belong
    to every largest set of consistent fixes. Proven runs between which nothing can have carried the glider contradict
    each other, too: some have wrong positions, such as those of another hemisphere. The largest consistent set stays
    if it is `CLEAR_MAJORITY` times the others, else none.
    """
    proven = [bool(time[stop - 1] - time[start] > SAME_SURFACING) for start, stop in runs]
    weights = [_PROVEN_WEIGHT if stays else stop - start for stays, (start, stop) in zip(proven, runs, strict=True)]
    right = _in_every_best_chain(weights, _links(runs, time, latitude, longitude, MAX_GROUND_SPEED))
    stays = [run for run, consistent, sure in zip(runs, right, proven, strict=True) if consistent or sure]
    if not stays:
        return list(runs)
    possible = _links(stays, time, latitude, longitude, MAX_CARRIED_SPEED, CARRIED_ALLOWANCE)
    certain = _in_every_best_chain([stop - start for start, stop in stays], possible)
    remaining = {run for run, each in zip(stays, certain, strict=True) if each}
    count, others = (sum(stop - start for start, stop in part) for part in (remaining, set(stays) - remaining))
    return [run for run in runs if run not in remaining or count < CLEAR_MAJORITY * others]


def _links(
    runs: Sequence[tuple[int, int]],
    time: TimeArray,
    latitude: FloatArray,
    longitude: FloatArray,
    speed: float,
    allowance: float = POSITION_ALLOWANCE,
) -> npt.NDArray[np.bool_]:
    """Mask ``(n, n)``, True where a glider could have come from the last fix of one run to the first of a later one.

    It moves at `speed` at most (m/s), apart from the `allowance` (m).
    """
    last, first = np.array([(stop - 1, start) for start, stop in runs]).T
    elapsed = (time[first][None, :] - time[last][:, None]) / SECOND
    north = latitude[first][None, :] - latitude[last][:, None]
    east = _east(longitude[first][None, :] - longitude[last][:, None], latitude[last][:, None])
    distance = _METRES_A_DEGREE * np.hypot(north, east)
    linked: npt.NDArray[np.bool_] = np.triu(_reachable(distance, elapsed, speed, allowance), 1)
    return linked


def _in_every_best_chain(weights: Sequence[int], linked: npt.NDArray[np.bool_]) -> list[bool]:
    """Mask of the nodes that belong to every chain of linked nodes of greatest weight."""
    forward = _chains(weights, linked)
    backward = _chains(weights[::-1], linked[::-1, ::-1].T)[::-1]
    most = max(total for total, _ in forward)
    count = sum(ways for total, ways in forward if total == most)
    return [
        before[0] + after[0] - weight == most and before[1] * after[1] == count
        for before, after, weight in zip(forward, backward, weights, strict=True)
    ]


def _chains(weights: Sequence[int], linked: npt.NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Greatest weight of a chain that ends in each node, and the number of such chains."""
    chains: list[tuple[int, int]] = []
    for node, weight in enumerate(weights):
        before = [chains[other] for other in np.flatnonzero(linked[:node, node]).tolist()]
        most = max((total for total, _ in before), default=0)
        chains.append((most + weight, sum(ways for total, ways in before if total == most) or 1))
    return chains


def _distances(latitude: FloatArray, longitude: FloatArray) -> FloatArray:
    """Approximate distances between neighbouring positions (m) on a sphere, accurate enough for a check."""
    return _METRES_A_DEGREE * np.hypot(np.diff(latitude), _east(np.diff(longitude), latitude[:-1]))


def _east(difference: FloatArray, latitude: FloatArray) -> FloatArray:
    """Difference in longitude, the short way round, in degrees of a great circle."""
    return np.asarray(wrapped_longitude(difference) * np.cos(np.radians(latitude)))


def _reachable(
    distance: FloatArray, elapsed: FloatArray, speed: float = MAX_GROUND_SPEED, allowance: float = POSITION_ALLOWANCE
) -> npt.NDArray[np.bool_]:
    return np.asarray(distance <= speed * np.abs(elapsed) + allowance)


def _ground_speed(distance: float, elapsed: float) -> str:
    speed = f"{distance / abs(elapsed):.3g} m/s over ground" if elapsed else f"{distance / 1000.0:.3g} km in zero time"
    return f"{speed} (glider and current together reach at most {MAX_GROUND_SPEED:g} m/s)"


def _clock(time: np.datetime64) -> str:
    return str(time.astype("datetime64[s]"))
