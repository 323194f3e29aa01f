"""Records from which a depth-averaged current is computed: time, depth, pitch, heading and positions at the surface.

Files of any source (the observation format, OG1, pyglider, data centres) are read by the names and standard names of
their variables. Neither ballast nor battery is needed.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr

from gliderhpc.errors import InputError
from gliderhpc.observations.dataset import open_stored
from gliderhpc.observations.dive_phases import dive_notes
from gliderhpc.observations.fixes import SurfaceFixes, pair_fault, screen_fixes
from gliderhpc.observations.format import VELOCITY
from gliderhpc.observations.navigation_columns import NavigationColumns
from gliderhpc.observations.profiles import IntArray, detect_profiles
from gliderhpc.observations.records import Fix, FloatArray, ProfileRecord, TimeArray
from gliderhpc.observations.times import plausible_times

RECEIVER_ERROR = 5.0
"""Standard deviation of a GPS fix in each of north and east (m)."""

POSITION_ERROR = 50.0
"""Standard deviation, in each of north and east, of a surface position in a file without GPS variables (m)."""

SURFACE = 2.0
"""Positions above this depth (m) are taken as positions at the surface."""

RECORD_BREAK = 86_400.0
"""Longest pause of the record within a profile (s); a longer one ends the profile."""

MIN_SAMPLES = 10
"""Least number of samples with depth, pitch and heading in a usable profile."""

_SECOND = np.timedelta64(1, "s")
_RADIANS = 1.6
"""Pitch of a diving glider that never exceeds this magnitude is in radians, even if its declared unit is degrees."""


@dataclass(frozen=True, eq=False)
class Navigation:
    """Records of a mission that are needed for a current, sorted by time.

    Attributes
    ----------
    source : str
        Name of the file in messages.
    vehicle : str
        Text of the file's attributes that describe the glider, in lower case.
    time : (n,) array
        Times of the samples (UTC, ns).
    depth, pitch, heading, roll : (n,) arrays
        Depth (m) and attitude (rad), NaN where missing.
    profile : (n,) int array
        Number of the profile, 0 outside any.
    fixes : SurfaceFixes
        Positions at the surface.
    fix_error : float
        Their standard deviation in each of north and east (m).
    remarks : tuple of str
        Remarks for the user on the reading of the file.
    velocity : (n, 3) array or None
        Measured velocity relative to the water in the body frame (m/s), NaN where missing; None without it.
    """

    source: str
    vehicle: str
    time: TimeArray
    depth: FloatArray
    pitch: FloatArray
    heading: FloatArray
    roll: FloatArray
    profile: IntArray
    fixes: SurfaceFixes
    fix_error: float
    remarks: tuple[str, ...]
    velocity: FloatArray | None = None

    @property
    def numbers(self) -> list[int]:
        """Numbers of the profiles, in time order."""
        found, first = np.unique(self.profile[self.profile > 0], return_index=True)
        return [int(number) for number in found[np.argsort(first, kind="stable")]]

    def record(self, number: int) -> ProfileRecord:
        """Return one profile's record; the unknown controls of the glider are set to zero."""
        rows = np.flatnonzero(self.profile == number)
        span = slice(int(rows[0]), int(rows[-1]) + 1)
        time = self.time[span]
        still = np.zeros(len(time))
        seconds = (time - time[0]) / _SECOND
        before, after, notes = self._fixes(span)
        return ProfileRecord(
            number=number, epoch=time[0], time=seconds,
            roll=np.nan_to_num(self.roll[span]), pitch=self.pitch[span], heading=self.heading[span],
            depth=self.depth[span], battery_position=still, battery_rotation=still, ballast_volume=still, rudder=still,
            entry_fix=before[-1] if before else None, exit_fix=after[0] if after else None,
            surface_fixes_before=before, surface_fixes_after=after,
            notes=(*notes, *dive_notes(seconds, self.depth[span], self.pitch[span])),
            velocity=None if self.velocity is None else self.velocity[span],
        )  # fmt: skip

    def _fixes(self, span: slice) -> tuple[tuple[Fix, ...], tuple[Fix, ...], tuple[str, ...]]:
        """Fixes of the surface intervals before and after a profile."""
        others = np.flatnonzero(self.profile > 0)
        earlier, later = others[others < span.start], others[others >= span.stop]
        begin = self.time[earlier[-1]] if len(earlier) else self.time[0] - np.timedelta64(1, "D")
        end = self.time[later[0]] if len(later) else self.time[-1] + np.timedelta64(1, "D")
        first, last = self.time[span.start], self.time[span.stop - 1]
        before, after = self.fixes.between(begin, first), self.fixes.between(last, end)
        fault = pair_fault(before[-1], after[0]) if before and after else None
        if fault is not None:
            return (), (), (fault,)
        missing = [side for side, found in (("before", before), ("after", after)) if not found]
        return before, after, (f"no GPS fix {' or '.join(missing)} the profile",) if missing else ()


def open_navigation(path: Path) -> Navigation:
    """Read the navigation of a netCDF file or Zarr folder.

    Raises
    ------
    InputError
        The file cannot be read, or lacks a quantity needed for a current; the message names it.
    """
    with open_stored(path) as dataset:
        return read_navigation(dataset, str(path))


def read_navigation(dataset: xr.Dataset, source: str = "dataset") -> Navigation:
    """Read the navigation of a Dataset, by the names, standard names and units of its variables.

    Parameters
    ----------
    dataset : xarray.Dataset
        Dataset with decoded or undecoded times.
    source : str
        Its name in messages.

    Raises
    ------
    InputError
        The Dataset lacks time, depth or pressure, pitch, heading or positions, has too few samples or no dive, or a
        unit cannot be converted.
    """
    columns = NavigationColumns(dataset, source)
    columns.check_complete()
    time = columns.times(columns.find("time"))
    order = np.argsort(time, kind="stable")
    order = order[plausible_times(time[order])]
    _, first = np.unique(time[order], return_index=True)
    order = order[first]
    if len(order) < MIN_SAMPLES:
        raise InputError(
            f"{source}: {len(order)} samples have a time between 2000 and 2099, which is too few for a current"
        )
    time = time[order]
    fixes, fix_error, remarks = _positions(columns)
    depth = columns.depth(fixes)[order]
    pitch = np.radians(columns.quantity("pitch")[order])
    declination, magnetic = columns.declination()
    remarks += magnetic
    heading = np.radians(columns.quantity("heading")[order] + declination)
    roll = np.radians(columns.quantity("roll")[order]) if columns.find("roll") else np.zeros(len(order))
    _check_plausible(source, pitch, depth)
    if len(order) < dataset.sizes[columns.dimension]:
        remarks.append(
            f"{dataset.sizes[columns.dimension] - len(order)} samples without a valid time, or with the time of "
            "another sample, are left out"
        )
    profile = _profiles(columns, order, time, depth)
    if not profile.any():
        raise InputError(
            f"{source}: no dive below 10 m with enough samples of depth, pitch and heading, so there is no current to "
            "estimate"
        )
    velocity = _velocity(columns, order, remarks)
    return Navigation(
        source, _vehicle(dataset), time, depth, pitch, heading, roll, profile, fixes, fix_error, tuple(remarks),
        velocity,
    )  # fmt: skip


def merge_navigation(parts: Sequence[Navigation]) -> Navigation:
    """Join the navigation of several files of one glider, such as one file per dive.

    Raises
    ------
    InputError
        There are no files.
    """
    if not parts:
        raise InputError("no file to read")
    if len(parts) == 1:
        return parts[0]
    order = np.unique(np.concatenate([part.time for part in parts]), return_index=True)[1]
    time, depth, pitch, heading, roll = (
        np.concatenate([getattr(part, name) for part in parts])[order]
        for name in ("time", "depth", "pitch", "heading", "roll")
    )
    at, latitude, longitude = (
        np.concatenate([getattr(part.fixes, name) for part in parts]) for name in ("time", "latitude", "longitude")
    )
    found = detect_profiles(_seconds(time), depth, record_break=RECORD_BREAK)
    return Navigation(
        f"{parts[0].source} and {len(parts) - 1} more", parts[0].vehicle, time, depth, pitch, heading, roll,
        _usable(found, depth, pitch, heading),
        screen_fixes(at, latitude, longitude, np.ones(len(at), dtype=bool)),
        max(part.fix_error for part in parts),
        tuple(dict.fromkeys(remark for part in parts for remark in part.remarks)),
        _joined_velocity(parts, order),
    )  # fmt: skip


def _velocity(columns: NavigationColumns, order: IntArray, remarks: list[str]) -> FloatArray | None:
    """Measured velocity relative to the water ``(n, 3)``, NaN for components that cannot be used; None if none can.

    The reasons are added to the remarks: a current needs no measured velocity.
    """
    found: dict[str, FloatArray] = {}
    for name in (name for name in VELOCITY if columns.find(name)):
        if not columns.lies_along_samples(name):
            remarks.append(
                f"{name} is not used: it does not lie along {columns.dimension}, the dimension of the samples"
            )
            continue
        try:
            found[name] = columns.quantity(name)[order]
        except InputError as error:
            remarks.append(f"{name} is not used: {error}")
    missing = np.full(len(order), np.nan)
    return np.column_stack([found.get(name, missing) for name in VELOCITY]) if found else None


def _joined_velocity(parts: Sequence[Navigation], order: IntArray) -> FloatArray | None:
    """Velocities of several files in an order; NaN for the files that have none."""
    if all(part.velocity is None for part in parts):
        return None
    found = [np.full((len(part.time), 3), np.nan) if part.velocity is None else part.velocity for part in parts]
    return np.concatenate(found)[order]


def _positions(columns: NavigationColumns) -> tuple[SurfaceFixes, float, list[str]]:
    """GPS fixes, or positions at the surface if there are none; their error; and remarks on them."""
    if columns.find("fix_latitude") and columns.find("fix_longitude"):
        latitude, longitude = columns.quantity("fix_latitude"), columns.quantity("fix_longitude")
        time = columns.times(columns.find("fix_time") or columns.find("time"))
        if len(time) == len(latitude) == len(longitude) and np.isfinite(latitude + longitude).any():
            return screen_fixes(time, latitude, longitude, np.isfinite(latitude + longitude)), RECEIVER_ERROR, []
    if not (columns.find("latitude") and columns.find("longitude")):
        return SurfaceFixes.none(), RECEIVER_ERROR, ["the GPS variables contain no position"]
    latitude, longitude, time = (
        columns.quantity("latitude"),
        columns.quantity("longitude"),
        columns.times(columns.find("time")),
    )
    known = np.isfinite(latitude + longitude) if len(latitude) == len(longitude) == len(time) else np.zeros(0, bool)
    if not known.any():
        return SurfaceFixes.none(), RECEIVER_ERROR, ["no sample has a position"]
    depth = columns.depth(SurfaceFixes(time, latitude[known], longitude[known], time[:0], ()))
    with np.errstate(invalid="ignore"):
        surfaced = known & (depth < SURFACE)
    remark = (
        f"no variables of the GPS receiver: positions above {SURFACE:g} m are taken as fixes, with an error of "
        f"{POSITION_ERROR:g} m"
    )
    return screen_fixes(time, latitude, longitude, surfaced), POSITION_ERROR, [remark]


def _profiles(columns: NavigationColumns, order: IntArray, time: TimeArray, depth: FloatArray) -> IntArray:
    """Number of the profile of every sample: the file's own in the observation format, else detected from depth."""
    if columns.find("profile") and columns.find("fix_time") == "fix_time":
        found = np.nan_to_num(columns.quantity("profile")[order]).astype(np.int64)
    else:
        found = detect_profiles(_seconds(time), depth, record_break=RECORD_BREAK)
    return _usable(found, depth, np.radians(columns.quantity("pitch")[order]), columns.quantity("heading")[order])


def _usable(found: IntArray, depth: FloatArray, pitch: FloatArray, heading: FloatArray) -> IntArray:
    """Profile number of every sample, 0 for profiles with too few complete samples."""
    complete = np.isfinite(depth) & np.isfinite(pitch) & np.isfinite(heading)
    counts = np.bincount(found[complete & (found > 0)], minlength=int(found.max(initial=0)) + 1)
    return np.where(counts[found] >= MIN_SAMPLES, found, 0)


def _check_plausible(source: str, pitch: FloatArray, depth: FloatArray) -> None:
    """Refuse records without any pitch or depth, and a pitch in radians that is declared in degrees."""
    if not np.isfinite(pitch).any() or not np.isfinite(depth).any():
        raise InputError(f"{source}: pitch or depth has no value")
    steepest, deepest = float(np.nanmax(np.abs(np.degrees(pitch)))), float(np.nanmax(depth))
    if steepest < _RADIANS and deepest > SURFACE:
        raise InputError(
            f"{source}: the pitch never exceeds {steepest:.2g} degrees although the glider dives to {deepest:.0f} m; "
            "if it is in radians, set its units to 'rad'"
        )


def _vehicle(dataset: xr.Dataset) -> str:
    """Text of a file's attributes and variables that describe its glider, in lower case."""
    words = ("platform", "model", "vehicle", "glider", "instrument", "title", "source", "manufacturer", "name")
    texts = [str(value) for key, value in dataset.attrs.items() if any(word in str(key).lower() for word in words)]
    named = [name for name in ("PLATFORM_MODEL", "PLATFORM_TYPE", "platform_model") if name in dataset.variables]
    texts += [str(dataset[name].values) for name in named if dataset[name].ndim == 0]
    return " ".join(texts).lower()


def _seconds(time: TimeArray) -> FloatArray:
    return np.asarray((time - time[0]) / _SECOND, dtype=np.float64)
