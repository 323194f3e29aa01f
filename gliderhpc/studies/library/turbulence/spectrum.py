"""Welch's spectrum of a series with gaps, and the exponent of a power law fitted to a band of it."""

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from gliderhpc.studies.library.turbulence.pieces import Pieces

Array = NDArray[np.float64]

LEAST_FREQUENCIES = 6
"""A power law is fitted to at least so many frequencies."""

_BLOCK = 2
"""Neighbouring segments share half their samples, so they are drawn in pairs."""

_COVERAGE = (2.5, 97.5)


@dataclass(frozen=True, eq=False)
class Periodograms:
    """Spectra of the segments of a series.

    Attributes
    ----------
    frequency : (m,) array
        Hz.
    density : (k, m) array
        One-sided power spectral density of each segment, the series' unit squared per Hz; their mean is Welch's.
    """

    frequency: Array
    density: Array

    @property
    def mean(self) -> Array:
        """Welch's spectrum ``(m,)``; NaN without a segment."""
        return self.density.mean(axis=0) if len(self.density) else np.full(len(self.frequency), np.nan)


@dataclass(frozen=True)
class PowerLaw:
    """Exponent of ``S(f) ~ f^-beta``, ends of its 95 % interval, and coefficient of determination; NaN where none."""

    exponent: float = float("nan")
    low: float = float("nan")
    high: float = float("nan")
    r2: float = float("nan")


def periodograms(pieces: Pieces, segment: float) -> Periodograms:
    """Spectra of segments of so many seconds, half overlapping, Hann-windowed, their mean taken out (Welch 1967).

    No segment spans two stretches; a stretch shorter than a segment has none.
    """
    count = max(2, round(segment / pieces.step))
    label = pieces.label
    found = [
        _segments(pieces.values[label == number], pieces.step, count)
        for number in range(label.max() + 1)
        if np.count_nonzero(label == number) >= count
    ]
    frequency = np.asarray(np.fft.rfftfreq(count, pieces.step), dtype=np.float64)
    return Periodograms(frequency, np.concatenate(found) if found else np.empty((0, len(frequency))))


def _segments(values: Array, step: float, count: int) -> Array:
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
        Of the segments.
    band : (float, float)
        Hz; every frequency within counts alike, as in the paper.
    draws : int
        Of the interval's bootstrap, which draws pairs of neighbouring segments; 0 for none.
    rng : numpy.random.Generator, optional
        Of these draws.

    Returns
    -------
    PowerLaw
        NaN where the band holds fewer than `LEAST_FREQUENCIES` or there is no segment.
    """
    chosen = (spectra.frequency >= band[0]) & (spectra.frequency <= band[1]) & (spectra.frequency > 0.0)
    mean = spectra.mean[chosen]
    if np.count_nonzero(chosen) < LEAST_FREQUENCIES or not np.all(mean > 0.0):
        return PowerLaw()
    x, y = np.log(spectra.frequency[chosen]), np.log(mean)
    slope = _slopes(x, y[None])[0]
    residual = y - y.mean() - slope * (x - x.mean())
    r2 = 1.0 - float(residual @ residual) / float(np.sum((y - y.mean()) ** 2))
    if draws == 0 or rng is None or len(spectra.density) < 2 * _BLOCK:
        return PowerLaw(-slope, r2=r2)
    means = _drawn_means(spectra.density[:, chosen], draws, rng)
    low, high = np.percentile(-_slopes(x, np.log(means)), _COVERAGE)
    return PowerLaw(-slope, float(low), float(high), r2)


def _slopes(x: Array, y: Array) -> Array:
    """Slopes ``(d,)`` of rows ``(d, m)`` on ``(m,)``."""
    lever = x - x.mean()
    return np.asarray(y @ lever / (lever @ lever))


def _drawn_means(density: Array, draws: int, rng: np.random.Generator) -> Array:
    """Mean spectra ``(draws, m)`` of as many pairs of neighbours as there are, drawn with replacement."""
    pairs = 0.5 * (density[:-1] + density[1:])
    weights = rng.multinomial(len(density) // _BLOCK, np.full(len(pairs), 1.0 / len(pairs)), draws)
    return np.asarray(weights @ pairs / (len(density) // _BLOCK))
