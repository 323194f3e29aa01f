"""Undeclared fill values in OG1 files: they are treated as missing, with a remark for each variable."""

import numpy as np
import numpy.typing as npt

from gliderhpc.observations.checks.heading_values import describe_impossible, remove_turns
from gliderhpc.observations.files.columns import Term, describe_fills
from gliderhpc.observations.files.fills import MeasuredVariable
from gliderhpc.observations.files.foreign import ForeignFile
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
        measured = MeasuredVariable(what, file.numbers(name), values)
        if measured.fills.any():
            if what == "heading":
                describe_impossible(values, measured.fills, f"{file.path}: {name}")
            masks[name] = measured.fills
            remarks.append(f"{file.path.name}: {_describe(name, term, measured)}")
    file.reject(masks)
    return tuple(remarks)


def _in_our_unit(file: ForeignFile, what: str, term: Term, name: str) -> FloatArray:
    """Values in the unit and sense of the observation format, NaN where missing; of the water as stored."""
    if what in SEAWATER:
        # A variable whose unit cannot be converted is left out when it is read.
        return file.numbers(name)
    sense = sense_of_depth(file, name) if what == "depth" else 1.0
    return sense * file.converted(name, term.unit, undeclared=term.undeclared or None)


def _describe(name: str, term: Term, measured: MeasuredVariable) -> str:
    """Sentence that counts the fill values of a variable, with the remedy."""
    (low, high), lost, values = measured.limits, measured.fills, measured.values
    impossible = not low <= values[int(np.flatnonzero(lost)[0])] <= high
    outside = f"is outside {low:g} to {high:g} {term.unit}"
    return describe_fills(name, values, lost, outside) if impossible else describe_fills(name, values, lost)
