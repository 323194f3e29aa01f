"""Which north a file's heading refers to, and what turns it to true north."""

from dataclasses import dataclass

import numpy as np

from gliderhpc.observations.foreign import ForeignFile
from gliderhpc.observations.og1 import vocabulary
from gliderhpc.observations.records import FloatArray

LEAST_STEP = 1.0
"""Shorter horizontal displacements of a dead reckoning (m) say nothing of its course."""

AGREEMENT = 1.0
"""A dead reckoning gives the declination only where its course less the heading is this constant (degree)."""


@dataclass(frozen=True)
class Declination:
    """What is added to a heading.

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
        What the user says (degree).
    """
    if given is not None:
        return Declination(given, "given by the user")
    described = " ".join(file.attribute(name, heading) for name in ("comment", "long_name", "standard_name"))
    if "magnetic" not in described.lower():
        return Declination(0.0, "none: the file does not call its heading magnetic, so it is taken as true")
    name = vocabulary.DECLINATION.find(file)
    if name is not None and np.isfinite(file.converted(name, "degree")).any():
        return Declination(float(np.nanmedian(file.converted(name, "degree"))), f"the file's {name}")
    return _from_track(file, heading)


def _from_track(file: ForeignFile, heading: str) -> Declination:
    """Compare the heading with the true course of the file's own dead reckoning."""
    names = [term.find(file) for term in (vocabulary.TRACK_NORTH, vocabulary.TRACK_EAST)]
    unknown = Declination(0.0, "unknown: the heading is magnetic and stays so", known=False)
    if None in names:
        return unknown
    file.check_lengths((heading, *map(str, names)))
    north, east = (file.converted(str(name), "m") for name in names)
    course = np.degrees(np.arctan2(east, north))
    turned = _wrap(course - file.converted(heading, "degree"))[np.hypot(north, east) > LEAST_STEP]
    turned = turned[np.isfinite(turned)]
    if len(turned) == 0:
        return unknown
    centre = turned[0] + float(np.median(_wrap(turned - turned[0])))
    if np.quantile(np.abs(_wrap(turned - centre)), 0.9) > AGREEMENT:
        return unknown
    return Declination(float(centre), "the file's dead reckoning: its true course less the magnetic heading")


def _wrap(degrees: FloatArray) -> FloatArray:
    return np.mod(degrees + 180.0, 360.0) - 180.0
