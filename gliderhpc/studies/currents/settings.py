"""Settings of the study ``currents``."""

from pydantic import Field

from gliderhpc.estimation.settings import Settings


class DepthResolvedSettings(Settings):
    """Eq. 41 and what surrounds it (section 5.4, model.md 7)."""

    baseline: float = Field(60.0, gt=0, description="moving average taken out of the yaw moment, s")
    smoothing: float = Field(15.0, gt=0, description="length of the Savitzky-Golay window, s")
    order: int = Field(3, ge=1, description="order of its polynomial")
    limit: float = Field(1.0, gt=0, description="largest lateral current that counts as a root, m/s")
    largest_condition: float = Field(10.0, gt=1, description="samples of a larger condition number are masked")
    coefficient_error: float = Field(0.15, ge=0, lt=1, description="relative error of the moment coefficients")
    largest_doubt: float = Field(
        0.05, gt=0, lt=1, description="share of coefficient draws of the other sign at which a hull is refused"
    )
    draws: int = Field(300, ge=2, description="of the moment coefficients")
    seed: int = Field(0, ge=0, description="of these draws")
    bin: float = Field(10.0, ge=0.1, description="depth of a bin, m")
    actuation_error: float | None = Field(
        None, ge=0, description="relative error of the displacement bridged while actuators move; default as the run's"
    )
