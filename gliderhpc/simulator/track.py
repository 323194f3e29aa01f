"""Where a profile lies on the Earth: its drift with the current, at the surface and below, and the fixes around it.

A profile owns half of the surface interval on either side of it and drifts with its own surface current all that time,
so that profiles are simulated one by one and only then strung together.
"""

import math
from dataclasses import dataclass

import numpy as np

from gliderhpc.observations.geodesic import Position, moved
from gliderhpc.observations.records import Fix, FloatArray
from gliderhpc.simulator.sections import SensorErrors, Surface


@dataclass(frozen=True)
class SurfaceTimes:
    """Time at the surface that belongs to a profile, before and after its dive, whole seconds."""

    before: int
    after: int


@dataclass(frozen=True)
class Track:
    """One profile on the Earth.

    Attributes
    ----------
    entry, exit : Position
        True position at the first and the last state of the dive.
    end : Position
        True position at the end of its surface time, where the next profile takes over.
    fixes_before, fixes_after : tuple of Fix
        With their errors, in time order.
    """

    entry: Position
    exit: Position
    end: Position
    fixes_before: tuple[Fix, ...]
    fixes_after: tuple[Fix, ...]


def draw_surface_times(settings: Surface, rng: np.random.Generator) -> SurfaceTimes:
    """Draw the time at the surface on both sides of a dive."""
    before, after = rng.uniform(*settings.half_interval, size=2)
    return SurfaceTimes(math.ceil(before), math.ceil(after))


def lay_track(
    start: Position,
    epoch: np.datetime64,
    duration: float,
    displacement: FloatArray,
    currents: tuple[FloatArray, FloatArray],
    times: SurfaceTimes,
    settings: Surface,
    errors: SensorErrors,
    rng: np.random.Generator,
) -> Track:
    """Lay a profile onto the Earth.

    Parameters
    ----------
    start : Position
        Where its time at the surface begins.
    epoch : numpy.datetime64
        Time of its first sample.
    duration : float
        Of the dive, s.
    displacement : (2,) array
        North and east, over the ground from the first state of the dive to the last, m.
    currents : two (2,) arrays
        North and east, at the surface before and after the dive, m/s.
    times : SurfaceTimes
        Time at the surface before and after.
    settings, errors : Surface, SensorErrors
        When fixes are taken, and how good they are.
    rng : numpy.random.Generator
        Of the fixes' errors.
    """
    before, after = currents
    entry = moved(start, times.before * before)
    leave = moved(entry, displacement)
    delays = settings.fix_delay + settings.fix_spacing * np.arange(settings.fixes)

    def fix(origin: Position, drift: FloatArray, time: float) -> Fix:
        position = moved(moved(origin, drift), errors.fix_deviation * rng.standard_normal(2))
        return Fix(later(epoch, time), *position)

    return Track(
        entry=entry,
        exit=leave,
        end=moved(leave, times.after * after),
        fixes_before=tuple(fix(entry, -delay * before, -delay) for delay in delays[::-1].tolist()),
        fixes_after=tuple(fix(leave, delay * after, duration + delay) for delay in delays.tolist()),
    )


def later(time: np.datetime64, seconds: float) -> np.datetime64:
    """Add seconds to a time, to the nanosecond."""
    return time + np.timedelta64(round(seconds * 1e9), "ns")
