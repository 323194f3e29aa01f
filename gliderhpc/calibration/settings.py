"""Settings of `calibrate`: the fit to the steady glides, the rounds over whole dives, and their sections together."""

from typing import Annotated

from pydantic import BeforeValidator, Field

from gliderhpc.calibration.glides.segment_errors import MIN_PROFILES
from gliderhpc.calibration.prior.fit import TuningSettings
from gliderhpc.estimation.priors import SLOW_SENSORS_PRIOR
from gliderhpc.estimation.settings import EstimationSettings, Settings
from gliderhpc.estimation.steady_segments import SegmentSettings
from gliderhpc.mission_hull.turn_test import TurnTestSettings
from gliderhpc.platform import Platform

USUAL_ROUNDS = 8
"""Maximum number of rounds for hulls with fast sensors, if the setting does not give one."""


def _listed(names: object) -> object:
    """Return a single name as a list of one."""
    return (names,) if isinstance(names, str) else names


class CalibrationSettings(Settings):
    """Settings of a calibration."""

    profiles: int = Field(
        40, ge=MIN_PROFILES, description="number of profiles used, spread over the mission, if none are named"
    )
    hold: Annotated[tuple[str, ...], BeforeValidator(_listed)] = Field(
        (), description="parameters that keep the platform's value, such as [K_L]"
    )
    trend: bool = Field(False, description="whether the neutral volume may change linearly in time")
    undetermined: float = Field(
        0.33,
        gt=0,
        le=1,
        description="a direction is held if its error exceeds this fraction of its plausible deviation",
    )


class RoundSettings(Settings):
    """Settings of the rounds over the profiles, which start from the trim in steady glides."""

    most: int | None = Field(
        None,
        ge=0,
        description="largest number of rounds; 0: only the fit of the steady glides; unset: 8 for hulls with a sample "
        "interval of at most 2 s, else 0",
    )
    tolerance: float = Field(
        0.1, gt=0, description="the rounds end at a largest move smaller than this, in plausible deviations"
    )
    misfit: float = Field(
        1.0,
        ge=0,
        description="variance of the errors common to all profiles, relative to the variance stated by one profile",
    )
    turning_misfit: float = Field(
        6.0,
        ge=0,
        description="the same, in addition, for the terms of sway, roll and yaw and the lag of the actuators",
    )
    step: float = Field(0.25, ge=1e-3, le=0.25, description="integration step of the rounds, s")
    robust: bool = Field(
        True, description="whether scatter between the profiles reduces their weight, and that of outliers further"
    )

    def largest_number(self, platform: Platform) -> int:
        """Largest number of rounds for a hull.

        By default slow records have none: on real missions of such gliders, rounds led to worse currents than the fit
        of the steady glides (docs/calibration.md).
        """
        if self.most is not None:
            return self.most
        return USUAL_ROUNDS if platform.sensors.sample_interval <= SLOW_SENSORS_PRIOR else 0


class CalibrateSettings(EstimationSettings):
    """Settings of records, steady flight, fit, rounds over the profiles, turn test, and tuning of the prior."""

    steady: SegmentSettings = SegmentSettings()
    calibration: CalibrationSettings = CalibrationSettings()
    rounds: RoundSettings = RoundSettings()
    turn_test: TurnTestSettings = TurnTestSettings()
    tuning: TuningSettings = TuningSettings()
