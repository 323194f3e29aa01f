"""Change points: steps, ramps and episodes of the axial force and the drag, on dives, climbs and both together."""

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
"""Parts of a dive that a series may be of: the dive, the climb, or both together."""

AXIAL = "B_cu"
QUANTITIES = (AXIAL, DRAG)

MIN_VALUES_SEARCHED = 4 * MIN_WINDOW
"""Values that a series is searched with, at least."""

SPIKE_DEVIATIONS = 4.0
"""Robust deviations by which a single profile that differs from both neighbours is left out."""

PHASE_SHARE = 1.0 / 3.0
"""Part of the larger change from which on a phase counts as changed."""

EARLY_STOP_SHARE = 0.2
"""Share of the first null series at least as strong, from which on no more are drawn."""

_NULLS_PER_DRAW = 100
"""Null series drawn at a time."""

SizeKey = tuple[str, str, str]
"""Quantity, part and estimate."""


@dataclass(frozen=True)
class Size:
    """Largest change of a series, and its 95 % interval."""

    value: float
    low: float
    high: float

    @property
    def leaves_out_zero(self) -> bool:
        """True where the interval lies on one side of zero."""
        return self.low > 0.0 or self.high < 0.0


@dataclass(frozen=True, eq=False)
class Change:
    """A change point, or two that enclose an episode.

    Attributes
    ----------
    kind, form : str
        Of `change_shapes`.
    phases : tuple of str
        Those that changed.
    estimates : tuple of str
        Estimates whose intervals leave zero out.
    first, last : int
        Profiles changed, the first and the last; the record's last where it is not back.
    back : int or None
        The first profile that is back; None where none is.
    days : (float, float)
        Of `first` and `last`, since the first observation.
    back_day : float
        Of `back`; NaN where none is.
    p : float
        Probability of a gain as large by chance, all series and positions counted.
    mean : float
        Mean of the change over its profiles, in parts of the largest.
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
        """Largest change of a quantity: the first primary estimate's, within what all of them leave open.

        That is the adjoint's, the method of record for disturbances, where it is there.
        """
        every = [self.sizes.get((quantity, part, estimate)) for estimate in PRIMARY]
        own = [size for size in every if size is not None and np.isfinite(size.value)]
        if not own:
            return Size(float("nan"), float("nan"), float("nan"))
        return Size(own[0].value, min(one.low for one in own), max(one.high for one in own))

    def holds(self, numbers: Array) -> Mask:
        """Profiles of the change, by number."""
        return np.asarray((numbers >= self.first) & (numbers <= self.last), dtype=np.bool_)


@dataclass(frozen=True)
class Changes:
    """Change points of a mission.

    Attributes
    ----------
    found : tuple of Change
        In the order of their days.
    p : float
        Probability of chance of the strongest that does not count; NaN where too few profiles could be searched, or as
        many changes count as are looked for.
    """

    found: tuple[Change, ...] = ()
    p: float = float("nan")

    @property
    def episodes(self) -> tuple[Change, ...]:
        """Changes that are over."""
        return tuple(one for one in self.found if one.kind == EPISODE)

    def outside(self, numbers: Array) -> Mask:
        """Profiles outside every episode, by number."""
        inside = [one.holds(numbers) for one in self.episodes]
        return ~np.any(inside, axis=0) if inside else np.ones(len(numbers), dtype=np.bool_)

    @property
    def leave_a_line(self) -> bool:
        """True where a line may still describe the series outside the episodes: no step and no ramp was found."""
        return len(self.episodes) == len(self.found)

    @property
    def leave_an_onset(self) -> bool:
        """True where a level that turns into a line may: apart from episodes there is at most a ramp that goes on."""
        others = [one for one in self.found if one.kind != EPISODE]
        return all(one.kind == RAMP and one.form == "continues" for one in others) and len(others) <= 1


@dataclass(eq=False)
class _Series:
    """A series of the mission, and the shapes found in it."""

    key: SizeKey
    days: Array
    values: Array
    known: Mask


@dataclass(frozen=True, eq=False)
class _FoundShape:
    """A shape that counts: its probability of chance, and the index of the series that it was found in."""

    shape: Shape
    p: float
    lead: int


def find_changes(table: pd.DataFrame, reference: float, settings: ChangeSettings, seed: int) -> Changes:
    """Find the change points of a mission.

    Parameters
    ----------
    table : pandas.DataFrame
        A row a profile, all of them.
    reference : float
        K_D0 of the hull, kg/m.
    settings : ChangeSettings
        Level, draws, smallest change.
    seed : int
        Of the bootstrap.

    Notes
    -----
    All windows of all series are one hypothesis: the largest gain is compared with the largest of null series, built
    of moving blocks of the independent errors that line and window leave, drawn at the same places in all series,
    and coloured with the noise that the line alone would need. A change that counts is fitted and joins the line, until
    the next one does not count. One that is smaller than those that are named joins it too. Episodes that overlap
    are one, whose course is that of both together.
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
    """Return the series to search: both quantities of both primary estimates, on dives, climbs and together."""
    days = days_of(table)
    return [
        _Series(key, days, values, np.isfinite(values) & ~spikes(values))
        for estimate in PRIMARY
        if median_column(DRAG, PHASES[0], estimate) in table
        for key, values in _of_estimate(table, estimate)
    ]


def spikes(values: Array) -> Mask:
    """Single values ``(n,)`` that lie far from both neighbours, by the scatter of the differences of neighbours."""
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
    """Return the search of each series about the shapes found; series known on the same profiles share one."""
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
    """Probability of chance of the strongest window of all series, which series that is, and the window."""
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
    """Independent errors of a series along the whole mission; a missing one is drawn among the others."""
    own = search.innovations(one.values[one.known], best)
    row = rng.choice(own, len(one.known))
    row[one.known] = own
    return row


def _shape(lead: _Series, search: WindowSearch, window: Strongest) -> Shape:
    """Fit the shape of a window in the series that leads, at all profiles of the mission."""
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
            return [*found[:place], _joined(series, one, new, others), *found[place + 1 :]]
    return [*found, new]


def _overlap(one: Shape, other: Shape) -> bool:
    """Return whether two episodes have profiles in common."""
    return one.kind == other.kind == EPISODE and one.first < other.stop and other.first < one.stop


def _joined(series: Sequence[_Series], one: _FoundShape, other: _FoundShape, others: Sequence[Shape]) -> _FoundShape:
    """One episode of two, fitted in the series that shows what the first one leaves.

    Where that is of another phase, the larger of the two changes decides: the other is what it shows of itself there.
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
    """Largest changes of the drag, by estimate and part, without their signs."""
    sizes = _sizes(series, found, place)
    return [0.0, *(abs(size.value) for key, size in sizes.items() if key[0] == DRAG and np.isfinite(size.value))]


def _change(table: pd.DataFrame, series: Sequence[_Series], found: Sequence[_FoundShape], place: int) -> Change:
    """Size a change in all series, the others fitted together with it."""
    shape, p, sizes = found[place].shape, found[place].p, _sizes(series, found, place)
    numbers, days = values_of(table, "profile"), days_of(table)
    over = shape.stop < len(numbers)
    phases, estimates = _changed(sizes)
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


def _changed(sizes: dict[SizeKey, Size]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Phases that changed, by the drag or else by the axial force, and the estimates that show it."""
    estimates = [name for name in PRIMARY if any(key[2] == name for key in sizes)]
    for quantity in (DRAG, AXIAL):
        own = {key: size for key, size in sizes.items() if key[0] == quantity and key[1] in PHASES}
        largest = max((abs(size.value) for size in own.values() if np.isfinite(size.value)), default=0.0)
        shown = [key for key, size in own.items() if size.leaves_out_zero and abs(size.value) >= PHASE_SHARE * largest]
        if shown:
            phases = tuple(phase for phase in PHASES if any(key[1] == phase for key in shown))
            return phases, tuple(name for name in estimates if any(key[2] == name for key in shown))
    return PHASES, tuple(estimates)


def _relative(change: Change, reference: float) -> float:
    """Largest change of drag on the phases that changed, in parts of the hull's."""
    return float(np.nanmax([0.0, *(abs(change.size(DRAG, phase).value) for phase in change.phases)])) / reference
