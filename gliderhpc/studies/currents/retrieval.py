"""One profile's depth-resolved current: eq. 41 along the dive, smoothed, and turned to north and east (section 5.4).

The hull follows the water in sideslip within seconds, so the yaw moment feels how fast the current across the hull
changes along the path, not the current itself (model.md 7): what comes out is the shear-sensitive part.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gliderhpc.archive.profile import ProfileData
from gliderhpc.flight.glider import Glider
from gliderhpc.studies.archived import states_of
from gliderhpc.studies.currents.filtering import smoothed, without_baseline
from gliderhpc.studies.currents.lateral_flow import solve_lateral_flow
from gliderhpc.studies.currents.settings import DepthResolvedSettings

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_YAW = 5
_TOLERANCE = 1e-5


@dataclass(frozen=True, eq=False)
class Retrieval:
    """What eq. 41 gives on the ``m`` records.

    Attributes
    ----------
    moment : (m,)
        Yaw moment without its baseline, N m, mean over the record.
    lateral : (m,)
        Current across the hull, m/s, positive to starboard; NaN where it is masked.
    horizontal : (m, 2)
        The same turned to north and east by the measured attitude.
    across : (m, 2)
        North and east of the hull's y axis.
    angle_of_attack, gain, condition : (m,)
        rad; N s (see `LateralFlow`); 1.
    rootless, ill_conditioned, interrupted : int
        Samples without a root, with a condition number beyond the limit, and in stretches too short to smooth.
    """

    moment: Array
    lateral: Array
    horizontal: Array
    across: Array
    angle_of_attack: Array
    gain: Array
    condition: Array
    rootless: int
    ill_conditioned: int
    interrupted: int


@dataclass(frozen=True, eq=False)
class SampledFlow:
    """Current across the hull on the ``n`` samples, before it is brought to records.

    Attributes
    ----------
    moment : (n,)
        Yaw moment without its baseline, N m.
    lateral : (n,)
        Smoothed current across the hull, m/s, positive to starboard; NaN where it is masked.
    gain, condition : (n,)
        N s (see `LateralFlow`); 1.
    rootless, ill_conditioned, interrupted : int
        As in `Retrieval`.
    """

    moment: Array
    lateral: Array
    gain: Array
    condition: Array
    rootless: int
    ill_conditioned: int
    interrupted: int


def sampled_flow(
    glider: Glider, motion: Array, rudder: Array, yaw_moment: Array, step: float, settings: DepthResolvedSettings
) -> SampledFlow:
    """Take the baseline out, solve eq. 41 and smooth its solution.

    Parameters
    ----------
    glider : Glider
        The hull that the disturbance was estimated with.
    motion : (n, 6)
        u, v, w (m/s) and p, q, r (rad/s) through the water.
    rudder : (n,)
        rad.
    yaw_moment : (n,)
        B_cr, N m; NaN where it is not to be used.
    step : float
        Between samples, s.
    settings : DepthResolvedSettings
        Windows and limits.
    """
    moment = without_baseline(yaw_moment, round(settings.baseline / step))
    solved = solve_lateral_flow(glider, motion, rudder, moment, settings.limit)
    well = solved.condition <= settings.largest_condition
    sound = np.where(well, solved.current, np.nan)
    smooth = smoothed(sound, round(settings.smoothing / step), settings.order)
    return SampledFlow(
        moment=moment,
        lateral=smooth,
        gain=solved.gain,
        condition=solved.condition,
        rootless=int(solved.rootless.sum()),
        ill_conditioned=int((np.isfinite(moment) & ~well).sum()),
        interrupted=int((np.isfinite(sound) & ~np.isfinite(smooth)).sum()),
    )


def retrieve(data: ProfileData, glider: Glider, settings: DepthResolvedSettings) -> Retrieval:
    """Retrieve the current across the hull of one profile.

    Parameters
    ----------
    data : ProfileData
        The profile.
    glider : Glider
        The hull it was estimated with.
    settings : DepthResolvedSettings
        Windows and limits.
    """
    states = states_of(data)
    motion = np.column_stack([np.interp(data.time, data.record_time, column) for column in states[:, 6:].T])
    rudder = np.interp(data.time, data.record_time, np.radians(data.controls[:, 3]))
    yaw_moment = np.where(data.steady, data.disturbances[:, _YAW], np.nan)
    flow = sampled_flow(glider, motion, rudder, yaw_moment, data.step, settings)
    lateral = _on_records(data, flow.lateral)
    across = starboard(np.radians(data.measured[:, :3]))
    return Retrieval(
        moment=_on_records(data, flow.moment),
        lateral=lateral,
        horizontal=lateral[:, None] * across,
        across=across,
        angle_of_attack=np.arctan2(states[:, 8], states[:, 6]),
        gain=_on_records(data, flow.gain),
        condition=_on_records(data, flow.condition),
        rootless=flow.rootless,
        ill_conditioned=flow.ill_conditioned,
        interrupted=flow.interrupted,
    )


def _on_records(data: ProfileData, values: Array) -> Array:
    """Mean ``(m,)`` over the samples ``(n,)`` of each record, NaN where none is known."""
    where = np.searchsorted(data.record_time, data.time + _TOLERANCE, side="right") - 1
    known = np.isfinite(values)
    size = len(data.record_time)
    total = np.bincount(where[known], values[known], minlength=size)
    count = np.bincount(where[known], minlength=size)
    return np.asarray(np.divide(total, count, out=np.full(size, np.nan), where=count > 0))


def starboard(attitude: Array) -> Array:
    """North and east ``(m, 2)`` of the body's y axis at ``attitude (m, 3)`` (rad): second column of R_eb (eq. 4)."""
    roll, pitch, heading = attitude.T
    tilt = np.sin(roll) * np.sin(pitch)
    return np.column_stack(
        [
            tilt * np.cos(heading) - np.cos(roll) * np.sin(heading),
            tilt * np.sin(heading) + np.cos(roll) * np.cos(heading),
        ]
    )
