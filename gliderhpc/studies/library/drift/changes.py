"""Changes of a mission as values: steps, ramps and episodes of drag and axial force, or of the moments."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gliderhpc.studies.library.drift.change_search import TOGETHER, Size, SizeKey
from gliderhpc.studies.library.drift.medians import DRAG, PRIMARY
from gliderhpc.studies.library.drift.shape_fits import EPISODE, RAMP
from gliderhpc.vocabulary import PHASES

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

AXIAL = "B_cu"
QUANTITIES = (AXIAL, DRAG)
"""Quantities of the search for changes of drag."""

MOMENTS = ("B_cp", "B_cq", "B_cr")
"""Quantities of the search for changes of the moments."""

PHASE_SHARE = 1.0 / 3.0
"""Ratio to the larger change above which a phase, or a moment, is regarded as changed."""

MISSING = Size(float("nan"), float("nan"), float("nan"))


@dataclass(frozen=True, eq=False)
class Change:
    """A change point, or two that enclose an episode.

    Attributes
    ----------
    kind, form : str
        Kind and form, as defined in `shape_fits`.
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
    next : str
        Brief description of that change; empty if it is too small or too probably chance to be named.
    """

    found: tuple[Change, ...] = ()
    p: float = float("nan")
    next: str = ""

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
