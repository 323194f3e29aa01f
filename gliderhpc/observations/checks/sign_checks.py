"""Signs and units that a glide determines.

A glider is nose down and heavy while it sinks, nose up and buoyant while it rises; and a hull with a heavy battery off
its axis rolls to the side to which the battery is rotated. Where it is pitched steeply it moves fast enough to fly.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from gliderhpc.errors import InputError
from gliderhpc.observations.checks.profile_checks import faults_of
from gliderhpc.observations.checks.validation import Span
from gliderhpc.observations.profiles import MIN_DEPTH, stretches
from gliderhpc.observations.records import FloatArray, TimeArray
from gliderhpc.observations.times import SECOND

Mask = npt.NDArray[np.bool_]

GLIDE = ("depth", "pitch", "ballast_volume", "roll", "battery_rotation")
"""Variables that are checked together."""

BIN = 20.0
"""Time over which depth and the other variables are averaged (s)."""

MIN_BINS = 4
"""Minimum number of consecutive bins in one direction that count.

In cycles that the bins or the samples do not resolve, the direction is wrong as often as right; such a profile is not
checked.
"""

MIN_RATE = 0.03
"""Vertical speed (m/s) above which a bin counts as sinking or rising."""

MIN_STEEP = 10.0
"""Magnitude of the pitch (degree) above which depth must change."""

MIN_DEPTH_RANGE = 5.0
"""Minimum range of depths (m) for a check of their rate; within less, the glider floats or the sensor is stuck."""

SLOWEST_FLIGHT = 0.08
"""Speed (m/s) along the pitch that some part of every glide exceeds."""

MIN_FLOWN = 0.03
"""This part: a parked glider may move as little. On 236 real dives its speed is at least 0.29 to 0.63 m/s."""

FASTEST_FLIGHT = 1.5
"""Median speed (m/s) along the pitch that no glider reaches."""

MAX_SPACING = 120.0
"""Time between bins (s) up to which speeds are judged; sparser samples may be of different cycles."""

SURE_PITCH = 5.0
"""Median pitch (degree) of the wrong sign, both sinking and rising, that proves a reversed sign."""

SURE_BALLAST = 20.0
"""Excess of the median ballast volume (cm3) sinking over that rising that proves a reversed sign."""

MIN_ROTATION_RANGE = 10.0
"""Minimum range of the battery rotation (degree) for a check of the roll that follows it."""

MIN_SIDE = 3
"""Minimum number of bins with the battery rotated to either side."""

MIN_CORRELATION = 0.6
"""Minimum magnitude of the correlation of roll and rotation for a check of the roll."""

SURE_ROLL = 2.5
"""Difference of the median roll (degree) against a rotation that is held for a while that proves a reversed sign."""

SURE_ROLL_MOVING = 4.0
"""As `SURE_ROLL`, where the rotation moves all the time, both sinking and rising.

A controller that rotates the battery against a heel of another cause looks the same, but does not leave so much heel.
SeaExplorers move the battery all the time; roll follows by 4.3 degrees and more.
"""

MAX_HELD_CHANGE = 0.1
"""Change of the rotation (degree) between bins up to which it is held."""

MIN_HELD = 0.4
"""Fraction of the bins at or above which the rotation counts as held."""

MAX_RADIANS = 0.6
"""Magnitude that roll in degrees exceeds in a profile with turns, and roll in radians hardly anywhere."""

MAX_RATIO = 0.02
"""Roll over rotation below which roll is in radians: in degrees it is 0.13 to 0.71 on the known hulls."""


def check_signs(
    time: TimeArray, glide: Mapping[str, FloatArray], spans: Mapping[int, Span], faults: Mapping[int, str]
) -> dict[int, str]:
    """Faults of the sign of pitch, ballast volume, roll or battery rotation in profiles that have no fault yet.

    Parameters
    ----------
    time : (n,) array
        Times (UTC).
    glide : mapping of str to (n,) array
        Variables of `GLIDE` in the units of the file (m, degree, cm3); NaN where missing.
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
        lambda number, own: fault_of_signs(number, time[own], {name: glide[name][own] for name in GLIDE}),
        spans,
        faults,
    )


def fault_of_signs(number: int, time: TimeArray, glide: Mapping[str, FloatArray]) -> str | None:
    """Fault of a sign in one profile, from arrays ``(n,)`` as in `check_signs`; None if it has none."""
    means = _bin_means(time, glide)
    if means is None:
        return None
    rate = np.gradient(means["depth"], means["time"])
    unit = _fault_of_depth(means)
    if unit:
        return f"profile {number}: {unit}"
    phases = (_steady(rate > MIN_RATE), _steady(rate < -MIN_RATE))
    if not all(phase.any() for phase in phases):
        return None
    fault = (
        _fault_of_pitch(means["pitch"], phases)
        or _fault_of_ballast(means["ballast_volume"], phases)
        or _fault_of_roll(means["roll"], means["battery_rotation"], phases)
    )
    return f"profile {number}: {fault}" if fault else None


def fault_of_depth_rate(number: int, time: TimeArray, depth: FloatArray, pitch: FloatArray) -> str | None:
    """Fault of a depth (m) whose rate is impossible at the pitch (degree) of one profile; None if there is none."""
    means = _bin_means(time, {"depth": depth, "pitch": pitch})
    if means is None:
        return None
    fault = _fault_of_depth(means)
    return f"profile {number}: {fault}" if fault else None


def _bin_means(time: TimeArray, glide: Mapping[str, FloatArray]) -> dict[str, FloatArray] | None:
    """Means of the time (s) and the variables in bins of `BIN`; None if there are too few bins."""
    seconds = (time - time[0]) / SECOND
    known = np.isfinite(glide["depth"])
    begins = np.flatnonzero(np.diff(np.floor(seconds[known] / BIN), prepend=-1.0))
    if len(begins) < 2 * MIN_BINS:
        return None
    counts = np.diff(begins, append=np.count_nonzero(known))
    filled = {"time": seconds} | {name: _filled(seconds, glide[name]) for name in GLIDE if name in glide}
    return {name: np.add.reduceat(values[known], begins) / counts for name, values in filled.items()}


def _fault_of_depth(means: Mapping[str, FloatArray]) -> str | None:
    """Fault of a depth whose rate is impossible at the pitch, from the means of bins; None if there is none."""
    time, depth, pitch = means["time"], means["depth"], means["pitch"]
    if np.median(np.diff(time)) > MAX_SPACING or np.ptp(depth) < MIN_DEPTH_RANGE:
        return None
    rate, steep = np.gradient(depth, time), np.abs(pitch) > MIN_STEEP
    if np.count_nonzero(steep) < MIN_BINS:
        return None
    rise, slope = np.abs(rate[steep]), np.abs(pitch[steep])
    speed = rise / np.sin(np.radians(slope))
    if np.quantile(speed, 1.0 - MIN_FLOWN) < SLOWEST_FLIGHT:
        wrong = (
            "too slowly for a glide; check the unit of depth (bar and decametres are a tenth of the depth in metres)"
        )
    elif np.median(speed) > FASTEST_FLIGHT:
        wrong = "faster than any glider; check the units of depth and time"
    else:
        return None
    return f"depth changes at {np.median(rise):.2g} m/s while the pitch is {np.median(slope):.0f} degree, {wrong}"


def _fault_of_pitch(pitch: FloatArray, phases: Sequence[Mask]) -> str | None:
    down, up = _medians(pitch, *phases)
    if down > SURE_PITCH and up < -SURE_PITCH:
        return (
            f"pitch is {down:+.0f} degree while the glider sinks and {up:+.0f} degree while it rises; nose up is "
            "positive, so reverse its sign"
        )
    return None


def _fault_of_ballast(ballast: FloatArray, phases: Sequence[Mask]) -> str | None:
    down, up = _medians(ballast, *phases)
    if down - up > SURE_BALLAST:
        return (
            f"ballast_volume is {down:+.0f} cm3 while the glider sinks and {up:+.0f} cm3 while it rises; more oil "
            "outside the hull makes it rise, so reverse its sign"
        )
    return None


def _fault_of_roll(roll: FloatArray, rotation: FloatArray, phases: Sequence[Mask]) -> str | None:
    """Fault of a roll that goes against the battery's rotation, or follows it but is in radians."""
    responses = [response for phase in phases if (response := _roll_response(roll[phase], rotation[phase]))]
    if len(responses) < len(phases):
        return None
    if all(response.is_reversed for response in responses):
        return (
            f"{responses[0].describe('+.1f')}; both are positive with starboard down, so reverse the sign of roll or "
            "of battery_rotation"
        )
    if np.abs(roll).max() < MAX_RADIANS and all(0.0 < response.ratio < MAX_RATIO for response in responses):
        return f"{responses[0].describe('+.3f')}, too little; if roll is in radians, convert it to degrees"
    return None


class _RollResponse(NamedTuple):
    """Median rotations (degree) towards port and starboard, median rolls (degree) there, and if rotations are held."""

    rotations: tuple[float, float]
    rolls: tuple[float, float]
    held: bool

    @property
    def is_reversed(self) -> bool:
        """True if roll certainly goes against the rotation."""
        return self.rolls[0] - self.rolls[1] > (SURE_ROLL if self.held else SURE_ROLL_MOVING)

    @property
    def ratio(self) -> float:
        """Change of roll over change of rotation."""
        return (self.rolls[1] - self.rolls[0]) / (self.rotations[1] - self.rotations[0])

    def describe(self, style: str) -> str:
        """Clause that gives the rolls, in a format, and the rotations."""
        (port, starboard), (left, right) = self.rotations, self.rolls
        return (
            f"roll is {left:{style}} degree where battery_rotation is {port:+.0f} degree and {right:{style}} degree "
            f"where it is {starboard:+.0f} degree"
        )


def _roll_response(roll: FloatArray, rotation: FloatArray) -> _RollResponse | None:
    """Roll in the lowest and the highest third of the rotations' range, without `MIN_SIDE` - 1 extremes at each end.

    None if the range is small or roll is hardly correlated with the rotation, as in waves.
    """
    if len(rotation) < 2 * MIN_SIDE:
        return None
    low, high = np.sort(rotation)[[MIN_SIDE - 1, -MIN_SIDE]]
    if high - low < MIN_ROTATION_RANGE:
        return None
    (roll_variance, covariance), (_, rotation_variance) = np.cov(roll, rotation)
    if covariance**2 <= MIN_CORRELATION**2 * roll_variance * rotation_variance:
        return None
    third = (high - low) / 3.0
    port, starboard = rotation <= low + third, rotation >= high - third
    left, right = _medians(rotation, port, starboard)
    roll_left, roll_right = _medians(roll, port, starboard)
    held = np.mean(np.abs(np.diff(rotation)) < MAX_HELD_CHANGE) >= MIN_HELD
    return _RollResponse((left, right), (roll_left, roll_right), bool(held))


def _steady(mask: Mask) -> Mask:
    """Mask without its runs of fewer than `MIN_BINS`."""
    found = np.zeros_like(mask)
    for first, stop in stretches(mask):
        found[first:stop] = stop - first >= MIN_BINS
    return found


def _filled(seconds: FloatArray, values: FloatArray) -> FloatArray:
    """Interpolate over missing values; the checks before guarantee that some are known."""
    known = np.isfinite(values)
    return np.interp(seconds, seconds[known], values[known])


def _medians(values: FloatArray, *masks: Mask) -> list[float]:
    return [float(np.median(values[mask])) for mask in masks]


# Sign of the depth; an instrument's own files declare none: positive down is expected

MIN_NEGATIVE = 10
"""Minimum number of depths below -`MIN_DEPTH` that prove a reversed sign; fewer may be junk."""


def sense_fault(positive: str) -> tuple[str, str]:
    """Fault of a depth whose sign contradicts its attribute `positive`, and the remedy."""
    if positive.strip().lower() == "up":
        return "positive under water, but declared positive up", "correct its attribute positive"
    return "negative under water", "make it positive down, or set its attribute positive to 'up'"


def refuse_negative_depth(depth: FloatArray, source: str, name: str) -> None:
    """Refuse depths that are negative under water.

    Parameters
    ----------
    depth : (n,) array
        Depths (m); NaN where missing.
    source, name : str
        Names of the file or folder and of the variable in the message.

    Raises
    ------
    InputError
        More depths are far above the surface than far below it; the message gives the remedy.
    """
    negative = np.count_nonzero(depth < -MIN_DEPTH)
    if negative >= MIN_NEGATIVE and negative > np.count_nonzero(depth > MIN_DEPTH):
        raise InputError(
            f"{source}: {name} is negative under water ({np.nanmin(depth):.4g} m at the deepest); make it positive down"
        )
