"""Settings of the rounds by which a mission's dives determine its hull."""

from pydantic import Field

from gliderhpc.estimation.settings import SLOW_SENSORS_PRIOR, Settings
from gliderhpc.platform import Platform

USUAL_ROUNDS = 8
"""Maximum number of rounds for hulls with fast sensors, if the setting does not give one."""


class RoundSettings(Settings):
    """Settings of the rounds over the dives, which start from the trim in steady glides."""

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
        description="variance of the errors common to all dives, relative to the variance stated by one dive",
    )
    turning_misfit: float = Field(
        6.0,
        ge=0,
        description="the same, in addition, for the terms of sway, roll and yaw and the lag of the actuators",
    )
    step: float = Field(0.25, ge=1e-3, le=0.25, description="integration step of the rounds, s")
    robust: bool = Field(
        True, description="whether scatter between the dives reduces their weight, and that of outliers further"
    )

    def largest_number(self, platform: Platform) -> int:
        """Largest number of rounds for a hull.

        By default slow records have none: on real missions of such gliders, rounds led to worse currents than the fit
        of the steady glides (docs/calibration.md).
        """
        if self.most is not None:
            return self.most
        return USUAL_ROUNDS if platform.sensors.sample_interval <= SLOW_SENSORS_PRIOR else 0
