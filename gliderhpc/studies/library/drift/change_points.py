"""Change points: steps, ramps and episodes of drag and axial force, and of the moments, on dives and climbs."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from gliderhpc.flight.hull_parameters import righting_moment
from gliderhpc.platform import GRAVITY, Platform
from gliderhpc.store_schema.columns import median_column
from gliderhpc.studies.library.drift.change_search import (
    PARTS,
    TOGETHER,
    FoundShape,
    MissionSeries,
    Size,
    SizeKey,
    search_series,
    series_of,
    sizes_of,
)
from gliderhpc.studies.library.drift.drag import shared_drag, weight_effects
from gliderhpc.studies.library.drift.medians import DRAG, PRIMARY, ChangeSettings
from gliderhpc.studies.library.drift.series import days_of, values_of
from gliderhpc.studies.library.drift.shape_fits import EPISODE, RAMP
from gliderhpc.vocabulary import PHASES

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

AXIAL = "B_cu"
QUANTITIES = (AXIAL, DRAG)
"""Quantities of the search for changes of drag."""

MOMENTS = ("B_cp", "B_cq", "B_cr")
"""Quantities of the search for changes of the moments."""

SEARCHES = 2
"""Number of searches, each of which has an equal part of the level: that of drag and that of the moments."""

PHASE_SHARE = 1.0 / 3.0
"""Ratio to the larger change above which a phase, or a moment, is regarded as changed."""

MAX_NAMED_P = 0.1
"""Largest probability of chance of a change that is mentioned although it is not significant."""

MISSING = Size(float("nan"), float("nan"), float("nan"))


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
        Largest change (N, kg/m or N m) by quantity, part and estimate.
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
            return MISSING
        return Size(
            own[0].value,
            min(estimate_size.low for estimate_size in own),
            max(estimate_size.high for estimate_size in own),
        )

    @property
    def is_drag(self) -> bool:
        """Return whether the drag changed on dives and climbs in the same direction, as that of the hull does."""
        signs = {self.size(DRAG, phase).value > 0.0 for phase in PHASES}
        return self.phases == PHASES and len(signs) == 1

    @property
    def is_opposite(self) -> bool:
        """Return whether dives and climbs changed in opposite directions, even if only one of them changed by much."""
        dive, climb = (self.size(DRAG, phase) for phase in PHASES)
        return dive.excludes_zero and climb.excludes_zero and dive.value * climb.value < 0.0

    @property
    def drag(self) -> Size:
        """Largest change of the drag that dives and climbs share (kg/m), with the hull's other errors in its interval.

        Such errors, for example a constant offset of the pitch, change the sizes on dives and climbs in opposite
        directions. The difference of the two phases is therefore a measure of the hull's part. Half of it is combined,
        in quadrature, with the half widths of the interval by scatter alone.
        """
        both = self.size(DRAG, TOGETHER)
        dive, climb = (self.size(DRAG, phase).value for phase in PHASES)
        hull = 0.5 * abs(dive - climb)
        below, above = np.hypot(both.value - both.low, hull), np.hypot(both.high - both.value, hull)
        return Size(both.value, float(both.value - below), float(both.value + above))

    @property
    def moments(self) -> tuple[str, ...]:
        """Moments that changed, beginning with the largest change."""
        sizes = {name: [self.size(name, phase) for phase in PHASES] for name in MOMENTS}
        shown = {
            name: max((abs(size.value) for size in own if size.excludes_zero), default=0.0)
            for name, own in sizes.items()
        }
        largest = max(shown.values())
        names = [name for name in MOMENTS if shown[name] > 0.0 and shown[name] >= PHASE_SHARE * largest]
        return tuple(sorted(names, key=lambda name: -shown[name]))

    def contains(self, numbers: Array) -> Mask:
        """Mask of the profile numbers that belong to the change."""
        return np.asarray((numbers >= self.first) & (numbers <= self.last), dtype=np.bool_)


@dataclass(frozen=True)
class Changes:
    """Change points of a mission, by one search.

    Attributes
    ----------
    found : tuple of Change
        Changes in order of their days.
    p : float
        Probability of chance of the strongest change that is not significant; NaN if too few profiles could be
        searched, or if the search ended at the largest number of changes.
    next : Change or None
        That change, after a search, if it is large enough to be named.
    next_text : str
        Brief description of that change, as stored, if its probability of chance is at most `MAX_NAMED_P`.
    """

    found: tuple[Change, ...] = ()
    p: float = float("nan")
    next: Change | None = None
    next_text: str = ""

    @property
    def episodes(self) -> tuple[Change, ...]:
        """Changes that have ended."""
        return tuple(change for change in self.found if change.kind == EPISODE)

    def outside(self, numbers: Array) -> Mask:
        """Mask of the profile numbers outside every episode."""
        inside = [change.contains(numbers) for change in self.episodes]
        return ~np.any(inside, axis=0) if inside else np.ones(len(numbers), dtype=np.bool_)

    @property
    def allow_line(self) -> bool:
        """Return whether a line may still describe the series outside the episodes: no step and no ramp was found."""
        return len(self.episodes) == len(self.found)

    @property
    def allow_onset(self) -> bool:
        """Return whether at most one ramp, which continues to the end of the record, was found outside the episodes."""
        others = [change for change in self.found if change.kind != EPISODE]
        return all(change.kind == RAMP and change.form == "continues" for change in others) and len(others) <= 1


def find_changes(table: pd.DataFrame, reference: float, settings: ChangeSettings, seed: int) -> Changes:
    """Find the changes of drag and axial force of a mission.

    Parameters
    ----------
    table : pandas.DataFrame
        Table of medians, one row for every profile.
    reference : float
        K_D0 of the hull, kg/m.
    settings : ChangeSettings
        Level of both searches together, draws, smallest change.
    seed : int
        Seed of the bootstrap.

    Notes
    -----
    Series are those of both quantities, by both primary estimates, on dives, climbs and both together. Significant
    changes below the smallest size are included in the fits of the others, but not reported.
    """
    series = series_of(table, lambda estimate: _of_drag(table, estimate))
    shapes, following = search_series(series, (DRAG,), settings, settings.level / SEARCHES, seed)
    return _named(
        shapes,
        following,
        lambda shapes, index: _change(table, series, shapes, index, (DRAG, AXIAL)),
        lambda change: _relative(change, reference) >= settings.smallest,
    )


def find_moment_changes(table: pd.DataFrame, hull: Platform, settings: ChangeSettings, seed: int) -> Changes:
    """Find the changes of the moments about the roll, pitch and yaw axes of a mission.

    Parameters
    ----------
    table : pandas.DataFrame
        Table of medians, one row for every profile.
    hull : Platform
        Hull of the mission; its righting moment gives the tilt that a moment causes.
    settings : ChangeSettings
        Level of both searches together, draws, smallest tilt.
    seed : int
        Seed of the bootstrap.

    Notes
    -----
    Series are those of the three moments, by both primary estimates, on dives and climbs. The heave force is not
    searched: the records determine it weakly, and whatever changes it (lift, weight or vertical motion of the water)
    also changes the equivalent drag.
    """
    series = series_of(table, lambda estimate: _of_moments(table, estimate))
    shapes, following = search_series(series, MOMENTS, settings, settings.level / SEARCHES, seed)
    smallest = settings.smallest_tilt * moment_per_degree(hull)
    return _named(
        shapes,
        following,
        lambda shapes, index: _moment_change(table, series, shapes, index),
        lambda change: bool(change.moments) and _largest(change, change.moments[:1]) >= smallest,
    )


def moment_per_degree(hull: Platform) -> float:
    """Return the moment that tilts a hull by one degree against its righting moment, N m."""
    return float(np.radians(1.0)) * GRAVITY * abs(righting_moment(hull))


def _named(
    shapes: Sequence[FoundShape],
    following: FoundShape | None,
    change_of: Callable[[Sequence[FoundShape], int], Change],
    is_large: Callable[[Change], bool],
) -> Changes:
    """Return the changes of significant shapes and of the following one, as far as they are large."""
    changes = [change for index in range(len(shapes)) if is_large(change := change_of(shapes, index))]
    found = tuple(sorted(changes, key=lambda change: change.days))
    if following is None:
        return Changes(found)
    candidate = change_of([*shapes, following], len(shapes))
    return Changes(found, following.p, candidate if is_large(candidate) else None)


def _of_drag(table: pd.DataFrame, estimate: str) -> Iterator[tuple[SizeKey, Array]]:
    if median_column(DRAG, PHASES[0], estimate) not in table:
        return
    for quantity in QUANTITIES:
        dive, climb = (values_of(table, median_column(quantity, phase, estimate)) for phase in PHASES)
        both = shared_drag(dive, climb, weight_effects(table)) if quantity == DRAG else 0.5 * (dive + climb)
        for part, values in zip(PARTS, (dive, climb, both), strict=True):
            yield (quantity, part, estimate), values


def _of_moments(table: pd.DataFrame, estimate: str) -> Iterator[tuple[SizeKey, Array]]:
    for quantity in MOMENTS:
        for phase in PHASES:
            yield (quantity, phase, estimate), values_of(table, median_column(quantity, phase, estimate))


def _moment_change(
    table: pd.DataFrame, series: Sequence[MissionSeries], shapes: Sequence[FoundShape], index: int
) -> Change:
    """Change of the moments; its phases are those of the largest."""
    moments = _change(table, series, shapes, index, MOMENTS).moments
    return _change(table, series, shapes, index, moments or MOMENTS)


def _change(
    table: pd.DataFrame,
    series: Sequence[MissionSeries],
    shapes: Sequence[FoundShape],
    index: int,
    quantities: Sequence[str],
) -> Change:
    """Determine the size of a change in all series; the phases are those of the first quantity that shows any."""
    shape, p, sizes = shapes[index].shape, shapes[index].p, sizes_of(series, shapes, index)
    numbers, days = values_of(table, "profile"), days_of(table)
    over = shape.stop < len(numbers)
    phases, estimates = _changed_phases(sizes, quantities)
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


def _changed_phases(sizes: dict[SizeKey, Size], quantities: Sequence[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Phases that changed according to the first quantity that shows any, and the estimates that show the change."""
    estimates = [name for name in PRIMARY if any(key[2] == name for key in sizes)]
    for quantity in quantities:
        own = {key: size for key, size in sizes.items() if key[0] == quantity and key[1] in PHASES}
        largest = max((abs(size.value) for size in own.values() if np.isfinite(size.value)), default=0.0)
        shown = [key for key, size in own.items() if size.excludes_zero and abs(size.value) >= PHASE_SHARE * largest]
        if shown:
            phases = tuple(phase for phase in PHASES if any(key[1] == phase for key in shown))
            return phases, tuple(name for name in estimates if any(key[2] == name for key in shown))
    return PHASES, tuple(estimates)


def _relative(change: Change, reference: float) -> float:
    """Largest change of drag in the phases that changed, relative to the hull's K_D0."""
    return _largest(change, (DRAG,)) / reference


def _largest(change: Change, quantities: Sequence[str]) -> float:
    """Magnitude of the largest change of quantities in the phases that changed."""
    sizes = [change.size(quantity, phase).value for quantity in quantities for phase in change.phases]
    return float(np.nanmax([0.0, *np.abs(sizes)]))
