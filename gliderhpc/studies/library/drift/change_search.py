"""Search of a mission's series for changes: the strongest windows, one after the other, and their sizes in all series.

The series of one search are one hypothesis; a change found in one of them is fitted in all.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from gliderhpc.distributions import MAD_TO_STD
from gliderhpc.studies.library.drift.departures import (
    MIN_WINDOW,
    StrongestWindow,
    WeightedBaseline,
    WindowSearch,
    amplitude,
    best_baseline,
)
from gliderhpc.studies.library.drift.drag import NORMAL_95
from gliderhpc.studies.library.drift.medians import PRIMARY, ChangeSettings
from gliderhpc.studies.library.drift.series import days_of
from gliderhpc.studies.library.drift.shape_fits import EPISODE, Shape, fitted_shape, joined_shape
from gliderhpc.studies.library.trends import block_length, moving_blocks
from gliderhpc.vocabulary import PHASES

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

TOGETHER = "together"
PARTS = (*PHASES, TOGETHER)
"""Parts of a profile from which a series may be: the dive, the climb, or both together."""

MIN_VALUES_SEARCHED = 4 * MIN_WINDOW
"""Minimum number of values of a series that is searched."""

SPIKE_DEVIATIONS = 4.0
"""Robust standard deviations from its neighbours beyond which a single profile is left out."""

EARLY_STOP_SHARE = 0.2
"""Share of the first null series that are at least as strong, above which no more are drawn."""

_ROUNDING = 1e-9
"""Scatter of a series relative to its values below which it is constant."""

_NULLS_PER_DRAW = 100
"""Number of null series drawn at a time."""

SizeKey = tuple[str, str, str]
"""Quantity, part and estimate."""


@dataclass(frozen=True)
class Size:
    """Largest change of a series, and its 95 % interval."""

    value: float
    low: float
    high: float

    @property
    def excludes_zero(self) -> bool:
        """Return whether the interval lies on one side of zero."""
        return self.low > 0.0 or self.high < 0.0


@dataclass(eq=False)
class MissionSeries:
    """A series of the mission, with the mask of the values used."""

    key: SizeKey
    days: Array
    values: Array
    known: Mask


@dataclass(frozen=True, eq=False)
class FoundShape:
    """A significant shape, its probability of chance, and the index of the series in which it was found."""

    shape: Shape
    p: float
    lead: int


def search_series(
    series: Sequence[MissionSeries], compared: Sequence[str], settings: ChangeSettings, level: float, seed: int
) -> tuple[list[FoundShape], FoundShape | None]:
    """Find the significant changes of series, and the strongest one that is not significant.

    Parameters
    ----------
    series : sequence of MissionSeries
        Series to search together.
    compared : sequence of str
        Quantities, of one unit, whose sizes determine the phase of episodes that are combined.
    settings : ChangeSettings
        Draws and largest number of changes.
    level : float
        Probability of chance below which a change counts.
    seed : int
        Seed of the bootstrap.

    Notes
    -----
    All windows of all series are one hypothesis. The largest gain is compared with the largest gain of null series.
    These are built from moving blocks of the independent residuals from line and window, drawn at the same places in
    all series, and coloured with the noise model of the line alone. A significant change is fitted and added to the
    line. The search ends when the next change is not significant. Overlapping episodes are combined into one, whose
    course is the sum of both. There is no next change if nothing could be searched, or if the search ended at the
    largest number of changes.
    """
    shapes: list[FoundShape] = []
    rng = np.random.default_rng(seed)
    for _ in range(settings.most if series else 0):
        searches = _searches(series, [shape.shape for shape in shapes])
        p, lead, best = _strongest(series, searches, settings, rng)
        new = FoundShape(_shape(series[lead], searches[lead], best), p, lead)
        if not p < level:
            return shapes, new
        shapes = _with_shape(series, shapes, new, compared)
    return shapes, None


def series_of(
    table: pd.DataFrame, values_by_key: Callable[[str], Iterable[tuple[SizeKey, Array]]]
) -> list[MissionSeries]:
    """Return the series of both primary estimates that have enough values to be searched, and any scatter.

    Parameters
    ----------
    table : pandas.DataFrame
        Table of medians, one row for each profile.
    values_by_key : callable
        Series of an estimate, by its name, each with its key.
    """
    days = days_of(table)
    series = [
        MissionSeries(key, days, values, np.isfinite(values) & ~spikes(values))
        for estimate in PRIMARY
        for key, values in values_by_key(estimate)
    ]
    return [own for own in series if own.known.sum() >= MIN_VALUES_SEARCHED and not _is_constant(own.values[own.known])]


def _is_constant(values: Array) -> bool:
    """Return whether values differ by no more than their rounding."""
    return bool(np.ptp(values) <= _ROUNDING * np.max(np.abs(values)))


def spikes(values: Array) -> Mask:
    """Mask ``(n,)`` of single values far from both neighbours, relative to the scatter of neighbours' differences."""
    known = np.flatnonzero(np.isfinite(values))
    mask = np.zeros(len(values), dtype=np.bool_)
    if len(known) < MIN_VALUES_SEARCHED:
        return mask
    y = values[known]
    triples = np.stack([y[:-2], y[1:-1], y[2:]])
    middle = np.median(triples, axis=0)
    middle = np.concatenate([[middle[0]], middle, [middle[-1]]])
    scatter = MAD_TO_STD * float(np.median(np.abs(np.diff(y)))) / np.sqrt(2.0)
    mask[known] = np.abs(y - middle) > SPIKE_DEVIATIONS * scatter
    return mask


def _searches(series: Sequence[MissionSeries], shapes: Sequence[Shape]) -> list[WindowSearch]:
    """Return the search of each series with the shapes found so far; series with the same profiles share a search."""
    made: dict[bytes, WindowSearch] = {}
    for own in series:
        mask = own.known.tobytes()
        if mask not in made:
            columns = [shape.unit[own.known] for shape in shapes]
            made[mask] = WindowSearch(own.days[own.known], np.flatnonzero(own.known), columns)
    return [made[own.known.tobytes()] for own in series]


def _strongest(
    series: Sequence[MissionSeries],
    searches: Sequence[WindowSearch],
    settings: ChangeSettings,
    rng: np.random.Generator,
) -> tuple[float, int, StrongestWindow]:
    """Find the strongest window of all series; returns its probability of chance, the series' index and the window."""
    windows = [search.strongest(own.values[own.known]) for own, search in zip(series, searches, strict=True)]
    gains = np.array([own.gain for own in windows])
    errors = [_errors(*of, rng) for of in zip(series, searches, windows, strict=True)]
    length = max(block_length(np.arange(float(len(row))), row) for row in errors)
    lead, above, drawn = int(gains.argmax()), 0, 0
    while drawn < settings.resamples and above < EARLY_STOP_SHARE * _NULLS_PER_DRAW:
        places = moving_blocks(np.arange(float(len(errors[0]))), length, _NULLS_PER_DRAW, rng).astype(np.int64)
        null = np.full(_NULLS_PER_DRAW, -np.inf)
        for own, search, best, row in zip(series, searches, windows, errors, strict=True):
            root = np.linalg.cholesky(best.null.covariance(np.arange(len(row))))
            null = np.maximum(null, search.gains((root @ row[places.T])[own.known]))
        above, drawn = above + int(np.sum(null >= gains[lead])), drawn + _NULLS_PER_DRAW
    return (1 + above) / (1 + drawn), lead, windows[lead]


def _errors(series: MissionSeries, search: WindowSearch, best: StrongestWindow, rng: np.random.Generator) -> Array:
    """Independent errors of a series along the whole mission; missing ones are drawn from the others."""
    own = search.innovations(series.values[series.known], best)
    row = rng.choice(own, len(series.known))
    row[series.known] = own
    return row


def _shape(lead: MissionSeries, search: WindowSearch, window: StrongestWindow) -> Shape:
    """Fit the shape of a window in the leading series, and interpolate it to all profiles of the mission."""
    values, known = lead.values[lead.known], np.flatnonzero(lead.known)
    baseline = WeightedBaseline(window.noise, search.positions, search.baseline)
    shape = fitted_shape(search.days, values, (window.first, window.stop), baseline)
    begin, end = int(known[shape.first]), int(known[shape.stop - 1]) + 1
    unit = np.interp(np.arange(len(lead.known)), known, shape.unit)
    unit[:begin] = 0.0
    if shape.stop < len(values):
        unit[end:] = 0.0
    else:
        end = len(lead.known)
    return Shape(shape.form, begin, end, unit)


def _with_shape(
    series: Sequence[MissionSeries], shapes: Sequence[FoundShape], new: FoundShape, compared: Sequence[str]
) -> list[FoundShape]:
    """Add a shape, or join it to the episode that it overlaps."""
    for index, before in enumerate(shapes):
        if _overlap(before.shape, new.shape):
            others = [other.shape for other in shapes if other is not before]
            return [*shapes[:index], _merge(series, (before, new), others, compared), *shapes[index + 1 :]]
    return [*shapes, new]


def _overlap(first: Shape, second: Shape) -> bool:
    """Return whether two episodes have profiles in common."""
    return first.kind == second.kind == EPISODE and first.first < second.stop and second.first < first.stop


def _merge(
    series: Sequence[MissionSeries],
    pair: tuple[FoundShape, FoundShape],
    others: Sequence[Shape],
    compared: Sequence[str],
) -> FoundShape:
    """Combine two episodes into one, fitted in the series in which the second was found.

    If the two were found in different phases, the one with the larger change of the compared quantities determines the
    series, because the other may be its trace in the other phase.
    """
    first, second = pair
    parts = {series[merged.lead].key[1] for merged in pair} - {TOGETHER}
    if len(parts) > 1:
        largest = [max(_magnitudes(series, pair, index, compared)) for index in range(2)]
        at = pair[int(np.argmax(largest))].lead
    else:
        at = second.lead
    lead = series[at]
    search, columns = _searches([lead], others)[0], np.column_stack([first.shape.unit, second.shape.unit])[lead.known]
    values = lead.values[lead.known]
    noise = best_baseline(search.positions, np.column_stack([search.baseline, columns]), values)
    baseline = WeightedBaseline(noise.model, search.positions, search.baseline)
    shape = joined_shape(first.shape, second.shape, lead.known, values, baseline)
    return FoundShape(shape, min(first.p, second.p), at)


def _magnitudes(
    series: Sequence[MissionSeries], shapes: Sequence[FoundShape], index: int, compared: Sequence[str]
) -> list[float]:
    """Magnitudes of the largest changes of the compared quantities, by estimate and part."""
    sizes = sizes_of(series, shapes, index)
    return [0.0, *(abs(size.value) for key, size in sizes.items() if key[0] in compared and np.isfinite(size.value))]


def sizes_of(series: Sequence[MissionSeries], shapes: Sequence[FoundShape], index: int) -> dict[SizeKey, Size]:
    """Sizes of a change in all series, in a joint fit with the other changes."""
    shape = shapes[index].shape
    searches = _searches(series, [other.shape for other in shapes if other.shape is not shape])
    return {own.key: _size(own, search, shape) for own, search in zip(series, searches, strict=True)}


def _size(series: MissionSeries, search: WindowSearch, shape: Shape) -> Size:
    unit = shape.unit[series.known]
    if not np.ptp(unit) > 0.0:
        return Size(float("nan"), float("nan"), float("nan"))
    value, deviation = amplitude(search.positions, search.baseline, unit, series.values[series.known])
    return Size(value, value - NORMAL_95 * deviation, value + NORMAL_95 * deviation)
