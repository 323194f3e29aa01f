"""Remarks on actuators: movements while the record pauses, which look like slow ramps, and a ballast that is stuck."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gliderhpc.observations.format import VARIABLES
from gliderhpc.observations.profiles import stretches
from gliderhpc.observations.records import FloatArray

MIN_GAP = 60.0
"""Longest pause (s) between the samples of an actuator that is not examined."""

SAME_PAUSE = 0.5
"""Fraction of an actuator's pause beyond which a pause of the attitude belongs to the whole record."""

START_LOGGED = 2.0
"""Ratio of the rest before a movement to its duration at or above which its beginning and its end count as logged."""

MIN_CHANGE = {"ballast_volume": 20.0, "battery_position": 0.002, "battery_rotation": 5.0}
"""Minimum change of an actuator that counts as a movement, in the units of the format (cm3, m, degree).

Each changes a glide perceptibly: the speed by about 3 %, the pitch by about 2 degrees, or the course.
"""

MIN_LEG = 20.0
"""Minimum height (m) of a dive and of a climb between which the ballast must change."""

MIN_BALLAST_CHANGE = 1.0
"""Change of the ballast volume (cm3) below which it cannot turn a dive into a climb: a force of 0.01 N."""

_MEDIAN = 5
"""Number of samples in the running median of the depth, which removes false samples."""


def stuck_ballast(depth: FloatArray, ballast: FloatArray) -> list[str]:
    """Remark on a ballast volume that stays the same while the glider dives and climbs; empty if there is none.

    Parameters
    ----------
    depth, ballast : (n,) arrays
        Depth (m) and ballast volume (cm3); NaN where missing.
    """
    both = np.isfinite(ballast) & np.isfinite(depth)
    known, deep = ballast[both], depth[both]
    if len(known) < _MEDIAN or np.ptp(known) >= MIN_BALLAST_CHANGE:
        return []
    deep = np.median(np.lib.stride_tricks.sliding_window_view(deep, _MEDIAN), axis=1)
    turn = int(np.argmax(deep))
    dive, climb = deep[turn] - deep[: turn + 1].min(), deep[turn] - deep[turn:].min()
    if min(dive, climb) < MIN_LEG:
        return []
    return [
        f"ballast_volume stays at {known[0]:.6g} cm3 although the glider dives by {dive:.0f} m and climbs by "
        f"{climb:.0f} m: its record is wrong, and so are the heave force and, less, the current"
    ]


@dataclass(frozen=True)
class _Jump:
    """Largest change of an actuator between two samples, in the unit of the format, and the time between them (s)."""

    change: float
    seconds: float


def unlogged_movements(time: FloatArray, attitude: npt.NDArray[np.bool_], controls: Mapping[str, FloatArray]) -> str:
    """Describe movements of the actuators whose start is not logged; empty if there are none.

    Parameters
    ----------
    time : (n,) array
        Times of the profile's samples (s), increasing.
    attitude : (n,) array of bool
        Mask of the samples that hold the attitude.
    controls : mapping of str to (n,) array
        Actuators by the names in `MIN_CHANGE`, in the units of the format; NaN where missing.

    Notes
    -----
    Controls are interpolated linearly between their samples. A record with a sample only where a movement ends
    therefore looks like a ramp from one inflection to the next. A pause that the attitude has too is one of the whole
    record, and cannot be remedied. Movements after a rest of `START_LOGGED` times their duration have been logged at
    their beginning and at their end, and really are ramps.
    """
    sampled = time[attitude]
    jumps = {name: _largest_jump(time, sampled, controls[name], least) for name, least in MIN_CHANGE.items()}
    parts = [
        f"{name} changes by {jump.change:.3g} {VARIABLES[name].unit} across {jump.seconds:.0f} s without a value"
        for name, jump in jumps.items()
        if jump is not None
    ]
    if not parts:
        return ""
    return f"{', '.join(parts)}, read as slow ramps: repeat the last value at every sample, or log every movement"


def _largest_jump(time: FloatArray, attitude: FloatArray, values: FloatArray, least: float) -> _Jump | None:
    """Largest change of at least `least` across a pause of one actuator that the attitude does not share."""
    known = np.isfinite(values)
    begins, pauses, changes = time[known][:-1], np.diff(time[known]), np.abs(np.diff(values[known]))
    moving = changes >= least
    rests = np.zeros(len(pauses))
    for first, stop in stretches(moving):
        rests[first:stop] = pauses[first - 1] if first > 0 else 0.0
    chosen = np.flatnonzero((pauses > MIN_GAP) & moving & (rests < START_LOGGED * pauses))
    own = [index for index in chosen.tolist() if not _shared(attitude, begins[index], pauses[index])]
    if not own:
        return None
    largest = max(own, key=lambda index: float(changes[index]))
    return _Jump(float(changes[largest]), float(pauses[largest]))


def _shared(attitude: FloatArray, begin: float, pause: float) -> bool:
    """Return whether a pause of the attitude fills much of an actuator's pause."""
    inside = attitude[(attitude > begin) & (attitude < begin + pause)]
    edges = np.concatenate([[begin], inside, [begin + pause]])
    return bool(np.diff(edges).max() > SAME_PAUSE * pause)
