"""Variables of OG1 files that are needed for an observation file: names, reading, and the heading's declination.

The OG1 vocabulary has no names for a glider's controls. The names used here are those in Seaglider files converted to
OG1, with the basestation's units and signs. If a file uses other names for its attitude, the variables are found by
their CF standard names. Matching of names ignores case.
"""

from collections.abc import Container, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gliderhpc.angles import wrap
from gliderhpc.errors import InputError
from gliderhpc.observations.checks.sign_checks import sense_fault
from gliderhpc.observations.checks.validation import Span
from gliderhpc.observations.files.columns import FACTORS, Term, UnitError, bare_unit
from gliderhpc.observations.files.foreign import IN_THE_FORMAT, OWN_FILES, ForeignFile, importer_of, is_in_the_format
from gliderhpc.observations.files.headings import North, file_declination, north_of
from gliderhpc.observations.files.quality_flags import find_rejected
from gliderhpc.observations.files.valid_limits import check_limits
from gliderhpc.observations.fixes import Fixes
from gliderhpc.observations.importing.dive_files import read_fixes, reference_speeds
from gliderhpc.observations.importing.rows import Columns
from gliderhpc.observations.profiles import MIN_DEPTH
from gliderhpc.observations.records import FloatArray, TimeArray
from gliderhpc.observations.times import FIRST_YEAR, LAST_YEAR
from gliderhpc.wording import counted

TIME = Term(("TIME",), "s")
DEPTH = Term(("DEPTH", "GLIDER_DEPTH"), "m")
ATTITUDE = {
    "roll": Term(
        ("ROLL", "GLIDER_ROLL", "PLATFORM_ROLL"),
        "degree",
        ("platform_roll_starboard_down", "platform_roll", "platform_roll_angle"),
    ),
    "pitch": Term(
        ("PITCH", "GLIDER_PITCH", "PLATFORM_PITCH"),
        "degree",
        ("platform_pitch_fore_up", "platform_pitch", "platform_pitch_angle"),
    ),
    "heading": Term(
        ("HEADING", "GLIDER_HEADING", "PLATFORM_HEADING"),
        "degree",
        ("platform_orientation", "platform_yaw_fore_starboard", "platform_yaw", "platform_yaw_angle"),
    ),
}
BALLAST = Term(("VBD_CC",), "cm3", undeclared="cm3")
BATTERY = {
    "battery_position": Term(("PITCH_CTL",), "m", undeclared="cm"),
    "battery_rotation": Term(("ROLL_CTL",), "degree", undeclared="degree"),
}
RUDDER = Term(("RUDDER",), "degree", undeclared="degree")
SEAWATER = {
    "temperature": Term(("TEMP",), "degC", ("sea_water_temperature",)),
    "practical_salinity": Term(("PSAL",), "1", ("sea_water_practical_salinity",)),
    "pressure": Term(("PRES",), "dbar", ("sea_water_pressure",)),
}
FIX_TIME = Term(("TIME_GPS", "TIME"), "s")
FIX_LATITUDE = Term(("LATITUDE_GPS",), "degrees_north")
FIX_LONGITUDE = Term(("LONGITUDE_GPS",), "degrees_east")
DIVE = Term(("DIVE_NUMBER", "divenum", "SEGMENT_NUMBER"), "1")
TRACK_NORTH = Term(("NORTH_DISPLACEMENT",), "m")
TRACK_EAST = Term(("EAST_DISPLACEMENT",), "m")
CURRENT = {
    "reference_current_north": Term(("DAVG_CURR_NORTH",), "m s-1"),
    "reference_current_east": Term(("DAVG_CURR_EAST",), "m s-1"),
}
FLIGHT_MODEL = {
    "reference_mass": Term(("MASS",), "kg"),
    "reference_maximum_volume": Term(("VOLMAX",), "cm3"),
    "reference_volume_bias": Term(("VBDBIAS", "VBD_BIAS"), "cm3"),
}
COEFFICIENTS = {
    "reference_lift": Term(("HD_A",), "1"),
    "reference_drag": Term(("HD_B",), "1"),
    "reference_induced_drag": Term(("HD_C",), "1"),
    "reference_drag_exponent": Term(("HD_S",), "1"),
}
"""Coefficients of the producer's flight model in the basestation's units, such as hd_a per degree."""
SPEED = {
    "reference_speed": Term(("GLIDE_SPEED",), "m s-1"),
    "reference_horizontal_speed": Term(("GLIDER_HORZ_VELO_MODEL",), "m s-1"),
    "reference_vertical_speed": Term(("GLIDER_VERT_VELO_MODEL",), "m s-1"),
    "reference_depth_rate": Term(("GLIDER_VERT_VELO_DZDT",), "m s-1"),
    "reference_vertical_current": Term(("VERT_CURR_MODEL",), "m s-1"),
}


def check_complete(file: ForeignFile) -> None:
    """Refuse a file that lacks a required variable.

    Raises
    ------
    InputError
        There is no row, or variables are missing. The message lists the missing variables, starting with the one that
        only the glider's own files have, the variables found, and the remedy.
    """
    terms = {"ballast volume": BALLAST, **ATTITUDE, "depth": DEPTH, "time": TIME}
    clock = TIME.find(file)
    if clock is not None and not len(file.present(clock)):
        raise InputError(f"{file.path}: has no rows ({clock} is empty)")
    lacking = {what: term for what, term in terms.items() if term.find(file) is None}
    ballast = BALLAST.find(file)
    if ballast is not None and not np.isfinite(file.numbers(ballast)).any():
        lacking = {"ballast volume": BALLAST, **lacking}
    if not lacking:
        return
    if is_in_the_format(file.names):
        raise InputError(f"{file.path}: {IN_THE_FORMAT}")
    first, *others = lacking
    found = ", ".join(f"{what} ({term.find(file)})" for what, term in terms.items() if what not in lacking)
    raise InputError(
        f"{file.path}: has no {first} ({terms[first].describe()}){_remedy(file, lacking)}"
        + (f"; it also lacks {', '.join(others)}" if others else "")
        + (f"; it has {found}" if found else "")
        + _pressure_instead(file, lacking)
    )


def _pressure_instead(file: ForeignFile, lacking: Container[str]) -> str:
    pressure = SEAWATER["pressure"].find(file)
    possible = pressure and "depth" in lacking and "ballast volume" not in lacking
    return f"; compute DEPTH (m, positive down) from {pressure}" if possible else ""


def _remedy(file: ForeignFile, lacking: Container[str]) -> str:
    kind = importer_of(file.names)
    if kind is not None and kind[0] != "og1":
        return f"; it contains {kind[1]}, which `gliderhpc import {kind[0]}` reads"
    if "ballast volume" in lacking:
        return f"; without the ballast, which drives the glide, there is nothing to invert; {OWN_FILES}"
    return ""


def sense_of_depth(file: ForeignFile, name: str) -> float:
    """Sign to multiply a depth with, -1 where the file declares it positive upward."""
    return -1.0 if file.attribute("positive", name).strip().lower() == "up" else 1.0


def read_depth(file: ForeignFile) -> FloatArray:
    """Depth (m), ``(n,)``, positive down; NaN where missing.

    Raises
    ------
    InputError
        The sign of the depth under water is not the declared one; without a declaration it is positive.
    """
    name = DEPTH.require(file, "depth")
    sense = sense_of_depth(file, name)
    depth = sense * file.converted(name, DEPTH.unit)
    # The file's own limits, such as valid_min = 0, may hide the negative values.
    factor = FACTORS[DEPTH.unit].get(bare_unit(file.attribute("units", name)).lower(), 1.0)
    lowest = factor * float(np.fmin.reduce(sense * file.unlimited(name), initial=0.0))
    if lowest < -MIN_DEPTH and not np.any(depth > MIN_DEPTH):
        found, remedy = sense_fault(file.attribute("positive", name))
        raise InputError(f"{file.path}: {name} is {found} ({sense * lowest:.4g} m); {remedy}")
    return depth


def read_controls(file: ForeignFile, count: int) -> tuple[Columns, tuple[str, ...]]:
    """Controls in the units and signs of the observation format, and the absent battery controls, which are zero."""
    ballast = BALLAST.require(file, "ballast volume")
    controls: Columns = {"ballast_volume": file.converted(ballast, "cm3")}
    absent: list[str] = []
    for what, term in BATTERY.items():
        name = term.find(file)
        if name is None or not np.isfinite(file.numbers(name)).any():
            absent.append(what)
            controls[what] = np.zeros(count)
        else:
            controls[what] = file.converted(name, term.unit, undeclared=term.undeclared)
    rudder = RUDDER.find(file)
    if rudder is not None:
        controls["rudder"] = file.converted(rudder, RUDDER.unit, undeclared=RUDDER.undeclared)
    # The position of a Seaglider's battery decreases forward.
    controls["battery_position"] = 0.0 - controls["battery_position"].astype(np.float64)
    return controls, tuple(absent)


def reject_flagged(file: ForeignFile) -> tuple[str, ...]:
    """Treat times, depth, attitude, controls and fixes that the file flags as bad as missing; return a remark on them.

    Raises
    ------
    InputError
        Every value of time, depth or attitude is flagged.
    """
    needed = [term.find(file) for term in (TIME, DEPTH, *ATTITUDE.values())]
    others = [term.find(file) for term in (BALLAST, *BATTERY.values(), RUDDER, FIX_TIME, FIX_LATITUDE, FIX_LONGITUDE)]
    remark = file.reject_flagged([name for name in (*needed, *others) if name is not None], set(filter(None, needed)))
    return (f"{file.path.name}: {remark}",) if remark else ()


def describe_limits(file: ForeignFile) -> tuple[str, ...]:
    """Remarks on values outside the limits that the file declares, which are missing.

    Raises
    ------
    InputError
        Most values of time, depth or attitude are outside.
    """
    needed = {name for term in (TIME, DEPTH, *ATTITUDE.values()) if (name := term.find(file)) is not None}
    others = (BALLAST, *BATTERY.values(), RUDDER, *SEAWATER.values(), FIX_TIME, FIX_LATITUDE, FIX_LONGITUDE)
    names = (*sorted(needed), *(name for term in others if (name := term.find(file)) is not None))
    return tuple(f"{file.path.name}: {remark}" for remark in check_limits(file, names, needed))


def read_seawater(file: ForeignFile) -> tuple[Columns, tuple[str, ...]]:
    """Temperature (degC), practical salinity and pressure (dbar), ``(n,)`` each; NaN where missing or bad.

    A variable in a unit that cannot be converted, or with all values flagged bad or missing, is left out with a remark.
    """
    found: Columns = {}
    remarks: list[str] = []
    for what, term in SEAWATER.items():
        name = term.find(file)
        if name is None:
            continue
        try:
            values = file.converted(name, term.unit)
        except UnitError as error:
            remarks.append(f"{error}; it is left out")
            continue
        used = find_rejected(file, [name]).without(name, values)
        if np.isfinite(values).any() and not np.isfinite(used).any():
            remarks.append(
                f"{file.path.name}: every value of {name} is flagged bad or missing, so it is left out; if the values "
                "are right, correct or remove the flags"
            )
            continue
        found[what] = used
    return found, tuple(remarks)


def describe_clock(file: ForeignFile, time: TimeArray) -> tuple[str, ...]:
    """Return a remark on the rows whose times ``(n,)`` are missing because the clock was not set."""
    name = TIME.require(file, "time")
    lost = np.flatnonzero(file.present(name) & np.isnat(time))
    if not len(lost):
        return ()
    return (
        f"{file.path.name}: {name} is not between {FIRST_YEAR} and {LAST_YEAR} in {counted(len(lost), 'row')}, the "
        f"first at row {lost[0]}; these are left out: correct the clock or the unit of time",
    )


def read_gps(file: ForeignFile) -> Fixes:
    """GPS fixes with a time and a position, in the order of the file."""
    names = [term.find(file) for term in (FIX_TIME, FIX_LATITUDE, FIX_LONGITUDE)]
    found = [name for name in names if name is not None]
    return read_fixes(file, found) if len(found) == len(names) else Fixes.none()


def describe_fixes(file: ForeignFile, fixes: Fixes) -> tuple[str, ...]:
    """Return a remark if a file has no GPS fix."""
    if len(fixes.time):
        return ()
    names = (*FIX_LATITUDE.names, *FIX_LONGITUDE.names)
    there = FIX_LATITUDE.find(file) and FIX_LONGITUDE.find(file)
    found = f"no position in {' and '.join(names)}" if there else f"no {' or '.join(names)}"
    positions = [name for name in ("LATITUDE", "LONGITUDE") if name in file]
    instead = f"; `gliderhpc currents` uses {' and '.join(positions)} at the surface" if len(positions) == 2 else ""
    return (f"{file.path.name}: has {found}, so there are no GPS fixes and no currents{instead}",)


def read_currents(file: ForeignFile, rows: npt.NDArray[np.int64], dives: Sequence[Span]) -> Columns:
    """Depth-averaged current of every dive (m/s), NaN where the file has none."""
    found = {name: term.find(file) for name, term in CURRENT.items()}
    file.check_lengths((TIME.require(file, "time"), *filter(None, found.values())))
    return {
        name: np.full(len(dives), np.nan)
        if source is None
        else medians_over(file.converted(source, "m s-1")[rows], dives)
        for name, source in found.items()
    }


def medians_over(values: FloatArray, dives: Sequence[Span]) -> FloatArray:
    """Median over each dive, NaN where it has no value; the files repeat the dive's current in every sample."""
    parts = [values[start:stop] for start, stop in dives]
    known = [part[np.isfinite(part)] for part in parts]
    return np.array([np.median(part) if len(part) else np.nan for part in known])


def read_flight_model(file: ForeignFile, dives: int) -> Columns:
    """Mass, volume and coefficients of the producer's flight model, the same for every dive; NaN where absent."""
    found: Columns = {}
    for name, term in {**FLIGHT_MODEL, **COEFFICIENTS}.items():
        source = term.find(file)
        if source is None:
            found[name] = np.full(dives, np.nan)
            continue
        values = file.converted(source, term.unit) if name in FLIGHT_MODEL else file.numbers(source)
        known = values[np.isfinite(values)]
        found[name] = np.full(dives, np.median(known) if len(known) else np.nan)
    return found


def read_speeds(file: ForeignFile) -> Columns:
    """Speeds through the water (m/s), at the times with a speed."""
    found = {name: term.find(file) for name, term in SPEED.items()}
    return reference_speeds(file, TIME.require(file, "time"), found)


MIN_STEP = 1.0
"""Minimum horizontal displacement (m) for which a dead reckoning determines its course."""

AGREEMENT = 1.0
"""Maximum deviation (degree) of course less heading from its median, in 90 % of the samples, for which a dead
reckoning gives the declination."""


@dataclass(frozen=True)
class Declination:
    """Declination to add to a heading.

    Attributes
    ----------
    angle : float
        Declination (degree).
    source : str
        Origin, as a phrase.
    known : bool
        True if the corrected heading refers to true north.
    """

    angle: float
    source: str
    known: bool = True


def find_declination(file: ForeignFile, heading: str, given: float | None) -> Declination:
    """Find the declination of a file's heading.

    Parameters
    ----------
    file : ForeignFile
        An OG1 file.
    heading : str
        Name of its heading variable.
    given : float, optional
        Declination given by the user (degree).
    """
    north = north_of(*(file.attribute(name, heading) for name in ("comment", "long_name", "standard_name")))
    if north is North.TRUE:
        unused = "" if given is None else f"; the given declination, {given:g} degree, is not used"
        return Declination(0.0, f"none: the file describes its heading as true{unused}")
    if given is not None:
        return Declination(given, "given by the user")
    if north is North.UNSTATED:
        return Declination(0.0, "none: the file does not describe its heading as magnetic, so it is taken as true")
    found = file_declination(file, file.names)
    if found is not None:
        return Declination(found.angle, f"the file's {found.name}")
    return _from_track(file, heading)


def _from_track(file: ForeignFile, heading: str) -> Declination:
    """Return the declination as the true course of the file's own dead reckoning less the magnetic heading."""
    names = [term.find(file) for term in (TRACK_NORTH, TRACK_EAST)]
    unknown = Declination(0.0, "unknown: the heading is left magnetic", known=False)
    if None in names:
        return unknown
    file.check_lengths((heading, *map(str, names)))
    north, east = (file.converted(str(name), "m") for name in names)
    course = np.degrees(np.arctan2(east, north))
    turned = wrap(course - file.converted(heading, "degree"))[np.hypot(north, east) > MIN_STEP]
    turned = turned[np.isfinite(turned)]
    if len(turned) == 0:
        return unknown
    centre = turned[0] + float(np.median(wrap(turned - turned[0])))
    if np.quantile(np.abs(wrap(turned - centre)), 0.9) > AGREEMENT:
        return unknown
    return Declination(float(centre), "the file's dead reckoning: its true course less the magnetic heading")
