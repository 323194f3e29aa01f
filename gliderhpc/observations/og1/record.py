"""One OG1 file as samples, fixes and what its producer found."""

from collections.abc import Container
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from gliderhpc.errors import InputError, ProfileError
from gliderhpc.observations.clock_steps import find_clock_steps, without_doubtful
from gliderhpc.observations.fixes import Fixes
from gliderhpc.observations.foreign import HELPFUL_ORDER, OWN_FILES, ForeignFile, importer_of
from gliderhpc.observations.og1 import vocabulary
from gliderhpc.observations.og1.vocabulary import Declination, find_declination
from gliderhpc.observations.profiles import detect_profiles, dive_span
from gliderhpc.observations.records import FloatArray, TimeArray
from gliderhpc.observations.rows import Columns, increasing
from gliderhpc.observations.validation import LARGEST_NUMBER

REJECTED = (3.0, 4.0, 9.0)
"""Quality flags of samples that are bad, or missing."""


@dataclass(frozen=True)
class DiveSpan:
    """Samples of one dive, and its number in the file."""

    number: int
    start: int
    stop: int


@dataclass(frozen=True, eq=False)
class Record:
    """Content of one file.

    Attributes
    ----------
    samples : dict of str to (n,) array
        Samples in the units of the observation format, time and the controls among them.
    dives : tuple of DiveSpan
        In time order.
    without_dive : dict of int to str
        Numbers of dives that give no profile, and why.
    fixes : Fixes
        In the order of the file.
    declination : Declination
        What was added to the heading.
    absent : tuple of str
        Controls that the file does not have; they are zero.
    current, speed : dict of str to array
        Reference quantities along the dives and along ``reference_time``.
    rows_dropped : int
        Samples whose time was missing or did not increase.
    lost : dict of int to str
        Numbers of dives that cannot be used because the clock was set in them, and why.
    remarks : tuple of str
        What else the user should hear.
    """

    samples: Columns
    dives: tuple[DiveSpan, ...]
    without_dive: dict[int, str]
    fixes: Fixes
    declination: Declination
    absent: tuple[str, ...]
    current: Columns
    speed: Columns
    rows_dropped: int
    lost: dict[int, str]
    remarks: tuple[str, ...]


def is_og1_file(path: Path) -> bool:
    """Return whether a path is an OG1 file that can be read."""
    if not path.is_file():
        return False
    try:
        with ForeignFile(path) as file:
            return "TIME" in file and "N_MEASUREMENTS" in file.dimensions
    except InputError:
        return False


def read_record(file: ForeignFile, declination: float | None) -> Record:
    """Read one file.

    Parameters
    ----------
    file : ForeignFile
        An OG1 file.
    declination : float, optional
        What to add to its heading (degree), if the user says.

    Raises
    ------
    InputError
        The file lacks time, depth, attitude or the ballast's volume, or was cut short.
    """
    _check_complete(file)
    names = {what: term.require(file, what) for what, term in vocabulary.ATTITUDE.items()}
    turned = find_declination(file, names["heading"], declination)
    samples: Columns = {
        "time": file.times(vocabulary.TIME.require(file, "time")),
        "depth": file.converted(vocabulary.DEPTH.require(file, "depth"), "m"),
        **{what: file.converted(name, "degree") for what, name in names.items()},
    }
    samples["heading"] = np.mod(_floats(samples["heading"]) + turned.angle, 360.0)
    controls, absent = _controls(file, len(samples["time"]))
    samples |= controls | _seawater(file)
    _check_lengths(file, samples)
    dives = _dive_numbers(file, samples)
    keep = _with_attitude(file, samples)
    rows = np.flatnonzero(keep)
    time = samples["time"][rows].astype("datetime64[ns]")
    in_order = increasing(time)
    steps = find_clock_steps(time, in_order, _floats(samples["depth"])[rows])
    ordered = rows[in_order]
    if len(ordered) == 0:
        raise InputError(f"{file.path}: has no sample with both time and attitude")
    samples = {name: values[ordered] for name, values in samples.items()}
    found, without = _find_dives(dives[ordered], _floats(samples["depth"]))
    marks = np.zeros(len(ordered), dtype=np.int64)
    for dive in found:
        marks[dive.start : dive.stop] = dive.number
    _, fixes, lost, remarks = without_doubtful(steps, marks, time[in_order], _fixes(file))
    spans = tuple(dive for dive in found if dive.number not in lost)
    return Record(
        samples, spans, without, fixes, turned, absent, _currents(file, ordered, spans), _speed(file),
        int(np.count_nonzero(~in_order)), lost, tuple(remarks),
    )  # fmt: skip


def _check_complete(file: ForeignFile) -> None:
    """Refuse a file that lacks anything required, what only the glider's own files have first."""
    terms = {"ballast volume": vocabulary.BALLAST, **vocabulary.ATTITUDE, "depth": vocabulary.DEPTH,
             "time": vocabulary.TIME}  # fmt: skip
    lacking = {what: term for what, term in terms.items() if term.find(file) is None}
    ballast = vocabulary.BALLAST.find(file)
    if ballast is not None and not np.isfinite(file.numbers(ballast)).any():
        lacking = {"ballast volume": vocabulary.BALLAST, **lacking}
    if not lacking:
        return
    if set(HELPFUL_ORDER) <= set(file.names):
        raise InputError(f"{file.path}: is in the observation format already; there is nothing to import")
    first, *others = lacking
    found = ", ".join(f"{what} ({name})" for what, term in terms.items() if what not in lacking
                      and (name := term.find(file)) is not None)  # fmt: skip
    raise InputError(
        f"{file.path}: has no {first} ({terms[first].describe()}){_remedy(file, lacking)}"
        + (f"; it also lacks {', '.join(others)}" if others else "")
        + (f"; it does have {found}" if found else "")
    )


def _remedy(file: ForeignFile, lacking: Container[str]) -> str:
    kind = importer_of(file.names)
    if kind is not None and kind[0] != "og1":
        return f": it holds {kind[1]}, which `gliderhpc import {kind[0]}` reads"
    if "ballast volume" in lacking:
        return f": without the buoyancy that drives the glide there is nothing to invert; {OWN_FILES}"
    return ""


def _floats(values: npt.NDArray[np.generic]) -> FloatArray:
    return values.astype(np.float64)


def _controls(file: ForeignFile, count: int) -> tuple[Columns, tuple[str, ...]]:
    """Oil volume and battery, in the basestation's signs; a battery that the file does not have stays at zero."""
    ballast = vocabulary.BALLAST.require(file, "ballast volume")
    controls: Columns = {"ballast_volume": file.converted(ballast, "cm3")}
    absent: list[str] = []
    for what, term in vocabulary.BATTERY.items():
        name = term.find(file)
        if name is None:
            absent.append(what)
            controls[what] = np.zeros(count)
        else:
            controls[what] = file.converted(name, term.unit, undeclared=term.undeclared)
    rudder = vocabulary.RUDDER.find(file)
    if rudder is not None:
        controls["rudder"] = file.converted(rudder, vocabulary.RUDDER.unit, undeclared=vocabulary.RUDDER.undeclared)
    # Forward is towards low values of a Seaglider's position.
    controls["battery_position"] = 0.0 - _floats(controls["battery_position"])
    return controls, tuple(absent)


def _seawater(file: ForeignFile) -> Columns:
    found: Columns = {}
    for what, term in vocabulary.SEAWATER.items():
        name = term.find(file)
        if name is not None:
            values = file.converted(name, term.unit)
            if f"{name}_QC" in file:
                file.check_lengths((name, f"{name}_QC"))
                values[np.isin(file.numbers(f"{name}_QC"), REJECTED)] = np.nan
            found[what] = values
    return found


def _check_lengths(file: ForeignFile, samples: Columns) -> None:
    odd = [name for name, values in samples.items() if len(values) != len(samples["time"])]
    if odd:
        raise InputError(f"{file.path}: {odd[0]} does not lie along TIME; is it an OG1 trajectory file?")


def _with_attitude(file: ForeignFile, samples: Columns) -> npt.NDArray[np.bool_]:
    """Rows of the glider's attitude: the others hold fixes, or sensors that are sampled at other times."""
    for what in vocabulary.ATTITUDE:
        if not np.isfinite(_floats(samples[what])).any():
            raise InputError(f"{file.path}: has no {what}, not one sample of it")
    keep = np.zeros(len(samples["time"]), dtype=bool)
    for what in vocabulary.ATTITUDE:
        keep |= np.isfinite(_floats(samples[what]))
    return keep


def _dive_numbers(file: ForeignFile, samples: Columns) -> npt.NDArray[np.int64]:
    """Number of the dive of every row: the file's, or else judged from depth."""
    name = vocabulary.DIVE.find(file)
    if name is not None:
        file.check_lengths((vocabulary.TIME.require(file, "time"), name))
        given = np.nan_to_num(file.numbers(name))
        # What is no number of a dive, a fill value that the file does not declare among them, is none.
        plausible = (given > 0) & (given <= LARGEST_NUMBER) & (given == np.rint(given))
        return np.asarray(np.where(plausible, given, 0.0), dtype=np.int64)
    time, depth = samples["time"].astype("datetime64[ns]"), _floats(samples["depth"])
    known = increasing(time) & np.isfinite(depth)
    numbers = np.zeros(len(time), dtype=np.int64)
    if known.any():
        seconds = (time[known] - time[known][0]) / np.timedelta64(1, "s")
        numbers[known] = detect_profiles(seconds, depth[known])
    return numbers


def _find_dives(numbers: npt.NDArray[np.int64], depth: FloatArray) -> tuple[tuple[DiveSpan, ...], dict[int, str]]:
    spans: list[DiveSpan] = []
    without: dict[int, str] = {}
    for number in np.unique(numbers[numbers > 0]).tolist():
        rows = np.flatnonzero(numbers == number)
        first = int(rows[0])
        try:
            start, stop = dive_span(depth[first : int(rows[-1]) + 1])
        except ProfileError as error:
            without[number] = str(error)
        else:
            spans.append(DiveSpan(number, first + start, first + stop))
    return tuple(spans), without


def _fixes(file: ForeignFile) -> Fixes:
    names = [term.find(file) for term in (vocabulary.FIX_TIME, vocabulary.FIX_LATITUDE, vocabulary.FIX_LONGITUDE)]
    if None in names:
        return Fixes(np.zeros(0, "datetime64[ns]"), np.zeros(0), np.zeros(0))
    clock, latitude, longitude = map(str, names)
    file.check_lengths((clock, latitude, longitude))
    time: TimeArray = file.times(clock)
    north, east = file.converted(latitude, "degree"), file.converted(longitude, "degree")
    there = ~np.isnat(time) & np.isfinite(north) & np.isfinite(east)
    return Fixes(time[there], north[there], east[there])


def _medians(values: FloatArray, dives: tuple[DiveSpan, ...]) -> FloatArray:
    """Median of a dive's samples, NaN where it has none: the files repeat the dive's current sample by sample."""
    parts = [values[dive.start : dive.stop] for dive in dives]
    known = [part[np.isfinite(part)] for part in parts]
    return np.array([np.median(part) if len(part) else np.nan for part in known])


def _currents(file: ForeignFile, rows: npt.NDArray[np.int64], dives: tuple[DiveSpan, ...]) -> Columns:
    """Depth-averaged current of every dive, NaN where the file has none."""
    found = {name: term.find(file) for name, term in vocabulary.CURRENT.items()}
    file.check_lengths((vocabulary.TIME.require(file, "time"), *filter(None, found.values())))
    return {
        name: np.full(len(dives), np.nan) if source is None else _medians(file.converted(source, "m s-1")[rows], dives)
        for name, source in found.items()
    }


def _speed(file: ForeignFile) -> Columns:
    """Speeds through the water at the times that have one."""
    time = file.times(vocabulary.TIME.require(file, "time"))
    found = {name: term.find(file) for name, term in vocabulary.SPEED.items()}
    file.check_lengths((vocabulary.TIME.require(file, "time"), *filter(None, found.values())))
    speeds = {
        name: np.full(len(time), np.nan) if source is None else file.converted(source, "m s-1")
        for name, source in found.items()
    }
    known = ~np.isnat(time) & np.isfinite(speeds["reference_speed"])
    return {"reference_time": time[known], **{name: values[known] for name, values in speeds.items()}}
