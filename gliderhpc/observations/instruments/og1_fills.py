"""Undeclared fill values in OG1 files: values that no sensor can have measured are missing.

Fill values repeat the same few numbers. Many different impossible values are therefore a variable in another unit than
declared; these are left to the checks of the profiles, which name the variable and the unit.
"""

import numpy as np
import numpy.typing as npt

from gliderhpc.observations.checks.heading_values import MIN_DISTINCT, RANGE, describe_impossible, remove_turns
from gliderhpc.observations.files.columns import NEGATIVE_FILLS, USUAL_FILLS, Term, describe_fills, usual_fills
from gliderhpc.observations.files.foreign import ForeignFile
from gliderhpc.observations.format import CONTROLS, VARIABLES
from gliderhpc.observations.instruments.og1_variables import (
    ATTITUDE,
    BALLAST,
    BATTERY,
    DEPTH,
    FIX_LATITUDE,
    FIX_LONGITUDE,
    RUDDER,
    SEAWATER,
    sense_of_depth,
)
from gliderhpc.observations.records import FloatArray

HUGE = 1e30
"""Magnitude at or above which a value is a fill value, such as the netCDF library's 9.96921e36."""

_TERMS: dict[str, Term] = {
    "depth": DEPTH,
    **ATTITUDE,
    "ballast_volume": BALLAST,
    **BATTERY,
    "rudder": RUDDER,
    **SEAWATER,
    "fix_latitude": FIX_LATITUDE,
    "fix_longitude": FIX_LONGITUDE,
}
"""Variables that are checked, by their names in the observation format."""


def reject_fills(file: ForeignFile) -> tuple[str, ...]:
    """Treat undeclared fill values as missing from now on; return a remark for each variable that has them.

    Raises
    ------
    InputError
        Most headings are impossible and differ from each other, or a unit cannot be converted.
    """
    masks: dict[str, npt.NDArray[np.bool_]] = {}
    remarks: list[str] = []
    for what, term in _TERMS.items():
        name = term.find(file)
        if name is None:
            continue
        values = _in_our_unit(file, what, term, name)
        if what == "heading":
            values, turns = remove_turns(values, f"{file.path}: {name}")
            remarks += [f"{file.path.name}: {name} {turns}"] if turns else []
        lost = _fills(file.numbers(name), values, what)
        if lost.any():
            if what == "heading":
                describe_impossible(values, lost, f"{file.path}: {name}")
            masks[name] = lost
            remarks.append(f"{file.path.name}: {_describe(name, what, term, values, lost)}")
    file.reject(masks)
    return tuple(remarks)


def _in_our_unit(file: ForeignFile, what: str, term: Term, name: str) -> FloatArray:
    """Values in the unit and sense of the observation format, NaN where missing; of the water as stored."""
    if what in SEAWATER:
        # A variable whose unit cannot be converted is left out when it is read.
        return file.numbers(name)
    sense = sense_of_depth(file, name) if what == "depth" else 1.0
    return sense * file.converted(name, term.unit, undeclared=term.undeclared or None)


def _range(what: str) -> tuple[float, float]:
    """Range of possible values; controls have none, since few different ones may well be in another unit."""
    if what in CONTROLS:
        return float("-inf"), float("inf")
    return RANGE if what == "heading" else (VARIABLES[what].low, VARIABLES[what].high)


def _fills(stored: FloatArray, values: FloatArray, what: str) -> npt.NDArray[np.bool_]:
    """Mask ``(n,)`` of the values, as stored and converted, that are not measurements."""
    low, high = _range(what)
    with np.errstate(invalid="ignore"):
        usual = np.abs(stored) >= HUGE
        outside = (values < low) | (values > high)
    # A depth in centimetres may well be 9999, but in metres it is not.
    usual |= np.isin(stored, NEGATIVE_FILLS if what == "depth" else USUAL_FILLS) | usual_fills(values)
    if what == "heading":
        # An impossible heading would become another angle.
        return np.asarray(usual | outside)
    in_another_unit = (
        len(np.unique(values[outside & ~usual])) >= MIN_DISTINCT or not (np.isfinite(values) & ~outside).any()
    )
    return np.asarray(usual if in_another_unit else usual | outside)


def _describe(name: str, what: str, term: Term, values: FloatArray, lost: npt.NDArray[np.bool_]) -> str:
    """Sentence that counts the fill values of a variable, with the remedy."""
    low, high = _range(what)
    first = int(np.flatnonzero(lost)[0])
    impossible = not low <= values[first] <= high
    outside = f"is outside {low:g} to {high:g} {term.unit}"
    return describe_fills(name, values, lost, outside) if impossible else describe_fills(name, values, lost)
