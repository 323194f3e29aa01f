"""Drag over lift of a glider without a platform file, from its measured velocity relative to the water."""

import math
from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gliderhpc.errors import ProfileError
from gliderhpc.estimation.glide_currents import on_points
from gliderhpc.estimation.relative_velocity import RelativeVelocity, assess_velocity
from gliderhpc.estimation.self_motion import angle_of_attack, depth_rate
from gliderhpc.flight.glide_polar import GlidePolar, with_drag
from gliderhpc.observations.records import ProfileRecord
from gliderhpc.observations.resample import ProfileSeries
from gliderhpc.platform import Platform

Array = NDArray[np.float64]

LEAST_ERROR = 0.02
"""Least relative error of the measured angle of attack: that of the velocity's axes and scale."""

_STEEP = np.radians(8.0)
_LEAST_DEPTH = 5.0
_FEWEST = 10
"""Least number of samples of a dive, and of a climb."""
_WIDEST, _POINTS = 3.0, 241
"""Reach of the factors tried, in standard deviations of the prior, and their number."""


def with_measured_attack(polar: GlidePolar, records: Iterable[ProfileRecord]) -> tuple[GlidePolar, tuple[str, ...]]:
    """Correct drag over lift by the angle of attack of the measured velocity.

    Parameters
    ----------
    polar : GlidePolar
        Drag and lift of the make or of a hull, with the uncertainty of their ratio.
    records : iterable of ProfileRecord
        Profiles, any of which may have no measured velocity.

    Returns
    -------
    GlidePolar
        Drag and lift with the most probable ratio and its uncertainty; unchanged without a measured velocity.
    tuple of str
        Remarks: from how many profiles, and why others are not used.

    Notes
    -----
    Half the difference of the angle of attack between dive and climb contains no constant error of the sensor's axes.
    It is compared with that of the hull with its drag multiplied by a factor, whose logarithm has the prior of the
    polar.
    """
    found, refusals = [], []
    for record in records:
        if record.velocity is None:
            continue
        try:
            series = on_points(record)
        except ProfileError:
            # Its current is refused with the reason.
            continue
        velocity = _assessed(polar.platform, series)
        refusals += [velocity.refusal] if velocity.refusal else []
        found += _half_differences(series, velocity)
    remarks = tuple(f"{refusals.count(text)} profiles: {text}" for text in dict.fromkeys(refusals[:1]))
    if not found:
        return polar, remarks
    pitch, attack = np.array(found)[:, :2], np.array(found)[:, 2]
    logarithms = polar.deviation * np.linspace(-_WIDEST, _WIDEST, _POINTS)
    modelled = np.array([_modelled(with_drag(polar.platform, math.exp(x)), pitch) for x in logarithms])
    usual = float(np.median(attack))
    scatter = float(np.std(attack)) / math.sqrt(len(attack)) if len(attack) > 1 else 0.5 * usual
    error = math.hypot(scatter, LEAST_ERROR * usual)
    cost = ((modelled - float(attack.mean())) / error) ** 2 + (logarithms / polar.deviation) ** 2
    cost = np.where(np.isfinite(cost), cost, np.inf)
    weights = np.exp(-0.5 * (cost - cost.min()))
    mean = float(np.sum(weights * logarithms) / weights.sum())
    deviation = math.sqrt(float(np.sum(weights * (logarithms - mean) ** 2) / weights.sum()))
    remark = f"drag over lift from the measured velocity relative to the water in {len(found)} profiles"
    changed = replace(polar, platform=with_drag(polar.platform, math.exp(mean)), deviation=deviation)
    return changed, (remark, *remarks)


def _assessed(platform: Platform, series: ProfileSeries) -> RelativeVelocity:
    assert series.velocity is not None
    assert series.velocity_std is not None
    angles, depth = series.measurements[:, :2], series.measurements[:, 3]
    attack = np.nan_to_num(angle_of_attack(platform, angles[:, 1]))
    steady = series.weights > 0.0
    return assess_velocity(series.velocity, series.velocity_std, angles, depth, depth_rate(series), steady, attack)


def _half_differences(series: ProfileSeries, velocity: RelativeVelocity) -> list[tuple[float, float, float]]:
    """Median pitch of dive and climb, and half the difference of their median angles of attack (rad); or nothing."""
    forward, _, normal = velocity.values.T
    pitch, depth = series.measurements[:, 1], series.measurements[:, 3]
    known = np.isfinite(forward + normal) & (forward > 0.0) & (depth > _LEAST_DEPTH)
    dive, climb = (known & (sign * pitch > _STEEP) for sign in (-1.0, 1.0))
    if min(np.count_nonzero(dive), np.count_nonzero(climb)) < _FEWEST:
        return []
    attack = [float(np.arctan2(np.median(normal[part]), np.median(forward[part]))) for part in (dive, climb)]
    return [(float(np.median(pitch[dive])), float(np.median(pitch[climb])), 0.5 * (attack[0] - attack[1]))]


def _modelled(platform: Platform, pitch: Array) -> float:
    """Mean over profiles of half the difference of the hull's angles of attack, for pitches ``(m, 2)``."""
    attack = angle_of_attack(platform, pitch)
    return float(np.mean(0.5 * (attack[:, 0] - attack[:, 1])))
