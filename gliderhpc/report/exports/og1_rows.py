"""Rows of an OG1 file, and the ground track of a profile's records if fixes determine it."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gliderhpc.archive.current import adopted_current
from gliderhpc.archive.profile import TRACKED, ProfileData
from gliderhpc.archive.reader import Archive
from gliderhpc.observations import Fix, cycle_boundaries
from gliderhpc.observations.fixes import moved
from gliderhpc.observations.regions import wrapped_longitude
from gliderhpc.observations.times import epoch_seconds
from gliderhpc.platform import Platform
from gliderhpc.report.exports.og1_vocabulary import (
    ADJOINT_TERMS,
    CURRENT_ESTIMATES,
    MAX_DIFFERENCE,
    PHASES,
    POSITION_METHODS,
    QC_FLAGS,
    SAMPLED,
    SMOOTHED_TERMS,
    TERMS,
    VERTICAL_QC,
    VERTICAL_TERMS,
    WITH_QC,
)
from gliderhpc.store_schema.schema import MOTION
from gliderhpc.studies.library.tracks import Motions, anchored_tracks, fix_of, motions_of, track_of
from gliderhpc.vocabulary import CHANNELS

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class GroundTrack:
    """Positions of a profile's m records.

    Attributes
    ----------
    latitude, longitude : (m,) arrays
        Positions, degrees; NaN if no fix determines them.
    method : int
        Method of the positions, a value of `POSITION_METHODS`.
    """

    latitude: Array
    longitude: Array
    method: int


def ground_track(archive: Archive, data: ProfileData, platform: Platform) -> GroundTrack:
    """Determine the positions of a profile's records.

    Between two fixes the track begins and ends on a fix and includes the current of each cycle (`anchored_tracks`).
    With only one fix, the track through the water starts or ends there, without the current. Without a fix there are no
    positions.
    """
    entry, last = fix_of(data.table, "entry"), fix_of(data.table, "exit")
    if entry is not None:
        return _from_entry(entry, archive, data, motions_of(data, platform))
    if last is not None:
        through_water = track_of(motions_of(data, platform).estimate)
        return _place_track(last, through_water - through_water[-1], "to_the_fix_after")
    unknown = np.full(len(data.record_time), np.nan)
    return GroundTrack(unknown, unknown, POSITION_METHODS["none"])


def _from_entry(entry: Fix, archive: Archive, data: ProfileData, motions: Motions) -> GroundTrack:
    tracks = anchored_tracks(archive, data, motions.estimate, motions.glide_angle)
    if tracks is None:
        return _place_track(entry, track_of(motions.estimate), "from_the_fix_before")
    return _place_track(entry, tracks.estimate, "between_both_fixes")


def _place_track(origin: Fix, displacement: Array, method: str) -> GroundTrack:
    start = (origin.latitude, origin.longitude)
    places = np.array([moved(start, step) for step in displacement])
    return GroundTrack(places[:, 0], places[:, 1], POSITION_METHODS[method])


Rows = dict[str, NDArray[np.generic]]

_FIXED = ("TIME_GPS", "LATITUDE_GPS", "LONGITUDE_GPS")


@dataclass
class Counter:
    """State of the file: number of legs so far, and the time of its last row (s since 1970)."""

    legs: int = 0
    last: float = -np.inf


def profile_rows(
    data: ProfileData, smoothed: xr.Dataset | None, vertical: xr.Dataset | None, track: GroundTrack, counter: Counter
) -> Rows:
    """Return the rows of one profile, by variable.

    Parameters
    ----------
    data : ProfileData
        The adjoint's estimate of the profile.
    smoothed : xarray.Dataset, optional
        Row of the profile in the smoother's group of the archive.
    vertical : xarray.Dataset, optional
        Row of the profile in the group of study ``vertical``.
    track : GroundTrack
        Positions of the profile's records.
    counter : Counter
        State of the file, updated for this profile.
    """
    rows = _records(data, smoothed, track)
    if vertical is not None:
        rows |= _vertical(vertical, len(data.record_time))
    rows["PROFILE_NUMBER"] = rows["PROFILE_NUMBER"] + counter.legs
    counter.legs = int(rows["PROFILE_NUMBER"].max())
    for end, fix in (("entry", fix_of(data.table, "entry")), ("exit", fix_of(data.table, "exit"))):
        if fix is not None:
            _add_fix(rows, fix, end, counter.last)
    counter.last = float(rows["TIME"][-1])
    rows |= {f"{name}_QC": np.zeros(len(rows["TIME"])) for name in WITH_QC}
    return {name: values.astype(TERMS[name].dtype) for name, values in rows.items()}


def _records(data: ProfileData, smoothed: xr.Dataset | None, track: GroundTrack) -> Rows:
    count = len(data.record_time)
    roll, pitch, heading, depth = data.measured.T
    position, rotation, volume, rudder = data.controls.T
    number, phase = _legs(depth)
    rows: Rows = {
        "TIME": epoch_seconds(data.epoch) + data.record_time,
        "LATITUDE": track.latitude,
        "LONGITUDE": track.longitude,
        "DEPTH": depth,
        **{name: np.full(count, np.nan) for name in _FIXED},
        "DIVE_NUMBER": np.full(count, data.number),
        "PROFILE_NUMBER": number,
        "PHASE": phase,
        "POSITION_METHOD": np.full(count, track.method),
        "SAMPLED": np.where(data.sampled, SAMPLED["sampled"], SAMPLED["interpolated"]),
        "QUALITY": np.bitwise_or.reduceat(data.quality, _first_steps(data)),
        "ROLL": roll,
        "PITCH": pitch,
        "HEADING": np.mod(heading, 360.0),
        "PITCH_CTL": 0.0 - 100.0 * position,
        "ROLL_CTL": rotation,
        "VBD_CC": volume,
        "RUDDER": rudder,
        **_speeds(data),
        **_adjoint_rows(data),
    }
    for name, values in _currents(data, smoothed is not None):
        rows[name] = np.full(count, values)
    return rows if smoothed is None else rows | _adjoint_deviations(data) | dict(_smoothed_rows(smoothed, count))


def _legs(depth: Array) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the number of the leg, from 1, and its phase, for each of the m records."""
    bounds = [0]
    for start, stop in pairwise(cycle_boundaries(depth)):
        bounds += [int(start) + int(np.argmax(np.nan_to_num(depth[start : stop + 1], nan=-np.inf))), int(stop)]
    # The last record belongs to the last leg.
    bounds[-1] += 1
    number = np.repeat(np.arange(1, len(bounds)), np.diff(bounds))
    return number, np.where(number % 2 == 1, PHASES["descent"], PHASES["ascent"])


def _first_steps(data: ProfileData) -> NDArray[np.int64]:
    """Find the sample at which each record's interval begins."""
    return np.searchsorted(data.time, data.record_time - 0.5 * data.step).astype(np.int64)


def _adjoint_rows(data: ProfileData) -> Rows:
    """Return the disturbances averaged over the steps of each record, and the motion at the record."""
    starts = _first_steps(data)
    known = np.asarray(np.isfinite(data.disturbances).all(axis=1))
    sums = np.add.reduceat(np.where(known[:, None], data.disturbances, 0.0), starts, axis=0)
    steps = np.asarray(np.add.reduceat(known.astype(np.float64), starts))[:, None]
    means = np.divide(sums, steps, out=np.full(sums.shape, np.nan), where=steps > 0.0)
    reconstructed = data.reconstructed.copy()
    reconstructed[:, 2] = np.mod(reconstructed[:, 2], 360.0)
    columns = np.column_stack([means, data.motion, reconstructed])
    return dict(zip((term.name for term in ADJOINT_TERMS), columns.T, strict=True))


def _adjoint_deviations(data: ProfileData) -> Rows:
    """Return the standard deviations of the adjoint's disturbances, which follow from the smoothed estimate."""
    deviations = data.disturbances_std[_first_steps(data)]
    terms = ADJOINT_TERMS[: len(CHANNELS)]
    return {f"{term.name}_STD": column for term, column in zip(terms, deviations.T, strict=True)}


def _smoothed_rows(row: xr.Dataset, count: int) -> Iterator[tuple[str, Array]]:
    names = [*CHANNELS, *MOTION, *TRACKED]
    for name, term in zip(names, SMOOTHED_TERMS, strict=True):
        yield term.name, row[name].values[:count]
        yield f"{term.name}_STD", row[f"{name}_std"].values[:count]


def _vertical(row: xr.Dataset, count: int) -> Rows:
    """Return the upward vertical velocities, and the quality flag of that of the water."""
    columns = (-row["depth_rate"], -row["depth_rate_still"], row["water_up"], row["water_up_std"])
    rows: Rows = {term.name: column.values[:count] for term, column in zip(VERTICAL_TERMS, columns, strict=True)}
    apart, allowed = abs(float(row["difference"])), MAX_DIFFERENCE * float(row["difference_std"])
    flag = "no_qc_applied"
    if np.isfinite(apart) and np.isfinite(allowed):
        flag = "probably_good_data" if apart <= allowed else "probably_bad_data"
    known = np.isfinite(row["water_up"].values[:count])
    return rows | {VERTICAL_QC.name: np.where(known, QC_FLAGS.index(flag), 0)}


def _speeds(data: ProfileData) -> Rows:
    velocity = data.motion[:, [list(MOTION).index(name) for name in "uvw"]]
    roll, pitch = np.radians(data.reconstructed[:, :2]).T
    down = np.column_stack([-np.sin(pitch), np.sin(roll) * np.cos(pitch), np.cos(roll) * np.cos(pitch)])
    squared, vertical = (velocity**2).sum(axis=1), (velocity * down).sum(axis=1)
    return {
        "GLIDE_SPEED": np.sqrt(squared),
        "GLIDER_HORZ_VELO_MODEL": np.sqrt(np.maximum(squared - vertical**2, 0.0)),
        "ANGLE_OF_ATTACK": np.degrees(np.arctan2(velocity[:, 2], velocity[:, 0])),
    }


def _currents(data: ProfileData, smoothed: bool) -> Iterator[tuple[str, float]]:
    """Yield the adopted current, its estimate, and the currents of all estimates of the archive."""
    adopted, columns = (
        adopted_current(data.table),
        {"adjoint": ""} | ({"smoothed": "_smoothed"} if smoothed else {}),
    )
    for along in ("north", "east"):
        for kind in ("", "_std"):
            yield f"DAVG_CURR_{along}{kind}".upper(), float(getattr(adopted, f"{along}{kind}"))
            for estimate, suffix in columns.items():
                value = data.table.get(f"dac_{along}{suffix}{kind}", np.nan)
                yield f"DAVG_CURR_{along}_{estimate}{kind}".upper(), float(value)
    yield "DAVG_CURR_ESTIMATE", CURRENT_ESTIMATES[str(adopted.estimate) or "none"]


def _add_fix(rows: Rows, fix: Fix, end: str, last: float) -> None:
    """Add a fix as a separate row, or to the record of the same time; skip one that is already in the file."""
    time = epoch_seconds(fix.time)
    if time <= last:
        return
    same = np.flatnonzero(rows["TIME"] == time)
    if len(same):
        index = int(same[0])
    else:
        index = 0 if end == "entry" else len(rows["TIME"])
        neighbour = index if end == "entry" else index - 1
        for name, values in rows.items():
            repeated = name in _REPEATED or name.startswith("DAVG_CURR")
            empty = np.nan if values.dtype.kind == "f" else 0
            rows[name] = np.insert(values, index, values[neighbour] if repeated else empty)
        rows["PHASE"][index], rows["DEPTH"][index], rows["TIME"][index] = PHASES["surfacing"], 0.0, time
    for name, value in zip(_FIXED, (time, fix.latitude, fix.longitude), strict=True):
        rows[name][index] = value
    rows["LATITUDE"][index], rows["LONGITUDE"][index] = fix.latitude, wrapped_longitude(fix.longitude)
    rows["LONGITUDE_GPS"][index] = wrapped_longitude(fix.longitude)
    rows["POSITION_METHOD"][index] = POSITION_METHODS["gps_fix"]


_REPEATED = ("DIVE_NUMBER", "PROFILE_NUMBER")
"""Variables that the row of a fix copies from the neighbouring row."""


def names_of(parts: Iterable[str]) -> list[str]:
    """Return names in the order of the vocabulary."""
    wanted = set(parts)
    return [name for name in TERMS if name in wanted]
