"""One channel of an estimate with what tells which of its samples count, from an archive or fresh from the pipeline."""

from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gliderhpc.archive.profile import SETTLING, SMOOTHED, ProfileData
from gliderhpc.estimation.diagnosis import quality_flags
from gliderhpc.estimation.profile import ProfileEstimate
from gliderhpc.platform import Platform
from gliderhpc.studies.archived import sample_interval
from gliderhpc.vocabulary import CHANNELS, QUALITY

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

NOT_MEASURED = ("gap_in_the_record", "prior_used_because_the_window_failed")
"""Quality bits of samples that say nothing of the water."""

ACTUATED = ("vibration", "battery_rotated")
"""Quality bits of samples that the paper leaves out: actuators that move, and a battery that is rotated."""


@dataclass(frozen=True, eq=False)
class ChannelSeries:
    """One disturbance channel of one profile.

    Attributes
    ----------
    time : (n,) array
        s from the profile's first sample.
    values : (n,) array
        N or N m; NaN is missing.
    depth : (n,) array
        m.
    quality : (n,) array of uint8
        The archive's flag masks.
    step : float
        Time between the values, s: the integration step, or the output interval for the smoother, whose estimate is
        kept on the records alone.
    sample_interval : float
        Time between the instrument's samples, s: the median by time, without gaps.
    """

    time: Array
    values: Array
    depth: Array
    quality: NDArray[np.uint8]
    step: float
    sample_interval: float

    @property
    def nyquist(self) -> float:
        """Highest frequency that both the records and the series resolve, Hz."""
        return 0.5 / max(self.sample_interval, self.step)

    def counted(self, *, actuated: bool) -> Mask:
        """Samples ``(n,)`` that count: settled, measured, and, unless `actuated` ones are asked for, at rest."""
        meanings = NOT_MEASURED if actuated else (*NOT_MEASURED, *ACTUATED)
        bits = np.uint8(sum(QUALITY.meanings[meaning] for meaning in meanings))
        return np.asarray(((self.quality & bits) == 0) & (self.time >= SETTLING) & np.isfinite(self.values))


def channel_of(data: ProfileData, channel: str, platform: Platform) -> ChannelSeries:
    """Take a channel out of an archive's profile, the smoother's on the records that it is kept on."""
    values = data.disturbance(channel)
    depth = np.interp(data.time, data.record_time, bridged_depth(data))
    interval = sample_interval(data, platform)
    if data.estimate != SMOOTHED:
        return ChannelSeries(data.time, values, depth, data.quality, data.step, interval)
    on = np.searchsorted(data.time, data.record_time - 0.5 * data.step)
    every = float(data.attributes["output_interval"])
    return ChannelSeries(data.time[on], values[on], depth[on], data.quality[on], every, interval)


def channel_of_estimate(estimate: ProfileEstimate, channel: str, which: str, every: int) -> ChannelSeries:
    """Take a channel out of an estimate that no archive holds; records lie `every` steps."""
    series, column = estimate.series, list(CHANNELS).index(channel)
    time, quality, depth = series.time - series.time[0], quality_flags(estimate), series.measurements[:, 3]
    if which != SMOOTHED or estimate.smoothed is None:
        values = _up_to(estimate.solution.disturbances[:, column], len(time))
        return ChannelSeries(time, values, depth, quality, series.step, series.sample_interval)
    time, quality, depth = time[::every], quality[::every], depth[::every]
    values = _up_to(estimate.smoothed.disturbances[:, column], len(time))
    return ChannelSeries(time, values, depth, quality, every * series.step, series.sample_interval)


def bridged_depth(data: ProfileData) -> Array:
    """Measured depth on the records ``(m,)`` with its gaps bridged, m."""
    depth = data.measured[:, 3]
    known = np.isfinite(depth)
    return np.interp(data.record_time, data.record_time[known], depth[known])


def series_step(archive: xr.DataTree, estimate: str) -> float:
    """Time between an estimate's values in an archive, s."""
    return float(archive.attrs["output_interval" if estimate == SMOOTHED else "step"])


def _up_to(values: Array, count: int) -> Array:
    """Values ``(count,)`` with what is lacking at the end missing: nothing acts after the last sample."""
    return np.concatenate([values[:count], np.full(max(0, count - len(values)), np.nan)])
