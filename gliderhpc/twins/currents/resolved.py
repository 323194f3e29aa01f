"""One twin's depth-resolved current beside the water's: in time, and by vertical scale.

The water's acceleration across the hull, ``y . dU/dt`` along the path, is what pushes a hull sideways against the water
(model.md 11); over the vertical speed it is the shear dU/dZ across the hull.
"""

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from gliderhpc.flight.glider import Glider
from gliderhpc.observations.stretches import stretches
from gliderhpc.platform import Platform
from gliderhpc.studies.currents.filtering import smoothed, without_baseline
from gliderhpc.studies.currents.retrieval import sampled_flow, starboard
from gliderhpc.studies.currents.settings import DepthResolvedSettings
from gliderhpc.studies.library.scores import correlation, rms
from gliderhpc.twins.inversion import TwinInversion
from gliderhpc.twins.runs import Row

Array = NDArray[np.float64]

SEGMENT = 200.0
"""Length of the segments whose spectra are taken, s: longer than any period that the baseline leaves."""
SHORTEST_PERIOD = 4.0
"""s; the water is known at the records alone."""
BINS_PER_OCTAVE = 3
SCALES = 2.0 ** (np.arange(-1 * BINS_PER_OCTAVE, 5 * BINS_PER_OCTAVE + 1) / BINS_PER_OCTAVE)
"""Edges of the bins of vertical scale, m: 0.5 to 32."""

_LEAST_DEPTH_RATE = 0.02
"""Vertical speed (m/s) below which a rate of change tells no shear."""
_NOTHING = 1e-9
"""What rounding leaves of a forcing that is zero, m/s2."""
_YAW = 5


@dataclass(frozen=True, eq=False)
class LateralSeries:
    """Across the hull, on the ``m`` records; NaN outside steady glide.

    Attributes
    ----------
    retrieved : (m,)
        What eq. 41 gives, m/s to starboard.
    water : (m, 2)
        The water, north and east, m/s.
    across : (m, 2)
        North and east of the hull's y axis.
    rate : (m,)
        Rate at which the water across the hull changes along the path, m/s2.
    depth_rate : (m,)
        m/s, positive down.
    interval : float
        Between records, s.
    """

    retrieved: Array
    water: Array
    across: Array
    rate: Array
    depth_rate: Array
    interval: float


def resolved_row(inversion: TwinInversion, platform: Platform, settings: DepthResolvedSettings) -> Row:
    """Correlations and gains of one twin, and its sums of spectra by vertical scale (see `spectral_sums`)."""
    series = lateral_series(inversion, platform, settings)
    samples = round(settings.baseline / series.interval)
    forcing = without_baseline(series.rate, samples)
    alike = smoothed(forcing, round(settings.smoothing / series.interval), settings.order)
    shear = np.where(np.abs(series.depth_rate) > _LEAST_DEPTH_RATE, series.rate / series.depth_rate, np.nan)
    diving = series.depth_rate > 0.0
    lateral = (series.water * series.across).sum(axis=1)
    return {
        "lateral_rms": rms(series.retrieved),
        "forcing_rms": rms(forcing),
        "shear_rms": rms(shear),
        "depth_rate": float(np.nanmedian(np.abs(series.depth_rate[np.isfinite(series.retrieved)]))),
        "speed": float(np.median(np.linalg.norm(inversion.states[:-1][inversion.steady, 6:9], axis=1))),
        "correlation_current": correlation(series.retrieved, lateral),
        "correlation_shear_dive": correlation(series.retrieved[diving], shear[diving]),
        "correlation_shear_climb": correlation(series.retrieved[~diving], shear[~diving]),
        "correlation_forcing": correlation(series.retrieved, forcing),
        "gain_forcing": slope(forcing, series.retrieved),
        "correlation_alike": correlation(series.retrieved, alike),
        "gain_alike": slope(alike, series.retrieved),
        "spectra": spectral_sums(series).tolist(),
    }


def lateral_series(inversion: TwinInversion, platform: Platform, settings: DepthResolvedSettings) -> LateralSeries:
    """Retrieve the current across the hull as ``analyze currents`` does, and lay the water's beside it.

    Parameters
    ----------
    inversion : TwinInversion
        The twin.
    platform : Platform
        The hull that the estimator believed in.
    settings : DepthResolvedSettings
        Windows and limits of the retrieval.
    """
    estimate, truth = inversion.estimate, inversion.profile_truth
    yaw_moment = np.where(inversion.steady, estimate.solution.disturbances[:, _YAW], np.nan)
    flow = sampled_flow(
        Glider(platform), estimate.solution.states[:-1, 6:], estimate.series.controls[:, 3], yaw_moment,
        inversion.step, settings,
    )  # fmt: skip
    sample = np.searchsorted(estimate.series.time, truth.time - 0.5 * inversion.step).clip(0, len(flow.lateral) - 1)
    retrieved = flow.lateral[sample]
    north, east, gust = truth.water.T
    bearing = truth.course + 0.5 * np.pi
    water = np.column_stack([north + gust * np.cos(bearing), east + gust * np.sin(bearing)])
    across = starboard(truth.states[:, :3])
    rate = (np.gradient(water, truth.time, axis=0) * across).sum(axis=1)
    return LateralSeries(
        retrieved=retrieved,
        water=water,
        across=across,
        rate=np.where(np.isfinite(retrieved), rate, np.nan),
        depth_rate=np.gradient(truth.states[:, 5], truth.time),
        interval=float(np.median(np.diff(truth.time))),
    )


def slope(x: Array, y: Array) -> float:
    """Slope of y on x through the origin over the samples where both are known; NaN where x never differs from 0."""
    known = np.isfinite(x) & np.isfinite(y)
    if rms(x[known]) <= _NOTHING or not known.any():
        return float("nan")
    return float(x[known] @ y[known]) / float(x[known] @ x[known])


def spectral_sums(series: LateralSeries) -> Array:
    """Sums ``(6, bins)`` of spectra over segments and frequencies, by vertical scale (`SCALES`).

    Rows: number of the sum's terms; power of the water across the hull, of its rate of change and of what was
    retrieved; real and imaginary part of the cross-spectrum of rate and retrieved (positive phase: the retrieved
    leads). A frequency f of a segment flown at a vertical speed W belongs to the scale W / f. Segments overlap by half,
    are detrended and tapered (Hann).
    """
    length = round(SEGMENT / series.interval)
    sums = np.zeros((6, len(SCALES) - 1))
    taper = scipy.signal.get_window("hann", length)
    frequency = np.fft.rfftfreq(length, series.interval)
    used = (frequency > 0.0) & (frequency <= 1.0 / SHORTEST_PERIOD)
    omega = 2.0 * np.pi * frequency[used]
    for first, stop in stretches(np.isfinite(series.retrieved)):
        for begin in range(first, stop - length + 1, length // 2):
            now = slice(begin, begin + length)
            # Against the segment's own mean, so that turning in a steady current counts as none.
            lateral = ((series.water[now] - series.water[now].mean(axis=0)) * series.across[now]).sum(axis=1)
            water, retrieved = (
                np.fft.rfft(taper * scipy.signal.detrend(values))[used] for values in (lateral, series.retrieved[now])
            )
            rate = 1j * omega * water
            cross = np.conj(rate) * retrieved
            scale = np.asarray(abs(float(series.depth_rate[now].mean())) / frequency[used], dtype=np.float64)
            powers = np.stack(
                [np.ones(len(omega)), *(np.abs(part) ** 2 for part in (water, rate, retrieved)), cross.real, cross.imag]
            )
            _add_by_scale(sums, scale, powers)
    return sums


def _add_by_scale(sums: Array, scale: Array, powers: Array) -> None:
    where = np.searchsorted(SCALES, scale, side="right") - 1
    inside = (where >= 0) & (where < sums.shape[1])
    for total, power in zip(sums, powers, strict=True):
        total += np.bincount(where[inside], power[inside], minlength=sums.shape[1])
