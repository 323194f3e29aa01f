"""All numbers of the estimation that a user may change: frozen, validated once, stored with the archive."""

from typing import Literal, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from gliderhpc.estimation.priors import is_slow_and_untuned
from gliderhpc.observations.intervals import longest_bridged
from gliderhpc.platform import Platform
from gliderhpc.platform_sections import SixPositive
from gliderhpc.yaml_text import UserValues

SLOW_SENSORS = 5.0
"""Sample interval (s) beyond which the window length is a number of samples (docs/theory/estimate.md)."""

USUAL_WINDOW = 30.0
"""Window length of fast sensors (s), and the shortest length to which a window of slow ones is halved."""

MAX_SETTING = 1e12
"""Largest value of a setting in any unit; a larger one is a typing error."""


Channel: TypeAlias = Literal["B_cu", "B_cv", "B_cw", "B_cp", "B_cq", "B_cr"]


class Settings(UserValues):
    """Base of every settings object."""

    max_number = MAX_SETTING
    max_number_rule = f"no setting may exceed {MAX_SETTING:g}"


class WindowSettings(Settings):
    """Settings of windows and their handover (eq. 38). Unset lengths depend on the sensors, see `window_length`."""

    length: float | None = Field(
        None, gt=0, description="T_seg, s; default 30, or six sample intervals of slow sensors"
    )
    margin: float | None = Field(None, ge=0, description="retraction, s; default a third of the length")
    cost_threshold: float = Field(0.2, gt=0, description="tau_c at a 30 s window, rad2 s; scaled with the window")

    @model_validator(mode="after")
    def _margin_inside(self) -> Self:
        if self.length is not None and self.margin is not None and self.margin >= self.length:
            raise ValueError(f"the margin ({self.margin} s) must be shorter than the window ({self.length} s)")
        return self


class OptimizerSettings(Settings):
    """Settings of the quasi-Newton solver of one window (docs/theory/estimate.md). Unset entries follow the preset."""

    tolerance: float | None = Field(None, gt=0, description="on max |s g|; default 5e-4 (recommended), 1e-3 (paper)")
    max_iterations: int = Field(
        200,
        ge=1,
        description="largest number of iterations per window; a third of it for a window that may be halved "
        "and is longer than 120 s, or halved already",
    )
    history: int = Field(10, ge=1, description="number of correction pairs of L-BFGS")
    scale: SixPositive | None = Field(
        None,
        description="s of the control-variable transform, six channels, N and N m; default from the prior, or ones",
    )


class FilterSettings(Settings):
    """Settings of the extended Kalman filter (docs/theory/estimate.md)."""

    gate: float = Field(12.0, gt=0, description="innovations beyond this many standard deviations are rejected")
    patience: float = Field(
        10.0, gt=0, description="time of rejections before a restart, s; at least three sample intervals"
    )
    vibration_noise_factor: float = Field(
        30.0, ge=1, description="factor on the disturbance noise inside the vibration set"
    )
    slow_feed: float = Field(
        2.0, gt=0, description="sample interval above which the filter gets the interpolated record, s"
    )
    feed_interval: float = Field(1.0, gt=0, description="interval of the interpolated record that the filter gets, s")
    max_rejected_fraction: float = Field(
        0.05, gt=0, le=1, description="share of rejected samples above which a profile fails"
    )


class SmootherSettings(Settings):
    """Settings of the iterated smoother (docs/smoother.md)."""

    tolerance: float = Field(
        0.25, gt=0, description="the passes end at an rms move no larger than this, in standard deviations"
    )
    max_passes: int | None = Field(
        None,
        ge=1,
        description="largest number of passes per dive; default 20, or 1 for slow sensors on a hull without "
        "its own prior",
    )
    estimate: Literal["mean", "mode"] = Field(
        "mean", description="estimate from the posterior: its mean, or its most probable path"
    )
    actuator_lag: float = Field(
        1.0,
        ge=0,
        description="error of the times of the actuators' records in addition to their common lag, s; at least half "
        "a sample interval",
    )
    adaptive: bool = Field(True, description="whether the noise is fitted to each dive, by one factor per channel")
    degrees_of_freedom: float | None = Field(
        None,
        gt=1,
        description="degrees of freedom of Student-t noise in the heavy-tailed channels; null: Gaussian everywhere",
    )
    heavy_tailed: tuple[Channel, ...] = Field(("B_cr",), description="channels whose noise may be Student-t")
    velocity_error: float = Field(
        0.003, gt=0, description="constant error of a measured relative velocity over a dive, in each component, m/s"
    )
    vertical_motion: float | None = Field(
        None,
        ge=0,
        description="standard deviation of the water's vertical velocity, m/s; default from the record of each dive, "
        "zero where its depth rate shows no motion",
    )
    hull: Literal["held", "corrected", "believed"] = Field(
        "held",
        description="hull errors in the intervals: held includes them, with the platform file's values; corrected "
        "includes them, with values corrected from each dive; believed excludes them, as if the file were exact",
    )


class RecordSettings(Settings):
    """Corrections of the records, made after those of the platform's sensors; none by default."""

    roll_offset: float = Field(0.0, ge=-45, le=45, description="subtracted from the roll, degree")
    pitch_offset: float = Field(0.0, ge=-45, le=45, description="subtracted from the pitch, degree")
    pitch_scale: float = Field(1.0, ge=0.5, le=2, description="factor on the recorded pitch less its offset")
    heading_offset: float = Field(0.0, ge=-180, le=180, description="subtracted from the heading, degree")
    heading_deviation: tuple[float, float, float, float] = Field(
        (0.0, 0.0, 0.0, 0.0),
        description="subtracted from the heading: factors of sin, cos, sin 2 and cos 2 of the heading, degree",
    )
    depth_lag: float = Field(0.0, description="delay of the recorded depth behind the attitude, s")
    actuator_lag: float = Field(0.0, ge=-3600, le=3600, description="delay of the actuators behind their records, s")


class EstimationSettings(Settings):
    """Settings of one profile's estimation."""

    preset: Literal["recommended", "paper"] = "recommended"
    engine: Literal["lanes", "scipy", "fortran"] = "lanes"
    start: Literal["prior", "smoothed"] | None = Field(
        None,
        description="path from which the windows start, the filter's or the smoother's; default smoothed "
        "(recommended), prior (paper)",
    )
    step: float = Field(0.1, ge=1e-3, le=0.25, description="integration step and disturbance interval h, s")
    output_interval: float = Field(1.0, gt=0, description="interval of the record axis, s; a multiple of the step")
    seawater: Literal["auto", "density", "depth_slope"] = Field(
        "auto",
        description="buoyancy from the measured density where hull and CTD allow, from density only, or from the "
        "depth slope",
    )
    max_gap: float | None = Field(
        None, gt=0, description="longer gaps are masked, s; default 10, or 3.5 local sample intervals if longer"
    )
    slow_part: float = Field(
        120.0, gt=0, description="length of the moving mean from which the lateral channels start (recommended), s"
    )
    records: RecordSettings = RecordSettings()
    window: WindowSettings = WindowSettings()
    optimizer: OptimizerSettings = OptimizerSettings()
    filter: FilterSettings = FilterSettings()
    smoother: SmootherSettings = SmootherSettings()

    @model_validator(mode="after")
    def _whole_steps(self) -> Self:
        ratio = self.output_interval / self.step
        if abs(ratio - round(ratio)) > 1e-9 or round(ratio) < 1:
            raise ValueError(f"output_interval ({self.output_interval} s) must be a multiple of step ({self.step} s)")
        return self

    @property
    def steps_per_record(self) -> int:
        """Integration steps in one output interval."""
        return round(self.output_interval / self.step)

    @property
    def transformed(self) -> bool:
        """Return whether the control-variable transform applies (preset `recommended`)."""
        return self.preset == "recommended"

    @property
    def tolerance(self) -> float:
        """Bound on the optimality measure ``max |s g|``."""
        if self.optimizer.tolerance is not None:
            return self.optimizer.tolerance
        return 5e-4 if self.transformed else 1e-3

    @property
    def starts_from(self) -> Literal["prior", "smoothed"]:
        """Path from which the windows start: the setting, else by preset."""
        if self.start is not None:
            return self.start
        return "smoothed" if self.transformed else "prior"

    def window_length(self, sample_interval: float) -> float:
        """Window length T_seg in s: the setting, else 30 s, or six sample intervals where those exceed 5 s."""
        if self.window.length is not None:
            return self.window.length
        return USUAL_WINDOW if sample_interval <= SLOW_SENSORS else 6.0 * sample_interval

    def window_margin(self, sample_interval: float) -> float:
        """Retraction margin in s: the setting, else a third of the window."""
        length = self.window_length(sample_interval)
        margin = length / 3.0 if self.window.margin is None else self.window.margin
        return min(margin, length - self.step)

    def cost_threshold(self, sample_interval: float) -> float:
        """Threshold tau_c in proportion to the window (0.2 at 30 s), since J is an integral."""
        return self.window.cost_threshold * self.window_length(sample_interval) / USUAL_WINDOW

    def gap_limit(self, sample_interval: float | NDArray[np.float64]) -> float | NDArray[np.float64]:
        """Longest gap (s) that is interpolated, for a sample interval or for local intervals (s) of the record."""
        return longest_bridged(sample_interval)[()] if self.max_gap is None else self.max_gap


def smoother_passes(platform: Platform, settings: SmootherSettings, interval: float = 0.0) -> int:
    """Largest number of passes of the smoother for the interval of a record's attitude, s (docs/smoother.md).

    Hulls whose records are slower than their response are usually uncalibrated (`default_prior`). There the smoother
    does not iterate: the errors of the hull's coefficients would determine the speed. It makes one pass about the
    filter's path, and one about a run of the model that is steered along its result.
    """
    if settings.max_passes is not None:
        return settings.max_passes
    return 1 if is_slow_and_untuned(platform, interval) else 20
