"""Profiles of a SeaExplorer mission, from the states and depths of its navigation rows."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from gliderhpc.observations.importing.rows import Rows
from gliderhpc.observations.records import FloatArray

DIVING = 100
INFLECTING_DOWN = 110
SURFACING = 115
TRANSMITTING = 116
CLIMBING = 117
INFLECTING_UP = 118

_GLIDING = (DIVING, INFLECTING_DOWN, CLIMBING, INFLECTING_UP)


def is_gliding(state: FloatArray, *, include_surfacing: bool = False) -> npt.NDArray[np.bool_]:
    """Mask of the rows in which the glider is gliding below the surface, or leaving it.

    In the surfacing manoeuvre the battery moves fully forward at about 9 m, the nose drops to -70 degrees and the
    glider rises tail first. The model of the paper does not describe this motion, so it is left out unless requested.
    """
    return np.isin(state, (*_GLIDING, SURFACING) if include_surfacing else _GLIDING)


SUBMERGED = 1.0
"""Depth below the floating level at which the hull is under water (m)."""

MIN_DIVE = 10.0
"""Depth below its beginning that a leg must reach to be a profile (m)."""

MAX_CYCLES = 20_000
"""Maximum number of cycles of a mission; a larger range of cycle numbers is due to a mistyped number."""

RECORD_BREAK = np.timedelta64(900, "s")
"""Longest pause of the record within a leg; a longer one splits the leg in two."""


@dataclass(frozen=True)
class Leg:
    """One stretch of rows below the surface.

    Attributes
    ----------
    number : int
        Number of the profile: the cycle in which it begins to dive.
    cycles : tuple of int
        Cycles of its rows, without those that hold only climbing rows.
    start, stop : int
        Its first row and the row after its last.
    """

    number: int
    cycles: tuple[int, ...]
    start: int
    stop: int


def find_legs(rows: Rows, *, include_surfacing: bool = False) -> tuple[list[Leg], dict[int, str]]:
    """Find the profiles of a mission, and the reasons why the other cycles hold none.

    Parameters
    ----------
    rows : Rows
        Navigation rows in time order, with NavState and Depth.
    include_surfacing : bool
        Treat the surfacing manoeuvre as part of the profile.

    Returns
    -------
    legs : list of Leg
        Profiles in time order.
    without : dict of int to str
        Reasons by number of the cycle in which no profile begins or continues, or only a part of the rows is used.
    """
    legs: list[Leg] = []
    refused: dict[int, str] = {}
    for start, stop in _stretches(rows, is_gliding(rows["NavState"], include_surfacing=include_surfacing)):
        leg = _trim(rows, start, stop)
        dive = _dive(rows["Depth"][leg.start : leg.stop])
        if dive < MIN_DIVE and legs and _is_rest(rows, start, stop, legs[-1]):
            refused[legs[-1].number] = _second_part(rows, start)
        elif dive < MIN_DIVE:
            # A dive of less than a metre is a floating glider with a wrong state, or the end of the previous climb.
            if dive >= SUBMERGED and np.any(rows["NavState"][start:stop] != CLIMBING):
                refused[leg.number] = f"too shallow: dives {dive:.0f} m, but at least {MIN_DIVE:g} m are needed"
        elif legs and legs[-1].number == leg.number:
            refused[leg.number] = _second_part(rows, start)
        else:
            legs.append(leg)
    return legs, _cycles_without(rows, legs, refused)


def _is_rest(rows: Rows, start: int, stop: int, leg: Leg) -> bool:
    """Return whether a stretch is the rest of a leg that a pause of the record broke under water."""
    deepest = float(np.nanmax(rows["Depth"][start:stop]))
    follows = leg.stop == start and rows.part[start] - rows.part[start - 1] <= 1
    return follows and rows.time[start] - rows.time[start - 1] > RECORD_BREAK and deepest > MIN_DIVE


def _second_part(rows: Rows, start: int) -> str:
    """Describe why the stretch that begins at a row does not belong to the profile of the same file."""
    pause = rows.time[start] - rows.time[start - 1]
    if pause <= RECORD_BREAK:
        return "dives twice between surfacings within one file: only the first dive is used"
    minutes, begin = pause / np.timedelta64(60, "s"), rows.time[start - 1].astype("datetime64[s]")
    return (
        f"the record pauses for {minutes:.0f} min after {begin}, or the clock was set forward there: only the part "
        "before it is used"
    )


def _stretches(rows: Rows, gliding: npt.NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Find the runs of gliding rows, broken at missing files and long pauses."""
    broken = (np.diff(rows.part) > 1) | (np.diff(rows.time) > RECORD_BREAK)
    turns = np.flatnonzero(broken | (gliding[1:] != gliding[:-1])) + 1
    edges = [0, *turns.tolist(), len(rows)]
    return [(a, b) for a, b in pairwise(edges) if b > a and gliding[a]]


def _trim(rows: Rows, start: int, stop: int) -> Leg:
    """Cut off the rows at the surface, where the glider still floats."""
    level = _floating_depth(rows, start) + SUBMERGED
    under = np.flatnonzero(rows["Depth"][start:stop] > level)
    if len(under):
        start, stop = start + int(under[0]), start + int(under[-1]) + 1
    # A file may begin with one or two climbing rows of the previous dive, which do not determine the number.
    sinking = np.flatnonzero(rows["NavState"][start:stop] != CLIMBING)
    diving = rows.part[start:stop][sinking] if len(sinking) else rows.part[start:stop]
    cycles = tuple(np.unique(diving).tolist())
    return Leg(int(diving[0]), cycles, start, stop)


def _floating_depth(rows: Rows, start: int) -> float:
    """Depth reading of the sensor in the nose at the surface (m): about 1 m if level and 3 m if tail up."""
    floating = (rows["NavState"] == TRANSMITTING) & np.isfinite(rows["Depth"])
    surface = np.flatnonzero(floating[:start])[-10:]
    if len(surface) == 0:
        surface = np.flatnonzero(floating)
    return float(np.median(rows["Depth"][surface])) if len(surface) else 0.0


def _dive(depth: FloatArray) -> float:
    """Greatest depth of a leg below its beginning (m)."""
    return float(np.nanmax(depth) - depth[0]) if len(depth) else 0.0


def _cycles_without(rows: Rows, legs: list[Leg], refused: dict[int, str]) -> dict[int, str]:
    taken = {cycle for leg in legs for cycle in leg.cycles}
    present = set(np.unique(rows.part).tolist())
    without: dict[int, str] = {}
    first, last = min(present, default=0), max(present, default=-1)
    # A file name with one digit too many would lead to a million missing files.
    for cycle in range(first, last + 1) if last - first < MAX_CYCLES else sorted(present):
        if cycle in refused:
            without[cycle] = refused[cycle]
        elif cycle not in present:
            without[cycle] = "its navigation file is missing"
        elif cycle not in taken:
            without[cycle] = "only a surface record"
    return without
