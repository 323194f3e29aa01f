"""Sections of a scenario: all numbers of the simulator, which are validated once and stored with the truth."""

from typing import Annotated, Literal, Self, TypeAlias

from pydantic import AfterValidator, Field, model_validator

from gliderhpc.yaml_text import UserValues

LARGEST_VALUE = 1e9
"""Largest number in a scenario, in any unit; a larger one is a typing error."""


def _ordered(limits: tuple[float, float]) -> tuple[float, float]:
    if limits[0] > limits[1]:
        raise ValueError(f"the lower limit {limits[0]:g} exceeds the upper limit {limits[1]:g}; exchange them")
    return limits


NonNegative: TypeAlias = Annotated[float, Field(ge=0)]
Range: TypeAlias = Annotated[tuple[NonNegative, NonNegative], AfterValidator(_ordered)]
PositiveRange: TypeAlias = Annotated[tuple[Annotated[float, Field(gt=0)], float], AfterValidator(_ordered)]
Latitude: TypeAlias = Annotated[float, Field(ge=-85, le=85)]
Longitude: TypeAlias = Annotated[float, Field(ge=-180, le=180)]
Six: TypeAlias = tuple[NonNegative, NonNegative, NonNegative, NonNegative, NonNegative, NonNegative]
Positive: TypeAlias = Annotated[float, Field(gt=0)]
SixPositive: TypeAlias = tuple[Positive, Positive, Positive, Positive, Positive, Positive]


class ScenarioSection(UserValues):
    """Base of a scenario and its sections."""

    max_number = LARGEST_VALUE
    max_number_rule = "no value in a scenario may exceed 1e9"


class Actuation(ScenarioSection):
    """Actuation of the glider.

    Unset net masses are derived from the hull: 0.35 % of its mass at half the depth, and at least 0.25 % at any depth,
    given the hull's gain in buoyancy with depth (docs/theory/model.md).
    """

    pitch: float = Field(23.0, gt=0, lt=80, description="magnitude of the pitch, nose down and nose up, degree")
    dive_net_mass: float | None = Field(None, gt=0, description="net mass at the surface on the dive, kg")
    climb_net_mass: float | None = Field(None, lt=0, description="net mass at the surface on the climb, kg")
    inflection_duration: float = Field(
        20.0,
        gt=0,
        description="time that battery and ballast take from dive to climb, s; 20 is short for a pump at depth",
    )
    rotation_rate: float = Field(
        2.0, gt=0, description="rate of the battery's rotation, degree/s; times the lag, the error of its record"
    )
    lag: float = Field(0.7, gt=0, description="time constant at which all actuators follow the recorded commands, s")


class Steering(ScenarioSection):
    """Heading controller: single turns towards the course, with the battery upright in between.

    The course is the bearing to the next waypoint, or one of `courses` if there are no waypoints.
    """

    courses: tuple[float, ...] = Field(
        (75.0, 345.0), min_length=1, description="headings steered, one per profile in turn, degree"
    )
    waypoints: tuple[tuple[Latitude, Longitude], ...] = Field(
        (), description="latitude and longitude of the waypoints, steered to in turn and repeatedly, degree"
    )
    reach: float = Field(3000.0, gt=0, description="distance at which a waypoint counts as reached, m")
    dead_band: float = Field(12.0, gt=0, lt=180, description="heading error that is not corrected, degree")
    rotation: float = Field(20.0, ge=0, le=90, description="battery rotation of a turn, degree; 0 does not steer")
    interval: float = Field(600.0, gt=0, description="time between decisions, s")
    longest_turn: float = Field(60.0, gt=0, description="longest time that the battery stays rotated, s")
    initial_error: float = Field(30.0, ge=0, le=180, description="largest heading error at the start of a dive, degree")


class GaussMarkov(ScenarioSection):
    """First-order Gauss-Markov processes, one per channel and stationary, as assumed by filter and smoother."""

    deviation: Six = Field(description="stationary standard deviation, six channels, N and N m")
    correlation_time: SixPositive = Field(description="correlation time, six channels, s")


class Disturbances(ScenarioSection):
    """True disturbance: slow sinusoids and random processes in each channel, and impulses of the yaw moment."""

    slow_rms: Six = Field(
        (0.15, 0.0, 0.2, 0.0, 0.035, 0.0), description="root mean square of the slow part, six channels, N and N m"
    )
    slow_periods: PositiveRange = Field((600.0, 2400.0), description="periods of the sinusoids, s")
    slow_terms: int = Field(3, ge=1, le=1000, description="number of sinusoids per channel")
    impulse_interval: float | None = Field(
        90.0, ge=1, description="mean time between yaw impulses (a Poisson process), s; null for none"
    )
    impulse_amplitude: Range = Field((0.6, 3.0), description="peak of an impulse, either sign, N m")
    impulse_width: PositiveRange = Field(
        (1.2, 2.5), description="width of an impulse, s: the standard deviation of its Gaussian shape"
    )
    gauss_markov: GaussMarkov | None = Field(
        None, description="deviation and correlation time of random processes, six channels each; null for none"
    )


class Current(ScenarioSection):
    """Horizontal current: shear, and a uniform part that is steady within a profile and changes between profiles."""

    speed: Range = Field((0.05, 0.4), description="speed of the uniform part, m/s; its direction is uniform")
    surface_rms: NonNegative = Field(
        0.0, description="rms at the surface, north and east each, of a layer that decays exponentially, m/s"
    )
    surface_scale: float = Field(60.0, gt=0, description="depth over which that layer decays, m")
    mode_rms: NonNegative = Field(
        0.0, description="rms, north and east each, of the first of the vertical modes cos(k pi Z / mode_depth), m/s"
    )
    modes: int = Field(
        3, ge=1, le=1000, description="number of modes; the k-th has the amplitude of the first divided by k"
    )
    mode_depth: float = Field(1000.0, gt=0, description="depth of the modes' lower end, m")
    fine_rms: NonNegative = Field(
        0.0,
        description="rms, north and east each, of a smooth random current profile, a new one for every profile, m/s",
    )
    fine_scale: float = Field(40.0, ge=0.5, description="vertical scale of the smooth random profile, m")
    evolution: float = Field(
        20.0,
        gt=0,
        description="profiles over which layer and modes, which change slowly in time, lose their correlation",
    )


class VerticalCurrent(ScenarioSection):
    """Vertical motion of the water, the same at all depths: sinusoids in time, like internal waves along the path.

    It varies only in time. It carries the glider and does not change its motion relative to the water.
    """

    rms: NonNegative = Field(0.0, description="root mean square of the vertical velocity, m/s")
    periods: PositiveRange = Field((600.0, 2400.0), description="periods of the sinusoids, s")
    terms: int = Field(3, ge=1, le=1000, description="number of sinusoids")


class Gusts(ScenarioSection):
    """Lateral gusts: a frozen random velocity across the course, as a function of path length (docs/theory/model.md).

    ``cascade`` is a She-Leveque log-Poisson cascade, ``gaussian`` a Gaussian field with the same spectrum. Within an
    octave or two of the smallest scale, the increments of a cascade are slightly less intermittent than in theory,
    because finer scales are absent.
    """

    kind: Literal["none", "cascade", "gaussian"] = Field("none", description="none, cascade or gaussian")
    rms: NonNegative = Field(0.02, description="root mean square, m/s")
    outer: float = Field(128.0, gt=0, description="largest scale, m")
    inner: float = Field(0.5, ge=0.01, description="smallest scale, m")
    slope: float | None = Field(
        None,
        gt=1,
        lt=3,
        description="slope of the spectrum; null for that of the cascade, 5/3 plus 0.03 for intermittency",
    )

    @model_validator(mode="after")
    def _scales_ordered(self) -> Self:
        if self.outer < 4.0 * self.inner:
            raise ValueError(
                f"outer must be at least four times inner, not {self.outer:g} m with an inner of {self.inner:g} m"
            )
        return self


class Ocean(ScenarioSection):
    """Stratified ocean, and the CTD that measures it; the hull's compressibility then replaces its depth slope.

    Temperature and salinity change from their surface values to their deep values as a logistic function of depth.
    """

    surface_temperature: float = Field(18.0, ge=-2, le=35, description="in situ, at the surface, degC")
    deep_temperature: float = Field(6.0, ge=-2, le=35, description="in situ, far below the thermocline, degC")
    surface_salinity: float = Field(35.0, ge=2, le=42, description="practical salinity at the surface")
    deep_salinity: float = Field(35.2, ge=2, le=42, description="practical salinity far below the thermocline")
    thermocline: float = Field(80.0, gt=0, description="depth of the thermocline's middle, m")
    thickness: float = Field(15.0, gt=0, description="scale of the thermocline, m")
    temperature_noise: NonNegative = Field(0.002, description="standard deviation of the CTD's temperature, degC")
    salinity_noise: NonNegative = Field(0.003, description="standard deviation of the CTD's practical salinity")
    pressure_noise: NonNegative = Field(0.05, description="standard deviation of the CTD's pressure, dbar")
    spikes: NonNegative = Field(0.0, description="false samples of the salinity per hour")
    spike_size: NonNegative = Field(1.0, description="rms error of a false sample, practical salinity")


class Coefficients(ScenarioSection):
    """Errors of the platform file: every viscous and added-mass coefficient of the true hull has a random error."""

    spread: float = Field(0.0, ge=0, lt=1, description="largest relative error, uniform and independent; 0.15 is usual")


class Fouling(ScenarioSection):
    """Growth on the hull: coefficients that drift over the mission, and a loss of buoyancy.

    Fouling acts differently on dive and climb (positive and negative angle of attack): the changes on the climb are
    `climb_share` times those on the dive.
    """

    profiles: int = Field(565, ge=1, description="number of profiles over which the changes develop")
    exponent: float = Field(
        1.0, gt=0, description="the changes grow as this power of the fraction of these profiles flown"
    )
    drag: float = Field(0.0, gt=-1, description="relative change of K_D0 on the dive")
    lift: float = Field(0.0, gt=-1, description="relative change of K_L on the dive")
    moment: float = Field(0.0, gt=-1, description="relative change of K_M on the dive")
    climb_share: float = Field(1.0, ge=0, le=1, description="ratio of the changes on the climb to those on the dive")
    net_mass: float = Field(0.0, description="gain in net mass, not in any record, kg")


class Episode(ScenarioSection):
    """Additional drag that appears suddenly, decays linearly and ends suddenly; dive and climb are separate."""

    first: int = Field(0, ge=0, description="first profile of the episode; 0 for none")
    last: int = Field(0, ge=0, description="last profile of the episode")
    dive_drag: float = Field(0.0, gt=-1, description="relative change of K_D0 on the dive of the first profile")
    climb_drag: float = Field(0.0, gt=-1, description="relative change of K_D0 on the climb of the first profile")
    remaining: float = Field(1.0, ge=0, le=1, description="fraction of the change that remains on the last profile")

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        if self.last < self.first:
            raise ValueError(f"the last profile of an episode, {self.last}, comes before its first, {self.first}")
        return self

    def part(self, number: int) -> float:
        """Fraction of the change on a profile, 0 outside the episode."""
        if not self.first or not self.first <= number <= self.last:
            return 0.0
        return 1.0 - (1.0 - self.remaining) * (number - self.first) / max(self.last - self.first, 1)


class SensorErrors(ScenarioSection):
    """Errors between the truth and the records."""

    factor: float = Field(
        1.0, ge=0, description="factor on the platform's attitude quantum and depth noise; 0 for perfect sensors"
    )
    attitude: Literal["rounded", "white"] = Field(
        "rounded", description="rounded to the resolution, or with white Gaussian noise of the same variance"
    )
    fix_deviation: float = Field(5.0, ge=0, description="standard deviation of a GPS fix, north and east each, m")
    roll_offset: float = Field(0.0, ge=-30, le=30, description="constant error of the roll, degree")
    pitch_offset: float = Field(0.0, ge=-30, le=30, description="constant error of the pitch, degree")
    heading_offset: float = Field(0.0, ge=-180, le=180, description="constant error of the heading, degree")
    dropouts: NonNegative = Field(0.0, description="gaps per hour, equally often in the attitude and in the depth")
    dropout_length: float = Field(20.0, gt=0, description="mean length of a gap, s")
    outliers: NonNegative = Field(0.0, description="false samples per hour, each in one of the four channels")
    outlier_angle: float = Field(10.0, ge=0, le=30, description="rms error of a false angle, degree")
    outlier_depth: float = Field(5.0, ge=0, le=50, description="rms error of a false depth, m")
    velocity_deviation: Positive | None = Field(
        None, description="standard deviation of a measured velocity relative to the water, m/s; null: not measured"
    )
    velocity_offset: tuple[float, float, float] = Field(
        (0.0, 0.0, 0.0), description="constant error of that velocity, forward, starboard and downward, m/s"
    )

    @model_validator(mode="after")
    def _offset_has_a_velocity(self) -> Self:
        if any(self.velocity_offset) and self.velocity_deviation is None:
            raise ValueError("velocity_offset needs a velocity_deviation: without it no velocity is measured")
        return self


class Surface(ScenarioSection):
    """Intervals at the surface; a mission begins and ends with half of one."""

    half_interval: PositiveRange = Field((180.0, 420.0), description="time at the surface before and after a dive, s")
    fixes: int = Field(2, ge=1, le=1000, description="GPS fixes before, and as many after, each dive")
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


class Integration(ScenarioSection):
    """Time steps of the simulation: half the estimator's, so the truth does not share its discretisation."""

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
