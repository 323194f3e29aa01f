"""Twin cases: the hull flown and the hull assumed, the scenario, and changes of the record before its inversion."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.flight.coefficients import ADDED, COEFFICIENTS, coefficients_of, with_viscous
from gliderhpc.observations.format import MEASURED, SEAWATER
from gliderhpc.observations.records import ProfileRecord
from gliderhpc.platform import DisturbancePrior, Platform
from gliderhpc.simulator import Scenario
from gliderhpc.simulator.scenario import load_scenario
from gliderhpc.simulator.sections import Disturbances, GaussMarkov

UNCERTAIN_COEFFICIENTS = tuple(name for name in (*COEFFICIENTS, *ADDED) if name != "K_L0")
"""Viscous and added-mass coefficients of the paper, to which its error of 15 % applies; draws follow this order."""

COEFFICIENT_ERROR = 0.15
"""The paper's relative error of the coefficients."""

PRESETS = ("recommended", "paper")
"""Presets of the estimator that the experiments compare."""

OPERATING_LENGTH = 30.0
"""Window length of the paper's operating point, s; its margin is 10 s, and tau_c = 0.2."""

NEGLIGIBLE_LAG = 0.01
"""Negligible lag of the actuators, s."""

QUIET = Disturbances(slow_rms=(0.0, 0.0, 0.0, 0.0, 0.0, 0.0), impulse_interval=None)
"""No disturbance: any identified disturbance is the pipeline's own error."""

_SAMPLED = ("time", *MEASURED, "battery_position", "battery_rotation", "ballast_volume", "rudder")
_FULL_TURN = 2.0 * np.pi
_ROUNDING = 1e-6


@dataclass(frozen=True)
class RecordChanges:
    """Changes of a record, applied in the order of the attributes.

    Attributes
    ----------
    roll_offset, pitch_offset, heading_offset : float
        Constant errors of the attitude, degree.
    sample_interval : float, optional
        Interval of which one sample is retained, s; None to retain all samples.
    dropout : float
        Share of the samples whose attitude and depth are missing, at random.
    gap, gap_spacing : float
        Length and spacing of gaps in attitude and depth, s.
    """

    roll_offset: float = 0.0
    pitch_offset: float = 0.0
    heading_offset: float = 0.0
    sample_interval: float | None = None
    dropout: float = 0.0
    gap: float = 0.0
    gap_spacing: float = 300.0

    def apply(self, record: ProfileRecord, rng: np.random.Generator) -> ProfileRecord:
        """Return the record with these changes; `rng` draws the dropouts."""
        record = _with_offsets(record, self)
        if self.sample_interval is not None:
            record = _subsample(record, self.sample_interval)
        missing = rng.random(len(record.time)) < self.dropout
        if self.gap > 0.0:
            missing |= _in_gaps(record, self.gap, self.gap_spacing)
        return _with_missing(record, missing) if missing.any() else record


@dataclass(frozen=True)
class TwinCase:
    """A twin and its inversion: everything that the result depends on; hashable and picklable.

    Attributes
    ----------
    hull : Platform
        Hull that flies.
    scenario : Scenario
        Dive, water, disturbances and sensors.
    seed, number : int
        Seed of the random numbers and number of the profile, which also selects the course.
    settings : EstimationSettings
        Settings of the inversion.
    assumed : Platform, optional
        Hull that the estimator assumes; the true one by default.
    changes : RecordChanges
        Changes of the record.
    initial_error : tuple of 12 floats, optional
        Error added to the estimator's first guess of the state (eq. 16, SI).
    """

    hull: Platform
    scenario: Scenario
    seed: int
    settings: EstimationSettings
    number: int = 1
    assumed: Platform | None = None
    changes: RecordChanges = field(default_factory=RecordChanges)
    initial_error: tuple[float, ...] | None = None

    @property
    def assumes_true_hull(self) -> bool:
        """Return whether the estimator assumes the coefficients of the simulated hull."""
        assumed = self.assumed or self.hull
        return self.scenario.coefficients.spread == 0.0 and coefficients_of(assumed) == coefficients_of(self.hull)

    @property
    def recorded_hull(self) -> Platform:
        """The hull with a recorder at least as fast as the record asked for, which is then thinned."""
        interval = self.changes.sample_interval
        if interval is None or interval >= self.hull.sensors.sample_interval:
            return self.hull
        return with_sample_interval(self.hull, interval)


def course_of(seed: int) -> int:
    """Return the number of the profile to fly: the two usual courses alternate with the seed."""
    return 1 + seed % 2


def with_factors(platform: Platform, factors: Mapping[str, float]) -> Platform:
    """Return a platform with some coefficients (`UNCERTAIN_COEFFICIENTS`) multiplied by factors."""
    values = {name: value * factors.get(name, 1.0) for name, value in coefficients_of(platform).items()}
    added = tuple(values[name] for name in ADDED)
    hull = with_viscous(platform, {name: values[name] for name in COEFFICIENTS})
    return hull.model_copy(update={"added_mass": added[:3], "added_inertia": added[3:]})


def with_coefficient_errors(platform: Platform, rng: np.random.Generator, share: float = COEFFICIENT_ERROR) -> Platform:
    """Draw every coefficient uniformly within `share` of its value, independently."""
    factors = rng.uniform(1.0 - share, 1.0 + share, len(UNCERTAIN_COEFFICIENTS))
    return with_factors(platform, dict(zip(UNCERTAIN_COEFFICIENTS, factors.tolist(), strict=True)))


def with_sample_interval(platform: Platform, interval: float) -> Platform:
    """Return a platform whose recorder has another sample interval, s."""
    return platform.model_copy(update={"sensors": platform.sensors.model_copy(update={"sample_interval": interval})})


def world(depth: float, *, pitch: float | None = None, disturbances: Disturbances | None = None) -> Scenario:
    """Return one dive to a depth (m); pitch (degree) and disturbances default to the simulator's usual ones."""
    base = Scenario()
    values: dict[str, Any] = {"name": "twin", "profiles": 1, "depth": depth}
    if pitch is not None:
        values["actuation"] = {**base.actuation.model_dump(), "pitch": pitch}
    if disturbances is not None:
        values["disturbances"] = disturbances.model_dump()
    return base.replaced(values)


def paper_dive(depth: float, *, speed: tuple[float, float]) -> Scenario:
    """Return one dive of the scenario ``paper`` to a depth (m), with a uniform current of that range of speeds (m/s).

    The hull is clean. The scenario's net masses apply to its own depths; shallower dives use the hull's usual ones.
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


def drawn_from(prior: DisturbancePrior) -> Disturbances:
    """Return disturbances drawn from the prior that filter and smoother assume, and no others."""
    process = GaussMarkov(deviation=prior.deviation, correlation_time=prior.correlation_time)
    return QUIET.model_copy(update={"gauss_markov": process})


def without_lag(scenario: Scenario) -> Scenario:
    """Return the scenario with actuators at the recorded positions."""
    return _with(scenario, "actuation", lag=NEGLIGIBLE_LAG)


def without_impulses(scenario: Scenario) -> Scenario:
    """Return the scenario without yaw impulses."""
    return _with(scenario, "disturbances", impulse_interval=None)


def with_impulses(scenario: Scenario, amplitude: float, width: float, spacing: float) -> Scenario:
    """Return the scenario with yaw impulses of one amplitude (N m) and width (s), on average `spacing` s apart."""
    return _with(
        scenario,
        "disturbances",
        impulse_interval=spacing,
        impulse_amplitude=(amplitude, amplitude),
        impulse_width=(width, width),
    )


def noiseless(scenario: Scenario) -> Scenario:
    """Return the scenario with perfect sensors."""
    return _with(scenario, "sensors", factor=0.0)


def with_white_errors(scenario: Scenario) -> Scenario:
    """Return the scenario with white attitude errors, as filter and smoother assume, instead of rounding errors."""
    return _with(scenario, "sensors", attitude="white")


def with_water(scenario: Scenario, current: Mapping[str, float], gust_rms: float) -> Scenario:
    """Return the scenario with values of its current replaced, Gaussian gusts of that RMS (m/s), and no faults.

    A Gaussian field is equally rough everywhere, so its spectra need fewer twins than those of an intermittent field.
    """
    scenario = _with(scenario, "current", **current)
    scenario = _with(scenario, "gusts", kind="gaussian", rms=gust_rms)
    return _with(scenario, "sensors", dropouts=0.0, outliers=0.0)


def _with(scenario: Scenario, section: str, **values: Any) -> Scenario:
    return scenario.replaced({section: {**getattr(scenario, section).model_dump(), **values}})


def _with_offsets(record: ProfileRecord, changes: RecordChanges) -> ProfileRecord:
    roll, pitch, heading = np.radians([changes.roll_offset, changes.pitch_offset, changes.heading_offset])
    return replace(
        record,
        roll=record.roll + roll,
        pitch=record.pitch + pitch,
        heading=np.mod(record.heading + heading, _FULL_TURN),
    )


def _subsample(record: ProfileRecord, interval: float) -> ProfileRecord:
    """Select the first sample of every interval: a slower recorder stores instants, not means."""
    _, first = np.unique(np.floor(record.time / interval + _ROUNDING), return_index=True)
    optional = (*SEAWATER, "velocity", "velocity_std")
    names = (*_SAMPLED, *(name for name in optional if getattr(record, name) is not None))
    samples: dict[str, Any] = {name: getattr(record, name)[first] for name in names}
    return replace(record, **samples)


def _in_gaps(record: ProfileRecord, gap: float, spacing: float) -> NDArray[np.bool_]:
    since = np.mod(record.time, spacing)
    # Gaps are centred in their spacing, away from the start and from control intervals.
    return np.asarray(np.abs(since - 0.5 * spacing) < 0.5 * gap, dtype=np.bool_)


def _with_missing(record: ProfileRecord, missing: NDArray[np.bool_]) -> ProfileRecord:
    """Set attitude and depth of the missing samples to NaN; the actuators' log is complete."""
    values: dict[str, Any] = {name: np.where(missing, np.nan, getattr(record, name)) for name in MEASURED}
    return replace(record, **values)
