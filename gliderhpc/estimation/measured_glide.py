"""Drag-to-lift ratio of a glider without a platform file, from its measured velocity relative to the water."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gliderhpc.distributions import few_values_factor
from gliderhpc.errors import ProfileError
from gliderhpc.estimation.glide_currents import on_points
from gliderhpc.estimation.relative_velocity import MIN_DEPTH, MIN_GLIDE_PITCH, RelativeVelocity, measured_velocity
from gliderhpc.estimation.self_motion import angle_of_attack
from gliderhpc.flight.glide_polar import GlidePolar, with_drag
from gliderhpc.observations.records import ProfileRecord
from gliderhpc.observations.series import ProfileSeries
from gliderhpc.platform import Platform
from gliderhpc.wording import counted

Array = NDArray[np.float64]

MIN_ATTACK_ERROR = 0.02
"""Minimum relative error of the measured angle of attack: that of the velocity's axes and scale."""

_MIN_SAMPLES = 10
"""Minimum number of samples of a dive, and of a climb, for an angle of attack."""
_UPPER_LEVEL = 0.975
"""Level of the quantile by which Student's distribution is wider than the normal one."""
_MAX_WIDTH, _GRID_POINTS = 4.0, 321
"""Reach of the factors tried, in standard deviations of the prior, and their number."""
_PLAUSIBLE = 3.0
"""Largest change of the drag-to-lift ratio, in standard deviations of the prior, that is attributed to the hull."""


@dataclass(frozen=True)
class _HalfDifference:
    """Median pitches of dive and climb, and half the difference of their median angles of attack, rad."""

    dive_pitch: float
    climb_pitch: float
    attack: float


def with_measured_attack(polar: GlidePolar, records: Iterable[ProfileRecord]) -> tuple[GlidePolar, tuple[str, ...]]:
    """Correct the drag-to-lift ratio by the angle of attack of the measured velocity.

    Parameters
    ----------
    polar : GlidePolar
        Drag and lift of the make or of a hull, with the uncertainty of their ratio.
    records : iterable of ProfileRecord
        Profiles, any of which may have no measured velocity.

    Returns
    -------
    GlidePolar
        Drag and lift with the most probable ratio and its uncertainty; unchanged without a usable velocity.
    tuple of str
        Remarks: from how many profiles, and why others are not used.

    Notes
    -----
    Half the difference of the angle of attack between dive and climb contains no constant error of the sensor's axes.
    It is compared with that of the hull with its drag multiplied by a factor, whose logarithm has the prior of the
    polar.
    """
    differences: list[_HalfDifference] = []
    refusals: list[str] = []
    for record in records:
        if record.velocity is None:
            continue
        try:
            series = on_points(record)
        except ProfileError:
            # The profile's current is refused later, with the reason.
            continue
        velocity = measured_velocity(polar.platform, series, np.ones(len(series.time), dtype=bool))
        if velocity is None:
            continue
        refusals += [velocity.refusal] if velocity.refusal and velocity.is_empty else []
        differences += _half_difference(series, velocity)
    remarks = (f"in {counted(len(refusals), 'profile')}, the first of them: {refusals[0]}",) if refusals else ()
    if not differences:
        return polar, remarks
    corrected, remark = _corrected(polar, differences)
    return corrected, (remark, *remarks)


def _error_of_mean(values: Array) -> float:
    """Standard error of a mean, widened by Student's quantile over the normal one where there are few values."""
    factor = few_values_factor(_UPPER_LEVEL, len(values) - 1)
    return float(factor * np.std(values, ddof=1) / math.sqrt(len(values)))


def _corrected(polar: GlidePolar, differences: list[_HalfDifference]) -> tuple[GlidePolar, str]:
    """Drag-to-lift ratio from the posterior of the drag's factor on a grid, and a remark."""
    attack = np.array([difference.attack for difference in differences])
    usual = float(np.median(attack))
    if not usual > 0.0:
        return polar, (
            f"the relative velocity is not used: its angle of attack (half the difference of dives and climbs) "
            f"is {math.degrees(usual):.1f} degrees, but must be positive"
        )
    scatter = _error_of_mean(attack) if len(attack) > 1 else 0.5 * usual
    error = math.hypot(scatter, MIN_ATTACK_ERROR * usual)
    logarithms = polar.deviation * np.linspace(-_MAX_WIDTH, _MAX_WIDTH, _GRID_POINTS)
    modelled = np.array([_modelled(with_drag(polar.platform, math.exp(x)), differences) for x in logarithms])
    cost = ((modelled - float(attack.mean())) / error) ** 2 + (logarithms / polar.deviation) ** 2
    cost = np.where(np.isfinite(cost), cost, np.inf)
    weights = np.exp(-0.5 * (cost - cost.min())) if np.isfinite(cost.min()) else np.zeros_like(cost)
    mean = float(np.sum(weights * logarithms) / max(weights.sum(), np.finfo(float).tiny))
    if not weights.any() or abs(mean) > _PLAUSIBLE * polar.deviation:
        return polar, (
            f"the relative velocity is not used: its angle of attack of {math.degrees(usual):.1f} degrees is not "
            f"plausible for {polar.make}; u is forward, w downward in the body frame"
        )
    deviation = math.sqrt(float(np.sum(weights * (logarithms - mean) ** 2) / weights.sum()))
    changed = replace(polar, platform=with_drag(polar.platform, math.exp(mean)), deviation=deviation)
    profiles = counted(len(differences), "profile")
    return changed, f"drag over lift from the measured velocity relative to the water in {profiles}"


def _half_difference(series: ProfileSeries, velocity: RelativeVelocity) -> list[_HalfDifference]:
    """Half the difference of a profile's angles of attack; none with too few samples of dive or climb."""
    forward, _, normal = velocity.values.T
    pitch, depth = series.measurements[:, 1], series.measurements[:, 3]
    known = np.isfinite(forward + normal) & (forward > 0.0) & (depth > MIN_DEPTH)
    dive, climb = (known & (sign * pitch > MIN_GLIDE_PITCH) for sign in (-1.0, 1.0))
    if min(np.count_nonzero(dive), np.count_nonzero(climb)) < _MIN_SAMPLES:
        return []
    attack = [float(np.arctan2(np.median(normal[phase]), np.median(forward[phase]))) for phase in (dive, climb)]
    return [
        _HalfDifference(float(np.median(pitch[dive])), float(np.median(pitch[climb])), 0.5 * (attack[0] - attack[1]))
    ]


def _modelled(platform: Platform, differences: list[_HalfDifference]) -> float:
    """Mean over profiles of half the difference of the hull's angles of attack."""
    pitches = np.array([[difference.dive_pitch, difference.climb_pitch] for difference in differences])
    attack = angle_of_attack(platform, pitches)
    return float(np.mean(0.5 * (attack[:, 0] - attack[:, 1])))
