"""What the glider says at the surface: its position, the declination there, and the depth that its sensor reads afloat.

The pressure sensor of a Slocum drifts and is not zeroed at the surface: on the same mission it reads anything from 0 to
4 m while positions come in. A position is the proof of a surfacing; the depth then read is the level that dives are
counted from.
"""

import numpy as np
import numpy.typing as npt

from gliderhpc.errors import InputError
from gliderhpc.observations.fixes import SAME_SURFACING, Fixes, drop_outliers
from gliderhpc.observations.records import FloatArray
from gliderhpc.observations.rows import Rows


def find_fixes(rows: Rows) -> Fixes:
    """Find the GPS fixes of a mission: rows with a new position that the receiver calls valid (``m_gps_status`` 0)."""
    found = _has_fix(rows)
    return drop_outliers(Fixes(rows.time[found], rows["m_gps_lat"][found], rows["m_gps_lon"][found]))


def surface_level(rows: Rows) -> FloatArray | None:
    """Depth that the sensor reads afloat (m), ``(n,)``: its median over the fixes of the nearest surfacing.

    None where there is no fix with a depth.
    """
    at = np.flatnonzero(_has_fix(rows) & np.isfinite(rows["m_depth"]))
    if len(at) == 0:
        return None
    groups = np.split(at, np.flatnonzero(np.diff(rows.time[at]) > SAME_SURFACING) + 1)
    levels = np.array([np.median(rows["m_depth"][group]) for group in groups])
    first = np.array([rows.time[group[0]] for group in groups])
    last = np.array([rows.time[group[-1]] for group in groups])
    halfway = last[:-1] + (first[1:] - last[:-1]) / 2
    return np.asarray(levels[np.searchsorted(halfway, rows.time)])


def true_heading(rows: Rows, declination: float | None) -> tuple[FloatArray, str]:
    """Heading from true north (degree), ``(n,)``, and what was done to the magnetic one.

    ``m_gps_mag_var`` is the magnetic heading less the true one, positive where the declination is west.

    Parameters
    ----------
    rows : Rows
        Rows of the flight computer.
    declination : float or None
        Declination (degree, east positive) instead of what the receiver reports.

    Raises
    ------
    InputError
        No declination is given, and none was reported.
    """
    if declination is not None:
        note = f"magnetic heading (m_heading) plus the declination that was given, {declination:g} degree"
        return np.mod(rows["m_heading"] + declination, 360.0), note
    variation = rows["m_gps_mag_var"]
    reported = np.isfinite(variation)
    if not reported.any():
        raise InputError(
            "m_gps_mag_var is not there, so the magnetic heading cannot be turned to true north; give the declination "
            "with --declination (degree, east positive; 0 leaves the heading as it is)"
        )
    seconds = (rows.time - rows.time[0]) / np.timedelta64(1, "s")
    east = -np.interp(seconds, seconds[reported], variation[reported])
    note = (
        "magnetic heading (m_heading) less m_gps_mag_var, interpolated between surfacings: a declination of "
        f"{east.min():.2f} to {east.max():.2f} degree east"
    )
    return np.mod(rows["m_heading"] + east, 360.0), note


def _has_fix(rows: Rows) -> npt.NDArray[np.bool_]:
    # A state that is not recorded (NaN) is not held against a position.
    return np.isfinite(rows["m_gps_lat"]) & np.isfinite(rows["m_gps_lon"]) & ~(rows["m_gps_status"] > 0.0)
