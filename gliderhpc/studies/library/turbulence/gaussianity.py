"""Test of whether the disturbances are Gaussian, on the smoother's standardised noise.

The smoothed noise is a linear function of the record about the smoothed path. If the disturbances are Gaussian, it is
Gaussian too, whatever their spectrum and the smoother's assumptions about it. Its kurtosis is then 3; that of an
intermittent gust is larger. The strength of a disturbance may also change slowly along a dive, as with depth or speed.
The noise is therefore divided by its root mean square over some minutes first.

Lateral gusts roll the glider and push it sideways, and are tested there. Where the roll hardly changes by more than the
sensor's resolution, the noise reflects the rounding, which is not Gaussian; such profiles are not tested.

References
----------
Z. A. Lomnicki (1961), Tests for departure from normality in the case of linear stochastic processes, Metrika 4, 37-62.

F. J. Anscombe, W. J. Glynn (1983), Distribution of the kurtosis statistic b2 for normal samples, Biometrika 70,
227-234.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from gliderhpc.archive.profile import ProfileData
from gliderhpc.archive.reader import Archive
from gliderhpc.estimation.profile import ProfileEstimate
from gliderhpc.estimation.quality import quality_flags
from gliderhpc.observations.resample import ProfileSeries
from gliderhpc.store_schema.columns import NOISE_MOMENTS
from gliderhpc.studies.library.turbulence.contrast import LEVEL, NullPasses
from gliderhpc.studies.library.turbulence.series import ChannelSeries, IntermittencySettings
from gliderhpc.vocabulary import CHANNELS

Array = NDArray[np.float64]
Row = dict[str, Any]

TESTED = ("B_cv", "B_cp")
"""Channels on which lateral gusts act directly: sway and roll. The moment of yaw is not tested: the record resolves it
less, and the test then rejects Gaussian gusts too often (docs/turbulence.md)."""

MIN_INDEPENDENT = 100.0
"""Least number of independent values for a test."""


_SAME_ROLL = 1e-4
"""Largest difference of rolls that are regarded as repeated, degree."""


@dataclass(frozen=True, eq=False)
class Noise:
    """Standardised noise of a profile on its records.

    Attributes
    ----------
    channels : mapping of str to ChannelSeries
        Noise of each channel ``(m,)``.
    sampled : (m,) array of bool
        Records at which the instrument sampled. Between them the noise may have another variance, relative to the one
        that the smoother states.
    roll : (m,) array
        Measured roll, degree.
    """

    channels: Mapping[str, ChannelSeries]
    sampled: NDArray[np.bool_]
    roll: Array

    @property
    def repeated(self) -> float:
        """Share of the samples with the roll of the sample before; 1 without any samples."""
        roll = self.roll[self.sampled & np.isfinite(self.roll)]
        return float(np.mean(np.abs(np.diff(roll)) < _SAME_ROLL)) if len(roll) > 1 else 1.0


@dataclass(frozen=True)
class NoiseMoments:
    """Moments of a channel's standardised noise in one profile.

    Attributes
    ----------
    variance : float
        Variance of the noise as the smoother standardised it; 1 if the smoother's assumptions are right.
    kurtosis : float
        Kurtosis of the noise over its local root mean square, 3 if it is Gaussian.
    independent : float
        Number of independent values of which this kurtosis is equally uncertain (Lomnicki 1961).
    score : float
        Standard normal score of this kurtosis under a Gaussian disturbance (Anscombe and Glynn 1983); NaN if there are
        too few values.
    """

    variance: float = float("nan")
    kurtosis: float = float("nan")
    independent: float = 0.0
    score: float = float("nan")


# Noise of a profile


def noise_of(archive: Archive, data: ProfileData) -> Noise | None:
    """Return the standardised noise of an archive's profile.

    None if the archive has none: without the smoother, or from a version before 1.9 of the archive's schema.
    """
    if "smoothed" not in archive.children:
        return None
    group = archive["smoothed"].to_dataset()
    names = {f"{channel}_noise": channel for channel in CHANNELS}
    if not set(names) <= set(group):
        return None
    row = group[list(names)].sel(profile=data.number).load()
    time, depth, interval = data.record_time, data.measured[:, 3], float(data.attributes["output_interval"])
    quality = data.quality[np.searchsorted(data.time, time - 0.5 * data.step)]
    values = {channel: row[name].values[: len(time)].astype(np.float64) for name, channel in names.items()}
    channels = {
        name: ChannelSeries(time, column, depth, quality, interval, interval) for name, column in values.items()
    }
    return Noise(channels, data.sampled, data.measured[:, 0])


def noise_of_estimate(estimate: ProfileEstimate, every: int) -> Noise | None:
    """Return the standardised noise of an estimate that is not in an archive; records are `every` steps apart."""
    if estimate.smoothed is None:
        return None
    return smoothed_noise(estimate.series, quality_flags(estimate), estimate.smoothed.standardised_noise, every)


def smoothed_noise(series: ProfileSeries, quality: NDArray[np.uint8], noise: Array, every: int) -> Noise:
    """Return the noise ``(m, 6)`` of a record on its steps, with quality flags of the steps."""
    time, depth, step = (series.time - series.time[0])[::every], series.measurements[::every, 3], every * series.step
    values = np.full((len(time), len(CHANNELS)), np.nan)
    values[: len(noise)] = noise[: len(time)]
    nearest = np.rint(series.sample_index / every).astype(np.int64)
    sampled = np.zeros(len(time), dtype=np.bool_)
    sampled[nearest[nearest < len(time)]] = True
    columns = dict(zip(CHANNELS, values.T, strict=True))
    channels = {name: ChannelSeries(time, one, depth, quality[::every], step, step) for name, one in columns.items()}
    return Noise(channels, sampled, np.degrees(series.measurements[::every, 0]))


# The test


def moments_of(noise: Noise, settings: IntermittencySettings) -> dict[str, NoiseMoments]:
    """Compute the moments of all channels of a profile, over the samples that the studies use."""
    return {
        name: noise_moments(series, series.counted(actuated=False) & noise.sampled, settings.noise_window)
        for name, series in noise.channels.items()
    }


def noise_moments(series: ChannelSeries, counted: NDArray[np.bool_], window: float) -> NoiseMoments:
    """Compute the moments of a channel's standardised noise, and the score of its kurtosis.

    Parameters
    ----------
    series : ChannelSeries
        Noise of the channel on ``m`` records.
    counted : (m,) array of bool
        Records that are used.
    window : float
        Window of the local root mean square, s.
    """
    if np.count_nonzero(counted) < MIN_INDEPENDENT:
        return NoiseMoments()
    centred = np.where(counted, series.values - series.values[counted].mean(), 0.0)
    variance = float(np.mean(centred[counted] ** 2))
    if variance == 0.0:
        return NoiseMoments(variance)
    width = max(1, round(window / series.step))
    scaled = centred / _local_rms(centred, counted, width)
    square = float(np.mean(scaled[counted] ** 2))
    kurtosis = float(np.mean(scaled[counted] ** 4)) / square**2
    independent = float(np.count_nonzero(counted) / np.sum(_correlation(scaled, counted, width) ** 4))
    score = kurtosis_score(kurtosis, independent) if independent >= MIN_INDEPENDENT else float("nan")
    return NoiseMoments(variance, kurtosis, independent, score)


def _local_rms(values: Array, counted: NDArray[np.bool_], width: int) -> Array:
    """Root mean square ``(n,)`` over a window of `width` samples; values that are not counted are zero."""
    square, share = (
        scipy.ndimage.uniform_filter1d(x, width, mode="constant") for x in (values**2, counted.astype(np.float64))
    )
    return np.asarray(np.sqrt(np.divide(square, share, out=np.ones_like(square), where=(share > 0.0) & (square > 0.0))))


def _correlation(values: Array, counted: NDArray[np.bool_], width: int) -> Array:
    """Autocorrelation at all lags from ``1 - width`` to ``width - 1``, from pairs of counted values; 0 without."""
    own, pairs = (
        scipy.signal.correlate(x, x, mode="full", method="fft")[len(x) - 1 : len(x) - 1 + width]
        for x in (values, counted.astype(np.float64))
    )
    covariance = np.where(pairs > 0.5, own / np.maximum(pairs, 1.0), 0.0)
    return np.asarray(np.concatenate([covariance[:0:-1], covariance]) / covariance[0])


def kurtosis_score(kurtosis: float, count: float) -> float:
    """Standard normal score of the kurtosis of `count` independent Gaussian values (Anscombe and Glynn 1983)."""
    n = count
    mean = 3.0 * (n - 1.0) / (n + 1.0)
    variance = 24.0 * n * (n - 2.0) * (n - 3.0) / ((n + 1.0) ** 2 * (n + 3.0) * (n + 5.0))
    skewness = (
        6.0 * (n * n - 5.0 * n + 2.0) / ((n + 7.0) * (n + 9.0))
        * np.sqrt(6.0 * (n + 3.0) * (n + 5.0) / (n * (n - 2.0) * (n - 3.0)))
    )  # fmt: skip
    freedom = 6.0 + 8.0 / skewness * (2.0 / skewness + np.sqrt(1.0 + 4.0 / skewness**2))
    base = 1.0 + (kurtosis - mean) / np.sqrt(variance) * np.sqrt(2.0 / (freedom - 4.0))
    root = np.sign(base) * np.cbrt((1.0 - 2.0 / freedom) / abs(base)) if base != 0.0 else 0.0
    return float((1.0 - 2.0 / (9.0 * freedom) - root) / np.sqrt(2.0 / (9.0 * freedom)))


def gaussianity_row(noise: Noise | None, settings: IntermittencySettings) -> Row:
    """Compute the largest score of a profile, and its p-value (Bonferroni); NaN if it is not tested."""
    return _test_row(noise, {} if noise is None else moments_of(noise, settings), settings)


def noise_rows(noise: Noise | None, settings: IntermittencySettings) -> Row:
    """Compute the moments ``(6,)`` of all channels, and the test of a profile.

    The names are those of group `intermittency`; the row is empty without any noise.
    """
    if noise is None:
        return {}
    found = moments_of(noise, settings)
    columns = {
        name: np.array([getattr(found[channel], name.removeprefix("noise_")) for channel in CHANNELS])
        for name in NOISE_MOMENTS
    }
    return columns | {"repeated_roll": noise.repeated} | _test_row(noise, found, settings)


def _test_row(noise: Noise | None, found: Mapping[str, NoiseMoments], settings: IntermittencySettings) -> Row:
    scores = np.array([found[name].score for name in TESTED if name in found])
    scores = scores[np.isfinite(scores)]
    if noise is None or not len(scores) or noise.repeated > settings.most_repeated:
        return {"gaussianity_score": float("nan"), "gaussianity_p_value": float("nan")}
    largest = float(scores.max())
    return {"gaussianity_score": largest, "gaussianity_p_value": smallest_p(largest, len(scores))}


def smallest_p(score: float, channels: int) -> float:
    """One-sided p of the largest of the scores of several channels (Bonferroni)."""
    return float(min(1.0, channels * scipy.stats.norm.sf(score)))


# A mission


@dataclass(frozen=True)
class PooledScore:
    """Scores of a channel pooled over profiles: their number, and their sum over its standard deviation (Stouffer)."""

    channel: str
    profiles: int
    score: float


@dataclass(frozen=True)
class Gaussianity:
    """Test of a mission's disturbances, pooled over its profiles.

    Attributes
    ----------
    tested, profiles : int
        Numbers of profiles in which a channel is tested, and of all profiles with statistics.
    rejected : int
        Profiles whose own test rejects a Gaussian disturbance at `LEVEL`.
    pooled : tuple of PooledScore
        Scores of the channels over all profiles.
    nulls : mapping of str to NullPasses
        Nulls that the test rejects, by family.
    """

    tested: int
    profiles: int
    rejected: int
    pooled: tuple[PooledScore, ...]
    nulls: Mapping[str, NullPasses]

    @property
    def strongest(self) -> PooledScore | None:
        """Channel with the largest pooled score; None if no channel is tested."""
        return max(self.pooled, key=lambda one: one.score, default=None)

    @property
    def p_value(self) -> float:
        """One-sided p of the largest pooled score; NaN if no channel is tested."""
        strongest = self.strongest
        return float("nan") if strongest is None else smallest_p(strongest.score, len(self.pooled))

    @property
    def holds_on_nulls(self) -> bool:
        """Return whether the test rejects no more nulls than its level allows."""
        return all(passes.holds for passes in self.nulls.values())


def stored_scores(archive: Archive, numbers: Sequence[int]) -> dict[str, Array]:
    """Return the scores ``(n,)`` of an archive's profiles by tested channel, NaN in profiles that are not tested.

    Empty if the study of the archive did not test them.
    """
    if "intermittency" not in archive.children:
        return {}
    group = archive["intermittency"].to_dataset()
    if "noise_score" not in group:
        return {}
    at = group.sel(profile=list(numbers))
    tested = np.isfinite(at["gaussianity_score"].values)
    return {name: np.where(tested, at["noise_score"].sel(channel=name).values, np.nan) for name in TESTED}


def judged_gaussianity(
    scores: Mapping[str, Array], measured_p: Array, null_p: Mapping[str, Array]
) -> Gaussianity | None:
    """Pool the test over a mission.

    Parameters
    ----------
    scores : mapping of str to (n,) array
        Scores of the profiles by tested channel (`stored_scores`).
    measured_p : (n,) array
        P-values of the profiles' own tests, NaN where no channel is tested.
    null_p : mapping of str to (m,) array
        The same of the nulls, by family. A null that is not tested is not rejected.

    Returns
    -------
    Gaussianity or None
        None if the profiles have no scores.
    """
    if not scores:
        return None
    known = {channel: values[np.isfinite(values)] for channel, values in scores.items()}
    pooled = tuple(
        PooledScore(channel, len(values), float(values.sum() / np.sqrt(len(values))))
        for channel, values in known.items()
        if len(values)
    )
    nulls = {name: NullPasses(int((values <= LEVEL).sum()), len(values), LEVEL) for name, values in null_p.items()}
    tested, rejected = int(np.isfinite(measured_p).sum()), int((measured_p <= LEVEL).sum())
    return Gaussianity(tested, len(measured_p), rejected, pooled, {k: v for k, v in nulls.items() if v.count})
