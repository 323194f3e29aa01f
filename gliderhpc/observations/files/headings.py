"""Reference of a heading, magnetic or true, by the words of its file; and the declination that the file gives."""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum

import numpy as np

from gliderhpc.observations.files.columns import NamedColumns, find_name


class North(Enum):
    """Reference of a heading."""

    TRUE = "true"
    MAGNETIC = "magnetic"
    UNSTATED = "unstated"


_ANGLE = r"(?:magnetic )?(?:declination|variation|deviation|magvar|m gps mag var)"
_UNCORRECTED = re.compile(
    rf"(?:\bnot|\bnever|\bwithout|\bno)\b[^.;]{{0,40}}?(?:correct\w*|\badd\w*|\bappl\w*|{_ANGLE})|\buncorrected\b"
    rf"|\b(?:must|should|has|have|still)(?: still)?(?: to)? be added\b|\badd (?:the )?{_ANGLE}"
    r"|\bnot (?:a )?true\b|\bleft magnetic\b|\b(?:relative|referred) to magnetic north\b"
)
_CORRECTED = re.compile(
    rf"\bcorrected (?:for|with|by|using) (?:the )?(?:[\w']+ ){{0,2}}?{_ANGLE}|\bcorrected (?:to|for) true\b"
    rf"|{_ANGLE}[^.;]{{0,20}}?\b(?:corrected|added|applied|included|removed|taken into account)\b"
    rf"|\b(?:plus|less|added|adding|includes|including)(?: the)? (?:[\w']+ ){{0,2}}?{_ANGLE}"
    r"|\bdegrees added \((?:the file's|given)"
)
_NOT_MAGNETIC = re.compile(r"\bnon?t?[ -]magnetic\b")
_NOT_STATED = re.compile(r"\(none: the file does not[^)]*\)")
"""Remark of the OG1 importer that the file says nothing about its heading."""
_TRUE = re.compile(
    r"\btrue (?:heading|north|bearing|course)\b|\bheading (?:is |as )?true\b|\(true\)|\bgeographic north\b"
)
_MAGNETIC = re.compile(r"\bmagnetic\b(?! (?:declination|variation|deviation))")


def north_of(*texts: str) -> North:
    """Reference of a heading by the texts of its attributes.

    A statement that the declination is missing decides first, then one that it is included. Otherwise whichever of the
    words `true heading` and `magnetic` comes first decides.
    """
    text = _NOT_STATED.sub("", re.sub(r"[_\s]+", " ", " ; ".join(texts).lower()))
    if _NOT_MAGNETIC.search(text):
        return North.TRUE
    if _UNCORRECTED.search(text) and "magnetic" in text:
        return North.MAGNETIC
    if _CORRECTED.search(text):
        return North.TRUE
    true, magnetic = _TRUE.search(text), _MAGNETIC.search(text)
    if magnetic is None:
        return North.UNSTATED if true is None else North.TRUE
    return North.TRUE if true is not None and true.start() < magnetic.start() else North.MAGNETIC


VEHICLE_COLUMNS = ("Heading", "m_heading")
"""Columns of a vehicle's own files with its magnetic heading; pyglider copies them and names them in `source`."""


@dataclass(frozen=True)
class FileDeclination:
    """Declination that a file gives.

    Attributes
    ----------
    angle : float
        Declination, positive where magnetic north lies east of true north (degree).
    name : str
        Variable that it comes from.
    """

    angle: float
    name: str


_SIGNS = {"magnetic_variation": 1.0, "m_gps_mag_var": -1.0, "magvar": 1.0, "declination": 1.0}
"""Names of a declination, and the sign to multiply it with. A Slocum's is the magnetic less the true heading."""

_UNDECLARED = {"m_gps_mag_var": "rad"}


def file_declination(columns: NamedColumns, names: Iterable[str]) -> FileDeclination | None:
    """Median declination of a file; None if it has none, or none between -180 and 180 degrees.

    Parameters
    ----------
    columns : NamedColumns
        The file.
    names : iterable of str
        Names of its variables, those without a dimension included.

    Raises
    ------
    InputError
        The unit of the declination cannot be converted to degrees.
    """
    name = find_name(names, tuple(_SIGNS))
    if name is None:
        return None
    wanted = name.casefold()
    values = columns.converted(name, "degree", undeclared=_UNDECLARED.get(wanted))
    known = values[np.isfinite(values) & (np.abs(np.nan_to_num(values)) <= 180.0)]
    return FileDeclination(_SIGNS[wanted] * float(np.median(known)), name) if known.size else None
