"""Signs that a glide determines: a glider is nose down and heavy while it sinks, nose up and buoyant while it rises."""

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from gliderhpc.observations.profile_checks import faults_of
from gliderhpc.observations.profiles import stretches
from gliderhpc.observations.records import FloatArray, TimeArray
from gliderhpc.observations.validation import Span

GLIDE = ("depth", "pitch", "ballast_volume")
"""Variables that are checked together."""

BIN = 20.0
"""Time over which depth and the other variables are averaged (s)."""

MIN_BINS = 4
"""Least number of consecutive bins in one direction that count.

In cycles that the bins or the samples do not resolve, the direction is wrong as often as right; such a profile is not
checked.
"""

MIN_RATE = 0.03
"""Vertical speed (m/s) from which a bin counts as sinking or rising."""

SURE_PITCH = 5.0
"""Median pitch (degree) of the wrong sign, both sinking and rising, that proves a reversed sign."""

SURE_BALLAST = 20.0
"""Excess of the median ballast volume (cm3) sinking over that rising that proves a reversed sign."""


def check_signs(
    time: TimeArray,
    depth: FloatArray,
    pitch: FloatArray,
    ballast: FloatArray,
    spans: Mapping[int, Span],
    faults: Mapping[int, str],
) -> dict[int, str]:
    """Faults of the sign of pitch or ballast volume in profiles that have no fault yet.

    Parameters
    ----------
    time : (n,) array
        Times (UTC).
    depth, pitch, ballast : (n,) array
        Depth (m), pitch (degree) and ballast volume (cm3); NaN where missing.
    spans : mapping of int to Span
        Sample ranges of the profiles.
    faults : mapping of int to str
        Faults found before, by profile number.

    Returns
    -------
    dict
        Profile number to its fault.
    """
    return faults_of(
        lambda number, own: fault_of_signs(number, time[own], depth[own], pitch[own], ballast[own]), spans, faults
    )


def fault_of_signs(
    number: int, time: TimeArray, depth: FloatArray, pitch: FloatArray, ballast: FloatArray
) -> str | None:
    """Fault of the sign of pitch or ballast of one profile, from arrays ``(n,)`` as in `check_signs`; or None."""
    seconds = (time - time[0]) / np.timedelta64(1, "s")
    known = np.isfinite(depth)
    begins = np.flatnonzero(np.diff(np.floor(seconds[known] / BIN), prepend=-1.0))
    if len(begins) < 2 * MIN_BINS:
        return None
    counts = np.diff(begins, append=np.count_nonzero(known))
    middle, mean_depth, mean_pitch, mean_ballast = (
        np.add.reduceat(values[known], begins) / counts
        for values in (seconds, depth, _filled(seconds, pitch), _filled(seconds, ballast))
    )
    rate = np.gradient(mean_depth, middle)
    sinking, rising = _steady(rate > MIN_RATE), _steady(rate < -MIN_RATE)
    if not (sinking.any() and rising.any()):
        return None
    down, up = _medians(mean_pitch, sinking, rising)
    if down > SURE_PITCH and up < -SURE_PITCH:
        return (
            f"profile {number}: pitch is {down:+.0f} degree while the glider sinks and {up:+.0f} degree while it "
            "rises; nose up is positive, so reverse its sign"
        )
    down, up = _medians(mean_ballast, sinking, rising)
    if down - up > SURE_BALLAST:
        return (
            f"profile {number}: ballast_volume is {down:+.0f} cm3 while the glider sinks and {up:+.0f} cm3 while it "
            "rises; more oil outside the hull makes it rise, so reverse its sign"
        )
    return None


def _steady(mask: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """Mask without its runs of fewer than `MIN_BINS`."""
    found = np.zeros_like(mask)
    for first, stop in stretches(mask):
        found[first:stop] = stop - first >= MIN_BINS
    return found


def _filled(seconds: FloatArray, values: FloatArray) -> FloatArray:
    """Interpolate over missing values; the checks before guarantee that some are known."""
    known = np.isfinite(values)
    return np.interp(seconds, seconds[known], values[known])


def _medians(values: FloatArray, *masks: npt.NDArray[np.bool_]) -> list[float]:
    return [float(np.median(values[mask])) for mask in masks]
