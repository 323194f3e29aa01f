"""Names under which OG1 files carry what an observation file needs, and the declination of their heading.

The OG1 vocabulary has none for a glider's controls: those here are what Seaglider files have on their way into OG1,
with the basestation's units and signs. A file may call its attitude otherwise; then the CF standard name finds it.
Names may be in capital or small letters.
"""

from dataclasses import dataclass

import numpy as np

from gliderhpc.errors import InputError
from gliderhpc.observations.foreign import ForeignFile, find_name
from gliderhpc.observations.records import FloatArray


@dataclass(frozen=True)
class Term:
    """One quantity.

    Attributes
    ----------
    names : tuple of str
        Names that variables of it have, the first found is taken.
    unit : str
        The unit that an observation file has it in.
    standard_names : tuple of str
        Its CF standard names, present and past; none where they would not be unambiguous.
    undeclared : str
        Its unit where a file does not say.
    """

    names: tuple[str, ...]
    unit: str
    standard_names: tuple[str, ...] = ()
    undeclared: str = ""

    def find(self, file: ForeignFile) -> str | None:
        """Name of the file's variable of this quantity, by name or by standard name."""
        named = find_name(file.names, self.names)
        if named is not None:
            return named
        return next((name for name in file.names if file.attribute("standard_name", name) in self.standard_names), None)

    def require(self, file: ForeignFile, what: str) -> str:
        """Name of the file's variable of this quantity.

        Raises
        ------
        InputError
            The file has none.
        """
        name = self.find(file)
        if name is None:
            raise InputError(f"{file.path}: has no {what} ({self.describe()})")
        return name

    def describe(self) -> str:
        """Names that are looked for, as a phrase."""
        return " or ".join(self.names)


TIME = Term(("TIME",), "s")
DEPTH = Term(("DEPTH", "GLIDER_DEPTH"), "m")
ATTITUDE = {
    "roll": Term(
        ("ROLL", "GLIDER_ROLL", "PLATFORM_ROLL"), "degree",
        ("platform_roll_starboard_down", "platform_roll", "platform_roll_angle"),
    ),
    "pitch": Term(
        ("PITCH", "GLIDER_PITCH", "PLATFORM_PITCH"), "degree",
        ("platform_pitch_fore_up", "platform_pitch", "platform_pitch_angle"),
    ),
    "heading": Term(
        ("HEADING", "GLIDER_HEADING", "PLATFORM_HEADING"), "degree",
        ("platform_orientation", "platform_yaw_fore_starboard", "platform_yaw", "platform_yaw_angle"),
    ),
}  # fmt: skip
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
FIX_LATITUDE = Term(("LATITUDE_GPS",), "degree")
FIX_LONGITUDE = Term(("LONGITUDE_GPS",), "degree")
DIVE = Term(("DIVE_NUMBER", "divenum"), "1")
DECLINATION = Term(("MAGNETIC_VARIATION", "magnetic_variation"), "degree")
TRACK_NORTH = Term(("NORTH_DISPLACEMENT",), "m")
TRACK_EAST = Term(("EAST_DISPLACEMENT",), "m")
CURRENT = {
    "reference_current_north": Term(("DAVG_CURR_NORTH",), "m s-1"),
    "reference_current_east": Term(("DAVG_CURR_EAST",), "m s-1"),
}
SPEED = {
    "reference_speed": Term(("GLIDE_SPEED",), "m s-1"),
    "reference_horizontal_speed": Term(("GLIDER_HORZ_VELO_MODEL",), "m s-1"),
    "reference_vertical_speed": Term(("GLIDER_VERT_VELO_MODEL",), "m s-1"),
}

MIN_STEP = 1.0
"""Shorter horizontal displacements of a dead reckoning (m) say nothing of its course."""

AGREEMENT = 1.0
"""A dead reckoning gives the declination only where its course less the heading is this constant (degree)."""


@dataclass(frozen=True)
class Declination:
    """Declination, which is added to a heading.

    Attributes
    ----------
    angle : float
        Degrees.
    source : str
        Where it comes from, as a phrase.
    known : bool
        Whether the heading refers to true north afterwards.
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
        Name of its heading.
    given : float, optional
        Declination given by the user (degree).
    """
    if given is not None:
        return Declination(given, "given by the user")
    described = " ".join(file.attribute(name, heading) for name in ("comment", "long_name", "standard_name"))
    if "magnetic" not in described.lower():
        return Declination(0.0, "none: the file does not call its heading magnetic, so it is taken as true")
    name = DECLINATION.find(file)
    if name is not None and np.isfinite(file.converted(name, "degree")).any():
        return Declination(float(np.nanmedian(file.converted(name, "degree"))), f"the file's {name}")
    return _from_track(file, heading)


def _from_track(file: ForeignFile, heading: str) -> Declination:
    """Compare the heading with the true course of the file's own dead reckoning."""
    names = [term.find(file) for term in (TRACK_NORTH, TRACK_EAST)]
    unknown = Declination(0.0, "unknown: the heading is magnetic and stays so", known=False)
    if None in names:
        return unknown
    file.check_lengths((heading, *map(str, names)))
    north, east = (file.converted(str(name), "m") for name in names)
    course = np.degrees(np.arctan2(east, north))
    turned = _wrap(course - file.converted(heading, "degree"))[np.hypot(north, east) > MIN_STEP]
    turned = turned[np.isfinite(turned)]
    if len(turned) == 0:
        return unknown
    centre = turned[0] + float(np.median(_wrap(turned - turned[0])))
    if np.quantile(np.abs(_wrap(turned - centre)), 0.9) > AGREEMENT:
        return unknown
    return Declination(float(centre), "the file's dead reckoning: its true course less the magnetic heading")


def _wrap(degrees: FloatArray) -> FloatArray:
    return np.mod(degrees + 180.0, 360.0) - 180.0
