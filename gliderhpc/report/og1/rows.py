"""One profile of an archive as rows of an OG1 file: its records in time order, with a row for each fix beside them."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gliderhpc.archive.profile import TRACKED, ProfileData
from gliderhpc.archive.taken_current import taken_current
from gliderhpc.observations import Fix, cycle_boundaries
from gliderhpc.report.og1.track import GroundTrack
from gliderhpc.report.og1.vocabulary import (
    ADJOINT_TERMS,
    CURRENT_ESTIMATES,
    PHASES,
    POSITION_METHODS,
    SMOOTHED_TERMS,
    TERMS,
    WITH_QC,
)
from gliderhpc.store_schema.schema import MOTION
from gliderhpc.studies.library.anchored_track import fix_of
from gliderhpc.vocabulary import CHANNELS

Array = NDArray[np.float64]
Rows = dict[str, NDArray[np.generic]]

_SECOND = np.timedelta64(1, "s")
_FIXED = ("TIME_GPS", "LATITUDE_GPS", "LONGITUDE_GPS")


@dataclass
class Counter:
    """Where the file stands: legs counted so far, and the time of its last row (s since 1970)."""

    legs: int = 0
    last: float = -np.inf


def profile_rows(data: ProfileData, smoothed: xr.Dataset | None, track: GroundTrack, counter: Counter) -> Rows:
    """Lay out one profile.

    Parameters
    ----------
    data : ProfileData
        The adjoint's estimate of the profile.
    smoothed : xarray.Dataset, optional
        Its row of the archive's group of the smoother.
    track : GroundTrack
        Where its records lie.
    counter : Counter
        Moved on by the profile.
    """
    rows = _records(data, smoothed, track)
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
        "TIME": _since_1970(data.epoch) + data.record_time,
        "LATITUDE": track.latitude,
        "LONGITUDE": track.longitude,
        "DEPTH": depth,
        **{name: np.full(count, np.nan) for name in _FIXED},
        "DIVE_NUMBER": np.full(count, data.number),
        "PROFILE_NUMBER": number,
        "PHASE": phase,
        "POSITION_METHOD": np.full(count, track.method),
        "QUALITY": np.bitwise_or.reduceat(data.quality, _first_steps(data)),
        "ROLL": roll,
        "PITCH": pitch,
        "HEADING": np.mod(heading, 360.0),
        "PITCH_CTL": 0.0 - 100.0 * position,
        "ROLL_CTL": rotation,
        "VBD_CC": volume,
        "RUDDER": rudder,
        **_speeds(data),
        **_adjoint(data),
    }
    for name, values in _currents(data, smoothed is not None):
        rows[name] = np.full(count, values)
    return rows if smoothed is None else rows | dict(_smoothed(smoothed, count))


def _legs(depth: Array) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Count the legs (m,) of a profile, from 1, and say which way each goes."""
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


def _adjoint(data: ProfileData) -> Rows:
    """Disturbances averaged over the steps of the record, and the motion at the record."""
    starts = _first_steps(data)
    known = np.asarray(np.isfinite(data.disturbances).all(axis=1))
    sums = np.add.reduceat(np.where(known[:, None], data.disturbances, 0.0), starts, axis=0)
    steps = np.asarray(np.add.reduceat(known.astype(np.float64), starts))[:, None]
    means = np.divide(sums, steps, out=np.full(sums.shape, np.nan), where=steps > 0.0)
    reconstructed = data.reconstructed.copy()
    reconstructed[:, 2] = np.mod(reconstructed[:, 2], 360.0)
    columns = np.column_stack([means, data.motion, reconstructed])
    return dict(zip((term.name for term in ADJOINT_TERMS), columns.T, strict=True))


def _smoothed(row: xr.Dataset, count: int) -> Iterator[tuple[str, Array]]:
    names = [*CHANNELS, *MOTION, *TRACKED]
    for name, term in zip(names, SMOOTHED_TERMS, strict=True):
        yield term.name, row[name].values[:count]
        yield f"{term.name}_STD", row[f"{name}_std"].values[:count]


def _speeds(data: ProfileData) -> Rows:
    velocity = data.motion[:, [list(MOTION).index(name) for name in "uvw"]]
    roll, pitch = np.radians(data.reconstructed[:, :2]).T
    down = np.column_stack([-np.sin(pitch), np.sin(roll) * np.cos(pitch), np.cos(roll) * np.cos(pitch)])
    squared, vertical = (velocity**2).sum(axis=1), (velocity * down).sum(axis=1)
    return {
        "GLIDE_SPEED": np.sqrt(squared),
        "GLIDER_HORZ_VELO_MODEL": np.sqrt(np.maximum(squared - vertical**2, 0.0)),
    }


def _currents(data: ProfileData, smoothed: bool) -> Iterator[tuple[str, float]]:
    """Current that is taken, what made it, and those of the estimates that the archive has."""
    taken, columns = taken_current(data.table), {"adjoint": ""} | ({"smoothed": "_smoothed"} if smoothed else {})
    for along in ("north", "east"):
        for kind in ("", "_std"):
            yield f"DAVG_CURR_{along}{kind}".upper(), float(getattr(taken, f"{along}{kind}"))
            for estimate, suffix in columns.items():
                found = data.table.get(f"dac_{along}{suffix}{kind}", np.nan)
                yield f"DAVG_CURR_{along}_{estimate}{kind}".upper(), float(found)
    yield "DAVG_CURR_ESTIMATE", CURRENT_ESTIMATES[str(taken.estimate) or "none"]


def _add_fix(rows: Rows, fix: Fix, end: str, last: float) -> None:
    """Put a fix into a row of its own, or on to the record of the same time; one that the file has already is left."""
    time = _since_1970(fix.time)
    if time <= last:
        return
    same = np.flatnonzero(rows["TIME"] == time)
    if len(same):
        place = int(same[0])
    else:
        place = 0 if end == "entry" else len(rows["TIME"])
        neighbour = place if end == "entry" else place - 1
        for name, values in rows.items():
            kept = name in _ON_A_FIX or name.startswith("DAVG_CURR")
            empty = np.nan if values.dtype.kind == "f" else 0
            rows[name] = np.insert(values, place, values[neighbour] if kept else empty)
        rows["PHASE"][place], rows["DEPTH"][place], rows["TIME"][place] = PHASES["surfacing"], 0.0, time
    for name, value in zip(_FIXED, (time, fix.latitude, fix.longitude), strict=True):
        rows[name][place] = value
    rows["LATITUDE"][place], rows["LONGITUDE"][place] = fix.latitude, _east(fix.longitude)
    rows["LONGITUDE_GPS"][place] = _east(fix.longitude)
    rows["POSITION_METHOD"][place] = POSITION_METHODS["gps_fix"]


_ON_A_FIX = ("DIVE_NUMBER", "PROFILE_NUMBER")


def _east(longitude: float) -> float:
    """Longitude from -180 to 180 degrees."""
    return (longitude + 180.0) % 360.0 - 180.0


def _since_1970(time: np.datetime64) -> float:
    return float((time - np.datetime64(0, "s")) / _SECOND)


def names_of(parts: Iterable[str]) -> list[str]:
    """Names in the order of the vocabulary."""
    wanted = set(parts)
    return [name for name in TERMS if name in wanted]
