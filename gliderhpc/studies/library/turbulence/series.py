"""Disturbance series of a profile for the studies of turbulence: high-pass, usable stretches, band, and settings."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
import scipy
from numpy.typing import NDArray
from pydantic import Field, model_validator

from gliderhpc.archive.mission import open_for_reading
from gliderhpc.archive.profile import SETTLING, SMOOTHED, ProfileData, read_profile_data, without_windows
from gliderhpc.archive.reader import Archive
from gliderhpc.estimation.profile import ProfileEstimate
from gliderhpc.estimation.quality import quality_flags
from gliderhpc.estimation.settings import Channel, Settings
from gliderhpc.observations.profile_numbers import evenly_spaced
from gliderhpc.observations.profiles import stretches
from gliderhpc.platform import Platform
from gliderhpc.studies.archived import chosen_profiles, platform_of, sample_interval
from gliderhpc.studies.library.scores import rms
from gliderhpc.studies.request import Request
from gliderhpc.vocabulary import CHANNELS, OF_WINDOWS, QUALITY

Range = tuple[float, float]
Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

CUTOFF = 0.05
"""Cutoff of the high-pass, Hz; slower disturbances are regarded as the model's bias."""


HIGH_PASS_ORDER = 4
"""Order of the Butterworth filter."""

NOT_MEASURED = ("gap_in_the_record", *OF_WINDOWS)
"""Quality bits of samples without information on the water."""

ACTUATED = ("vibration", "battery_rotated")
"""Quality bits of samples that the paper excludes: moving actuators, and a rotated battery."""

MIN_RMS = 1e-9
"""Root mean square of a fast part (N or N m) below which it is zero to rounding, as in nulls that do not turn."""

MIN_DURATION = 300.0
"""Minimum duration of usable samples for the statistics of a profile, s."""


class FastSettings(Settings):
    """Channel, high-pass and band of a disturbance's fast part."""

    channel: Channel = Field("B_cr", description="disturbance that is studied, one of the six")
    cutoff: float = Field(CUTOFF, gt=0, description="cutoff frequency of the high-pass, Hz")
    band: Range = Field(
        (0.15, 0.80), description="frequencies at which turbulence is sought, Hz; spectra are fitted over them"
    )

    @model_validator(mode="after")
    def _band_ordered(self) -> Self:
        if not 0.0 < self.band[0] < self.band[1]:
            raise ValueError(f"band must be two frequencies above zero, the lower one first, not {list(self.band)}")
        return self


class SpectraSettings(FastSettings):
    """Spectra and the power laws fitted to them (docs/turbulence.md)."""

    segment: float = Field(100.0, gt=0, description="length of Welch's segments, s")
    shallowest: float = Field(
        0.0, ge=0, description="samples above this depth are excluded, m; the paper's begin at 200"
    )
    groups: int = Field(3, ge=1, description="groups of profiles by their depth-averaged current")
    draws: int = Field(200, ge=0, description="draws of the bootstrap for the intervals")
    seed: int = Field(0, ge=0, description="seed of all random numbers of the study")


class IntermittencySettings(SpectraSettings):
    """Increments, surrogates and the rank test (docs/turbulence.md)."""

    interval: float = Field(
        0.5, gt=0, description="length of the averages of the series, s; rounded down to whole steps"
    )
    lags: tuple[float, ...] = Field(
        (0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 10.0, 14.0, 20.0),
        min_length=4,
        description="lags of the increments, s",
    )
    lag: float = Field(1.0, gt=0, description="lag of the flatness that is tested, fixed beforehand, s")
    scaling: Range = Field((1.0, 10.0), description="lags over which exponents are fitted, s")
    scaling_varied: tuple[Range, ...] = Field(
        ((1.0, 6.0), (2.0, 10.0), (2.0, 20.0), (1.0, 20.0)), description="other ranges, in addition to the first"
    )
    block: float = Field(60.0, gt=0, description="length of a block of the bootstrap, s")
    block_draws: int = Field(500, ge=10, description="draws of that bootstrap")
    surrogates: int = Field(39, ge=1, description="number for each profile")
    iterations: int = Field(200, ge=1, description="largest number of iterations of a surrogate")
    tolerance: float = Field(1e-2, gt=0, lt=1, description="gain of an iteration below which a surrogate has converged")
    fade: float = Field(
        2.0, gt=0, description="length of the taper at both ends of a stretch before surrogates are made, s"
    )
    noise_window: float = Field(300.0, gt=0, description="window of the noise's local root mean square, s")
    most_repeated: float = Field(0.7, gt=0, le=1, description="largest share of repeated rolls that is tested")

    @property
    def every_lag(self) -> tuple[float, ...]:
        """Lags including that of the test, in ascending order, s."""
        return tuple(sorted({*self.lags, self.lag}))

    @property
    def scaling_ranges(self) -> tuple[Range, ...]:
        """Ranges of lags over which exponents are fitted, `scaling` first, s."""
        return (self.scaling, *self.scaling_varied)

    @model_validator(mode="after")
    def _ranges_ordered(self) -> Self:
        if self.interval > self.lag:
            raise ValueError(
                f"the series is averaged over an interval of {self.interval:g} s, which does not resolve the lag of "
                f"{self.lag:g} s that is tested; give a shorter interval or a longer lag"
            )
        for low, high in self.scaling_ranges:
            if not 0.0 < low < high:
                raise ValueError(
                    f"a range of lags must be two times above zero, the lower one first, not {[low, high]}"
                )
        return self


# Filtering


def bridge_gaps(signal: Array, usable: Mask) -> Array:
    """Interpolate a signal ``(n,)`` linearly where it is not usable; without any usable sample return zeros."""
    if not usable.any():
        return np.zeros_like(signal)
    index = np.arange(len(signal))
    return np.interp(index, index[usable], signal[usable])


def high_passed(signal: Array, step: float, cutoff: float = CUTOFF, *, pad: int | None = None) -> Array:
    """High-pass a signal by a Butterworth filter run forward and backward, without phase shift (docs/turbulence.md).

    Parameters
    ----------
    signal : (n,) array
        Signal without missing values.
    step : float
        Time between samples, s.
    cutoff : float
        Cutoff frequency, Hz.
    pad : int, optional
        Samples of odd extension at each end; by default a period of the cutoff.
    """
    sections = scipy.signal.butter(HIGH_PASS_ORDER, cutoff, "highpass", fs=1.0 / step, output="sos")
    extension = round(1.0 / (cutoff * step)) if pad is None else pad
    return np.asarray(scipy.signal.sosfiltfilt(sections, signal, padlen=min(len(signal) - 1, extension)))


# Series with samples left out


@dataclass(frozen=True, eq=False)
class GappySeries:
    """A series with gaps; increments and segments never span one.

    Attributes
    ----------
    values : (n,) array
        The whole series.
    label : (n,) int array
        Number of the unbroken stretch that a sample belongs to, -1 if the sample is not used.
    step : float
        Time between samples, s.
    """

    values: Array
    label: NDArray[np.int64]
    step: float

    @property
    def counted(self) -> Mask:
        """Mask ``(n,)`` of the samples used."""
        return np.asarray(self.label >= 0, dtype=np.bool_)

    @property
    def duration(self) -> float:
        """Total duration of the samples used, s."""
        return float(np.count_nonzero(self.counted)) * self.step

    @property
    def rms(self) -> float:
        """Root mean square of the samples used."""
        return rms(self.values[self.counted])

    @property
    def stretch_count(self) -> int:
        """Number of unbroken stretches."""
        return int(self.label.max(initial=-1)) + 1

    def increments(self, lag: int) -> tuple[Array, NDArray[np.int64]]:
        """Differences ``x[i + lag] - x[i]`` within a stretch, and the indices i at which they begin."""
        begin, end = self.label[:-lag], self.label[lag:]
        first = np.flatnonzero((begin == end) & (begin >= 0))
        return self.values[first + lag] - self.values[first], first

    def with_values(self, values: Array) -> "GappySeries":
        """Return a series of other values ``(n,)`` with the same stretches."""
        return replace(self, values=values)

    def block_averaged(self, count: int) -> "GappySeries":
        """Average blocks of `count` samples; blocks not within one stretch are unused, an incomplete one is dropped."""
        if count == 1:
            return self
        blocks = len(self.values) // count
        values = self.values[: blocks * count].reshape(blocks, count).mean(axis=1)
        labels = self.label[: blocks * count].reshape(blocks, count)
        alike = (labels == labels[:, :1]).all(axis=1)
        return GappySeries(values, np.where(alike, labels[:, 0], -1), count * self.step)


def gappy_series(values: Array, mask: Mask, step: float, min_duration: float = 0.0) -> GappySeries:
    """Cut a series ``(n,)`` into the stretches of a mask ``(n,)`` that last at least `min_duration` (s)."""
    label = np.full(len(values), -1, dtype=np.int64)
    long = [(first, stop) for first, stop in stretches(mask) if (stop - first) * step >= min_duration]
    for number, (first, stop) in enumerate(long):
        label[first:stop] = number
    return GappySeries(values, label, step)


def averaged_over(series: GappySeries, interval: float) -> GappySeries:
    """Average a series over `interval` (s), rounded down to whole steps."""
    return series.block_averaged(steps_within(interval, series.step))


def steps_within(interval: float, step: float) -> int:
    """Number of whole steps in an interval, at least one."""
    return max(1, int(interval / step + 1e-9))


# Channels of an estimate


@dataclass(frozen=True, eq=False)
class ChannelSeries:
    """One disturbance channel of one profile.

    Attributes
    ----------
    time : (n,) array
        Time from the profile's first sample, s.
    values : (n,) array
        Disturbance, N or N m; NaN where missing.
    depth : (n,) array
        Depth, m.
    quality : (n,) array of uint8
        Flag masks of the archive.
    step : float
        Time between the values, s: the integration step, or the output interval for the smoother, whose estimate is
        stored on the records alone.
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
        """Mask ``(n,)`` of usable samples: settled, measured and, unless `actuated`, with actuators at rest."""
        meanings = NOT_MEASURED if actuated else (*NOT_MEASURED, *ACTUATED)
        bits = QUALITY.mask(*meanings)
        return np.asarray(((self.quality & bits) == 0) & (self.time >= SETTLING) & np.isfinite(self.values))


def channel_of(data: ProfileData, channel: str, platform: Platform) -> ChannelSeries:
    """Return a channel of an archive's profile; the smoother's is on the records."""
    values = data.disturbance(channel)
    depth = np.interp(data.time, data.record_time, bridged_depth(data))
    interval = sample_interval(data, platform)
    if data.estimate != SMOOTHED:
        return ChannelSeries(data.time, values, depth, data.quality, data.step, interval)
    on = np.searchsorted(data.time, data.record_time - 0.5 * data.step)
    output_interval = float(data.attributes["output_interval"])
    return ChannelSeries(data.time[on], values[on], depth[on], data.own_quality[on], output_interval, interval)


def channel_of_estimate(estimate: ProfileEstimate, channel: str, source: str, every: int) -> ChannelSeries:
    """Return a channel of an estimate that is not in an archive; records are `every` steps apart."""
    series, column = estimate.series, list(CHANNELS).index(channel)
    time, quality, depth = series.time - series.time[0], quality_flags(estimate), series.measurements[:, 3]
    if source != SMOOTHED or estimate.smoothed is None:
        values = pad_to(estimate.solution.disturbances[:, column], len(time))
        return ChannelSeries(time, values, depth, quality, series.step, series.sample_interval)
    time, quality, depth = time[::every], without_windows(quality[::every]), depth[::every]
    values = pad_to(estimate.smoothed.disturbances[:, column], len(time))
    return ChannelSeries(time, values, depth, quality, every * series.step, series.sample_interval)


def bridged_depth(data: ProfileData) -> Array:
    """Measured depth on the records ``(m,)``, with interpolated gaps, m."""
    depth = data.measured[:, 3]
    known = np.isfinite(depth)
    return np.interp(data.record_time, data.record_time[known], depth[known])


def series_step(archive: Archive, estimate: str) -> float:
    """Time between an estimate's values in an archive, s."""
    return float(archive.attrs["output_interval" if estimate == SMOOTHED else "step"])


def pad_to(values: Array, count: int) -> Array:
    """Pad values to ``(count,)`` with NaN at the end: there is no disturbance after the last sample."""
    return np.concatenate([values[:count], np.full(max(0, count - len(values)), np.nan)])


# The fast part and the band


@dataclass(frozen=True, eq=False)
class FastPart:
    """High-passed series of a channel in its usable stretches, and the reason if it has no statistics."""

    series: GappySeries
    message: str = ""


def fast_part(channel: ChannelSeries, settings: FastSettings, *, actuated: bool) -> FastPart:
    """High-pass a channel, after bridging unusable samples to avoid ringing of the filter.

    The result has a message if the record does not resolve the band, if too little of it is usable, or if the fast part
    is zero. A record that does not resolve the band would give statistics of the interpolation between samples.
    """
    counted, lowest = channel.counted(actuated=actuated), settings.band[0]
    values = high_passed(bridge_gaps(channel.values, counted), channel.step, settings.cutoff)
    fast = gappy_series(values, counted, channel.step, 1.0 / settings.cutoff)
    if channel.nyquist <= lowest:
        return FastPart(fast, describe_unresolved(channel.sample_interval, channel.nyquist, lowest))
    if fast.duration < MIN_DURATION:
        return FastPart(fast, f"only {fast.duration:.0f} s of samples can be used, and {MIN_DURATION:.0f} s are needed")
    if fast.rms < MIN_RMS:
        return FastPart(fast, "the fast part is zero to rounding")
    return FastPart(fast)


def resolved_band(band: tuple[float, float], nyquist: float) -> tuple[float, float]:
    """Return the part of a band (Hz) that lies below the Nyquist frequency."""
    return band[0], min(band[1], nyquist)


def describe_unresolved(interval: float, nyquist: float, lowest: float) -> str:
    """Explain that samples `interval` s apart resolve up to `nyquist` Hz, and nothing of a band above `lowest` Hz."""
    return (
        f"samples {interval:.3g} s apart resolve nothing above {nyquist:.2g} Hz, so nothing of the band from "
        f"{lowest:g} Hz on"
    )


EXAMINED_PROFILES = 5
"""Number of profiles, spread over those chosen, whose sample interval is compared with the band."""


def missing_band(request: Request, settings: FastSettings) -> str | None:
    """Return the reason why no examined profile of a request resolves any of the band, or None if at least one does.

    Parameters
    ----------
    request : Request
        Archive, profiles and estimate.
    settings : FastSettings
        Settings of the study, with the band in Hz.

    Raises
    ------
    InputError
        No such profile is done, or the archive has no such estimate.
    """
    lowest, interval, nyquist = settings.band[0], np.inf, 0.0
    with open_for_reading(request.archive) as archive:
        step = series_step(archive, request.estimate)
        for own in _sample_intervals(archive, request):
            interval = min(interval, own)
            nyquist = 0.5 / max(interval, step)
            if nyquist > lowest:
                return None
    needed = f"this study needs samples less than {0.5 / lowest:.2g} s apart"
    return f"{describe_unresolved(interval, nyquist, lowest)}; {needed}"


def _sample_intervals(archive: Archive, request: Request) -> Iterator[float]:
    """Yield the sample intervals (s) of a few profiles spread over those chosen."""
    numbers = chosen_profiles(archive, request.profiles, request.quick)
    platform = platform_of(archive)
    for number in evenly_spaced(numbers, EXAMINED_PROFILES):
        yield sample_interval(read_profile_data(archive, number, request.estimate), platform)
