"""Positions of the battery and volume of oil in the bladder, from either of the two layouts of the files.

Older files carry a column of positions for every control, sampled with the attitude. Newer ones have only the tables of
the guidance and control phases (``gc_*``): counts of the position sensors when a phase began and when it ended, and how
long each motor ran. Within a phase the motors run one after the other, battery forward or aft, oil, battery round, from
the phase's beginning on: on SG249 the pitch, the ballast's rate and the roll change in just these seconds.

A position is ``CNV * (count - C)`` with the conversion and the centre of the file's own log. The operator moves the
centres between dives, but the hull does not notice: every dive is referred to the centres of the mission's first one.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from gliderhpc.errors import InputError
from gliderhpc.observations.foreign import ForeignFile
from gliderhpc.observations.records import FloatArray, TimeArray

_SECOND = np.timedelta64(1, "s")


@dataclass(frozen=True)
class Control:
    """Names of one control in the files.

    Attributes
    ----------
    column : str
        Its column of positions, if there is one.
    table : str
        What its columns in the tables of phases begin with.
    conversion, centre : str
        Position per count, and the count at which the position is zero.
    """

    column: str
    table: str
    conversion: str
    centre: str


PITCH = Control("eng_pitchCtl", "gc_pitch", "log_PITCH_CNV", "log_C_PITCH")
BALLAST = Control("eng_vbdCC", "gc_vbd", "log_VBD_CNV", "log_C_VBD")
ROLL = Control("eng_rollCtl", "gc_roll", "log_ROLL_CNV", "log_C_ROLL_DIVE")

CONTROLS = (PITCH, BALLAST, ROLL)
"""In the order in which the motors run within a phase."""

Centres = Mapping[Control, float]
"""Counts to which the positions are referred."""


def read_centres(file: ForeignFile) -> dict[Control, float]:
    """Counts at which the file's own positions are zero.

    The battery's rotation has one centre for the dive and another for the climb; that of the dive is taken for both,
    because the battery stands where it stands.
    """
    return {control: file.number(control.centre) for control in CONTROLS}


def has_column(file: ForeignFile, control: Control) -> bool:
    """Return whether the file has the control's positions sample by sample."""
    return control.column in file and bool(np.isfinite(file.numbers(control.column)).any())


def position(file: ForeignFile, control: Control, time: TimeArray, centres: Centres) -> FloatArray:
    """Position of a control at the samples, in the log's unit (cm, cm3, degree).

    Parameters
    ----------
    file : ForeignFile
        A per-dive file.
    control : Control
        Which one.
    time : (n,) array
        The samples.
    centres : mapping of Control to float
        To which counts the position is referred.

    Raises
    ------
    InputError
        The file has neither a column nor a table of this control, or no conversion from counts.
    """
    if has_column(file, control):
        return file.numbers(control.column) + _recentring(file, control, centres)
    return _from_table(file, control, time) + _recentring(file, control, centres)


def _recentring(file: ForeignFile, control: Control, centres: Centres) -> float:
    shift = file.number(control.centre) - centres[control]
    moved = shift * file.number(control.conversion)
    # A file without a log says nothing of its centre: its positions stand as they are.
    return moved if np.isfinite(moved) else 0.0


def _from_table(file: ForeignFile, control: Control, time: TimeArray) -> FloatArray:
    """Interpolate between the ends of the motor's runs."""
    if "gc_st_secs" not in file:
        raise InputError(f"{file.path}: has neither {control.column} nor a table of guidance and control (gc_st_secs)")
    tables = (f"{each.table}_{column}" for each in CONTROLS for column in ("secs", "ad", "ad_start"))
    file.check_lengths(("gc_st_secs", *tables))
    begins, ends = _runs(file, control)
    before, after = _counts(file, control)
    known = np.isfinite(before) & np.isfinite(after)
    if not known.any():
        raise InputError(f"{file.path}: has neither {control.column} nor a position in {control.table}_ad")
    clock = np.column_stack([begins[known], ends[known]]).ravel()
    counts = np.column_stack([before[known], after[known]]).ravel()
    conversion, centre = file.number(control.conversion), file.number(control.centre)
    if not np.isfinite(conversion * centre):
        raise InputError(f"{file.path}: has no {control.conversion} and {control.centre} to convert counts with")
    seconds = (time - np.datetime64(0, "s")) / _SECOND
    return conversion * (np.interp(seconds, clock, counts) - centre)


def _runs(file: ForeignFile, control: Control) -> tuple[FloatArray, FloatArray]:
    """Times when the motor began and ended to run in every phase (s since 1970): after those that run before."""
    begins = file.numbers("gc_st_secs")
    for earlier in CONTROLS[: CONTROLS.index(control)]:
        begins = begins + _running(file, earlier)
    ends = begins + _running(file, control)
    # No run reaches into the next phase, whatever the logged seconds add up to.
    latest = np.append(file.numbers("gc_st_secs")[1:], np.inf)
    return np.minimum(begins, latest), np.minimum(ends, latest)


def _running(file: ForeignFile, control: Control) -> FloatArray:
    """Seconds that a motor ran in every phase; logged below zero where the oil was let in instead of pumped out."""
    return np.abs(np.nan_to_num(file.numbers(f"{control.table}_secs")))


def _counts(file: ForeignFile, control: Control) -> tuple[FloatArray, FloatArray]:
    """Counts before and after every phase; where the former is not logged the last phase's end stands for it."""
    after = file.numbers(f"{control.table}_ad")
    if f"{control.table}_ad_start" in file:
        return file.numbers(f"{control.table}_ad_start"), after
    return np.concatenate([after[:1], after[:-1]]), after
