"""One profile's depth-resolved current: eq. 41 along the dive, smoothed, and turned to north and east (section 5.4).

The hull follows the water in sideslip within seconds, so the yaw moment responds to the rate of change of the current
across the hull along the path, not to the current itself (model.md 7): the result is the shear-sensitive part.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray
from pydantic import Field

from gliderhpc.archive.profile import ProfileData
from gliderhpc.estimation.settings import Settings
from gliderhpc.flight.glider import Glider
from gliderhpc.observations.profiles import stretches
from gliderhpc.studies.archived import states_of
from gliderhpc.studies.currents.lateral_flow import solve_lateral_flow


class DepthResolvedSettings(Settings):
    """Eq. 41 and what surrounds it (section 5.4, model.md 7)."""

    baseline: float = Field(60.0, gt=0, description="moving average taken out of the yaw moment, s")
    smoothing: float = Field(15.0, gt=0, description="length of the Savitzky-Golay window, s")
    order: int = Field(3, ge=1, description="order of its polynomial")
    limit: float = Field(1.0, gt=0, description="largest lateral current that counts as a root, m/s")
    largest_condition: float = Field(10.0, gt=1, description="samples of a larger condition number are masked")
    coefficient_error: float = Field(0.15, ge=0, lt=1, description="relative error of the moment coefficients")
    largest_doubt: float = Field(
        0.05, gt=0, lt=1, description="share of coefficient draws of the other sign at which a hull is refused"
    )
    draws: int = Field(300, ge=2, description="of the moment coefficients")
    seed: int = Field(0, ge=0, description="of these draws")
    bin: float = Field(10.0, ge=0.1, description="depth of a bin, m")
    actuation_error: float | None = Field(
        None, ge=0, description="relative error of the displacement bridged while actuators move; default as the run's"
    )


Array = NDArray[np.float64]


def without_baseline(values: Array, samples: int) -> Array:
    """Take the centred moving average over `samples` out of values ``(n,)``; missing ones stay missing and count none.

    At either end of the record the window is cut, so the average there is that of fewer samples.
    """
    known = np.isfinite(values)
    window = max(1, samples)
    total = scipy.ndimage.uniform_filter1d(np.where(known, values, 0.0), window, mode="constant")
    weight = scipy.ndimage.uniform_filter1d(known.astype(np.float64), window, mode="constant")
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(known, values - total / weight, np.nan)


def smoothing_samples(samples: int, order: int) -> int:
    """Odd length of the Savitzky-Golay window that is asked for in samples, long enough for its order."""
    return max(samples | 1, (order + 1) | 1)


def smoothed(values: Array, samples: int, order: int) -> Array:
    """Smooth each unbroken stretch of values ``(n,)`` (Savitzky-Golay); a stretch shorter than the window is lost."""
    window = smoothing_samples(samples, order)
    out = np.full_like(values, np.nan)
    for first, stop in stretches(np.isfinite(values)):
        if stop - first >= window:
            out[first:stop] = scipy.signal.savgol_filter(values[first:stop], window, order)
    return out


Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Bins:
    """Assignment of records to bins of depth.

    Attributes
    ----------
    weights : (bins, m) sparse
        Average the records of each bin; the rows of empty bins are zero.
    count : (bins,)
        Records a bin.
    """

    weights: scipy.sparse.csr_array
    count: NDArray[np.int64]

    def mean(self, values: Array) -> Array:
        """Mean a bin of ``values (m, ...)``, NaN where the bin is empty; what is missing must not be in a bin."""
        mean = np.asarray(self.weights @ np.nan_to_num(values))
        mean[self.count == 0] = np.nan
        return mean

    def spread(self, values: Array) -> Array:
        """Standard deviation within each bin."""
        return np.asarray(np.sqrt(np.maximum(self.mean(values**2) - self.mean(values) ** 2, 0.0)))


def bin_count(deepest: float, height: float) -> int:
    """Bins of a height that reach from the surface to below a depth (m)."""
    return int(deepest // height) + 1


def bins_of(depth: Array, chosen: Mask, height: float, bins: int) -> Bins:
    """Sort the chosen records ``(m,)`` into bins.

    Parameters
    ----------
    depth : (m,)
        m; what lies above the surface falls into the first bin, what lies deeper than the last one into that.
    chosen : (m,) mask
        Records that count.
    height : float
        Of a bin, m.
    bins : int
        Their number.
    """
    rows = np.flatnonzero(chosen & np.isfinite(depth))
    where = np.clip((depth[rows] // height).astype(np.int64), 0, bins - 1)
    count = np.bincount(where, minlength=bins)
    weights = scipy.sparse.csr_array((1.0 / count[where], (where, rows)), shape=(bins, len(depth)))
    return Bins(weights, count)


_YAW = 5
_TOLERANCE = 1e-5


@dataclass(frozen=True, eq=False)
class Retrieval:
    """Solution of eq. 41 on the ``m`` records.

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
    roll_pitch = np.sin(roll) * np.sin(pitch)
    return np.column_stack(
        [
            roll_pitch * np.cos(heading) - np.cos(roll) * np.sin(heading),
            roll_pitch * np.sin(heading) + np.cos(roll) * np.cos(heading),
        ]
    )
