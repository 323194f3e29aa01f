"""Monte Carlo of the hull's coefficients: steady segments inverted again with drawn hulls (Table 6).

Every draw is inverted like the mission, by filter and windows, with several segments side by side in the lanes.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from gliderhpc.archive.profile import ProfileData
from gliderhpc.archive.reader import Archive
from gliderhpc.estimation.preparation import PreparedProfile, prepare_profile
from gliderhpc.estimation.profile import ProfileEstimate, estimate_profiles
from gliderhpc.flight.coefficients import with_errors
from gliderhpc.flight.glider import Glider
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.observations import ProfileSeries
from gliderhpc.observations.profiles import stretches
from gliderhpc.platform import Platform
from gliderhpc.studies.archived import series_of
from gliderhpc.studies.library.drift.medians import UNITS, CoefficientSettings, DepthBand, counted, medians_of
from gliderhpc.studies.library.drift.series import LONGITUDINAL, days_of
from gliderhpc.studies.library.scores import finite_median
from gliderhpc.studies.library.trends import MIN_VALUES, interval, theil_sen
from gliderhpc.vocabulary import PHASES

Array = NDArray[np.float64]

Segment = tuple[int, int]
"""First and last record."""

NOMINAL, PITCHED_UP, PITCHED_DOWN = "nominal", "pitch up", "pitch down"

OWN = (NOMINAL, PITCHED_UP, PITCHED_DOWN)
"""Variants inverted with the archive's own hull: unchanged records, and records with a constant error of the pitch."""

_PITCH = 1

_BODY_VELOCITY = slice(6, 9)

QUANTITIES = tuple(UNITS)

_GROUP = "drift"


def steady_segments(data: ProfileData, band: DepthBand, phase: str, length: float, count: int) -> list[Segment]:
    """Choose segments of a phase, evenly among all that fit into its stretches of usable records.

    Parameters
    ----------
    data : ProfileData
        The profile.
    band : DepthBand
        Depths that are used.
    phase : str
        ``dive`` or ``climb``.
    length : float
        Length of a segment, s.
    count : int
        Maximum number of segments.
    """
    records = round(length / float(data.attributes["output_interval"]))
    fitting = [
        (start, start + records)
        for begin, end in stretches(counted(data, band, phase))
        for start in range(begin, end - records, records)
    ]
    if not fitting:
        return []
    places = (np.arange(count) + 0.5) * len(fitting) / count
    return [fitting[index] for index in sorted(set(places.astype(int).tolist()))]


def segment_series(data: ProfileData, platform: Platform, segment: Segment, step: float) -> ProfileSeries:
    """Return a segment's records, interpolated to a step like those of the mission.

    Parameters
    ----------
    data, platform : ProfileData, Platform
        The profile and its hull.
    segment : (int, int)
        First and last record.
    step : float
        Step, s.
    """
    series = series_of(data, platform)
    first, last = segment
    known = slice(first, last + 1)
    time = series.time[known]
    fine = time[0] + step * np.arange(round((time[-1] - time[0]) / step) + 1)
    middles = fine[:-1] + 0.5 * step
    # Archives without `sampled` do not distinguish samples from values interpolated between them.
    own = data.sampled[known] if data.sampled.any() else np.ones(len(time), dtype=np.bool_)
    sampled = np.flatnonzero(own & (series.weights[known] > 0.0))
    return replace(
        series,
        step=step,
        time=fine - fine[0],
        measurements=_interpolate(fine, time, series.measurements[known]),
        weights=np.where(np.interp(fine, time, series.weights[known]) == 1.0, 1.0, 0.0),
        controls=_interpolate(middles, series.time[:-1], series.controls),
        gap_seconds=0.0,
        sample_index=np.rint((time[sampled] - time[0]) / step).astype(np.int64),
        seawater=None if series.seawater is None else _interpolate(middles, series.time[:-1], series.seawater),
    )


def segments_by_phase(data: ProfileData, band: DepthBand, length: float, count: int) -> dict[str, list[Segment]]:
    """Choose the segments of both phases."""
    return {phase: steady_segments(data, band, phase, length, count) for phase in PHASES}


def _interpolate(
    at: NDArray[np.float64], time: NDArray[np.float64], columns: NDArray[np.float64]
) -> NDArray[np.float64]:
    return np.column_stack([np.interp(at, time, column) for column in columns.T])


@dataclass(frozen=True, eq=False)
class SegmentMedians:
    """Medians over the segments of a profile.

    Attributes
    ----------
    number : int
        Number of the profile.
    medians : (variants, phases, quantities) array
        Medians of the quantities of `UNITS`, for the variants of `OWN` and then for every drawn hull; NaN where a phase
        has no segment or no estimate.
    segments : int
        Number of segments inverted.
    """

    number: int
    medians: Array
    segments: int


def segment_medians(
    data: ProfileData,
    platform: Platform,
    mission: MissionSettings,
    band: DepthBand,
    settings: CoefficientSettings,
    seed: int,
) -> SegmentMedians:
    """Invert a profile's segments with its own hull and with every drawn hull.

    Parameters
    ----------
    data, platform : ProfileData, Platform
        The profile and its hull.
    mission : MissionSettings
        Settings that the mission was inverted with.
    band : DepthBand
        Depths that are used.
    settings : CoefficientSettings
        Segments and draws.
    seed : int
        Seed of the draws.
    """
    chosen = segments_by_phase(data, band, settings.length, settings.segments)
    pieces = {
        phase: [segment_series(data, platform, segment, mission.step) for segment in own]
        for phase, own in chosen.items()
    }
    hulls = drawn_hulls(platform, settings.error, settings.draws, seed)
    medians = _medians(pieces, platform, hulls, settings, mission)
    return SegmentMedians(data.number, medians, sum(map(len, pieces.values())))


@lru_cache(maxsize=2)
def drawn_hulls(platform: Platform, error: float, draws: int, seed: int) -> tuple[Platform, ...]:
    """Draw stable hulls whose viscous and added-mass coefficients each have a relative error of up to `error`."""
    return tuple(with_errors(platform, error, seed + draw) for draw in range(draws))


def _medians(
    pieces: dict[str, list[ProfileSeries]],
    platform: Platform,
    hulls: Sequence[Platform],
    chosen: CoefficientSettings,
    settings: MissionSettings,
) -> Array:
    """Medians over the segments of each phase, for every variant."""
    by_variant: dict[tuple[int, int], list[dict[str, float]]] = {}
    tasks = _tasks(pieces, platform, hulls, np.radians(chosen.pitch_offset))
    estimation = settings.model_copy(update={"start": "prior", "engine": "lanes"})
    for key, estimate in estimate_profiles(tasks, estimation):
        if isinstance(estimate, ProfileEstimate):
            by_variant.setdefault(key, []).append(_of_segment(estimate, chosen.settling))
    medians = np.full((len(OWN) + len(hulls), len(PHASES), len(UNITS)), np.nan)
    for (variant, phase), rows in by_variant.items():
        medians[variant, phase] = np.median([[row.get(name, np.nan) for name in UNITS] for row in rows], axis=0)
    return medians


def _tasks(
    pieces: dict[str, list[ProfileSeries]], platform: Platform, hulls: Sequence[Platform], offset: float
) -> Iterator[tuple[tuple[int, int], PreparedProfile]]:
    """Yield every variant of every segment, keyed by variant and phase."""
    own = Glider(platform)
    drawn = [Glider(hull) for hull in hulls]
    for phase, name in enumerate(PHASES):
        for series in pieces[name]:
            for variant, by in enumerate((0.0, offset, -offset)):
                yield (variant, phase), prepare_profile(own, _with_pitch_error(series, by))
            for variant, glider in enumerate(drawn, start=len(OWN)):
                yield (variant, phase), prepare_profile(glider, series)


def _with_pitch_error(series: ProfileSeries, by: float) -> ProfileSeries:
    """Return the records with a constant error of the pitch, rad."""
    measurements = series.measurements.copy()
    measurements[:, _PITCH] += by
    return replace(series, measurements=measurements)


def _of_segment(estimate: ProfileEstimate, settling: float) -> dict[str, float]:
    counted = (estimate.series.time[:-1] >= settling) & ~estimate.vibrating[:-1]
    velocity = estimate.solution.states[:-1, _BODY_VELOCITY]
    return medians_of(estimate.solution.disturbances[counted], velocity[counted])


@dataclass(frozen=True, eq=False)
class CoefficientSlopes:
    """Slopes of a series over the segments, by hull.

    Attributes
    ----------
    quantity, phase : str
        Quantity and phase of the series.
    nominal : float
        Slope with the hull's own coefficients.
    draws : (draws,) array
        Slopes with every drawn hull; NaN if too few profiles could be inverted.
    pitched : (2,) array
        Slopes with the hull's own coefficients and a constant error of the pitch, up and down.
    shift : (2,) array
        Median changes of the series due to these errors of the pitch.
    """

    quantity: str
    phase: str
    nominal: float
    draws: Array
    pitched: Array
    shift: Array

    @property
    def interval(self) -> tuple[float, float]:
        """Return the 95 % interval of the draws."""
        return interval(self.draws)

    @property
    def same_sign(self) -> float:
        """Share of the draws whose slope has the same sign as the nominal one."""
        known = self.draws[np.isfinite(self.draws)]
        return float(np.mean(np.sign(known) == np.sign(self.nominal))) if known.size else float("nan")


def coefficient_slopes(table: pd.DataFrame, segments: Sequence[SegmentMedians]) -> list[CoefficientSlopes]:
    """Find the slopes of the longitudinal series and of the drag for every hull.

    Parameters
    ----------
    table : pandas.DataFrame
        Table with one row for each profile, with ``profile`` and ``elapsed_days``.
    segments : sequence of SegmentMedians
        Medians over the segments of the same profiles.
    """
    by_number = {profile.number: profile.medians for profile in segments}
    medians = np.stack([by_number[int(number)] for number in table["profile"]])
    days = days_of(table)
    return [
        _slopes(days, medians[:, :, phase, QUANTITIES.index(quantity)], quantity, name)
        for quantity in (*LONGITUDINAL, "K_D0")
        for phase, name in enumerate(PHASES)
    ]


def are_drawn(slopes: Sequence[CoefficientSlopes]) -> bool:
    """Return whether there are slopes for drawn coefficients."""
    return any(bool(np.isfinite(slope.draws).any()) for slope in slopes)


def read_slopes(archive: Archive) -> list[CoefficientSlopes]:
    """Read the slopes stored in an archive's group; none if no coefficients were drawn."""
    group = archive[_GROUP].to_dataset()
    own, series = len(OWN), [str(name) for name in group["series"].values]
    stored = zip((name.split() for name in series if name), group["slope"].values, group["shift"].values, strict=False)
    return [
        CoefficientSlopes(quantity, phase, float(slope[0]), slope[own:], slope[1:own], shift)
        for (quantity, phase), slope, shift in stored
    ]


def stored_slopes(slopes: Sequence[CoefficientSlopes]) -> dict[str, Array]:
    """Slopes as stored in the group, one row for each series: nominal, with each error of the pitch, of every draw."""
    return {
        "slope": np.array([[slope.nominal, *slope.pitched, *slope.draws] for slope in slopes]),
        "shift": np.array([slope.shift for slope in slopes]),
    }


def slope_labels(slopes: Sequence[CoefficientSlopes]) -> dict[str, list[str]]:
    """Names along the dimensions of the stored slopes; without draws there is one unnamed series."""
    draws = len(slopes[0].draws) if slopes else 0
    return {
        "series": [f"{slope.quantity} {slope.phase}" for slope in slopes] or [""],
        "hull": [*OWN, *(f"draw {number}" for number in range(1, draws + 1))],
        "offset": list(OWN[1:]),
    }


def _slopes(days: Array, medians: Array, quantity: str, phase: str) -> CoefficientSlopes:
    slopes = np.array([_slope(days, values) for values in medians.T])
    own = len(OWN)
    shift = np.array([finite_median(medians[:, variant] - medians[:, 0]) for variant in range(1, own)])
    return CoefficientSlopes(quantity, phase, float(slopes[0]), slopes[own:], slopes[1:own], shift)


def _slope(days: Array, values: Array) -> float:
    known = np.isfinite(values)
    return theil_sen(days[known], values[known]) if known.sum() >= MIN_VALUES else float("nan")
