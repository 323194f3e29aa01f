"""The twins' worlds: the simulator's usual scenario and what the studies change about it."""

from collections.abc import Mapping
from typing import Any

from gliderhpc.platform import DisturbancePrior
from gliderhpc.simulator import Scenario
from gliderhpc.simulator.scenario import load_scenario
from gliderhpc.simulator.sections import Disturbances, GaussMarkov

LEAST_LAG = 0.01
"""As good as none, s."""

QUIET = Disturbances(slow_rms=(0.0, 0.0, 0.0, 0.0, 0.0, 0.0), impulse_interval=None)
"""No disturbance at all: what comes back is the pipeline's own."""


def world(depth: float, *, pitch: float | None = None, disturbances: Disturbances | None = None) -> Scenario:
    """Give one dive to a depth (m), its pitch (degree) and disturbances the usual ones where not given."""
    base = Scenario()
    values: dict[str, Any] = {"name": "twin", "profiles": 1, "depth": depth}
    if pitch is not None:
        values["actuation"] = {**base.actuation.model_dump(), "pitch": pitch}
    if disturbances is not None:
        values["disturbances"] = disturbances.model_dump()
    return base.replaced(values)


def paper_dive(depth: float, *, speed: tuple[float, float]) -> Scenario:
    """Give one dive of the scenario ``paper`` to a depth (m), with a uniform current of that range of speeds (m/s).

    The hull is clean. The scenario's net masses are those for its own depths; shallower dives take the hull's usual.
    """
    base = load_scenario("paper")
    shallow = depth < base.depth - base.depth_spread
    usual = {"pitch": base.actuation.pitch}
    return base.replaced(
        {
            "name": "paper dive",
            "profiles": 1,
            "depth": depth,
            "depth_spread": 0.0,
            "actuation": usual if shallow else base.actuation.model_dump(),
            "current": {**base.current.model_dump(), "speed": speed},
            "fouling": {},
        }
    )


def without_lag(scenario: Scenario) -> Scenario:
    """Give the same world with actuators that are where the records say."""
    return scenario.replaced({"actuation": {**scenario.actuation.model_dump(), "lag": LEAST_LAG}})


def with_water(scenario: Scenario, current: Mapping[str, float], gust_rms: float) -> Scenario:
    """Give the same world with values of its current replaced, Gaussian gusts of that strength (m/s), and no faults.

    A Gaussian field is rough everywhere alike, so that spectra need fewer twins than of an intermittent one.
    """
    return scenario.replaced(
        {
            "current": {**scenario.current.model_dump(), **current},
            "gusts": {**scenario.gusts.model_dump(), "kind": "gaussian", "rms": gust_rms},
            "sensors": {**scenario.sensors.model_dump(), "dropouts": 0.0, "outliers": 0.0},
        }
    )


def drawn_from(prior: DisturbancePrior) -> Disturbances:
    """Give disturbances that are what filter and smoother assume: drawn from their own prior, and nothing else."""
    process = GaussMarkov(deviation=prior.deviation, correlation_time=prior.correlation_time)
    return QUIET.model_copy(update={"gauss_markov": process})


def without_impulses(scenario: Scenario) -> Scenario:
    """Give the same world with no yaw impulses."""
    return scenario.replaced({"disturbances": {**scenario.disturbances.model_dump(), "impulse_interval": None}})


def with_white_errors(scenario: Scenario) -> Scenario:
    """Give the same world with white errors of the attitude, as filter and smoother assume, not those of rounding."""
    return scenario.replaced({"sensors": {**scenario.sensors.model_dump(), "attitude": "white"}})


def noiseless(scenario: Scenario) -> Scenario:
    """Give the same world with perfect sensors."""
    return scenario.replaced({"sensors": {**scenario.sensors.model_dump(), "factor": 0.0}})


def with_impulses(scenario: Scenario, amplitude: float, width: float, spacing: float) -> Scenario:
    """Give the same world with yaw impulses of one amplitude (N m) and width (s), `spacing` s apart on average."""
    changed = {
        "impulse_interval": spacing,
        "impulse_amplitude": (amplitude, amplitude),
        "impulse_width": (width, width),
    }
    return scenario.replaced({"disturbances": {**scenario.disturbances.model_dump(), **changed}})


def course_of(seed: int) -> int:
    """Give the number of the profile that is flown: both of the usual courses in turn."""
    return 1 + seed % 2
