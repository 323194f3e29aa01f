"""The statistics of one channel of one profile, measured or of a null, the same for both."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gliderhpc.studies.library.turbulence.channel import ChannelSeries
from gliderhpc.studies.library.turbulence.high_pass import bridged, high_passed
from gliderhpc.studies.library.turbulence.pieces import Pieces, pieces_of
from gliderhpc.studies.library.turbulence.settings import FastSettings, IntermittencySettings
from gliderhpc.studies.library.turbulence.spectrum import periodograms, power_law
from gliderhpc.studies.library.turbulence.structure import Structure, lag_samples, structure
from gliderhpc.studies.library.turbulence.surrogates import iaaft, joined, rank_p, spectrum_deviation

Array = NDArray[np.float64]
Row = dict[str, Any]

ROUNDING = 1e-9
"""A fast part of less (N or N m, root mean square) is zero to rounding, as without a turn in a null."""

LEAST_TIME = 300.0
"""A profile with less time (s) that counts has no statistics."""


@dataclass(frozen=True, eq=False)
class FastPart:
    """The high-passed series of a channel, in the stretches that count, or why there is none."""

    pieces: Pieces
    message: str = ""


def fast_part(series: ChannelSeries, settings: FastSettings, *, actuated: bool) -> FastPart:
    """High-pass a channel; what does not count is bridged first, so that its ends do not ring.

    A record that resolves nothing of the band, or too little of which counts, gives none: what lies between samples is
    interpolated, and a number made from it would be the interpolation's.
    """
    counted, lowest = series.counted(actuated=actuated), settings.band[0]
    values = high_passed(bridged(series.values, counted), series.step, settings.cutoff)
    pieces = pieces_of(values, counted, series.step, 1.0 / settings.cutoff)
    if series.nyquist <= lowest:
        return FastPart(pieces, unresolved_text(series.sample_interval, series.nyquist, lowest))
    if pieces.duration < LEAST_TIME:
        return FastPart(pieces, f"only {pieces.duration:.0f} s count, of {LEAST_TIME:.0f} s needed")
    if moments_row(pieces)["rms"] < ROUNDING:
        return FastPart(pieces, "the fast part is zero to rounding")
    return FastPart(pieces)


def unresolved_text(interval: float, nyquist: float, lowest: float) -> str:
    """Say that samples `interval` s apart, resolving up to `nyquist` Hz, hold nothing of a band from `lowest` Hz on."""
    return (
        f"samples {interval:.3g} s apart resolve nothing above {nyquist:.2g} Hz, so nothing of the band from "
        f"{lowest:g} Hz on"
    )


def resolved_band(band: tuple[float, float], nyquist: float) -> tuple[float, float]:
    """Part of a band (Hz) that lies below the Nyquist frequency."""
    return band[0], min(band[1], nyquist)


def thinned(pieces: Pieces, interval: float) -> Pieces:
    """Average a series over so many seconds, or the next whole number of steps below."""
    return pieces.thinned(max(1, int(interval / pieces.step + 1e-9)))


def moments_row(pieces: Pieces) -> Row:
    """Kurtosis (3 for Gaussian), largest magnitude and standard deviation of what counts."""
    values = pieces.values[pieces.counted]
    square = float(np.mean(values**2))
    return {
        "kurtosis": float(np.mean(values**4)) / square**2 if square > 0.0 else float("nan"),
        "peak": float(np.max(np.abs(values))),
        "rms": float(np.sqrt(square)),
    }


def structure_of(pieces: Pieces, settings: IntermittencySettings, sample_interval: float) -> Structure:
    """Structure functions of a series at the settings' lags, those missing that are shorter than a sample interval."""
    lags = lag_samples(settings.every_lag, pieces.step)
    found = structure(pieces, lags)
    found.functions[found.lags < sample_interval - 1e-6] = np.nan
    return found


def statistics_row(pieces: Pieces, found: Structure, series: ChannelSeries, settings: IntermittencySettings) -> Row:
    """Statistics of a fast part and of the structure functions of it: one set for measured series and for nulls."""
    spectra = periodograms(pieces, settings.segment)
    on_band = settings.band[1] <= 0.5 / series.step + 1e-9
    return {
        **moments_row(pieces),
        "flatness": float(found.flatness_at(settings.lag)),
        "zeta_ratio": float(found.ratio(settings.scaling)),
        "beta": power_law(spectra, settings.band).exponent if on_band else float("nan"),
        "beta_resolved": power_law(spectra, resolved_band(settings.band, series.nyquist)).exponent,
    }


@dataclass(frozen=True, eq=False)
class SurrogateTest:
    """A series beside its surrogates.

    Attributes
    ----------
    flatness : float
        Of the series as the surrogates were made from it: its stretches less their faded ends.
    p_value : float
        Of the rank test.
    structures : Structure
        Of the surrogates, ``functions (s, m, 6)``.
    iterations : (s,) int array
        Taken.
    converged : (s,) mask
        Whose order stood, or whose spectrum came no nearer.
    deviation : (s, 2) array
        Root mean square and largest deviation of their spectra in half-octave bands.
    """

    flatness: float
    p_value: float
    structures: Structure
    iterations: NDArray[np.int64]
    converged: NDArray[np.bool_]
    deviation: Array


def surrogate_test(pieces: Pieces, settings: IntermittencySettings, rng: np.random.Generator) -> SurrogateTest:
    """Make a series' surrogates and rank its flatness among theirs; one-sided, at the lag fixed beforehand."""
    source = joined(pieces, settings.fade)
    lags = lag_samples(settings.every_lag, pieces.step)
    band = (settings.cutoff, min(settings.band[1], 0.5 / pieces.step))
    own = float(structure(source.pieces(source.values), lags).flatness_at(settings.lag))
    made = [
        iaaft(source.values, rng, most=settings.iterations, tolerance=settings.tolerance)
        for _ in range(settings.surrogates)
    ]
    each = [structure(source.pieces(one.values), lags) for one in made]
    structures = Structure(each[0].lags, np.stack([one.functions for one in each]))
    return SurrogateTest(
        own,
        rank_p(own, structures.flatness_at(settings.lag)),
        structures,
        np.array([one.iterations for one in made]),
        np.array([one.converged for one in made]),
        np.array([spectrum_deviation(one.values, source.values, pieces.step, band) for one in made]),
    )
