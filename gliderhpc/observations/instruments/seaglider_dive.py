"""One dive from a Seaglider's per-dive netCDF file: samples, controls, fixes and CTD.

The controls (battery position and rotation, and oil volume in the bladder) are stored in one of two layouts. Older
files have a column of positions for every control, sampled with the attitude. Newer files have only the tables of the
guidance and control phases (``gc_*``): counts of the position sensors at the beginning and end of each phase, and the
running time of each motor. From the beginning of a phase the motors run one after the other: battery forward or aft,
oil, battery rotation. On SG249 the pitch, the ballast rate and the roll change in exactly these seconds.

A position is ``CNV * (count - C)`` with the conversion and the centre of the file's own log. The operator changes the
centres between dives, which does not change the physical position. Every dive is therefore referred to the centres of
the mission's first dive.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from gliderhpc.errors import InputError
from gliderhpc.observations.checks.heading_values import RANGE, describe_impossible, outside, remove_turns
from gliderhpc.observations.checks.sign_checks import refuse_negative_depth
from gliderhpc.observations.checks.validation import clock_set_back
from gliderhpc.observations.files.columns import UnitError
from gliderhpc.observations.files.fills import MeasuredVariable
from gliderhpc.observations.files.foreign import ForeignFile
from gliderhpc.observations.files.valid_limits import check_limits
from gliderhpc.observations.fixes import Fixes, decimal_degrees
from gliderhpc.observations.importing.dive_files import check_samples, read_fixes
from gliderhpc.observations.importing.excursions import in_excursion
from gliderhpc.observations.importing.position_form import may_be_minutes
from gliderhpc.observations.importing.rows import Columns, increasing
from gliderhpc.observations.intervals import local_intervals
from gliderhpc.observations.nearest import onto_nearest
from gliderhpc.observations.profiles import SURFACE_DEPTH, dive_span
from gliderhpc.observations.records import FloatArray, TimeArray
from gliderhpc.observations.times import FIRST_YEAR, LAST_YEAR, SECOND, epoch_seconds


@dataclass(frozen=True)
class Control:
    """Names of one control in the files.

    Attributes
    ----------
    column : str
        Name of its column of positions, if there is one.
    table : str
        Prefix of its column names in the tables of phases.
    conversion, centre : str
        Names of the variables with the position per count, and with the count at which the position is zero.
    """

    column: str
    table: str
    conversion: str
    centre: str


PITCH = Control("eng_pitchCtl", "gc_pitch", "log_PITCH_CNV", "log_C_PITCH")
BALLAST = Control("eng_vbdCC", "gc_vbd", "log_VBD_CNV", "log_C_VBD")
ROLL = Control("eng_rollCtl", "gc_roll", "log_ROLL_CNV", "log_C_ROLL_DIVE")

CONTROLS = (PITCH, BALLAST, ROLL)
"""Controls in the order in which the motors run within a phase."""

_QUANTITIES = {PITCH: "battery_position", BALLAST: "ballast_volume", ROLL: "battery_rotation"}
"""Names of the controls in the observation format."""

Centres = Mapping[Control, float]
"""Counts to which the positions are referred."""


def read_centres(file: ForeignFile) -> dict[Control, float]:
    """Counts at which the file's own positions are zero.

    The battery's rotation has one centre for the dive and another for the climb. The centre of the dive is used for
    both, because the change of centre does not move the battery.
    """
    return {control: file.number(control.centre) for control in CONTROLS}


def has_column(file: ForeignFile, control: Control) -> bool:
    """Return whether the file has the control's position at every sample."""
    return control.column in file and bool(np.isfinite(file.numbers(control.column)).any())


def position(file: ForeignFile, control: Control, time: TimeArray, centres: Centres) -> FloatArray:
    """Position of a control at the samples, in the log's unit (cm, cm3, degree).

    Parameters
    ----------
    file : ForeignFile
        A per-dive file.
    control : Control
        Control of interest.
    time : (n,) array
        Times of the samples.
    centres : mapping of Control to float
        Counts to which the position is referred.

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
    # A file without a log has no centre, so its positions are left unchanged.
    return moved if np.isfinite(moved) else 0.0


def _from_table(file: ForeignFile, control: Control, time: TimeArray) -> FloatArray:
    """Interpolate the position between the begins and ends of the motor's runs."""
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
        raise InputError(
            f"{file.path}: lacks {control.conversion} or {control.centre}, which convert counts to positions"
        )
    seconds = epoch_seconds(time)
    return conversion * (np.interp(seconds, clock, counts) - centre)


def _runs(file: ForeignFile, control: Control) -> tuple[FloatArray, FloatArray]:
    """Times of the start and stop of the motor in every phase (s since 1970); it runs after the preceding motors."""
    begins = file.numbers("gc_st_secs")
    for earlier in CONTROLS[: CONTROLS.index(control)]:
        begins = begins + _running(file, earlier)
    ends = begins + _running(file, control)
    # A run is cut off at the beginning of the next phase, even if the logged seconds add up to more.
    latest = np.append(file.numbers("gc_st_secs")[1:], np.inf)
    return np.minimum(begins, latest), np.minimum(ends, latest)


def _running(file: ForeignFile, control: Control) -> FloatArray:
    """Running time of a motor in every phase (s); the log is negative if oil was bled in rather than pumped out."""
    return np.abs(np.nan_to_num(file.numbers(f"{control.table}_secs")))


def _counts(file: ForeignFile, control: Control) -> tuple[FloatArray, FloatArray]:
    """Counts before and after every phase; if the former are not logged, those after the preceding phase are taken."""
    after = file.numbers(f"{control.table}_ad")
    if f"{control.table}_ad_start" in file:
        return file.numbers(f"{control.table}_ad_start"), after
    return np.concatenate([after[:1], after[:-1]]), after


REJECTED_FLAG = "4"
"""Flag of a fix that the basestation rejected."""

_CTD = {
    "temperature": ("temperature", "temperature_raw", "degC"),
    "practical_salinity": ("salinity", "salinity_raw", "1"),
}


@dataclass(frozen=True, eq=False)
class Dive:
    """Content of one dive's file.

    Attributes
    ----------
    variables : dict of str to (n,) array
        Samples in the units of the observation format, including time and the controls.
    start, stop : int
        First sample below the surface and the sample after the last.
    fixes : Fixes
        GPS fixes in the order of the file.
    declination : float
        Declination added to the magnetic heading (degree); NaN if it is unknown and none was added.
    rows_dropped : int
        Number of dropped samples, whose time was missing or did not increase.
    remarks : tuple of str
        Sentences on impossible headings, and on variables of the water that are left out.
    fills : dict of str to int
        Number of undeclared fill values by variable of the file; they are treated as missing.
    """

    variables: Columns
    start: int
    stop: int
    fixes: Fixes
    declination: float
    rows_dropped: int
    remarks: tuple[str, ...] = ()
    fills: Mapping[str, int] = field(default_factory=dict)

    @property
    def magnetic_heading(self) -> FloatArray:
        """Heading (degree) without the declination, ``(n,)``."""
        declination = self.declination if np.isfinite(self.declination) else 0.0
        return np.asarray(self.variables["heading"].astype(np.float64) - declination)

    def turned(self, declination: float) -> "Dive":
        """Return the dive with another declination (degree)."""
        heading = np.mod(self.magnetic_heading + declination, 360.0)
        return replace(self, variables=self.variables | {"heading": heading}, declination=declination)


def read_dive(file: ForeignFile, centres: Centres) -> Dive:
    """Read one dive.

    Parameters
    ----------
    file : ForeignFile
        A per-dive file.
    centres : mapping of Control to float
        Counts of the sensors to which the controls are referred.

    Raises
    ------
    InputError
        The file lacks attitude, depth or a control, its depth is negative, its clock was set back, it has no plausible
        time, or it is truncated.
    ProfileError
        The file contains no dive, or one that is too shallow.
    """
    time = file.times("time")
    depth_name = file.first(["depth", "eng_depth"])
    if depth_name is None:
        raise InputError(f"{file.path}: has no depth")
    fills = _reject_fills(file, depth_name)
    declination = _declination(file)
    remarks: list[str] = []
    samples: Columns = {
        "time": time,
        "depth": file.converted(depth_name, "m"),
        "roll": file.converted("eng_rollAng", "degree"),
        "pitch": file.converted("eng_pitchAng", "degree"),
        "heading": np.mod(_magnetic_heading(file, remarks) + np.nan_to_num(declination), 360.0),
        # The file's positions increase aft.
        "battery_position": -0.01 * position(file, PITCH, time, centres),
        "battery_rotation": position(file, ROLL, time, centres),
        "ballast_volume": position(file, BALLAST, time, centres),
    }
    pressure = _water(file, "pressure", "dbar", remarks) if "pressure" in file else None
    if pressure is not None:
        samples["pressure"] = pressure
    check_samples(samples, str(file.path), "is not sampled with time; give a per-dive file of the basestation")
    _check_clock(file, time)
    keep = increasing(time)
    if len(keep) and not keep.any():
        units = file.attribute("units", "time")
        raise InputError(
            f"{file.path}: none of its {len(keep)} times is in the years {FIRST_YEAR} to {LAST_YEAR}: time is in "
            f"'{units}'; correct its units"
        )
    samples = {name: values[keep] for name, values in samples.items()}
    samples |= _ctd(file, samples["time"].astype("datetime64[ns]"), remarks)
    remarks += check_limits(file, (depth_name, "eng_rollAng", "eng_pitchAng", "eng_head"))
    depth = samples["depth"].astype(np.float64)
    refuse_negative_depth(depth, str(file.path), depth_name)
    start, stop = _submerged(file, depth)
    fixes = _fixes(file, remarks)
    lost = int(np.count_nonzero(~keep))
    return Dive(samples, start, stop, fixes, declination, lost, tuple(remarks), fills)


def _reject_fills(file: ForeignFile, depth: str) -> dict[str, int]:
    """Treat undeclared fill values as missing from now on; return their number by variable, for those that have any."""
    columns = [
        ("depth", depth, "m"),
        ("roll", "eng_rollAng", "degree"),
        ("pitch", "eng_pitchAng", "degree"),
        *((quantity, control.column, None) for control, quantity in _QUANTITIES.items()),
        ("pressure", "pressure", None),
        *((quantity, file.first(names) or "", None) for quantity, (*names, _) in _CTD.items()),
    ]
    masks: dict[str, npt.NDArray[np.bool_]] = {}
    for quantity, name, unit in columns:
        if name in file:
            stored = file.numbers(name)
            fills = MeasuredVariable(quantity, stored, file.converted(name, unit) if unit else stored).fills
            masks |= {name: fills} if fills.any() else {}
    file.reject(masks)
    return {name: int(np.count_nonzero(mask)) for name, mask in masks.items()}


def _magnetic_heading(file: ForeignFile, remarks: list[str]) -> FloatArray:
    """Magnetic heading (degree), NaN with a remark where it is impossible.

    Raises
    ------
    InputError
        Most headings are impossible and differ from each other.
    """
    heading, turns = remove_turns(file.converted("eng_head", "degree"), f"{file.path}: eng_head")
    if turns:
        remarks.append("eng_head is beyond -180 to 360 degree; whole turns are removed")
    lost = outside(heading)
    if not lost.any():
        return heading
    describe_impossible(heading, lost, f"{file.path}: eng_head")
    remarks.append(f"values of eng_head outside {RANGE[0]:g} to {RANGE[1]:g} degree are treated as missing")
    return np.where(lost, np.nan, heading)


def _check_clock(file: ForeignFile, time: TimeArray) -> None:
    """Refuse a dive in which the clock was set back, for more than a few rows; the order of its rows is unknown."""
    step = clock_set_back(time[~in_excursion(time, brief=True)])
    if step is not None:
        raise InputError(f"{file.path}: the clock was set back by {step:.0f} s during the dive")


def _declination(file: ForeignFile) -> float:
    """Declination in the file (degree): that of the dive, or the one reported with the fixes; NaN without any."""
    for name in ("magnetic_variation", "log_gps_magvar"):
        values = file.converted(name, "degree") if name in file else np.zeros(0)
        known = values[np.isfinite(values)]
        if len(known):
            return float(np.median(known))
    return float("nan")


def _submerged(file: ForeignFile, depth: FloatArray) -> tuple[int, int]:
    """Find the dive, between the depth of the flare at the end of the initial plunge and the depth of surfacing.

    Above these depths the glider floats, or hangs nose down while oil is bled in. The model does not describe this.
    """
    flare, surfacing = (_depth_in_log(file, name) for name in ("log_D_FLARE", "log_D_SURF"))
    return dive_span(depth, begin=flare, end=surfacing)


def _depth_in_log(file: ForeignFile, name: str) -> float:
    depth = file.number(name)
    # Zero disables the manoeuvre.
    return depth if depth > 0.0 else SURFACE_DEPTH


def _fixes(file: ForeignFile, remarks: list[str]) -> Fixes:
    """Read the file's fixes that the basestation did not reject; a remark is added if they are DDMM.mmm."""
    names = ("log_gps_time", "log_gps_lat", "log_gps_lon")
    if names[0] not in file:
        return Fixes.none()
    file.check_lengths(names)
    count = len(file.numbers(names[0]))
    flags = np.array([*file.text("log_gps_qc").ljust(count)])
    fixes = read_fixes(file, names, flags[:count] != REJECTED_FLAG)
    if not may_be_minutes(fixes.latitude, fixes.longitude):
        return fixes
    remarks.append("log_gps_lat and log_gps_lon lie off the globe as degrees, so they are read as DDMM.mmm")
    return Fixes(fixes.time, decimal_degrees(fixes.latitude), decimal_degrees(fixes.longitude))


def _water(file: ForeignFile, name: str, unit: str, remarks: list[str]) -> FloatArray | None:
    """Values of a variable of the water; None, with a remark, if it is in a unit that cannot be converted."""
    try:
        return file.converted(name, unit)
    except UnitError as error:
        remarks.append(f"{str(error).removeprefix(f'{file.source}: ')}; it is left out")
        return None


def _ctd(file: ForeignFile, time: TimeArray, remarks: list[str]) -> Columns:
    """Temperature and salinity on the nearest sample within half an interval."""
    if len(time) < 2 or "ctd_time" not in file:
        return {}
    file.check_lengths(("ctd_time", *(name for corrected, raw, _ in _CTD.values() for name in (corrected, raw))))
    sampled = file.times("ctd_time")
    known = ~np.isnat(sampled)
    within = np.clip(np.searchsorted(time, sampled[known]) - 1, 0, len(time) - 2)
    reach = (local_intervals(np.diff(time) / SECOND)[within] / 2.0 * 1e9).astype("timedelta64[ns]")
    found: Columns = {}
    for name, (corrected, raw, unit) in _CTD.items():
        column = file.first([corrected, raw])
        values = None if column is None else _water(file, column, unit, remarks)
        if values is not None:
            found[name] = onto_nearest(time, sampled[known], values[known], reach)
    return found
