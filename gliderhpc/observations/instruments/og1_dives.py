"""Dives of an OG1 file: by the file's own dive counter, or else from depth."""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from gliderhpc.errors import ProfileError
from gliderhpc.observations.checks.validation import MAX_PROFILE_NUMBER, Span
from gliderhpc.observations.files.foreign import ForeignFile
from gliderhpc.observations.importing.excursions import find_lost
from gliderhpc.observations.importing.rows import increasing
from gliderhpc.observations.instruments.og1_variables import DIVE, TIME
from gliderhpc.observations.profiles import detect_profiles, dive_span
from gliderhpc.observations.records import FloatArray
from gliderhpc.observations.times import SECOND

IntArray = npt.NDArray[np.int64]

_NO_DIVE = -1


@dataclass(frozen=True, eq=False)
class Dives:
    """Dives of one file.

    Attributes
    ----------
    spans : dict of int to Span
        Sample range of each dive by its number, in time order.
    without : dict of int to str
        Reasons why other numbers of the file's counter give no dive.
    remark : str
        Reason why the dives are not numbered as in the file; empty if they are.
    """

    spans: dict[int, Span]
    without: dict[int, str]
    remark: str = ""


def is_counted(file: ForeignFile) -> bool:
    """Return whether a file numbers its dives."""
    return DIVE.find(file) is not None


def keeps_count(file: ForeignFile, rows: IntArray) -> bool:
    """Return whether the file's dive counter, if it has one, decreases no more often in another order of the rows.

    Sorted by the times of a clock that was wrong, the dives are not in the order in which they were counted.
    """
    name = DIVE.find(file)
    if name is None:
        return True
    file.check_lengths((TIME.require(file, "time"), name))
    given = _plausible_numbers(file.numbers(name))
    before, after = (np.diff(numbers[numbers > 0]) < 0 for numbers in (given, given[rows]))
    return bool(np.count_nonzero(after) <= np.count_nonzero(before))


def _plausible_numbers(given: FloatArray) -> IntArray:
    """Dive numbers; impossible values, such as undeclared fill values, mean no dive."""
    known = np.nan_to_num(given, nan=_NO_DIVE)
    plausible = (known >= 0) & (known <= MAX_PROFILE_NUMBER) & (known == np.rint(known))
    return np.asarray(np.where(plausible, known, _NO_DIVE), dtype=np.int64)


def dive_numbers(file: ForeignFile, rows: IntArray, time: npt.NDArray[np.datetime64], depth: FloatArray) -> IntArray:
    """Dive number of some rows, given with their time and depth: from the file, or else detected; -1 for none."""
    name = DIVE.find(file)
    if name is not None:
        file.check_lengths((TIME.require(file, "time"), name))
        return _plausible_numbers(file.numbers(name))[rows]
    return detect_dives(time, depth)


def detect_dives(time: npt.NDArray[np.datetime64], depth: FloatArray) -> IntArray:
    """Dive number of every row, detected from depth; -1 where there is none."""
    known = increasing(time) & np.isfinite(depth)
    numbers = np.full(len(time), _NO_DIVE)
    if known.any():
        seconds = (time[known] - time[known][0]) / SECOND
        detected = detect_profiles(seconds, depth[known])
        numbers[known] = np.where(detected > 0, detected, _NO_DIVE)
    return numbers


def drop_contradicting(
    numbers: IntArray, time: npt.NDArray[np.datetime64], depth: FloatArray, keep: npt.NDArray[np.bool_]
) -> tuple[IntArray, dict[int, str]]:
    """Drop the dives whose times contradict those before and after.

    Parameters
    ----------
    numbers : (n,) int array
        Dive number of every sample, -1 where there is none.
    time : (n,) array
        Times in the order of the file.
    depth : (n,) array
        Depth (m), NaN where missing.
    keep : (n,) array of bool
        Mask of the samples that remain.

    Returns
    -------
    numbers : (n,) int array
        Dive numbers, -1 for the samples of these dives.
    lost : dict of int to str
        Reasons by number of these dives.
    """
    # Zero usually means no dive.
    lost = {number: why for number, why in find_lost(time, numbers, depth, keep).items() if number > 0}
    return np.where(np.isin(numbers, list(lost)), _NO_DIVE, numbers), lost


def find_dives(
    numbers: IntArray, time: npt.NDArray[np.datetime64], depth: FloatArray, *, is_whole: bool = True
) -> Dives:
    """Find the sample range of each dive.

    Parameters
    ----------
    numbers : (n,) array
        Dive number of every sample, -1 where there is none.
    time : (n,) array
        Increasing times (UTC).
    depth : (n,) array
        Depth (m), NaN where missing.
    is_whole : bool
        Whether no dive has been dropped, whose samples have no number.

    Notes
    -----
    In most files the first dive is number one, and zero means no dive; in others it is number zero. Samples numbered
    zero are therefore a dive if they go down and come up again once. If no sample has another number, or all have the
    same although the glider came up between dives, the dives are detected from depth. A counter that restarts, such as
    that of a Slocum's segments with each mission, gives the same number to several dives. If the numbers do not
    increase from one dive to the next, or begin with zero, the dives are numbered from one in time order.
    """
    if (only := _only_number(numbers)) is not None:
        detected = detect_dives(time, depth)
        count = len(np.unique(detected[detected != _NO_DIVE]))
        if only == 0 or (is_whole and (count > 1 or (count and only < 1))):
            what = "has no value" if only == _NO_DIVE else f"is always {only}"
            return replace(find_dives(detected, time, depth), remark=f"its dive counter {what}: {_FROM_DEPTH}")
    found: list[tuple[int, Span]] = []
    without: dict[int, str] = {}
    for number, start, stop in _stretches(_without_strays(numbers, time, depth), depth):
        try:
            first, last = dive_span(depth[start:stop])
        except ProfileError as error:
            without[number] = str(error)
        else:
            found.append((number, (start + first, start + last)))
    own = [number for number, _ in found]
    without = {number: why for number, why in without.items() if number not in own}
    if all(number > 0 for number in own) and all(before < after for before, after in pairwise(own)):
        return Dives(dict(found), without)
    what = "begins with 0" if own[0] == 0 and len(set(own)) == len(own) else "restarts or decreases"
    remark = f"its dive counter {what}: the dives are numbered from 1 in time order"
    return Dives({place: span for place, (_, span) in enumerate(found, 1)}, without, remark)


_FROM_DEPTH = "the dives are detected from depth"


def _only_number(numbers: IntArray) -> int | None:
    """Number of all samples that have one, -1 if none has; None if there are several."""
    found = np.unique(numbers[numbers != _NO_DIVE])
    if len(found) > 1:
        return None
    return int(found[0]) if len(found) else _NO_DIVE


def _without_strays(numbers: IntArray, time: npt.NDArray[np.datetime64], depth: FloatArray) -> IntArray:
    """Numbers without zeros that do not form one dive, and without isolated numbers inside another dive.

    Isolated numbers are those between two samples of another number that do not form a whole dive.
    """
    kept = numbers.copy()
    runs = _runs(np.flatnonzero(numbers != _NO_DIVE), numbers)
    whole = [_is_whole_dive(depth[start:stop]) for start, stop in runs]
    strays = [
        place
        for place, (start, stop) in enumerate(runs)
        if numbers[start] == 0 and not (whole[place] and _is_one_dive(time[start:stop], depth[start:stop]))
    ]
    last: dict[int, int] = {}
    for place, (start, _) in enumerate(runs):
        number = int(numbers[start])
        between = range(last.get(number, place) + 1, place)
        if number > 0 and not any(whole[other] for other in between):
            strays += between
        last[number] = place
    for place in strays:
        start, stop = runs[place]
        kept[start:stop][numbers[start:stop] == numbers[start]] = _NO_DIVE
    return kept


def _is_one_dive(time: npt.NDArray[np.datetime64], depth: FloatArray) -> bool:
    detected = detect_dives(time, depth)
    return len(np.unique(detected[detected > 0])) == 1


def _is_whole_dive(depth: FloatArray) -> bool:
    """Return whether the glider begins and ends nearer to the surface than to the bottom of its dive."""
    known = depth[np.isfinite(depth)]
    return _is_dive(depth) and bool(max(known[0], known[-1]) < 0.5 * known.max())


def _stretches(numbers: IntArray, depth: FloatArray) -> list[tuple[int, int, int]]:
    """Number, first sample and end of each stretch with one number, in time order.

    Samples with another number that go to no depth do not divide a stretch.
    """
    runs = _runs(np.flatnonzero(numbers != _NO_DIVE), numbers)
    diving = [run for run in runs if _is_dive(depth[run[0] : run[1]])]
    stretches: list[tuple[int, int, int]] = []
    for start, stop in diving:
        number = int(numbers[start])
        if stretches and stretches[-1][0] == number:
            stretches[-1] = (number, stretches[-1][1], stop)
        else:
            stretches.append((number, start, stop))
    dived = {number for number, *_ in stretches}
    idle = {int(numbers[start]): (start, stop) for start, stop in runs if int(numbers[start]) not in dived}
    return sorted([*stretches, *((number, *span) for number, span in idle.items())], key=lambda each: each[1])


def _runs(rows: IntArray, numbers: IntArray) -> list[Span]:
    """Sample ranges of successive rows with the same number; rows that are not given do not end a range."""
    if len(rows) == 0:
        return []
    ends = np.flatnonzero(np.diff(numbers[rows])) + 1
    return [(int(part[0]), int(part[-1]) + 1) for part in np.split(rows, ends)]


def _is_dive(depth: FloatArray) -> bool:
    try:
        dive_span(depth)
    except ProfileError:
        return False
    return True
