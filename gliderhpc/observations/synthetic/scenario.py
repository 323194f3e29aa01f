"""What a synthetic mission consists of: every number of the simulator, validated once, stored with its truth."""

import datetime
from collections.abc import Mapping
from typing import Annotated, Any, Self, TypeAlias

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, NaiveDatetime, ValidationError, model_validator

from gliderhpc.errors import InputError


def _ordered(limits: tuple[float, float]) -> tuple[float, float]:
    if limits[0] > limits[1]:
        raise ValueError(f"the lower limit {limits[0]:g} lies above the upper limit {limits[1]:g}")
    return limits


NonNegative: TypeAlias = Annotated[float, Field(ge=0)]
Range: TypeAlias = Annotated[tuple[NonNegative, NonNegative], AfterValidator(_ordered)]
PositiveRange: TypeAlias = Annotated[tuple[Annotated[float, Field(gt=0)], float], AfterValidator(_ordered)]
Latitude: TypeAlias = Annotated[float, Field(ge=-85, le=85)]
Longitude: TypeAlias = Annotated[float, Field(ge=-180, le=180)]
Six: TypeAlias = tuple[NonNegative, NonNegative, NonNegative, NonNegative, NonNegative, NonNegative]


class _Section(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Actuation(_Section):
    """How the glider is flown.

    Unset net masses follow the hull: 0.35 % of its mass at half the depth, and at least 0.25 % where the hull's gain in
    buoyancy with depth (model.md 3) leaves least of it.
    """

    pitch: float = Field(23.0, gt=0, lt=80, description="magnitude of the pitch, nose down and nose up, degree")
    dive_net_mass: float | None = Field(None, gt=0, description="net mass at the surface on the dive, kg")
    climb_net_mass: float | None = Field(None, lt=0, description="net mass at the surface on the climb, kg")
    inflection_duration: float = Field(
        20.0, gt=0, description="time battery and ballast take from dive to climb, s; fast for a pump at depth"
    )
    rotation_rate: float = Field(
        2.0, gt=0, description="rate of the battery's rotation, degree/s; times the lag, what the records get wrong"
    )
    lag: float = Field(0.7, gt=0, description="time constant at which all actuators follow the recorded commands, s")


class Steering(_Section):
    """The heading controller: single turns towards the course, the battery upright in between."""

    courses: tuple[float, ...] = Field(
        (75.0, 345.0), min_length=1, description="headings steered, one a profile in turn, degree"
    )
    dead_band: float = Field(12.0, gt=0, lt=180, description="heading error that is left alone, degree")
    rotation: float = Field(20.0, ge=0, le=90, description="battery rotation of a turn, degree; 0 does not steer")
    interval: float = Field(600.0, gt=0, description="time between decisions, s")
    longest_turn: float = Field(60.0, gt=0, description="longest time the battery is kept rotated, s")
    initial_error: float = Field(30.0, ge=0, le=180, description="largest heading error at the start of a dive, degree")


class Disturbances(_Section):
    """The true disturbance: sums of slow sinusoids in each channel, and impulses of the yaw moment."""

    slow_rms: Six = Field(
        (0.15, 0.0, 0.2, 0.0, 0.035, 0.0), description="root mean square of the slow part, six channels, N and N m"
    )
    slow_periods: PositiveRange = Field((600.0, 2400.0), description="periods of the sinusoids, s")
    slow_terms: int = Field(3, ge=1, description="sinusoids a channel")
    impulse_interval: float | None = Field(
        90.0, gt=0, description="mean time between yaw impulses (a Poisson process), s; null for none"
    )
    impulse_amplitude: Range = Field((0.6, 3.0), description="peak of an impulse, either sign, N m")
    impulse_width: PositiveRange = Field(
        (1.2, 2.5), description="width of an impulse, s: the standard deviation of its Gaussian shape"
    )


class Current(_Section):
    """The horizontal current: uniform and steady within a profile, another one in the next."""

    speed: Range = Field((0.05, 0.4), description="speed, m/s; its direction is uniform")


class SensorErrors(_Section):
    """What stands between the truth and the records."""

    factor: float = Field(
        1.0, ge=0, description="times the platform's attitude quantum and depth noise; 0 for perfect sensors"
    )
    fix_deviation: float = Field(5.0, ge=0, description="standard deviation of a GPS fix, north and east each, m")


class Surface(_Section):
    """What happens between the dives; a mission begins and ends with half a surface interval."""

    half_interval: PositiveRange = Field((180.0, 420.0), description="time at the surface before and after a dive, s")
    fixes: int = Field(2, ge=1, description="GPS fixes before, and as many after, each dive")
    fix_delay: float = Field(30.0, ge=0, description="time between a dive and the fix nearest to it, s")
    fix_spacing: float = Field(60.0, gt=0, description="time between fixes, s")

    @model_validator(mode="after")
    def _fixes_fit(self) -> Self:
        needed = self.fix_delay + (self.fixes - 1) * self.fix_spacing
        if needed >= self.half_interval[0]:
            raise ValueError(
                f"{self.fixes} fixes take {needed:g} s; half_interval must be longer, not {self.half_interval[0]:g} s"
            )
        return self


class Integration(_Section):
    """Time steps of the simulation; half the estimator's, so that its discretisation is not assumed true."""

    step: float = Field(0.05, gt=0, le=0.25, description="Runge-Kutta step, s")
    truth_step: float = Field(0.1, gt=0, description="interval over which the true disturbance is averaged, s")
    control_interval: float = Field(1.0, gt=0, description="interval of the glider's own control loop, s")

    @model_validator(mode="after")
    def _whole_steps(self) -> Self:
        for longer, shorter in (("truth_step", "step"), ("control_interval", "truth_step")):
            ratio = getattr(self, longer) / getattr(self, shorter)
            if round(ratio) < 1 or abs(ratio - round(ratio)) > 1e-9:
                raise ValueError(f"{longer} must be a multiple of {shorter}")
        return self

    @property
    def steps_per_truth(self) -> int:
        """Integration steps in one interval of the stored truth."""
        return round(self.truth_step / self.step)

    @property
    def steps_per_control(self) -> int:
        """Integration steps in one interval of the control loop."""
        return round(self.control_interval / self.step)


class Scenario(_Section):
    """A synthetic mission, but for its hull and its seed."""

    name: str = Field("drift-and-impulses", min_length=1, description="name of the scenario")
    profiles: int = Field(4, ge=1, description="number of profiles")
    depth: float = Field(200.0, ge=15, le=11_000, description="depth at which a dive is turned into a climb, m")
    start_depth: float = Field(1.0, ge=0, le=5, description="depth at which the records of a profile begin and end, m")
    start: NaiveDatetime = Field(datetime.datetime(2024, 1, 1), description="start of the mission, UTC")
    origin: tuple[Latitude, Longitude] = Field((18.0, 115.0), description="latitude and longitude of the start, degree")
    actuation: Actuation = Actuation()
    steering: Steering = Steering()
    disturbances: Disturbances = Disturbances()
    current: Current = Current()
    sensors: SensorErrors = SensorErrors()
    surface: Surface = Surface()
    integration: Integration = Integration()

    def replaced(self, values: Mapping[str, Any]) -> "Scenario":
        """Give the scenario with some top-level values replaced, validated anew.

        Parameters
        ----------
        values : mapping
            By name; None leaves a value as it is.

        Raises
        ------
        InputError
            A name that a scenario does not have, or a value out of range.
        """
        given = {name: value for name, value in values.items() if value is not None}
        return read_scenario({**self.model_dump(), **given})


def read_scenario(content: Mapping[str, Any]) -> Scenario:
    """Validate a scenario given as plain values.

    Raises
    ------
    InputError
        Naming the first key that is unknown or out of range.
    """
    try:
        return Scenario.model_validate(content)
    except ValidationError as error:
        fault = error.errors(include_url=False)[0]
        key = ".".join(str(part) for part in fault["loc"]) or "the whole"
        raise InputError(f"scenario: {key} is {fault['input']!r}: {fault['msg'].lower()}") from None
