"""Checks of the records of a current: quantities in another unit than the one declared or assumed, and short dives."""

from collections.abc import Iterator

import numpy as np

from gliderhpc.errors import InputError
from gliderhpc.observations.checks.profile_checks import MIN_PITCH, check_heading_unit
from gliderhpc.observations.checks.validation import describe_time, profile_spans
from gliderhpc.observations.profiles import IntArray
from gliderhpc.observations.records import FloatArray, TimeArray
from gliderhpc.wording import counted

MIN_DEPTH = 20.0
"""Depth (m) below which depth and pressure are compared, and least range of both."""

MIN_COMPARED = 30
"""Minimum number of samples with depth and pressure for a comparison."""

MAX_OFFSET = 5.0
"""Maximum offset (m) of depth or pressure that needs no remark; an absolute pressure has 10 m."""

_METRES = {"feet": 0.3048, "fathoms": 1.8288, "inches": 0.0254, "centimetres": 0.01}
"""Units in which a depth may be that is taken as metres."""

_TOLERANCE, _DOUBT = 0.03, 0.1
"""Relative deviation of depth over pressure within which a unit is recognised, and from which both are uncertain; the
density of sea water accounts for 0.03."""

_METRES_A_DECIBAR = 0.99


def check_pitch(source: str, pitch: FloatArray, depth: FloatArray, surface: float) -> None:
    """Refuse records without any pitch or depth, and a pitch in radians that is declared in degrees.

    Raises
    ------
    InputError
        The records cannot be used; the message gives the remedy.
    """
    empty = [name for name, values in (("pitch", pitch), ("depth", depth)) if not np.isfinite(values).any()]
    if empty:
        verb = "has" if len(empty) == 1 else "have"
        raise InputError(f"{source}: {' and '.join(empty)} {verb} no value that is possible for a glider")
    steepest, deepest = float(np.nanmax(np.abs(np.degrees(pitch)))), float(np.nanmax(depth))
    if steepest < MIN_PITCH and deepest > surface:
        raise InputError(
            f"{source}: the pitch never exceeds {steepest:.2g} degrees although the glider dives to {deepest:.0f} m; "
            "if it is in radians, set its units to 'rad'"
        )


def check_heading(source: str, heading: FloatArray, profile: IntArray, name: str) -> list[str]:
    """Refuse a heading in radians that is declared in degrees, and return a remark where it may be.

    Parameters
    ----------
    source : str
        Name of the records in messages.
    heading : (n,) array
        Heading as measured, without a declination added (degree).
    profile : (n,) int array
        Number of the profile, 0 outside any.
    name : str
        Name of the heading's variable in messages.
    """
    spans, _ = profile_spans(profile)
    doubt = check_heading_unit(heading, spans, source, name)
    return [] if doubt is None else [doubt]


def check_depth_unit(source: str, depth: FloatArray, pressure: FloatArray) -> list[str]:
    """Compare a depth (m) with the pressure of the same samples (dbar), and return a remark where they contradict.

    Raises
    ------
    InputError
        Their ratio is that of a depth in another unit, such as feet.
    """
    with np.errstate(invalid="ignore"):
        both = (depth > MIN_DEPTH) & (pressure > 0.0)
    if np.count_nonzero(both) < MIN_COMPARED:
        return []
    deep, pressed = depth[both], pressure[both] * _METRES_A_DECIBAR
    low, high = np.quantile(pressed, (0.1, 0.9))
    if high - low < MIN_DEPTH:
        return []
    # The ratio of the ranges does not depend on an offset, such as that of an absolute pressure.
    ratio = float(np.subtract(*np.quantile(deep, (0.9, 0.1))) / (high - low))
    for unit, metres in _METRES.items():
        if abs(ratio * metres - 1.0) < _TOLERANCE:
            raise InputError(
                f"{source}: the depth is {ratio:.3g} times that from pressure (dbar), so it is in {unit}; convert "
                "it to metres"
            )
    if abs(ratio - 1.0) > _DOUBT:
        return [f"the depth is {ratio:.3g} times that from pressure (dbar): check the units of both"]
    offset = float(np.median(deep - ratio * pressed))
    if abs(offset) <= MAX_OFFSET:
        return []
    return [f"the depth is {offset:+.1f} m off that by pressure: check the zero of both"]


def describe_short_dives(
    time: TimeArray, depth: FloatArray, dives: IntArray, profile: IntArray, needed: int
) -> Iterator[str]:
    """Remark on the dives with fewer complete samples than a profile needs."""
    short = dives[(dives > 0) & (profile == 0)]
    numbers = np.unique(short)
    if not len(numbers):
        return
    first = np.flatnonzero(dives == short[0])
    to = f", to {np.nanmax(depth[first]):.0f} m" if np.isfinite(depth[first]).any() else ""
    yield (
        f"{counted(len(numbers), 'dive')} with fewer than {needed} samples of depth, pitch and heading "
        f"{'is' if len(numbers) == 1 else 'are'} left out, the first{to}, at "
        f"{describe_time(time[first[0]])}"
    )
