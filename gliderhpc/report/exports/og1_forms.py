"""Forms of an OG1 file: the full one with all results, and the strict one for data centres."""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from gliderhpc.archive.profile import ProfileData
from gliderhpc.archive.reader import Archive
from gliderhpc.observations.files.appended import Column
from gliderhpc.observations.files.discovery import MEASUREMENT, content_type
from gliderhpc.report.exports.og1_community import COMMUNITY_TERMS, VOCABULARY, community_rows
from gliderhpc.report.exports.og1_dives import dive_columns
from gliderhpc.report.exports.og1_rows import Rows, names_of
from gliderhpc.report.exports.og1_vocabulary import AXIS, MEASURED_TERMS, TERMS, Og1Term

_COORDINATES = frozenset({"TIME", "LATITUDE", "LONGITUDE", "DEPTH", "TIME_GPS", "LATITUDE_GPS", "LONGITUDE_GPS"})


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
