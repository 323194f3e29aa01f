"""A glider flown open loop by recorded actuation: what its sensors would have shown under other disturbances.

The scheme is the simulator's: half the estimator's step, and stages of its own (`gliderhpc.kernels.current`).
"""

from dataclasses import dataclass, replace

import numpy as np

from gliderhpc.errors import ProfileError
from gliderhpc.flight.glider import Glider
from gliderhpc.kernels import current
from gliderhpc.observations.records import FloatArray, ProfileRecord
from gliderhpc.platform import Platform
from gliderhpc.simulator.dive import DEPTH, Flight
from gliderhpc.simulator.sections import Integration, SensorErrors
from gliderhpc.simulator.sensors import observe
from gliderhpc.simulator.water import still_water

OUT_OF_THE_WATER = 0.5
"""The glider is at the surface once it is this far (m) above it, and above where it began."""


@dataclass(frozen=True, eq=False)
class Actuation:
    """Actuation of a glider, as recorded.

    Attributes
    ----------
    number : int
        Of the profile.
    epoch : numpy.datetime64
        Time of the first record.
    interval : float
        Between records, s.
    state : (12,) array
        At the first record (eq. 16, SI).
    commands : (m, 4) array
        Battery position (m), battery rotation (rad), ballast volume (m3), rudder (rad) on the records.
    sampled : (m,) array of bool
        Records at which the sensors were read.
    """

    number: int
    epoch: np.datetime64
    interval: float
    state: FloatArray
    commands: FloatArray
    sampled: np.ndarray[tuple[int], np.dtype[np.bool_]]

    @property
    def steps(self) -> int:
        """Steps of the simulator in one interval: at most as long as it would take by itself."""
        return max(1, round(self.interval / Integration().step))

    @property
    def times(self) -> FloatArray:
        """Midpoints ``(n,)`` of the simulator's steps, s from the first record."""
        step = self.interval / self.steps
        return (np.arange((len(self.commands) - 1) * self.steps, dtype=np.float64) + 0.5) * step

    def at(self, times: FloatArray) -> FloatArray:
        """Commands ``(k, 4)`` at times (s), linear between records."""
        records = self.interval * np.arange(len(self.commands))
        return np.column_stack([np.interp(times, records, column) for column in self.commands.T])


def replay(hull: Platform, actuation: Actuation, bodies: FloatArray, disturbances: FloatArray) -> Flight:
    """Fly a hull in still water.

    Parameters
    ----------
    hull : Platform
        Whose coefficients are true.
    actuation : Actuation
        How it is flown.
    bodies : (n, 11) array
        Mass properties at `Actuation.times`, of the hull that is known.
    disturbances : (n, 6) array
        Over the simulator's steps, N and N m.

    Raises
    ------
    ProfileError
        The flight leaves the model's domain.
    """
    glider, step, water = Glider(hull), actuation.interval / actuation.steps, still_water()
    states, carried = np.empty((len(bodies) + 1, 12)), np.empty((len(bodies) + 1, 3))
    acting = np.empty((len(bodies), 6))
    current.simulate(
        glider.hull, water.field(hull.mass.total), bodies, water.current.table, water.gusts, actuation.state,
        np.zeros(3), 0.0, disturbances, step, states, carried, acting,
    )  # fmt: skip
    intervals = _intervals_in_the_water(states[:, DEPTH], actuation)
    n = intervals * actuation.steps
    if not np.isfinite(states[: n + 1]).all():
        raise ProfileError(f"profile {actuation.number}: the flight under recorded actuation leaves the model's domain")
    return Flight(
        step,
        actuation.interval,
        states[: n + 1],
        actuation.at(actuation.times[:n])[:, :3],
        actuation.commands[: intervals + 1, :3],
        carried[: n + 1],
        acting[:n],
    )


def record_of(flight: Flight, actuation: Actuation, platform: Platform, rng: np.random.Generator) -> ProfileRecord:
    """Record a flight by the hull's sensor model, at the records at which the sensors were read."""
    sensors = platform.sensors.model_copy(update={"sample_interval": actuation.interval})
    record = observe(flight, sensors, SensorErrors(), rng, number=actuation.number, epoch=actuation.epoch)
    sampled = actuation.sampled[: len(record.time)]
    rudder = actuation.commands[: len(record.time), 3]
    names = ("time", "roll", "pitch", "heading", "depth", "battery_position", "battery_rotation", "ballast_volume")
    return replace(record, **{name: getattr(record, name)[sampled] for name in names}, rudder=rudder[sampled])


def _intervals_in_the_water(depth: FloatArray, actuation: Actuation) -> int:
    """Whole intervals before the glider comes out of the water."""
    out = np.flatnonzero(depth < min(0.0, float(depth[0])) - OUT_OF_THE_WATER)
    steps = int(out[0]) if len(out) else len(depth) - 1
    return steps // actuation.steps
