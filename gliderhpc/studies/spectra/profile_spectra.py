"""One profile of the study: spectra of the whole and of three parts by depth, each with its exponents."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gliderhpc.studies.library.turbulence.channel import ChannelSeries
from gliderhpc.studies.library.turbulence.pieces import Pieces, pieces_of
from gliderhpc.studies.library.turbulence.settings import SpectraSettings
from gliderhpc.studies.library.turbulence.spectrum import Periodograms, PowerLaw, periodograms, power_law
from gliderhpc.studies.library.turbulence.statistics import fast_part, moments_row, resolved_band

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Row = dict[str, Any]

PARTS = ("whole", "shallow", "middle", "deep")


@dataclass(frozen=True, eq=False)
class ProfileSpectra:
    """Row of the group's table, and its rows on the frequencies."""

    row: Row
    on_frequencies: Row


def profile_spectra(series: ChannelSeries, settings: SpectraSettings) -> ProfileSpectra:
    """Study one profile; a record that resolves nothing of the band gives the reason alone."""
    part = fast_part(series, settings, actuated=False)
    deep_enough = series.depth >= settings.shallowest
    counted = part.pieces.counted & deep_enough
    row: Row = {"nyquist": series.nyquist, "counted": float(counted.mean())}
    if part.message:
        return ProfileSpectra({**row, "message": part.message}, {})
    rng = np.random.default_rng(settings.seed)
    for name, chosen in zip(PARTS, (counted, *thirds(series.depth, counted)), strict=True):
        spectra = _spectra(part.pieces, chosen, settings)
        row |= _extent(name, series.depth[chosen]) | {f"{name}_segments": len(spectra.density)}
        row |= exponents(f"{name}_", spectra, series, settings, rng)
    row["rms"] = moments_row(part.pieces)["rms"]
    included = fast_part(series, settings, actuated=True).pieces
    beside = _spectra(included, included.counted & deep_enough, settings)
    row |= exponents("", beside, series, settings, rng, suffix="_all")
    whole = _spectra(part.pieces, counted, settings)
    return ProfileSpectra(row, {"frequency_hz": whole.frequency, "density": whole.mean, "density_all": beside.mean})


def thirds(depth: Array, counted: Mask) -> tuple[Mask, Mask, Mask]:
    """Shallow, middle and deep samples ``(n,)``, of equal time, of those that count."""
    if not counted.any():
        return counted, counted, counted
    low, high = np.percentile(depth[counted], [100.0 / 3.0, 200.0 / 3.0])
    return counted & (depth <= low), counted & (depth > low) & (depth <= high), counted & (depth > high)


def exponents(
    prefix: str,
    spectra: Periodograms,
    series: ChannelSeries,
    settings: SpectraSettings,
    rng: np.random.Generator,
    suffix: str = "",
) -> Row:
    """Exponents on the band and on its resolved part, with intervals; none on a band that the series ends within."""
    own_end = 0.5 / series.step
    bands = {"beta": settings.band, "beta_resolved": resolved_band(settings.band, series.nyquist)}
    row: Row = {}
    for name, band in bands.items():
        law = power_law(spectra, band, settings.draws, rng) if band[1] <= own_end + 1e-9 else PowerLaw()
        whole = f"{prefix}{name}{suffix}"
        row |= {whole: law.exponent, f"{whole}_low": law.low, f"{whole}_high": law.high, f"{whole}_r2": law.r2}
    return row


def _spectra(pieces: Pieces, chosen: Mask, settings: SpectraSettings) -> Periodograms:
    return periodograms(pieces_of(pieces.values, chosen, pieces.step), settings.segment)


def _extent(part: str, depth: Array) -> Row:
    return {f"{part}_from": float(depth.min()), f"{part}_to": float(depth.max())} if depth.size else {}
