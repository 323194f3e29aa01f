"""Test of whether the disturbances are Gaussian, on the smoother's standardised noise.

The smoothed noise is a linear function of the record about the smoothed path. If the disturbances are Gaussian, it is
Gaussian too, whatever their spectrum and the smoother's assumptions about it. Its kurtosis is then 3; that of an
intermittent gust is larger. The strength of a disturbance may also change slowly along a dive, as with depth or speed.
The noise is therefore divided by its root mean square over some minutes first.

Lateral gusts roll the glider and push it sideways, and are tested there. Where the roll hardly changes by more than the
sensor's resolution, the noise reflects the rounding, which is not Gaussian; such profiles are not tested. With heavy
tails in sway or roll (setting `smoother.heavy_tailed`) the smoother fits the variance to each value, and the test has
no power.

References
----------
Z. A. Lomnicki (1961), Tests for departure from normality in the case of linear stochastic processes, Metrika 4, 37-62.

F. J. Anscombe, W. J. Glynn (1983), Distribution of the kurtosis statistic b2 for normal samples, Biometrika 70,
227-234.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pandas as pd
import scipy
from numpy.typing import NDArray

from gliderhpc.archive.profile import ProfileData
from gliderhpc.archive.reader import Archive
from gliderhpc.estimation.profile import ProfileEstimate
from gliderhpc.estimation.quality import quality_flags
from gliderhpc.store_schema.columns import NOISE_MOMENTS
from gliderhpc.studies.library.turbulence.contrast import LEVEL, Contrast, FalsePositives, contrast_of
from gliderhpc.studies.library.turbulence.series import ChannelSeries, IntermittencySettings, pad_to
from gliderhpc.vocabulary import CHANNELS

Array = NDArray[np.float64]
Row = dict[str, Any]

TESTED = ("B_cv", "B_cp")
"""Channels on which lateral gusts act directly: sway and roll. The moment of yaw is not tested: the record resolves it
less, and the test then rejects Gaussian gusts too often (docs/turbulence.md)."""

MIN_INDEPENDENT, MIN_LOCAL = 100.0, 10.0
"""Minimum numbers of independent values for a test: in a profile, and in the window of the local root mean square."""

NO_ESTIMATE = "the smoother has no estimate of the profile, as may happen where a disturbance is strongest"
REPEATED_ROLL = "the roll hardly changes by more than its resolution"
TOO_FEW = "there are too few independent samples"
"""Reasons why a profile is not tested."""

_MAX_LISTED = 8
"""Maximum number of profiles that are named."""

_MIN_PAIR_FRACTION = 0.05
"""Minimum number of pairs of values with a correlation, relative to the number of values."""

_EQUAL_ROLLS = 1e-4
"""Largest difference of rolls that are regarded as repeated, degree."""


@dataclass(frozen=True, eq=False)
class Noise:
    """Standardised noise of a profile on its records.

    Attributes
    ----------
    channels : mapping of str to ChannelSeries
        Noise of each channel ``(m,)``.
    sampled : (m,) array of bool
        Records nearest to samples. Between them the noise may have another variance, relative to the one that the
        smoother states.
    roll : (m,) array
        Measured roll, degree, NaN in gaps. Where samples lie between records, it is interpolated to the records, and
        fewer values are repeated than were in the samples.
    """

    channels: Mapping[str, ChannelSeries]
    sampled: NDArray[np.bool_]
    roll: Array

    def counted(self, channel: str) -> NDArray[np.bool_]:
        """Mask ``(m,)`` of a channel's records that are used."""
        return self.channels[channel].counted(actuated=False) & self.sampled

    @property
    def is_estimated(self) -> bool:
        """Return whether the smoother has an estimate of the profile."""
        return any(bool(np.isfinite(self.channels[name].values).any()) for name in TESTED)

    @property
    def repeated(self) -> float:
        """Fraction of the used records whose roll equals the previous one; 1 without any records."""
        roll = self.roll[self.counted(TESTED[-1]) & np.isfinite(self.roll)]
        return float(np.mean(np.abs(np.diff(roll)) < _EQUAL_ROLLS)) if len(roll) > 1 else 1.0


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
        Standard normal score of this kurtosis under a Gaussian disturbance (Anscombe and Glynn 1983); NaN with fewer
        than `MIN_INDEPENDENT` independent values, or `MIN_LOCAL` in the window of the local root mean square.
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
    series, quality = estimate.series, quality_flags(estimate)[::every]
    time, depth, step = (series.time - series.time[0])[::every], series.measurements[::every, 3], every * series.step
    noise = dict(zip(CHANNELS, estimate.smoothed.standardised_noise.T, strict=True))
    channels = {
        name: ChannelSeries(time, pad_to(column, len(time)), depth, quality, step, step)
        for name, column in noise.items()
    }
    roll = np.where(series.weights > 0.0, np.degrees(series.measurements[:, 0]), np.nan)
    return Noise(channels, series.sampled_records(every), roll[::every])


# The test


def moments_of(noise: Noise, settings: IntermittencySettings) -> dict[str, NoiseMoments]:
    """Compute the moments of all channels of a profile, over the samples that the studies use."""
    return {
        name: noise_moments(series, noise.counted(name), settings.noise_window)
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
    count = np.count_nonzero(counted)
    if count < MIN_INDEPENDENT:
        return NoiseMoments()
    centred = np.where(counted, series.values - series.values[counted].mean(), 0.0)
    variance = float(np.mean(centred[counted] ** 2))
    if variance == 0.0:
        return NoiseMoments(variance)
    width = max(1, round(window / series.step))
    rms, values_within = _local_rms(centred, counted, width)
    scaled = centred / rms
    pairs, correlation = _correlation(scaled, counted, width)
    independent, by_square = (float(count**2 / np.sum(pairs * correlation**power)) for power in (4, 2))
    local = values_within * by_square / count
    if local < MIN_LOCAL:
        return NoiseMoments(variance, independent=independent)
    kurtosis = float(np.mean(scaled[counted] ** 4) / np.mean(scaled[counted] ** 2) ** 2)
    # A value is part of its own local mean square, so that the expectation is 3 m / (m + 2) with m values within.
    kurtosis *= (local + 2.0) / local
    score = kurtosis_score(kurtosis, independent) if independent >= MIN_INDEPENDENT else float("nan")
    return NoiseMoments(variance, kurtosis, independent, score)


def _local_rms(values: Array, counted: NDArray[np.bool_], width: int) -> tuple[Array, float]:
    """Root mean square ``(n,)`` over a window of `width` samples, and the mean number of values used within it.

    Values that are not used are zero.
    """
    square, share = (
        scipy.ndimage.uniform_filter1d(x, width, mode="constant") for x in (values**2, counted.astype(np.float64))
    )
    known = (share > 0.0) & (square > 0.0)
    rms = np.sqrt(np.divide(square, share, out=np.ones_like(square), where=known))
    return np.asarray(rms), float(width * share[counted].mean())


def _correlation(values: Array, counted: NDArray[np.bool_], width: int) -> tuple[Array, Array]:
    """Numbers of pairs of used values, and their correlation, at all lags from ``1 - width`` to ``width - 1``.

    At lags with few pairs, as where the sample interval changes, the correlation is regarded as zero.
    """
    own, pairs = (
        scipy.signal.correlate(x, x, mode="full", method="fft")[len(x) - 1 : len(x) - 1 + width]
        for x in (values, counted.astype(np.float64))
    )
    pairs = np.rint(pairs)
    known = pairs >= _MIN_PAIR_FRACTION * pairs[0]
    correlation = np.divide(own, pairs, out=np.zeros_like(own), where=known) * pairs[0] / own[0]
    return np.concatenate([pairs[:0:-1], pairs]), np.concatenate([correlation[:0:-1], correlation])


def kurtosis_score(kurtosis: float, count: float) -> float:
    """Standard normal score of the kurtosis of `count` independent Gaussian values (Anscombe and Glynn 1983)."""
    n = count
    mean = 3.0 * (n - 1.0) / (n + 1.0)
    variance = 24.0 * n * (n - 2.0) * (n - 3.0) / ((n + 1.0) ** 2 * (n + 3.0) * (n + 5.0))
    skewness = (
        6.0
        * (n * n - 5.0 * n + 2.0)
        / ((n + 7.0) * (n + 9.0))
        * np.sqrt(6.0 * (n + 3.0) * (n + 5.0) / (n * (n - 2.0) * (n - 3.0)))
    )
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
    moments = moments_of(noise, settings)
    columns = {
        name: np.array([getattr(moments[channel], name.removeprefix("noise_")) for channel in CHANNELS])
        for name in NOISE_MOMENTS
    }
    row = _test_row(noise, moments, settings)
    reason = "" if np.isfinite(row["gaussianity_p_value"]) else _untested_reason(noise, settings)
    return columns | {"repeated_roll": noise.repeated, "gaussianity_message": reason} | row


def _untested_reason(noise: Noise, settings: IntermittencySettings) -> str:
    if not noise.is_estimated:
        return NO_ESTIMATE
    return REPEATED_ROLL if noise.repeated > settings.most_repeated else TOO_FEW


def _test_row(noise: Noise | None, moments: Mapping[str, NoiseMoments], settings: IntermittencySettings) -> Row:
    scores = np.array([moments[name].score for name in TESTED if name in moments])
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
class Gaussianity:
    """Test of a mission's lateral disturbances over its profiles.

    Attributes
    ----------
    profiles, tested, rejected : int
        Numbers of profiles with statistics, of those that are tested, and of those whose own test rejects a Gaussian
        disturbance at `LEVEL`.
    nulls : FalsePositives, optional
        Gaussian nulls that are tested and rejected; None if none is tested.
    contrast : Contrast, optional
        Comparison of the profiles' scores with those of the Gaussian nulls. It has its level even if the scores of
        Gaussian disturbances are not exactly standard normal.
    untested : mapping of str to tuple of int
        Profiles that are not tested, by the reason; empty if the archive records none.
    """

    profiles: int
    tested: int
    rejected: int
    nulls: FalsePositives | None = None
    contrast: Contrast | None = None
    untested: Mapping[str, tuple[int, ...]] = field(default_factory=dict)

    @property
    def count_p_value(self) -> float:
        """Probability of as many rejections if all profiles were Gaussian; NaN if none is tested."""
        if not self.tested:
            return float("nan")
        return float(scipy.stats.binomtest(self.rejected, self.tested, LEVEL, "greater").pvalue)

    @property
    def rejects_gaussian(self) -> bool:
        """True if the profiles have larger scores than Gaussian nulls at level `LEVEL`."""
        return self.contrast is not None and self.contrast.p_value <= LEVEL


def judged_gaussianity(measured: pd.DataFrame, nulls: pd.DataFrame) -> Gaussianity | None:
    """Judge the test over a mission.

    Parameters
    ----------
    measured, nulls : pandas.DataFrame
        Measured profiles, and Gaussian nulls, with columns ``gaussianity_score`` and ``gaussianity_p_value``.

    Returns
    -------
    Gaussianity or None
        None if the profiles have no such columns.
    """
    if "gaussianity_p_value" not in measured:
        return None
    scores, p = (measured[name].to_numpy(dtype=np.float64) for name in ("gaussianity_score", "gaussianity_p_value"))
    counts = (len(measured), int(np.isfinite(p).sum()), int((p <= LEVEL).sum()))
    judged = Gaussianity(*counts, untested=_untested(measured))
    if "gaussianity_p_value" not in nulls or not np.isfinite(nulls["gaussianity_p_value"]).any():
        return judged
    null_scores, null_p = (nulls[name].dropna().to_numpy() for name in ("gaussianity_score", "gaussianity_p_value"))
    passes = FalsePositives(int((null_p <= LEVEL).sum()), len(null_p), LEVEL)
    return replace(judged, nulls=passes, contrast=contrast_of(scores, null_scores))


def _untested(measured: pd.DataFrame) -> dict[str, tuple[int, ...]]:
    """Profiles that are not tested, by the reason in their message."""
    if "gaussianity_message" not in measured:
        return {}
    known = measured[measured["gaussianity_message"].notna()]
    return {
        str(reason): tuple(int(number) for number in rows["profile"])
        for reason, rows in known.groupby("gaussianity_message", sort=False)
        if reason
    }


def describe_untested(gaussianity: Gaussianity) -> str:
    """Describe the profiles that are not tested, and why."""
    parts = [f"{_listed(numbers)}, since {reason}" for reason, numbers in gaussianity.untested.items()]
    count = sum(len(numbers) for numbers in gaussianity.untested.values())
    return f"{count} of {gaussianity.profiles} not tested ({'; '.join(parts)})"


def _listed(numbers: tuple[int, ...]) -> str:
    if len(numbers) > _MAX_LISTED:
        return f"{len(numbers)} profiles"
    return f"{'profile' if len(numbers) == 1 else 'profiles'} {', '.join(map(str, numbers))}"
