"""The twins' worlds: the simulator's usual scenario and what the studies change about it."""

from typing import Any

from gliderhpc.observations.synthetic import Scenario
from gliderhpc.observations.synthetic.sections import Disturbances, GaussMarkov
from gliderhpc.platform import DisturbancePrior

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
