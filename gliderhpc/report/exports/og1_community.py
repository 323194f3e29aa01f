"""Strict OG1 file for data centres: the variables of the OG1 manual and nothing else, each with its term.

The file ``og1_terms.yaml`` lists the terms with their sources. OG1 has no terms for standard deviations, disturbances,
controls, and the vertical velocity of the water; only the full file contains these.
"""

from collections.abc import Iterator, Mapping
from importlib import resources

import numpy as np
from numpy.typing import NDArray

from gliderhpc.report.exports.og1_rows import Rows
from gliderhpc.report.exports.og1_vocabulary import PHASES, TERMS, WITH_QC, Og1Term, flags, quality_control, quantity
from gliderhpc.yaml_text import parse_yaml

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


def _terms() -> Iterator[Og1Term]:
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


COMMUNITY_TERMS: Mapping[str, Og1Term] = {term.name: term for term in _terms()}
"""Variables of the file along the axis of measurements, by name."""


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
