"""Open-loop flight with recorded actuation, which gives the sensor records under other disturbances.

The numerical scheme is that of the simulator: half the estimator's step, and its own stages
(`gliderhpc.kernels.current`).
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
"""Height (m) above the surface, and above the depth of the start, at which the glider has left the water."""


@dataclass(frozen=True, eq=False)
class RecordedActuation:
    """Recorded actuation of a glider.

    Attributes
    ----------
    number : int
        Number of the profile.
    epoch : numpy.datetime64
        Time of the first record.
    interval : float
        Interval between records, s.
    state : (12,) array
        State at the first record (eq. 16, SI).
    commands : (m, 4) array
        Battery position (m), battery rotation (rad), ballast volume (m3) and rudder (rad) on the records.
    sampled : (m,) array of bool
        Mask of the records at which the sensors were read.
    """

    number: int
    epoch: np.datetime64
    interval: float
    state: FloatArray
    commands: FloatArray
    sampled: np.ndarray[tuple[int], np.dtype[np.bool_]]

    @property
    def steps(self) -> int:
        """Number of simulator steps in one interval, each about as long as the simulator's own step."""
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


def replay(hull: Platform, actuation: RecordedActuation, bodies: FloatArray, disturbances: FloatArray) -> Flight:
    """Fly a hull in still water.

    Parameters
    ----------
    hull : Platform
        Hull with the true coefficients.
    actuation : Actuation
        Recorded actuation.
    bodies : (n, 11) array
        Mass properties of the nominal hull at `RecordedActuation.times`.
    disturbances : (n, 6) array
        Disturbances over the simulator's steps, N and N m.

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


def record_of(
    flight: Flight, actuation: RecordedActuation, platform: Platform, rng: np.random.Generator
) -> ProfileRecord:
    """Record a flight with the hull's sensor model, on the records at which the sensors were read."""
    sensors = platform.sensors.model_copy(update={"sample_interval": actuation.interval})
    record = observe(flight, sensors, SensorErrors(), rng, number=actuation.number, epoch=actuation.epoch)
    sampled = actuation.sampled[: len(record.time)]
    rudder = actuation.commands[: len(record.time), 3]
    names = ("time", "roll", "pitch", "heading", "depth", "battery_position", "battery_rotation", "ballast_volume")
    return replace(record, **{name: getattr(record, name)[sampled] for name in names}, rudder=rudder[sampled])


def _intervals_in_the_water(depth: FloatArray, actuation: RecordedActuation) -> int:
    """Number of whole intervals before the glider leaves the water."""
    out = np.flatnonzero(depth < min(0.0, float(depth[0])) - OUT_OF_THE_WATER)
    steps = int(out[0]) if len(out) else len(depth) - 1
    return steps // actuation.steps
