"""Shapes of a change over the mission: a step, a ramp, or an episode that begins, ends and has a form."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gliderhpc.studies.library.drift.departures import MIN_WINDOW, OWN_SLOPE, WeightedBaseline

Array = NDArray[np.float64]

EPISODE, STEP, RAMP = "episode", "step", "ramp"

SUDDEN = "begins abruptly"
GRADUAL = "builds up gradually"
FORMS = {
    "stays": f"{SUDDEN}, stays, ends abruptly",
    "decays": f"{SUDDEN}, decays",
    "grows": f"{GRADUAL}, ends abruptly",
    "peaks": f"{GRADUAL}, decays",
    "lasts": f"{SUDDEN}, lasts until the end of the record",
    "continues": f"{GRADUAL}, goes on until the end of the record",
    "levels off": f"{GRADUAL}, levels off and lasts until the end of the record",
}
"""Forms of a change, in words."""

_KINDS = {"lasts": STEP, "continues": RAMP, "levels off": RAMP}

_PEAKS, _PLACES, _REACH = 8, 6, 4
"""Number of trial peaks in an episode; number of trial edges on each side, within 1 / `_REACH` of its length."""

_HALF, _EDGE = 0.5, 0.2
"""Fractions of the largest change: an end below the first is gradual, values below the second are not included."""


@dataclass(frozen=True, eq=False)
class Shape:
    """A change of unit size.

    Attributes
    ----------
    form : str
        Key of `FORMS`.
    first, stop : int
        Index of the first value changed, and of the first value after the return; without a return, the number of
        values.
    unit : (n,)
        Change at every value, with a largest value of 1.
    """

    form: str
    first: int
    stop: int
    unit: Array

    @property
    def kind(self) -> str:
        """Step, ramp or episode."""
        return _KINDS.get(self.form, EPISODE)

    @property
    def mean(self) -> float:
        """Mean over the values changed, as a fraction of the largest."""
        return float(self.unit[self.first : self.stop].mean())


@dataclass(frozen=True, eq=False)
class _Candidate:
    """Columns of a shape, with its number of edges and coefficients."""

    form: str
    first: int
    stop: int
    columns: tuple[Array, ...]
    coefficients: int


def fitted_shape(days: Array, values: Array, window: tuple[int, int], baseline: WeightedBaseline) -> Shape:
    """Fit the shape of a change whose window was found by the search.

    Parameters
    ----------
    days, values : (n,)
        The series.
    window : (int, int)
        Indices of the first value and of the first value after the window.
    baseline : WeightedBaseline
        Columns included in every fit, and the noise.

    Notes
    -----
    All shapes with edges near those of the window are fitted by weighted least squares, first coarsely and then value
    by value. The penalty of each coefficient and each edge is the logarithm of the number of values.
    """
    first, stop = window
    step = max(1, (stop - first) // (_REACH * _PLACES))
    best = _best(days, values, baseline, first, stop, step)
    while step > 1:
        step = max(1, step // _PLACES)
        best = _best(days, values, baseline, best.first, best.stop, step)
    return _unit_shape(best, values, baseline)


def joined_shape(
    earlier: Shape, later: Shape, known: NDArray[np.bool_], values: Array, baseline: WeightedBaseline
) -> Shape:
    """Fit one episode whose course is a combination of two.

    Parameters
    ----------
    earlier, later : Shape
        Overlapping episodes, over n profiles.
    known : (n,)
        Mask of the profiles with values.
    values : (m,)
        Values of the series.
    baseline : WeightedBaseline
        Further columns of the fit, and the noise.
    """
    columns = np.column_stack([earlier.unit, later.unit])
    course = columns @ _fit_columns(columns[known], values, baseline)
    unit = course / course[np.argmax(np.abs(course))]
    changed = np.flatnonzero(np.abs(unit) >= _EDGE)
    first, stop = int(changed[0]), int(changed[-1]) + 1
    unit[:first], unit[stop:] = 0.0, 0.0
    return Shape(_form_of(float(unit[first]), float(unit[stop - 1])), first, stop, unit)


def _best(days: Array, values: Array, baseline: WeightedBaseline, first: int, stop: int, step: int) -> _Candidate:
    candidates = list(_candidates(days, first, stop, step))
    weighted = baseline.projected @ values
    left, penalty = float(values @ weighted), float(np.log(len(values)))

    def loss(candidate: _Candidate) -> float:
        explained = _explained(np.column_stack(candidate.columns), weighted, baseline)
        rest = max(left - explained, np.finfo(np.float64).eps * left)
        return float(baseline.freedom * np.log(rest)) + candidate.coefficients * penalty

    return min(candidates, key=loss)


def _explained(columns: Array, weighted: Array, baseline: WeightedBaseline) -> float:
    sums = columns.T @ weighted
    return float(sums @ np.linalg.lstsq(columns.T @ baseline.projected @ columns, sums, rcond=None)[0])


def _candidates(days: Array, first: int, stop: int, step: int) -> Iterator[_Candidate]:
    n, reach = len(days), step * _PLACES
    stops = {min(max(end, 0), n) for end in range(stop - reach, stop + reach + 1, step)}
    # A step in the last profiles is, apart from the mission's level, the opposite of a window over all before.
    for begin in sorted(stops):
        if MIN_WINDOW <= begin <= n - MIN_WINDOW:
            yield from _until_the_end(days, begin)
    for begin in range(first - reach, first + reach + 1, step):
        if not MIN_WINDOW <= begin <= n - MIN_WINDOW:
            continue
        yield from _until_the_end(days, begin)
        for end in sorted(stops):
            if begin + MIN_WINDOW <= end <= n - MIN_WINDOW:
                yield from _that_end(days, begin, end)


def _until_the_end(days: Array, first: int) -> Iterator[_Candidate]:
    n = len(days)
    inside = _inside(n, first, n)
    yield _Candidate("lasts", first, n, (inside,), 2)
    start = days[first - 1]
    yield _Candidate("continues", first, n, (np.maximum(days - start, 0.0) / (days[-1] - start),), 2)


def _that_end(days: Array, first: int, stop: int) -> Iterator[_Candidate]:
    n, inside = len(days), _inside(len(days), first, stop)
    yield _Candidate("stays", first, stop, (inside,), 3)
    before, after = days[first - 1], days[stop]
    if after <= before:
        return
    yield _Candidate("levels off", first, n, (np.clip((days - before) / (days[stop - 1] - before), 0.0, 1.0),), 3)
    if stop - first < OWN_SLOPE:
        return
    yield _Candidate("decays", first, stop, (inside, inside * (days - before) / (after - before)), 4)
    for peak in np.unique(np.linspace(first, stop - 1, _PEAKS + 2)[1:-1].astype(int)):
        rise, fall = (days - before) / (days[peak] - before), (after - days) / (after - days[peak])
        yield _Candidate("peaks", first, stop, (np.maximum(np.minimum(rise, fall), 0.0),), 4)


def _inside(n: int, first: int, stop: int) -> Array:
    inside = np.zeros(n)
    inside[first:stop] = 1.0
    return inside


def _unit_shape(candidate: _Candidate, values: Array, baseline: WeightedBaseline) -> Shape:
    unit = _unit(np.column_stack(candidate.columns), values, baseline)
    form = (
        _form_of(float(unit[candidate.first]), float(unit[candidate.stop - 1]))
        if candidate.form == "decays"
        else candidate.form
    )
    return Shape(form, candidate.first, candidate.stop, unit)


def _unit(columns: Array, values: Array, baseline: WeightedBaseline) -> Array:
    """Course of columns (n, p) fitted to a series, with a largest value of 1."""
    course = columns @ _fit_columns(columns, values, baseline)
    largest = float(course[np.argmax(np.abs(course))])
    return np.asarray(course / largest if largest else columns[:, 0])


def _fit_columns(columns: Array, values: Array, baseline: WeightedBaseline) -> Array:
    squares, sums = columns.T @ baseline.projected @ columns, columns.T @ (baseline.projected @ values)
    return np.asarray(np.linalg.lstsq(squares, sums, rcond=None)[0])


def _form_of(start: float, end: float) -> str:
    """Return an episode's form from its ends, as fractions of the largest change; an end below half is gradual."""
    if start < _HALF:
        return "peaks" if end < _HALF else "grows"
    return "decays" if end < _HALF else "stays"
