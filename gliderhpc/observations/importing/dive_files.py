"""Files of one or more dives: samples, fixes and the source's own solution, and joining of the files to a mission."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from gliderhpc.errors import InputError
from gliderhpc.observations.checks.validation import Span
from gliderhpc.observations.files.foreign import ForeignFile
from gliderhpc.observations.fixes import Fixes, merge_fixes
from gliderhpc.observations.importing.clock_steps import ClockStep, in_time_order
from gliderhpc.observations.importing.excursions import find_lost
from gliderhpc.observations.importing.rows import NOT_INCREASING, Columns, increasing, join_columns


@dataclass(frozen=True, eq=False)
class FileRecords:
    """Content of one of several files that hold consecutive dives.

    Attributes
    ----------
    samples : dict of str to (n,) array
        Samples in the variables of the observation format, including the number of the profile.
    solution : dict of str to array
        Reference quantities: the source's own current, speed and flight model.
    fixes : Fixes
        GPS fixes in the order of the file.
    rows_dropped : int
        Number of dropped samples, whose time was missing or did not increase.
    """

    samples: Columns
    solution: Columns
    fixes: Fixes
    rows_dropped: int = 0


def contradicting_dives(files: Sequence[FileRecords]) -> dict[int, str]:
    """Find the profiles whose times contradict those of the files before and after.

    Parameters
    ----------
    files : sequence of FileRecords
        Content of the files, in the order of the mission.

    Returns
    -------
    dict of int to str
        Reasons by number of the profile.
    """
    if not files:
        return {}
    time, profile, depth = (
        np.concatenate([file.samples[name] for file in files]) for name in ("time", "profile", "depth")
    )
    clock = time.astype("datetime64[ns]")
    lost = find_lost(clock, profile.astype(np.int64), depth.astype(np.float64), increasing(clock))
    return {number: why for number, why in lost.items() if number}


def without_dives(files: Sequence[FileRecords], numbers: Iterable[int]) -> list[FileRecords]:
    """Leave out some profiles: their samples are in no profile, and a file without other profiles is left out."""
    rest: list[FileRecords] = []
    for file in files:
        profile = file.samples["profile"]
        lost = np.isin(profile, list(numbers))
        if not lost.any():
            rest.append(file)
        elif np.any(profile[~lost] != 0):
            rest.append(replace(file, samples=file.samples | {"profile": np.where(lost, 0, profile)}))
    return rest


class JoinedFiles(NamedTuple):
    """Content of the files of a mission, joined.

    Attributes
    ----------
    variables : dict of str to array
        Samples in time order, without those that precede the end of an earlier file, and reference quantities.
    fixes : Fixes
        GPS fixes in time order, without repetitions and outliers.
    clock_steps : list of ClockStep
        Steps of the clock between the files.
    rows_dropped : Counter
        Number of samples left out, by reason.
    """

    variables: Columns
    fixes: Fixes
    clock_steps: list[ClockStep]
    rows_dropped: Counter[str]


def join_files(files: Sequence[FileRecords]) -> JoinedFiles:
    """Join the files of a mission.

    Parameters
    ----------
    files : sequence of FileRecords
        Content of the files, in time order.
    """
    variables, backwards, steps = in_time_order(join_columns([file.samples for file in files]))
    variables |= {name: np.concatenate([file.solution[name] for file in files]) for name in files[0].solution}
    dropped = backwards + sum(file.rows_dropped for file in files)
    rows_dropped = Counter({NOT_INCREASING: dropped} if dropped else {})
    return JoinedFiles(variables, merge_fixes([file.fixes for file in files]), steps, rows_dropped)


def check_samples(samples: Columns, path: str, otherwise: str) -> None:
    """Refuse samples of different lengths, or without roll, pitch or heading.

    Parameters
    ----------
    samples : dict of str to (n,) array
        Columns of one file, including ``time`` and the attitude (degree).
    path : str
        Name of the file in messages.
    otherwise : str
        Predicate and remedy of the message on a variable whose length is not that of ``time``.

    Raises
    ------
    InputError
        There are such samples; the message names the first variable concerned.
    """
    odd = [name for name, values in samples.items() if len(values) != len(samples["time"])]
    if odd:
        raise InputError(f"{path}: {odd[0]} {otherwise}")
    for name in ("roll", "pitch", "heading"):
        if not np.isfinite(samples[name].astype(np.float64)).any():
            raise InputError(f"{path}: has no sample of {name}")


def number_samples(spans: Mapping[int, Span], count: int) -> npt.NDArray[np.int64]:
    """Return the profile number of each of `count` samples, 0 outside any profile, from the spans of the profiles."""
    numbers = np.zeros(count, dtype=np.int64)
    for number, (start, stop) in spans.items():
        numbers[start:stop] = number
    return numbers


def read_fixes(file: ForeignFile, names: Sequence[str], usable: npt.ArrayLike = True) -> Fixes:
    """Read the GPS fixes of a file that have a time and a position, in the order of the file.

    Parameters
    ----------
    file : ForeignFile
        The file.
    names : sequence of str
        Names of time, latitude and longitude, ``(m,)`` each.
    usable : (m,) array of bool
        Mask of the fixes that the file does not flag as bad.

    Raises
    ------
    InputError
        The variables are missing, differ in length, or cannot be converted.
    """
    file.check_lengths(names)
    time = file.times(names[0])
    latitude, longitude = (
        file.converted(name, unit) for name, unit in zip(names[1:], ("degrees_north", "degrees_east"), strict=True)
    )
    return Fixes(time, latitude, longitude).where(
        ~np.isnat(time) & np.isfinite(latitude) & np.isfinite(longitude) & np.asarray(usable)
    )


def reference_speeds(file: ForeignFile, clock: str, sources: Mapping[str, str | None]) -> Columns:
    """Read the speeds of the source's own flight model, at the times with a speed.

    Parameters
    ----------
    file : ForeignFile
        The file.
    clock : str
        Name of the time variable of the speeds.
    sources : mapping of str to str or None
        Variable name in the file by reference quantity, None where the file has none.

    Returns
    -------
    dict of str to (k,) array
        ``reference_time`` (UTC), increasing, and the reference quantities (m/s), NaN where missing.
    """
    file.check_lengths((clock, *filter(None, sources.values())))
    time = file.times(clock)
    speeds = {
        name: np.full(len(time), np.nan) if source is None else file.converted(source, "m s-1")
        for name, source in sources.items()
    }
    known = np.flatnonzero(~np.isnat(time) & np.isfinite(speeds["reference_speed"]))
    known = known[np.unique(time[known], return_index=True)[1]]
    return {"reference_time": time[known], **{name: values[known] for name, values in speeds.items()}}
