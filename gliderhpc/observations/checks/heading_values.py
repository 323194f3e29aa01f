"""Checks of the values of a heading: its unit, whole turns, impossible values, and a compass that was stuck."""

import numpy as np
import numpy.typing as npt

from gliderhpc.errors import InputError
from gliderhpc.observations.profiles import IntArray, equal_runs
from gliderhpc.observations.records import FloatArray
from gliderhpc.wording import counted

RANGE = (-181.0, 361.0)
"""Range of headings (degree); those outside differ from one inside by whole turns, or are impossible."""

_ONE_TURN_MORE = (-360.0, 540.0)
"""Range of headings that are angles too: those of both usual ranges, turned by half a turn, or by a declination."""

MIN_DISTINCT = 10
"""Minimum number of different impossible values that are not fill values."""

_TENTHS = ((0.0, 3600.0), (-1800.0, 1800.0))
"""Ranges of headings in tenths of a degree; an unwrapped one within them looks the same."""

_GON, _DEGREES = (-0.5, 400.5), 361.0
"""Range of headings in gon (400 to a turn), and extent that no headings in degrees have, unless they are unwrapped."""

_LARGEST, _OVERFLOWN = 327.68, (-327.68, -295.36)
"""Limit (degree) of hundredths of a degree in two bytes, and range of those that have overflowed."""

_MARGIN = 0.1
"""Deviation (degree) from these limits by rounding."""


def check_circle(heading: FloatArray, where: str) -> None:
    """Refuse headings in gon, and those whose two bytes have overflowed, although they are declared as degrees.

    As degrees, less whole turns, they would be plausible.

    Parameters
    ----------
    heading : (n,) array
        Headings (degree) in time order, NaN where missing.
    where : str
        Names of the file and the variable in the error.

    Raises
    ------
    InputError
        The headings are such.
    """
    known = heading[np.isfinite(heading)]
    beyond, below = known[known > _DEGREES], known[known < 0.0]
    # An unwrapped heading extends over more than a turn too, but passes north without a step.
    in_gon = np.ptp(known) > _DEGREES and not outside(known, _GON).any() if len(known) else False
    if len(np.unique(beyond)) >= MIN_DISTINCT and in_gon and not _is_continuous(known):
        raise InputError(
            f"{where} covers {known.min():.4g} to {known.max():.4g}, {len(beyond)} of {counted(len(known), 'sample')} "
            "above 361: it is in gon, not in degree; set its units to 'gon', or convert it (1 gon = 0.9 degree)"
        )
    overflown = not outside(below, _with_margin(_OVERFLOWN)).any()
    if len(np.unique(below)) >= MIN_DISTINCT and overflown and known.max() <= _LARGEST + _MARGIN:
        raise InputError(
            f"{where} is between {below.min():.5g} and {below.max():.5g} degree in {len(below)} of "
            f"{counted(len(known), 'sample')}, and nowhere above {known.max():.5g}: hundredths of a degree have "
            f"overflowed two bytes; add {2.0 * _LARGEST:g} to the negative values"
        )


def _with_margin(limits: tuple[float, float]) -> tuple[float, float]:
    return limits[0] - _MARGIN, limits[1] + _MARGIN


def remove_turns(heading: FloatArray, where: str = "heading") -> tuple[FloatArray, str]:
    """Remove whole turns from headings outside their range, if these are angles.

    They are angles up to about one turn around the range. Beyond it, they are angles if the heading is continuous, as
    an unwrapped one is, and cannot be in tenths of a degree.

    Parameters
    ----------
    heading : (n,) array
        Headings (degree) in time order, NaN where missing.
    where : str
        Names of the file and the variable in the error.

    Returns
    -------
    (n,) array
        The headings, those outside `RANGE` from 0 to 360 if they are angles, else unchanged.
    str
        The change in words, to follow the name of the variable; empty if there is none.

    Raises
    ------
    InputError
        The headings are not degrees (`check_circle`).
    """
    check_circle(heading, where)
    far = outside(heading, _ONE_TURN_MORE)
    turned = outside(heading) & ~far
    if len(np.unique(heading[far])) >= MIN_DISTINCT:
        unwrapped = _is_continuous(heading) and all(outside(heading, limits).any() for limits in _TENTHS)
        turned = outside(heading) & unwrapped
    if not turned.any():
        return heading, ""
    first = int(np.flatnonzero(turned)[0])
    text = (
        f"is beyond -180 to 360 degree in {counted(int(np.count_nonzero(turned)), 'sample')}, the first "
        f"{heading[first]:g} at sample {first}; whole turns are removed"
    )
    return np.where(turned, np.mod(heading, 360.0), heading), text


def _is_continuous(heading: FloatArray) -> bool:
    """Return whether a heading (degree) has no step of more than half a turn, as where it passes north."""
    return bool((np.abs(np.diff(heading[np.isfinite(heading)])) <= 180.0).all())


def outside(angle: FloatArray, limits: tuple[float, float] = RANGE) -> npt.NDArray[np.bool_]:
    """Mask ``(n,)`` of the angles (degree) outside a range; missing ones are not."""
    with np.errstate(invalid="ignore"):
        return np.asarray((angle < limits[0]) | (angle > limits[1]))


def describe_impossible(
    angle: FloatArray, lost: npt.NDArray[np.bool_], where: str, limits: tuple[float, float] = RANGE
) -> str:
    """Count the impossible values of an angle, and name the first.

    Parameters
    ----------
    angle : (n,) array
        Values (degree), NaN where missing.
    lost : (n,) array of bool
        Mask of the impossible ones, at least one.
    where : str
        Names of the file and the variable in the error.
    limits : tuple of float
        Range of possible values.

    Raises
    ------
    InputError
        Many different values are impossible, and they are most of all or those of a continuous heading: they are in
        another unit than declared, or unwrapped.
    """
    first = int(np.flatnonzero(lost)[0])
    found, count = np.count_nonzero(lost), np.count_nonzero(np.isfinite(angle))
    text = (
        f"is outside {limits[0]:g} to {limits[1]:g} degree in {found} of {counted(int(count), 'sample')}, the first "
        f"{angle[first]:g} at sample {first}"
    )
    is_heading = limits == RANGE
    if len(np.unique(angle[lost])) >= MIN_DISTINCT and (found > 0.5 * count or (is_heading and _is_continuous(angle))):
        unwrapped = "; a heading over several turns must be written modulo 360" if is_heading else ""
        raise InputError(f"{where} {text}; convert it, or set its units to those that it is in{unwrapped}")
    return text


MIN_FROZEN, MIN_CHANGES, MANY_CHANGES = 20, 0.3, 60
"""Number of successive samples with one heading, and share or number of them at which the pitch changes, from which a
compass may have failed. Rounded to a degree, the heading is the same for 16 samples at most in 314 profiles of ten real
records. In simulated calm water it is the same to 0.1 degree for half an hour, but then the pitch hardly changes
either. In a fast record the pitch, rounded to 0.1 degree, changes in a tenth of the samples of a glide in disturbed
water, but often."""

STILL_ROLL = 5
"""Number of changes of the roll below which the glide may be a simulated one without noise, which keeps its heading."""

_MIN_CHANGE = 1e-6
"""Change of an angle (rad) that a sensor may resolve; a simulated glide without noise changes by less."""

FROZEN_TIME, FROZEN_SHARE, LEAST_TIME, MIN_OVERLAP = 1800.0, 0.25, 300.0, 5
"""Time (s), or share of a profile and least time, from which a heading that stays the same to the last digit is not
measured (at most 505 s and 0.14 in the same profiles), and least number of such samples in a profile."""


def frozen_profiles(
    time: FloatArray, heading: FloatArray, pitch: FloatArray, roll: FloatArray, profile: IntArray
) -> dict[int, str]:
    """Profiles, by number, with a heading constant to the last digit while pitch and roll change; with reasons.

    Parameters
    ----------
    time, heading, pitch, roll : (n,) arrays
        Times (s), heading, pitch and roll (rad) of all profiles, NaN where missing. A roll that is missing or the same
        everywhere was not measured and is not considered.
    profile : (n,) int array
        Number of the profile, 0 outside any.
    """
    known = np.flatnonzero(np.isfinite(heading))
    if not _changes(roll).any():
        roll = np.full(len(roll), np.nan)
    time, pitch, roll, profile = time[known], pitch[known], roll[known], profile[known]
    sizes = dict(zip(*np.unique(profile, return_counts=True), strict=True))
    found: dict[int, str] = {}
    for start, stop in equal_runs(heading[known], MIN_FROZEN):
        if not _varies(pitch[start:stop]) or is_still(roll[start:stop]):
            continue
        lasts = float(time[stop - 1] - time[start])
        for number, count in zip(*np.unique(profile[start:stop], return_counts=True), strict=True):
            share = count / sizes[number]
            if number > 0 and count >= MIN_OVERLAP and lasts >= (LEAST_TIME if share >= FROZEN_SHARE else FROZEN_TIME):
                found[int(number)] = (
                    f"profile {number}: heading is constant over {count} samples ({lasts / 60.0:.0f} min in "
                    "total) while pitch varies: the compass was stuck; mark the heading missing (NaN) there"
                )
    return found


def _changes(values: FloatArray) -> npt.NDArray[np.bool_]:
    """Mask of the known values (rad) after the first that differ from the one before."""
    return np.asarray(np.abs(np.diff(values[np.isfinite(values)])) > _MIN_CHANGE)


def _varies(values: FloatArray) -> bool:
    """Return whether many of the known values (rad) differ from the one before, in number or as a share."""
    changes = _changes(values)
    return bool(changes.sum() >= MANY_CHANGES or (len(changes) and changes.mean() >= MIN_CHANGES))


def is_still(roll: FloatArray) -> bool:
    """Return whether a roll (rad) is known and hardly changes, as in a simulated glide without noise."""
    changes = _changes(roll)
    return bool(len(changes) and changes.sum() < STILL_ROLL)
