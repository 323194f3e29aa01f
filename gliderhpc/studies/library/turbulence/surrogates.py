"""Surrogates that keep a series' values and spectrum and lose its phases (Schreiber & Schmitz 1996), and their test.

The iterated amplitude-adjusted Fourier transform puts the spectrum right and then the values, in turn. It ends with the
values, so these are exactly the series' own and the spectrum is as near as the iteration came.
"""

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from gliderhpc.studies.library.turbulence.pieces import Pieces

Array = NDArray[np.float64]

BANDS_PER_OCTAVE = 2
"""Of the spectrum's deviation."""


@dataclass(frozen=True, eq=False)
class Surrogate:
    """A surrogate.

    Attributes
    ----------
    values : (n,) array
        A reordering of the series.
    iterations : int
        Taken.
    converged : bool
        Whether the order stood, or the spectrum stopped coming nearer, before the cap.
    """

    values: Array
    iterations: int
    converged: bool


def iaaft(values: Array, rng: np.random.Generator, *, most: int = 200, tolerance: float = 1e-2) -> Surrogate:
    """Make a surrogate of a series ``(n,)``, which counts as periodic.

    Parameters
    ----------
    values : (n,) array
        The series; its ends should meet, see `joined`.
    rng : numpy.random.Generator
        Of the order that the iteration starts from.
    most : int
        Cap of the iterations.
    tolerance : float
        Relative gain of an iteration in the distance of the amplitudes below which it has converged.
    """
    ordered, amplitudes = np.sort(values), np.abs(scipy.fft.rfft(values))
    surrogate = rng.permutation(values)
    before = np.inf
    for iteration in range(1, most + 1):
        spectrum = scipy.fft.rfft(surrogate)
        magnitudes = np.abs(spectrum)
        distance = float(np.linalg.norm(magnitudes - amplitudes))
        if distance >= (1.0 - tolerance) * before:
            return Surrogate(surrogate, iteration - 1, converged=True)
        before = distance
        phases = np.divide(spectrum, magnitudes, out=np.ones_like(spectrum), where=magnitudes > 0.0)
        wanted = scipy.fft.irfft(amplitudes * phases, len(values))
        surrogate = np.empty_like(values)
        surrogate[np.argsort(wanted)] = ordered
    return Surrogate(surrogate, most, converged=False)


def spectrum_deviation(surrogate: Array, values: Array, step: float, band: tuple[float, float]) -> tuple[float, float]:
    """Root mean square and largest relative difference of power over half-octave bands between two frequencies (Hz).

    NaN where the series has no power there.
    """
    frequency = np.fft.rfftfreq(len(values), step)
    octave = np.floor(BANDS_PER_OCTAVE * np.log2(np.maximum(frequency, 1e-12) / band[0])).astype(np.int64)
    inside = (frequency >= band[0]) & (frequency <= band[1])
    theirs, own = (np.bincount(octave[inside], np.abs(scipy.fft.rfft(one)[inside]) ** 2) for one in (surrogate, values))
    known = own > 0.0
    if not known.any():
        return float("nan"), float("nan")
    relative = theirs[known] / own[known] - 1.0
    return float(np.sqrt(np.mean(relative**2))), float(np.max(np.abs(relative)))


def rank_p(measured: float, surrogates: Array) -> float:
    """One-sided p of the exact rank test: the share of measured and surrogates together that are as large.

    NaN where there is nothing to rank.
    """
    if not np.isfinite(measured):
        return float("nan")
    return float((1 + np.count_nonzero(surrogates >= measured)) / (1 + len(surrogates)))


@dataclass(frozen=True, eq=False)
class Joined:
    """The stretches of a series on end, for surrogates, and what of the result counts.

    Attributes
    ----------
    values : (n,) array
        Each stretch fades to nothing at both ends, so that no jump is where two meet, nor where the end meets the
        beginning.
    label : (n,) int array
        As in `Pieces`; what faded does not count.
    step : float
        s.
    """

    values: Array
    label: NDArray[np.int64]
    step: float

    def pieces(self, values: Array) -> Pieces:
        """A series of these samples in its stretches."""
        return Pieces(values, self.label, self.step)


def joined(pieces: Pieces, fade: float) -> Joined:
    """Put the stretches of a series on end, each faded in and out over so many seconds.

    The last stretch is cut by a few samples, to a length whose Fourier transform is fast. A stretch too short to keep
    anything unfaded is left out.
    """
    width = max(1, round(fade / pieces.step))
    numbers = np.flatnonzero(np.bincount(pieces.label[pieces.counted]) > 2 * width)
    samples = [np.flatnonzero(pieces.label == number) for number in numbers]
    if not samples:
        return Joined(np.empty(0), np.empty(0, dtype=np.int64), pieces.step)
    total = sum(len(one) for one in samples)
    surplus = total - scipy.fft.prev_fast_len(total, real=True)
    if len(samples[-1]) - surplus > 2 * width:
        samples[-1] = samples[-1][: len(samples[-1]) - surplus]
    at = np.concatenate(samples)
    weight = np.concatenate([_faded(len(one), width) for one in samples])
    label = np.where(weight < 1.0, -1, pieces.label[at])
    return Joined(pieces.values[at] * weight, label, pieces.step)


def _faded(count: int, width: int) -> Array:
    """Weights ``(count,)`` that rise to one over `width` samples, and fall at the end; below one only there."""
    ramp = 0.5 - 0.5 * np.cos(np.pi * (np.arange(width) + 0.5) / width)
    return np.concatenate([ramp, np.ones(count - 2 * width), ramp[::-1]])
