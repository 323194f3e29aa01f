"""Speed of glides through the water; an implausible one indicates a depth or a time in a wrong unit."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gliderhpc.errors import InputError, ProfileError
from gliderhpc.estimation.glide_currents import GlideTrack
from gliderhpc.observations.profile_checks import fault_of_pace
from gliderhpc.observations.records import ProfileRecord
from gliderhpc.observations.sign_checks import fault_of_depth_rate

Array = NDArray[np.float64]

MAX_SPEED = 1.0
"""Speed through the water (m/s) that no glider exceeds over a mission, not even with a thruster."""

USUAL = (0.1, 0.6)
"""Speeds (m/s) between which that of buoyancy-driven gliders lies; on the real missions tested it is 0.17 to 0.36."""

INTERVAL = 60.0
"""Time (s) over which the depth rate is taken; over a minute, the noise of the sensor does not matter."""

MIN_RATE = 0.005
"""Vertical speed (m/s) from which a glider moves up or down."""


def check_depth_rate(record: ProfileRecord) -> None:
    """Refuse a profile whose depth changes faster or slower than any glider's.

    Raises
    ------
    ProfileError
        Time or depth is in a wrong unit.
    """
    time = record.instants
    fault = fault_of_pace(record.number, time, record.depth) or fault_of_depth_rate(
        record.number, time, record.depth, np.degrees(record.pitch)
    )
    if fault is not None:
        raise ProfileError(fault)


def check_speed(source: str, tracks: Sequence[GlideTrack]) -> list[str]:
    """Check the usual speed through the water of a mission, and return a remark where it is unusual.

    Raises
    ------
    InputError
        No glider has such a speed: depth, pitch or time is in a wrong unit.
    """
    speed = usual_speed(tracks)
    if np.isnan(speed) or USUAL[0] <= speed <= USUAL[1]:
        return []
    text = f"pitch and depth rate give a speed through the water of {speed:.2g} m/s"
    if speed > MAX_SPEED:
        raise InputError(
            f"{source}: {text}, faster than any glider; check the units of depth (or pressure), pitch and time"
        )
    return [f"{text}, which is unusual for a glider: check the units of depth (or pressure), pitch and time"]


def usual_speed(tracks: Sequence[GlideTrack]) -> float:
    """Weighted median of the speed through the water (m/s) by vertical distance, over all profiles; NaN without any.

    Time in which a glider is stationary has no weight.
    """
    parts = [_speeds(track) for track in tracks]
    speed, distance = (np.concatenate([np.zeros(0), *(part[k] for part in parts)]) for k in (0, 1))
    if not len(speed):
        return float("nan")
    order = np.argsort(speed)
    passed = np.cumsum(distance[order])
    return float(speed[order][np.searchsorted(passed, 0.5 * passed[-1])])


def _speeds(track: GlideTrack) -> tuple[Array, Array]:
    """Speeds (m/s) and vertical distances (m) of the minutes of one profile."""
    series = track.series
    every = max(1, round(INTERVAL / series.step))
    at = np.arange(0, len(series.time), every)
    rise = np.diff(series.measurements[at, 3])
    path = (series.measurements[:, 1] - track.angle_of_attack)[at[:-1] + every // 2]
    with np.errstate(invalid="ignore", divide="ignore"):
        speed = np.abs(rise / (every * series.step * np.sin(path)))
        moving = np.isfinite(speed) & (np.abs(rise) > MIN_RATE * every * series.step)
    # Sinking with the nose up happens in turns only.
    moving &= np.sign(rise) == -np.sign(path)
    return speed[moving], np.abs(rise[moving])
