"""Spectra with power laws, structure functions with scaling exponents, and the set of statistics of a fast part.

Spectra are computed by Welch's method, from segments that never span two stretches. Increments
``dx(tau) = x(t + tau) - x(t)`` have the structure functions ``S_p = <|dx|^p>`` and the flatness ``F = S_4 / S_2^2``. In
extended self-similarity (Benzi et al. 1993), ``zeta_p / zeta_3`` is the slope of ``log S_p`` against ``log S_3`` over a
range of tau. The same statistics are computed for measured series and nulls.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from gliderhpc.distributions import few_values_factor
from gliderhpc.studies.library.trends import INTERVAL
from gliderhpc.studies.library.turbulence.series import (
    ChannelSeries,
    GappySeries,
    IntermittencySettings,
    SpectraSettings,
    resolved_band,
)

Array = NDArray[np.float64]
Row = dict[str, Any]

MIN_FREQUENCIES = 6
"""Minimum number of frequencies for the fit of a power law."""

MIN_LAGS = 4
"""Minimum number of lags for the fit of an exponent."""

ORDERS = (1, 2, 3, 4, 5, 6)
"""Orders of the structure functions."""

_SEGMENTS_PER_DRAW = 2
"""Number of segments in a bootstrap draw: neighbours share half their samples, so they are drawn in pairs."""


# Spectra


@dataclass(frozen=True, eq=False)
class Periodograms:
    """Spectra of the segments of a series.

    Attributes
    ----------
    frequency : (m,) array
        Frequencies, Hz.
    density : (k, m) array
        One-sided power spectral density of each segment, the series' unit squared per Hz; their mean is Welch's.
    """

    frequency: Array
    density: Array

    @property
    def mean(self) -> Array:
        """Welch's spectrum ``(m,)``; NaN without segments."""
        return self.density.mean(axis=0) if len(self.density) else np.full(len(self.frequency), np.nan)


@dataclass(frozen=True)
class PowerLaw:
    """Exponent of ``S(f) ~ f^-beta``, ends of its 95 % interval, and coefficient of determination; NaN if undefined."""

    exponent: float = float("nan")
    low: float = float("nan")
    high: float = float("nan")
    r2: float = float("nan")


def periodograms(series: GappySeries, segment: float) -> Periodograms:
    """Compute the spectra of half overlapping, Hann-windowed segments without their means (Welch 1967).

    Stretches shorter than a segment (s) are not used.
    """
    count = max(2, round(segment / series.step))
    label = series.label
    densities = [
        _segment_densities(series.values[label == number], series.step, count)
        for number in range(label.max() + 1)
        if np.count_nonzero(label == number) >= count
    ]
    frequency = np.asarray(np.fft.rfftfreq(count, series.step), dtype=np.float64)
    return Periodograms(frequency, np.concatenate(densities) if densities else np.empty((0, len(frequency))))


def _segment_densities(values: Array, step: float, count: int) -> Array:
    _, _, density = scipy.signal.spectrogram(
        values, fs=1.0 / step, window="hann", nperseg=count, noverlap=count // 2, detrend="constant", mode="psd"
    )
    return np.asarray(density.T)


def power_law(
    spectra: Periodograms, band: tuple[float, float], draws: int = 0, rng: np.random.Generator | None = None
) -> PowerLaw:
    """Fit a straight line to the logarithms of a spectrum over a band (section 5.3).

    Parameters
    ----------
    spectra : Periodograms
        Spectra of the segments.
    band : (float, float)
        Band, Hz; all frequencies in it have the same weight, as in the paper.
    draws : int
        Number of bootstrap draws for the interval, made of pairs of neighbouring segments; 0 for no interval.
    rng : numpy.random.Generator, optional
        Generator of these draws.

    Returns
    -------
    PowerLaw
        Fitted power law; NaN if the band has fewer than `MIN_FREQUENCIES` frequencies or there are no segments.
    """
    chosen = (spectra.frequency >= band[0]) & (spectra.frequency <= band[1]) & (spectra.frequency > 0.0)
    mean = spectra.mean[chosen]
    if np.count_nonzero(chosen) < MIN_FREQUENCIES or not np.all(mean > 0.0):
        return PowerLaw()
    x, y = np.log(spectra.frequency[chosen]), np.log(mean)
    slope = _slopes(x, y[None])[0]
    residual = y - y.mean() - slope * (x - x.mean())
    r2 = 1.0 - float(residual @ residual) / float(np.sum((y - y.mean()) ** 2))
    if draws == 0 or rng is None or len(spectra.density) < 2 * _SEGMENTS_PER_DRAW:
        return PowerLaw(-slope, r2=r2)
    means = _drawn_means(spectra.density[:, chosen], draws, rng)
    low, high = np.percentile(-_slopes(x, np.log(means)), INTERVAL)
    wider = _few_draws_factor(len(spectra.density) // _SEGMENTS_PER_DRAW)
    return PowerLaw(-slope, float(-slope - wider * (-slope - low)), float(-slope + wider * (high + slope)), r2)


def band_power_law(
    spectra: Periodograms,
    step: float,
    settings: SpectraSettings,
    draws: int = 0,
    rng: np.random.Generator | None = None,
) -> PowerLaw:
    """Fit a power law over the settings' band; NaN if a series sampled every `step` (s) does not resolve all of it."""
    if settings.band[1] > 0.5 / step + 1e-9:
        return PowerLaw()
    return power_law(spectra, settings.band, draws, rng)


def _slopes(x: Array, y: Array) -> Array:
    """Slopes ``(d,)`` of the regressions of rows ``(d, m)`` on ``(m,)``."""
    lever = x - x.mean()
    return np.asarray(y @ lever / (lever @ lever))


def _few_draws_factor(count: int) -> float:
    """Factor by which a bootstrap of ``count`` independent parts widens: Student's quantile, and the lost freedom.

    Without it, intervals of 5 to 23 segments held the exponents of synthetic series in 76 to 90 % of cases.
    """
    level = 0.5 + 0.005 * float(INTERVAL[1] - INTERVAL[0])
    return few_values_factor(level, count - 1) * math.sqrt(count / (count - 1))


def _drawn_means(density: Array, draws: int, rng: np.random.Generator) -> Array:
    """Mean spectra ``(draws, m)`` of pairs of neighbours drawn with replacement, half as many as there are segments."""
    pairs = 0.5 * (density[:-1] + density[1:])
    count = len(density) // _SEGMENTS_PER_DRAW
    weights = rng.multinomial(count, np.full(len(pairs), 1.0 / len(pairs)), draws)
    return np.asarray(weights @ pairs / count)


# Structure functions


@dataclass(frozen=True, eq=False)
class StructureFunctions:
    """Structure functions at some lags.

    Attributes
    ----------
    lags : (m,) array
        Lags, s; multiples of the step between samples.
    functions : (..., m, 6) array
        ``S_1`` to ``S_6``; NaN where all stretches are shorter than the lag.
    """

    lags: Array
    functions: Array

    @property
    def flatness(self) -> Array:
        """Flatness ``(..., m)``."""
        return np.asarray(self.functions[..., 3] / self.functions[..., 1] ** 2)

    def flatness_at(self, lag: float) -> Array:
        """Flatness ``(...)`` at the lag (s) nearest to a given one."""
        return np.asarray(self.flatness[..., int(np.argmin(np.abs(self.lags - lag)))])

    def exponents(self, scaling: tuple[float, float]) -> Array:
        """Relative exponents ``zeta_p / zeta_3 (..., 6)`` over a range of lags (s); NaN if it has too few lags."""
        inside = (self.lags >= scaling[0] - 1e-9) & (self.lags <= scaling[1] + 1e-9)
        logs = np.log(self.functions[..., inside, :])
        if np.count_nonzero(inside) < MIN_LAGS:
            return np.full((*self.functions.shape[:-2], len(ORDERS)), np.nan)
        third = logs[..., 2] - logs[..., 2].mean(axis=-1, keepdims=True)
        return np.asarray(np.einsum("...l,...lp->...p", third, logs) / np.sum(third**2, axis=-1)[..., None])

    def zeta_ratio(self, scaling: tuple[float, float]) -> Array:
        """Relative exponent of the sixth order ``zeta_6 / zeta_3 (...)`` over a range of lags (s)."""
        return np.asarray(self.exponents(scaling)[..., 5])


def lag_samples(lags: Sequence[float], step: float) -> NDArray[np.int64]:
    """Convert lags (s) to distinct numbers of samples, at least one."""
    return np.unique(np.maximum(1, np.rint(np.asarray(lags) / step).astype(np.int64)))


def structure_functions(series: GappySeries, lags: NDArray[np.int64]) -> StructureFunctions:
    """Compute the structure functions of a series at lags in samples."""
    sums, counts = _block_sums(series, lags, len(series.values))
    return _averages(series, lags, sums[0], counts[0])


def bootstrap_structure_functions(
    series: GappySeries, lags: NDArray[np.int64], block: float, draws: int, rng: np.random.Generator
) -> StructureFunctions:
    """Compute structure functions ``(draws, m, 6)`` of blocks of `block` (s), drawn with replacement."""
    sums, counts = _block_sums(series, lags, max(1, round(block / series.step)))
    filled = np.flatnonzero(counts.sum(axis=1) > 0.0)
    weights = rng.multinomial(len(filled), np.full(len(filled), 1.0 / len(filled)), draws).astype(np.float64)
    drawn = np.einsum("db,blp->dlp", weights, sums[filled], optimize=True)
    return _averages(series, lags, drawn, weights @ counts[filled])


def _block_sums(series: GappySeries, lags: NDArray[np.int64], block: int) -> tuple[Array, Array]:
    """Sums ``(b, m, 6)`` of powers of the increments that begin in each block of `block` samples, and their numbers."""
    blocks = -(-len(series.values) // block)
    sums, counts = np.zeros((blocks, len(lags), len(ORDERS))), np.zeros((blocks, len(lags)))
    for at, lag in enumerate(lags):
        increments, first = series.increments(int(lag))
        index, magnitude = first // block, np.abs(increments)
        counts[:, at] = np.bincount(index, minlength=blocks)
        power = np.ones_like(magnitude)
        for column in range(len(ORDERS)):
            power = power * magnitude
            sums[:, at, column] = np.bincount(index, power, minlength=blocks)
    return sums, counts


def _averages(series: GappySeries, lags: NDArray[np.int64], sums: Array, counts: Array) -> StructureFunctions:
    with np.errstate(invalid="ignore", divide="ignore"):
        return StructureFunctions(np.asarray(lags * series.step, dtype=np.float64), sums / counts[..., None])


def without_unresolved_lags(structures: StructureFunctions, sample_interval: float) -> StructureFunctions:
    """Set the structure functions at lags shorter than the records' sample interval (s) to NaN."""
    functions = structures.functions.copy()
    functions[..., structures.lags < sample_interval - 1e-6, :] = np.nan
    return StructureFunctions(structures.lags, functions)


def resolved_structure_functions(
    series: GappySeries, settings: IntermittencySettings, sample_interval: float
) -> StructureFunctions:
    """Compute structure functions at the settings' lags; NaN at lags shorter than a sample interval (s)."""
    lags = lag_samples(settings.every_lag, series.step)
    return without_unresolved_lags(structure_functions(series, lags), sample_interval)


# The set of statistics


def moments(series: GappySeries) -> Row:
    """Kurtosis (3 for a Gaussian series), largest magnitude and root mean square of the samples used."""
    values = series.values[series.counted]
    square = float(np.mean(values**2))
    return {
        "kurtosis": float(np.mean(values**4)) / square**2 if square > 0.0 else float("nan"),
        "peak": float(np.max(np.abs(values))),
        "rms": series.rms,
    }


def statistics_row(
    fast: GappySeries, structures: StructureFunctions, channel: ChannelSeries, settings: IntermittencySettings
) -> Row:
    """Compute the statistics of a fast part and its structure functions, under the names used in the archive's groups.

    See group `intermittency` in ``gliderhpc/store_schema/studies.txt``.
    """
    spectra = periodograms(fast, settings.segment)
    return {
        **moments(fast),
        "flatness": float(structures.flatness_at(settings.lag)),
        "zeta_ratio": float(structures.zeta_ratio(settings.scaling)),
        "beta": band_power_law(spectra, channel.step, settings).exponent,
        "beta_resolved": power_law(spectra, resolved_band(settings.band, channel.nyquist)).exponent,
    }
