"""Surrogates with a series' values and spectrum but random phases (Schreiber & Schmitz 1996), and the rank test.

The iterated amplitude-adjusted Fourier transform restores the spectrum and the values in turn. It ends with the values:
these are exactly those of the series, and the spectrum is approximate.
"""

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from gliderhpc.errors import ProfileError
from gliderhpc.studies.library.turbulence.series import GappySeries, IntermittencySettings
from gliderhpc.studies.library.turbulence.statistics import (
    StructureFunctions,
    lag_samples,
    structure_functions,
    without_unresolved_lags,
)

Array = NDArray[np.float64]

BANDS_PER_OCTAVE = 2
"""Number of bands in an octave over which the spectrum's deviation is computed."""


@dataclass(frozen=True, eq=False)
class Surrogate:
    """A surrogate.

    Attributes
    ----------
    values : (n,) array
        Values of the series in another order.
    iterations : int
        Number of iterations.
    converged : bool
        True if the order or the distance of the spectrum stopped changing before the largest number of iterations.
    """

    values: Array
    iterations: int
    converged: bool


def iaaft(values: Array, rng: np.random.Generator, *, max_iterations: int = 200, tolerance: float = 1e-2) -> Surrogate:
    """Make a surrogate of a series ``(n,)``, which is assumed to be periodic.

    Parameters
    ----------
    values : (n,) array
        Series, whose ends should meet (see `join_stretches`).
    rng : numpy.random.Generator
        Generator of the order from which the iteration starts.
    max_iterations : int
        Largest number of iterations.
    tolerance : float
        Relative decrease of the amplitudes' distance in an iteration, below which the iteration has converged.
    """
    ordered, amplitudes = np.sort(values), np.abs(scipy.fft.rfft(values))
    surrogate = rng.permutation(values)
    last_distance = np.inf
    for iteration in range(1, max_iterations + 1):
        spectrum = scipy.fft.rfft(surrogate)
        magnitudes = np.abs(spectrum)
        distance = float(np.linalg.norm(magnitudes - amplitudes))
        if distance >= (1.0 - tolerance) * last_distance:
            return Surrogate(surrogate, iteration - 1, converged=True)
        last_distance = distance
        phases = np.divide(spectrum, magnitudes, out=np.ones_like(spectrum), where=magnitudes > 0.0)
        target = scipy.fft.irfft(amplitudes * phases, len(values))
        surrogate = np.empty_like(values)
        surrogate[np.argsort(target)] = ordered
    return Surrogate(surrogate, max_iterations, converged=False)


def spectrum_deviation(surrogate: Array, values: Array, step: float, band: tuple[float, float]) -> tuple[float, float]:
    """Root mean square and largest relative difference of power over half-octave bands between two frequencies (Hz).

    NaN if the series has no power there.
    """
    frequency = np.fft.rfftfreq(len(values), step)
    octave = np.floor(BANDS_PER_OCTAVE * np.log2(np.maximum(frequency, 1e-12) / band[0])).astype(np.int64)
    inside = (frequency >= band[0]) & (frequency <= band[1])
    power, own = (
        np.bincount(octave[inside], np.abs(scipy.fft.rfft(series)[inside]) ** 2) for series in (surrogate, values)
    )
    known = own > 0.0
    if not known.any():
        return float("nan"), float("nan")
    relative = power[known] / own[known] - 1.0
    return float(np.sqrt(np.mean(relative**2))), float(np.max(np.abs(relative)))


def rank_p_value(measured: float, surrogates: Array) -> float:
    """One-sided p of the exact rank test: share of the measured value and the surrogates that are at least as large.

    NaN if the measured value is not finite.
    """
    if not np.isfinite(measured):
        return float("nan")
    return float((1 + np.count_nonzero(surrogates >= measured)) / (1 + len(surrogates)))


def join_stretches(series: GappySeries, fade: float) -> GappySeries:
    """Join the stretches of a series end to end for surrogates, each faded in and out over `fade` (s).

    Each stretch fades to zero at both ends, which avoids jumps where two stretches meet and where the end meets the
    beginning. Faded samples are not used in statistics. The last stretch is cut by a few samples to a total length with
    a fast Fourier transform. A stretch too short to have an unfaded sample is left out.
    """
    width = max(1, round(fade / series.step))
    numbers = np.flatnonzero(np.bincount(series.label[series.counted]) > 2 * width)
    samples = [np.flatnonzero(series.label == number) for number in numbers]
    if not samples:
        return GappySeries(np.empty(0), np.empty(0, dtype=np.int64), series.step)
    total = sum(len(stretch) for stretch in samples)
    surplus = total - scipy.fft.prev_fast_len(total, real=True)
    if len(samples[-1]) - surplus > 2 * width:
        samples[-1] = samples[-1][: len(samples[-1]) - surplus]
    at = np.concatenate(samples)
    weight = np.concatenate([_fade_weights(len(stretch), width) for stretch in samples])
    label = np.where(weight < 1.0, -1, series.label[at])
    return GappySeries(series.values[at] * weight, label, series.step)


def _fade_weights(count: int, width: int) -> Array:
    """Weights ``(count,)`` that rise to one over `width` samples and fall over the last `width`."""
    ramp = 0.5 - 0.5 * np.cos(np.pi * (np.arange(width) + 0.5) / width)
    return np.concatenate([ramp, np.ones(count - 2 * width), ramp[::-1]])


@dataclass(frozen=True, eq=False)
class SurrogateTest:
    """Rank test of a series among its surrogates.

    Attributes
    ----------
    p_value : float
        p of the rank test of the flatness; that of the series is computed after fading, as for the surrogates.
    structures : StructureFunctions
        Structure functions of the surrogates, ``functions (s, m, 6)``.
    iterations : (s,) int array
        Numbers of iterations.
    converged : (s,) mask
        True for surrogates whose iteration converged.
    deviation : (s, 2) array
        Root mean square and largest deviation of the surrogates' spectra in half-octave bands.
    """

    p_value: float
    structures: StructureFunctions
    iterations: NDArray[np.int64]
    converged: NDArray[np.bool_]
    deviation: Array


def surrogate_test(
    series: GappySeries, settings: IntermittencySettings, sample_interval: float, rng: np.random.Generator
) -> SurrogateTest:
    """Make surrogates of a series, and rank its flatness among theirs: one-sided, at the lag of the settings.

    Structure functions at lags shorter than the records' sample interval (s), which they do not resolve, are NaN, and
    so is the rank at such a lag.

    Raises
    ------
    ProfileError
        No stretch of the series is longer than the fades at its ends.
    """
    source = join_stretches(series, settings.fade)
    if len(source.values) == 0:
        raise ProfileError(f"no stretch of the record is longer than twice the fade of {settings.fade:g} s")
    lags = lag_samples(settings.every_lag, source.step)
    band = (settings.cutoff, min(settings.band[1], 0.5 / source.step))
    own = without_unresolved_lags(structure_functions(source, lags), sample_interval).flatness_at(settings.lag)
    surrogates = [
        iaaft(source.values, rng, max_iterations=settings.iterations, tolerance=settings.tolerance)
        for _ in range(settings.surrogates)
    ]
    of_surrogates = [structure_functions(source.with_values(surrogate.values), lags) for surrogate in surrogates]
    every = StructureFunctions(of_surrogates[0].lags, np.stack([surrogate.functions for surrogate in of_surrogates]))
    structures = without_unresolved_lags(every, sample_interval)
    return SurrogateTest(
        rank_p_value(float(own), structures.flatness_at(settings.lag)),
        structures,
        np.array([surrogate.iterations for surrogate in surrogates]),
        np.array([surrogate.converged for surrogate in surrogates]),
        np.array([spectrum_deviation(surrogate.values, source.values, source.step, band) for surrogate in surrogates]),
    )
