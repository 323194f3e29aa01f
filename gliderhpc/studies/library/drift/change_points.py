"""Change points: steps, ramps and episodes of axial force and drag, on dives, on climbs and on both together."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from gliderhpc.store_schema.columns import PHASES, median_column
from gliderhpc.studies.library.drift.change_shapes import EPISODE, RAMP, Shape, fitted_shape, joined_shape
from gliderhpc.studies.library.drift.drag import NORMAL_95, shared_drag, weight_effects
from gliderhpc.studies.library.drift.medians import DRAG, PRIMARY, ChangeSettings
from gliderhpc.studies.library.drift.series import days_of, values_of
from gliderhpc.studies.library.drift.window_search import (
    MIN_WINDOW,
    Strongest,
    WeightedBaseline,
    WindowSearch,
    amplitude,
    best_baseline,
)
from gliderhpc.studies.library.trends import MAD, block_length, moving_blocks

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

TOGETHER = "together"
PARTS = (*PHASES, TOGETHER)
"""Parts of a profile from which a series may be: the dive, the climb, or both together."""

AXIAL = "B_cu"
QUANTITIES = (AXIAL, DRAG)

MIN_VALUES_SEARCHED = 4 * MIN_WINDOW
"""Minimum number of values of a series that is searched."""

SPIKE_DEVIATIONS = 4.0
"""Robust standard deviations from its neighbours beyond which a single profile is left out."""

PHASE_SHARE = 1.0 / 3.0
"""Ratio to the larger change above which a phase is regarded as changed."""

EARLY_STOP_SHARE = 0.2
"""Share of the first null series that are at least as strong, above which no more are drawn."""

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


@dataclass(frozen=True, eq=False)
class Change:
    """A change point, or two that enclose an episode.

    Attributes
    ----------
    kind, form : str
        Kind and form, as defined in `change_shapes`.
    phases : tuple of str
        Phases that changed.
    estimates : tuple of str
        Estimates whose intervals exclude zero.
    first, last : int
        First and last profile changed; without a return, `last` is the last of the record.
    back : int or None
        First profile after the return; None if the change lasts.
    days : (float, float)
        Days of `first` and `last` since the first observation.
    back_day : float
        Day of `back`; NaN if the change lasts.
    p : float
        Probability of a gain as large by chance, over all series and positions.
    mean : float
        Mean of the change over its profiles, as a fraction of the largest change.
    sizes : dict
        Largest change (N or kg/m) by quantity, part and estimate.
    """

    kind: str
    form: str
    phases: tuple[str, ...]
    estimates: tuple[str, ...]
    first: int
    last: int
    back: int | None
    days: tuple[float, float]
    back_day: float
    p: float
    mean: float
    sizes: dict[SizeKey, Size]

    def size(self, quantity: str, part: str) -> Size:
        """Largest change of a quantity by the first primary estimate, with an interval that spans those of all.

        The first is the adjoint's, the method of record for disturbances, if available.
        """
        every = [self.sizes.get((quantity, part, estimate)) for estimate in PRIMARY]
        own = [size for size in every if size is not None and np.isfinite(size.value)]
        if not own:
            return Size(float("nan"), float("nan"), float("nan"))
        return Size(own[0].value, min(one.low for one in own), max(one.high for one in own))

    def contains(self, numbers: Array) -> Mask:
        """Mask of the profile numbers that belong to the change."""
        return np.asarray((numbers >= self.first) & (numbers <= self.last), dtype=np.bool_)


@dataclass(frozen=True)
class Changes:
    """Change points of a mission.

    Attributes
    ----------
    found : tuple of Change
        Changes in order of their days.
    p : float
        Probability of chance of the strongest change that is not significant; NaN if too few profiles could be
        searched, or if the search ended at the largest number of changes.
    """

    found: tuple[Change, ...] = ()
    p: float = float("nan")

    @property
    def episodes(self) -> tuple[Change, ...]:
        """Changes that have ended."""
        return tuple(one for one in self.found if one.kind == EPISODE)

    def outside(self, numbers: Array) -> Mask:
        """Mask of the profile numbers outside every episode."""
        inside = [one.contains(numbers) for one in self.episodes]
        return ~np.any(inside, axis=0) if inside else np.ones(len(numbers), dtype=np.bool_)

    @property
    def allow_line(self) -> bool:
        """Return whether a line may still describe the series outside the episodes: no step and no ramp was found."""
        return len(self.episodes) == len(self.found)

    @property
    def allow_onset(self) -> bool:
        """Return whether at most one ramp, which continues to the end of the record, was found outside the episodes."""
        others = [one for one in self.found if one.kind != EPISODE]
        return all(one.kind == RAMP and one.form == "continues" for one in others) and len(others) <= 1


@dataclass(eq=False)
class _Series:
    """A series of the mission, with the mask of the values used."""

    key: SizeKey
    days: Array
    values: Array
    known: Mask


@dataclass(frozen=True, eq=False)
class _FoundShape:
    """A significant shape, its probability of chance, and the index of the series in which it was found."""

    shape: Shape
    p: float
    lead: int


def find_changes(table: pd.DataFrame, reference: float, settings: ChangeSettings, seed: int) -> Changes:
    """Find the change points of a mission.

    Parameters
    ----------
    table : pandas.DataFrame
        Table of medians, one row for every profile.
    reference : float
        K_D0 of the hull, kg/m.
    settings : ChangeSettings
        Level, draws, smallest change.
    seed : int
        Seed of the bootstrap.

    Notes
    -----
    All windows of all series are one hypothesis. The largest gain is compared with the largest gain of null series.
    These are built from moving blocks of the independent residuals from line and window, drawn at the same places in
    all series, and coloured with the noise model of the line alone. A significant change is fitted and added to the
    line. The search ends when the next change is not significant. Significant changes below the smallest size are also
    added to the line, but not reported. Overlapping episodes are combined into one, whose course is the sum of both.
    """
    series = [one for one in mission_series(table) if one.known.sum() >= MIN_VALUES_SEARCHED]
    found: list[_FoundShape] = []
    p, rng = float("nan"), np.random.default_rng(seed)
    for _ in range(settings.most if series else 0):
        searches = _searches(series, [one.shape for one in found])
        p, lead, best = _strongest(series, searches, settings, rng)
        if not p < settings.level:
            break
        found = _with_shape(series, found, _FoundShape(_shape(series[lead], searches[lead], best), p, lead))
    else:
        p = float("nan")
    changes = [_change(table, series, found, place) for place in range(len(found))]
    named = [one for one in changes if _relative(one, reference) >= settings.smallest]
    return Changes(tuple(sorted(named, key=lambda one: one.days)), p)


def mission_series(table: pd.DataFrame) -> list[_Series]:
    """Return the series to search: both quantities, by both primary estimates, on dives, climbs and both together."""
    days = days_of(table)
    return [
        _Series(key, days, values, np.isfinite(values) & ~spikes(values))
        for estimate in PRIMARY
        if median_column(DRAG, PHASES[0], estimate) in table
        for key, values in _of_estimate(table, estimate)
    ]


def spikes(values: Array) -> Mask:
    """Mask ``(n,)`` of single values far from both neighbours, relative to the scatter of neighbours' differences."""
    known = np.flatnonzero(np.isfinite(values))
    found = np.zeros(len(values), dtype=np.bool_)
    if len(known) < MIN_VALUES_SEARCHED:
        return found
    y = values[known]
    triples = np.stack([y[:-2], y[1:-1], y[2:]])
    middle = np.median(triples, axis=0)
    middle = np.concatenate([[middle[0]], middle, [middle[-1]]])
    scatter = MAD * float(np.median(np.abs(np.diff(y)))) / np.sqrt(2.0)
    found[known] = np.abs(y - middle) > SPIKE_DEVIATIONS * scatter
    return found


def _of_estimate(table: pd.DataFrame, estimate: str) -> Iterator[tuple[SizeKey, Array]]:
    for quantity in QUANTITIES:
        dive, climb = (values_of(table, median_column(quantity, phase, estimate)) for phase in PHASES)
        both = shared_drag(dive, climb, weight_effects(table)) if quantity == DRAG else 0.5 * (dive + climb)
        for part, values in zip(PARTS, (dive, climb, both), strict=True):
            yield (quantity, part, estimate), values


def _searches(series: Sequence[_Series], shapes: Sequence[Shape]) -> list[WindowSearch]:
    """Return the search of each series with the shapes found so far; series with the same profiles share a search."""
    made: dict[bytes, WindowSearch] = {}
    for one in series:
        mask = one.known.tobytes()
        if mask not in made:
            columns = [shape.unit[one.known] for shape in shapes]
            made[mask] = WindowSearch(one.days[one.known], np.flatnonzero(one.known), columns)
    return [made[one.known.tobytes()] for one in series]


def _strongest(
    series: Sequence[_Series], searches: Sequence[WindowSearch], settings: ChangeSettings, rng: np.random.Generator
) -> tuple[float, int, Strongest]:
    """Find the strongest window of all series; returns its probability of chance, the series' index and the window."""
    found = [search.strongest(one.values[one.known]) for one, search in zip(series, searches, strict=True)]
    gains = np.array([one.gain for one in found])
    errors = [_errors(*of, rng) for of in zip(series, searches, found, strict=True)]
    length = max(block_length(np.arange(float(len(row))), row) for row in errors)
    lead, above, drawn = int(gains.argmax()), 0, 0
    while drawn < settings.resamples and above < EARLY_STOP_SHARE * _NULLS_PER_DRAW:
        places = moving_blocks(np.arange(float(len(errors[0]))), length, _NULLS_PER_DRAW, rng).astype(np.int64)
        null = np.full(_NULLS_PER_DRAW, -np.inf)
        for one, search, best, row in zip(series, searches, found, errors, strict=True):
            root = np.linalg.cholesky(best.null.covariance(np.arange(len(row))))
            null = np.maximum(null, search.gains((root @ row[places.T])[one.known]))
        above, drawn = above + int(np.sum(null >= gains[lead])), drawn + _NULLS_PER_DRAW
    return (1 + above) / (1 + drawn), lead, found[lead]


def _errors(one: _Series, search: WindowSearch, best: Strongest, rng: np.random.Generator) -> Array:
    """Independent errors of a series along the whole mission; missing ones are drawn from the others."""
    own = search.innovations(one.values[one.known], best)
    row = rng.choice(own, len(one.known))
    row[one.known] = own
    return row


def _shape(lead: _Series, search: WindowSearch, window: Strongest) -> Shape:
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


def _with_shape(series: Sequence[_Series], found: Sequence[_FoundShape], new: _FoundShape) -> list[_FoundShape]:
    """Add a shape, or join it to the episode that it overlaps."""
    for place, one in enumerate(found):
        if _overlap(one.shape, new.shape):
            others = [other.shape for other in found if other is not one]
            return [*found[:place], _merge(series, one, new, others), *found[place + 1 :]]
    return [*found, new]


def _overlap(one: Shape, other: Shape) -> bool:
    """Return whether two episodes have profiles in common."""
    return one.kind == other.kind == EPISODE and one.first < other.stop and other.first < one.stop


def _merge(series: Sequence[_Series], one: _FoundShape, other: _FoundShape, others: Sequence[Shape]) -> _FoundShape:
    """Combine two episodes into one, fitted in the series in which the second was found.

    If the two were found in different phases, the one with the larger change of drag determines the series, because the
    other may be its trace in the other phase.
    """
    parts = {series[found.lead].key[1] for found in (one, other)} - {TOGETHER}
    if len(parts) > 1:
        largest = [max(_drags(series, [one, other], place)) for place in range(2)]
        at = (one, other)[int(np.argmax(largest))].lead
    else:
        at = other.lead
    lead = series[at]
    search, columns = _searches([lead], others)[0], np.column_stack([one.shape.unit, other.shape.unit])[lead.known]
    values = lead.values[lead.known]
    noise = best_baseline(search.positions, np.column_stack([search.baseline, columns]), values)
    baseline = WeightedBaseline(noise.model, search.positions, search.baseline)
    shape = joined_shape(one.shape, other.shape, lead.known, values, baseline)
    return _FoundShape(shape, min(one.p, other.p), at)


def _drags(series: Sequence[_Series], found: Sequence[_FoundShape], place: int) -> list[float]:
    """Magnitudes of the largest changes of drag, by estimate and part."""
    sizes = _sizes(series, found, place)
    return [0.0, *(abs(size.value) for key, size in sizes.items() if key[0] == DRAG and np.isfinite(size.value))]


def _change(table: pd.DataFrame, series: Sequence[_Series], found: Sequence[_FoundShape], place: int) -> Change:
    """Determine the size of a change in all series, in a joint fit with the other changes."""
    shape, p, sizes = found[place].shape, found[place].p, _sizes(series, found, place)
    numbers, days = values_of(table, "profile"), days_of(table)
    over = shape.stop < len(numbers)
    phases, estimates = _changed_phases(sizes)
    return Change(
        shape.kind,
        shape.form,
        phases,
        estimates,
        first=int(numbers[shape.first]),
        last=int(numbers[shape.stop - 1]),
        back=int(numbers[shape.stop]) if over else None,
        days=(float(days[shape.first]), float(days[shape.stop - 1])),
        back_day=float(days[shape.stop]) if over else float("nan"),
        p=p,
        mean=shape.mean,
        sizes=sizes,
    )


def _sizes(series: Sequence[_Series], found: Sequence[_FoundShape], place: int) -> dict[SizeKey, Size]:
    shape = found[place].shape
    searches = _searches(series, [other.shape for other in found if other.shape is not shape])
    return {one.key: _size(one, search, shape) for one, search in zip(series, searches, strict=True)}


def _size(one: _Series, search: WindowSearch, shape: Shape) -> Size:
    unit = shape.unit[one.known]
    if not np.ptp(unit) > 0.0:
        return Size(float("nan"), float("nan"), float("nan"))
    value, deviation = amplitude(search.positions, search.baseline, unit, one.values[one.known])
    return Size(value, value - NORMAL_95 * deviation, value + NORMAL_95 * deviation)


def _changed_phases(sizes: dict[SizeKey, Size]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Phases that changed according to the drag, or else to the axial force, and the estimates that show the change."""
    estimates = [name for name in PRIMARY if any(key[2] == name for key in sizes)]
    for quantity in (DRAG, AXIAL):
        own = {key: size for key, size in sizes.items() if key[0] == quantity and key[1] in PHASES}
        largest = max((abs(size.value) for size in own.values() if np.isfinite(size.value)), default=0.0)
        shown = [key for key, size in own.items() if size.excludes_zero and abs(size.value) >= PHASE_SHARE * largest]
        if shown:
            phases = tuple(phase for phase in PHASES if any(key[1] == phase for key in shown))
            return phases, tuple(name for name in estimates if any(key[2] == name for key in shown))
    return PHASES, tuple(estimates)


def _relative(change: Change, reference: float) -> float:
    """Largest change of drag in the phases that changed, relative to the hull's K_D0."""
    return float(np.nanmax([0.0, *(abs(change.size(DRAG, phase).value) for phase in change.phases)])) / reference
