"""Depth-resolved current of a twin compared with that of the water, in time and by vertical scale.

The water's acceleration across the hull along the path, ``y . dU/dt``, is the forcing: it pushes the hull sideways
through the water (docs/theory/model.md). Divided by the vertical speed, it is the shear dU/dZ across the hull.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from gliderhpc.errors import InputError
from gliderhpc.flight.glider import Glider
from gliderhpc.observations.profiles import stretches
from gliderhpc.platform import Platform
from gliderhpc.studies.library.retrieval import (
    DepthResolvedSettings,
    sampled_flow,
    smooth_stretches,
    starboard,
    without_baseline,
)
from gliderhpc.studies.library.scores import correlation, rms
from gliderhpc.twins.inversion import TwinInversion
from gliderhpc.twins.scoring import YAW, Row
from gliderhpc.twins.study import groups, tidy_table

Array = NDArray[np.float64]

SEGMENT = 200.0
"""Length of the spectral segments, s: longer than any period that passes the baseline."""

MIN_PERIOD = 4.0
"""Shortest period, s; the water is known only at the records."""

BINS_PER_OCTAVE = 3
SCALES = 2.0 ** (np.arange(-1 * BINS_PER_OCTAVE, 5 * BINS_PER_OCTAVE + 1) / BINS_PER_OCTAVE)
"""Edges of the bins of vertical scale, m: 0.5 to 32."""

MIN_TERMS = 20
"""Minimum number of terms of a spectral sum; with fewer terms the coherence would be random."""

MEDIANS = (
    "lateral_rms", "forcing_rms", "shear_rms", "depth_rate", "correlation_current", "correlation_shear_dive",
    "correlation_shear_climb", "correlation_forcing", "gain_forcing", "correlation_alike", "gain_alike",
)  # fmt: skip

GROUP = ["preset", "world", "factor"]

_MIN_DEPTH_RATE = 0.02
"""Vertical speed (m/s) below which a rate of change determines no shear."""

_ROUNDING_RMS = 1e-9
"""Largest root mean square of a zero forcing due to rounding, m/s2."""


@dataclass(frozen=True, eq=False)
class LateralSeries:
    """Series across the hull, on the ``m`` records; NaN outside steady glide.

    Attributes
    ----------
    retrieved : (m,)
        Current from eq. 41, m/s to starboard.
    water : (m, 2)
        True current, north and east, m/s.
    across : (m, 2)
        North and east components of the hull's y axis.
    rate : (m,)
        Rate at which the water across the hull changes along the path, m/s2.
    depth_rate : (m,)
        Vertical speed, m/s, positive down.
    interval : float
        Time between records, s.
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
    alike = smooth_stretches(forcing, round(settings.smoothing / series.interval), settings.order)
    shear = np.where(np.abs(series.depth_rate) > _MIN_DEPTH_RATE, series.rate / series.depth_rate, np.nan)
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
    """Retrieve the current across the hull as in ``analyze currents``, with the true current on the same records.

    Parameters
    ----------
    inversion : TwinInversion
        The twin.
    platform : Platform
        Hull that the estimator assumed.
    settings : DepthResolvedSettings
        Windows and limits of the retrieval.
    """
    estimate, truth = inversion.estimate, inversion.profile_truth
    yaw_moment = np.where(inversion.steady, estimate.solution.disturbances[:, YAW], np.nan)
    flow = sampled_flow(
        Glider(platform),
        estimate.solution.states[:-1, 6:],
        estimate.series.controls[:, 3],
        yaw_moment,
        inversion.step,
        settings,
    )
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
    """Slope of y on x through the origin over the samples where both are known; NaN if x is zero at all of them."""
    known = np.isfinite(x) & np.isfinite(y)
    if rms(x[known]) <= _ROUNDING_RMS or not known.any():
        return float("nan")
    return float(x[known] @ y[known]) / float(x[known] @ x[known])


def spectral_sums(series: LateralSeries) -> Array:
    """Sums ``(6, bins)`` of spectra over segments and frequencies, by vertical scale (`SCALES`).

    Rows: number of the sum's terms; power of the water across the hull, of its rate of change and of the retrieved
    current; real and imaginary part of the cross-spectrum of rate and retrieved current (positive phase: the retrieved
    leads). A frequency f of a segment flown at a vertical speed W belongs to the scale W / f. Segments overlap by half,
    are detrended and tapered (Hann).
    """
    length = round(SEGMENT / series.interval)
    sums = np.zeros((6, len(SCALES) - 1))
    taper = scipy.signal.get_window("hann", length)
    frequency = np.fft.rfftfreq(length, series.interval)
    used = (frequency > 0.0) & (frequency <= 1.0 / MIN_PERIOD)
    omega = 2.0 * np.pi * frequency[used]
    for first, stop in stretches(np.isfinite(series.retrieved)):
        for begin in range(first, stop - length + 1, length // 2):
            now = slice(begin, begin + length)
            # The segment's mean is subtracted: turning in a steady current does not change the water.
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


def summary_lines(rows: Sequence[Row]) -> list[Row]:
    """Medians over the twins per preset, water and strength, in the order of the runs."""
    table = tidy_table([{name: value for name, value in row.items() if name != "spectra"} for row in rows])
    return [
        labels | {"twins": len(group), **{name: float(group[name].median()) for name in MEDIANS}}
        for labels, group in groups(table, GROUP)
    ]


def transfer_lines(rows: Sequence[Row]) -> list[Row]:
    """Transfer functions, one line per preset, water, strength and bin of vertical scale."""
    sums: dict[tuple[Any, ...], Any] = {}
    for row in rows:
        key = tuple(row[name] for name in GROUP)
        sums[key] = sums.get(key, 0.0) + np.array(row["spectra"])
    return [{**dict(zip(GROUP, key, strict=True)), **line} for key, total in sums.items() for line in _by_scale(total)]


def resolved_band(lines: Sequence[Row]) -> tuple[float, float]:
    """Vertical scales (m) around the largest gain on the current over which at least half of it remains.

    Raises
    ------
    InputError
        There are no lines, because no stretch of steady glide was as long as a segment.
    """
    if not lines:
        raise InputError(
            f"no twin of a preset in broadband water glides steadily for {SEGMENT:g} s without interruption, with an "
            "angle of sideslip that follows from its turning; give deeper twins, or a hull whose yaw coefficients tell "
            "the sign of the sideslip (see `gliderhpc platforms NAME`)"
        )
    gains = np.array([line["gain_current"] for line in lines])
    best = int(np.argmax(gains))
    short = np.flatnonzero(gains < 0.5 * gains.max())
    first = max((int(i) + 1 for i in short if i < best), default=0)
    last = min((int(i) - 1 for i in short if i > best), default=len(lines) - 1)
    return float(lines[first]["scale_low"]), float(lines[last]["scale_high"])


def _by_scale(sums: Any) -> list[Row]:
    lines = []
    for low, high, (terms, water, rate, retrieved, real, imaginary) in zip(
        SCALES[:-1], SCALES[1:], sums.T, strict=True
    ):
        # The spectrum of still water consists of rounding errors.
        if terms < MIN_TERMS or water <= 1e-12 * retrieved:
            continue
        cross = complex(real, imaginary)
        lines.append(
            {
                "scale": float(np.sqrt(low * high)),
                "scale_low": float(low),
                "scale_high": float(high),
                "terms": int(terms),
                "gain_current": float(abs(cross) / np.sqrt(rate * water)),
                "gain_rate": float(abs(cross) / rate),
                "phase": float(np.degrees(np.angle(cross))),
                "coherence": float(abs(cross) ** 2 / (rate * retrieved)),
            }
        )
    return lines
