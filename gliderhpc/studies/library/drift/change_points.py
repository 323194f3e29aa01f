"""Search for change points of drag and axial force, and of the moments, on dives and climbs."""

from collections.abc import Callable, Iterator, Sequence

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from gliderhpc.flight.hull_parameters import righting_moment
from gliderhpc.platform import GRAVITY, Platform
from gliderhpc.store_schema.columns import median_column
from gliderhpc.studies.library.drift.change_search import (
    PARTS,
    FoundShape,
    MissionSeries,
    Size,
    SizeKey,
    search_series,
    series_of,
    sizes_of,
)
from gliderhpc.studies.library.drift.change_text import describe_briefly, drag_name, moment_name
from gliderhpc.studies.library.drift.changes import (
    AXIAL,
    MOMENTS,
    PHASE_SHARE,
    QUANTITIES,
    Change,
    Changes,
)
from gliderhpc.studies.library.drift.drag import shared_drag, weight_effects
from gliderhpc.studies.library.drift.medians import DRAG, PRIMARY, ChangeSettings
from gliderhpc.studies.library.drift.series import days_of, values_of
from gliderhpc.vocabulary import PHASES

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

SEARCHES = 2
"""Number of searches, each of which has an equal part of the level: that of drag and that of the moments."""

MAX_NAMED_P = 0.1
"""Largest probability of chance of a change that is mentioned although it is not significant."""


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
        drag_name,
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
        moment_name,
    )


def moment_per_degree(hull: Platform) -> float:
    """Return the moment that tilts a hull by one degree against its righting moment, N m."""
    return float(np.radians(1.0)) * GRAVITY * abs(righting_moment(hull))


def _named(
    shapes: Sequence[FoundShape],
    following: FoundShape | None,
    change_of: Callable[[Sequence[FoundShape], int], Change],
    is_large: Callable[[Change], bool],
    name_of: Callable[[Change], str],
) -> Changes:
    """Return the changes of significant shapes and the description of the following one, as far as they are large."""
    changes = [change for index in range(len(shapes)) if is_large(change := change_of(shapes, index))]
    found = tuple(sorted(changes, key=lambda change: change.days))
    if following is None:
        return Changes(found)
    candidate = change_of([*shapes, following], len(shapes))
    is_named = following.p <= MAX_NAMED_P and is_large(candidate)
    return Changes(found, following.p, describe_briefly(candidate, name_of) if is_named else "")


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
