"""Forms of an OG1 file: the full one with all results, and the strict one for data centres.

The strict file has the variables of the OG1 manual and nothing else, each with its term; the file ``og1_terms.yaml``
lists the terms with their sources. OG1 has no terms for standard deviations, disturbances, controls, and the vertical
velocity of the water; only the full file contains these.
"""

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from importlib import resources

import numpy as np
from numpy.typing import NDArray

from gliderhpc.archive.profile import ProfileData
from gliderhpc.archive.reader import Archive
from gliderhpc.observations.files.appended import Column
from gliderhpc.observations.files.discovery import MEASUREMENT, content_type
from gliderhpc.report.exports.og1_dives import dive_columns
from gliderhpc.report.exports.og1_rows import Rows, names_of
from gliderhpc.report.exports.og1_vocabulary import (
    AXIS,
    MEASURED_TERMS,
    PHASES,
    TERMS,
    WITH_QC,
    Og1Term,
    flags,
    quality_control,
    quantity,
)
from gliderhpc.yaml_text import parse_yaml

_COORDINATES = frozenset({"TIME", "LATITUDE", "LONGITUDE", "DEPTH", "TIME_GPS", "LATITUDE_GPS", "LONGITUDE_GPS"})

_FILE = "og1_terms.yaml"


def _read_terms() -> dict[str, str]:
    content = parse_yaml((resources.files(__package__) / _FILE).read_text("utf-8"), _FILE)
    return {name: f"{content['collection']}{entry['term']}/" for name, entry in content["variables"].items()}


VOCABULARY: Mapping[str, str] = _read_terms()
"""Address of the OG1 term of each variable that has one."""

DIRECTIONS = {"ascending": -1, "neither": 0, "descending": 1}
"""Values of PROFILE_DIRECTION."""

RECKONINGS = {"position_of_a_fix": 0, "dead_reckoning": 1}
"""Values of DEAD_RECKONING."""

_NO_POSITION = -1
_COMPUTED = ("ROLL", "PITCH", "HEADING", "WCUR_X", "WCUR_Y")
_SAME = ("TIME", "LATITUDE", "LONGITUDE", "DEPTH", "TIME_GPS", "LATITUDE_GPS", "LONGITUDE_GPS", "PROFILE_NUMBER",
         "PHASE", "ROLL", "PITCH", "HEADING")  # fmt: skip
_OLDER_NAMES = frozenset({"time_vocabulary", "latitude_vocabulary", "longitude_vocabulary", "depth_vocabulary"})
"""Attributes that the manual replaced by `vocabulary` in December 2025."""


def _strict_terms() -> Iterator[Og1Term]:
    for name in _SAME:
        term = TERMS[name]
        yield Og1Term(
            name, term.dtype, {key: text for key, text in term.attributes.items() if key not in _OLDER_NAMES}, term.fill
        )
    yield Og1Term(
        "SEGMENT_NUMBER",
        "i4",
        {
            "long_name": "number of the segment from surfacing to surfacing",
            "units": "1",
            "comment": "number of the profile in the archive; a row of a fix has that of its segment",
        },
    )
    yield flags("PROFILE_DIRECTION", "vertical direction of the profile", "flag_values", DIRECTIONS)
    reckoned = flags("DEAD_RECKONING", "whether the position is computed by dead reckoning", "flag_values", RECKONINGS)
    yield Og1Term(reckoned.name, reckoned.dtype, reckoned.attributes, _NO_POSITION)
    for name, towards in (("WCUR_X", "east"), ("WCUR_Y", "north")):
        yield quantity(
            name,
            "m s-1",
            f"depth-averaged current to the {towards}",
            standard_name=f"{towards}ward_sea_water_velocity",
            observation_type="calculated",
            comment="one value per dive, in the row of the fix after it: mean between the fixes before and after the "
            "dive, by dead reckoning, without the drift at the surface",
        )
    yield from map(quality_control, (*WITH_QC, *_COMPUTED))


COMMUNITY_TERMS: Mapping[str, Og1Term] = {term.name: term for term in _strict_terms()}
"""Variables of the file along the axis of measurements, by name."""


@dataclass(frozen=True)
class Og1Form:
    """Form of an OG1 file.

    Attributes
    ----------
    summary, comment : str
        Global attributes that describe the content.
    columns : callable
        Function that makes the columns of a profile from its data and from the rows of the full file.
    settings : callable
        Function that returns the global attributes about hull and settings from the archive.
    described : callable
        Function that selects the operator's global attributes.
    """

    summary: str
    comment: str
    columns: Callable[[ProfileData, Rows], dict[str, Column]]
    settings: Callable[[Archive], dict[str, str]]
    described: Callable[[Mapping[str, str]], dict[str, str]]


def community_rows(rows: Rows) -> Rows:
    """Return the rows of a strict file from those of the full file.

    Parameters
    ----------
    rows : dict of str to (m,) array
        Rows of one profile, as returned by `profile_rows`.
    """
    phase, fixed = rows["PHASE"], np.isfinite(rows["LATITUDE_GPS"].astype(np.float64))
    reckoned = np.where(fixed, RECKONINGS["position_of_a_fix"], RECKONINGS["dead_reckoning"])
    directions = [PHASES["descent"], PHASES["ascent"]]
    strict: Rows = {name: rows[name] for name in _SAME}
    strict |= {
        "SEGMENT_NUMBER": rows["DIVE_NUMBER"],
        "PROFILE_DIRECTION": np.select([phase == code for code in directions], [1, -1], 0),
        "DEAD_RECKONING": np.where(np.isfinite(rows["LATITUDE"].astype(np.float64)), reckoned, _NO_POSITION),
        "WCUR_X": _after_the_dive(rows["DAVG_CURR_EAST"], fixed),
        "WCUR_Y": _after_the_dive(rows["DAVG_CURR_NORTH"], fixed),
    }
    strict |= {f"{name}_QC": np.zeros(len(phase)) for name in (*WITH_QC, *_COMPUTED)}
    return {name: strict[name].astype(term.dtype) for name, term in COMMUNITY_TERMS.items()}


def _after_the_dive(current: NDArray[np.generic], fixed: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return a dive's current in the row of the dive's last fix, and NaN in all others."""
    last = np.flatnonzero(fixed)[-1:]
    values = np.full(len(current), np.nan)
    values[last] = current[last]
    return values


def _full_columns(data: ProfileData, rows: Rows) -> dict[str, Column]:
    return {name: _column(TERMS[name], rows) for name in names_of(rows)} | dive_columns(data)


def _strict_columns(data: ProfileData, rows: Rows) -> dict[str, Column]:
    strict = community_rows(rows)
    return {name: _column(term, strict) for name, term in COMMUNITY_TERMS.items()}


def _hull_and_settings(tree: Archive) -> dict[str, str]:
    return {
        "gliderhpc_platform": json.dumps(tree.attrs.get("platform", {})),
        "gliderhpc_settings": json.dumps(tree.attrs.get("settings", {})),
    }


def _no_settings(tree: Archive) -> dict[str, str]:
    return {}


def _in_lower_case(described: Mapping[str, str]) -> dict[str, str]:
    """Select the attributes in lower case.

    The only others in OG1 are ``Conventions`` and ``featureType``, which the export itself sets.
    """
    return {name: text for name, text in described.items() if name.islower()}


def _column(term: Og1Term, rows: Rows) -> Column:
    name, values = term.name, rows[term.name]
    if term.fill is not None:
        values = np.where(np.isfinite(values.astype(np.float64)), values, term.fill)
    measured = name in MEASURED_TERMS
    further = {"coverage_content_type": MEASUREMENT if measured else content_type(name, coordinates=_COORDINATES)}
    if name in VOCABULARY:
        further["vocabulary"] = VOCABULARY[name]
    ancillary = [f"{name}{suffix}" for suffix in ("_QC", "_STD") if f"{name}{suffix}" in rows]
    if ancillary:
        further["ancillary_variables"] = " ".join(ancillary)
    # Flag values have the number type of their variable (CF 3.5).
    attributes = {
        key: np.array(value, dtype=term.dtype) if isinstance(value, list) else value
        for key, value in {**term.attributes, **further}.items()
    }
    return Column((AXIS,), values, attributes, fill=term.fill)


FULL = Og1Form(
    summary="Records of an underwater glider, and estimates from them by its flight model: forces and moments of the "
    "water, motion, speed through the water, currents averaged over the dives, and positions under water",
    comment="Forces, moments, motion and currents from attitude, depth and actuators. ADJOINT: windowed adjoint "
    "inversion, the primary estimate; SMOOTHED: fixed-interval smoother, or the filter's estimate, without standard "
    "deviations, where the smoother has none. HEADING is true.",
    columns=_full_columns,
    settings=_hull_and_settings,
    described=dict,
)
"""File with all results."""

STRICT = Og1Form(
    summary="Attitude and depth of an underwater glider, positions under water by dead reckoning, and currents "
    "averaged over the dives, by a flight model",
    comment="Positions and currents from attitude, depth, actuators and GPS fixes by a flight model. HEADING is true.",
    columns=_strict_columns,
    settings=_no_settings,
    described=_in_lower_case,
)
"""File for data centres, with the variables of the OG1 manual alone."""
