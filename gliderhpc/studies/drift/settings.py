"""Settings of the study ``drift``."""

from typing import Self

from pydantic import Field, model_validator

from gliderhpc.estimation.settings import Settings


class CoefficientSettings(Settings):
    """The Monte-Carlo of the hull's coefficients: draws of them, and the segments that are inverted again."""

    error: float = Field(0.15, ge=0, lt=1, description="relative error of every viscous and added-mass coefficient")
    draws: int = Field(300, ge=0, description="hulls drawn; 0 for none")
    segments: int = Field(1, ge=1, description="steady segments a profile and phase")
    length: float = Field(240.0, gt=0, description="length of a segment, s")
    settling: float = Field(120.0, ge=0, description="start of a segment that is not counted, s")
    pitch_offset: float = Field(1.0, gt=0, le=10, description="constant error of the pitch that is tried out, degree")

    @model_validator(mode="after")
    def _leaves_something(self) -> Self:
        if self.settling >= self.length:
            raise ValueError(f"a segment of {self.length:g} s must be longer than its settling of {self.settling:g} s")
        return self


class ChangeSettings(Settings):
    """The search for steps, ramps and episodes."""

    level: float = Field(
        0.02, gt=0, lt=1, description="probability of chance below which a change counts; rates in docs/drift.md"
    )
    resamples: int = Field(400, ge=100, description="null series of the bootstrap")
    smallest: float = Field(0.05, ge=0, description="smallest change of K_D0, in parts of it, that is named")
    most: int = Field(4, ge=0, description="changes looked for; 0 for none")


class DriftSettings(Settings):
    """Medians of each profile, tests of their trends, and the question asked (section 5.6, model.md 9)."""

    depth_band: tuple[float, float] | None = Field(
        None, description="depths that count, m; default 150 to 500, or the like part of shallower dives"
    )
    epochs: int | None = Field(11, ge=3, description="number of epochs, evenly over the mission; null: all profiles")
    epoch_size: int = Field(3, ge=2, description="consecutive profiles an epoch")
    resamples: int = Field(2000, ge=200, description="of the bootstraps")
    seed: int = Field(0, ge=0, description="of bootstraps and draws")
    drag_increase: float = Field(0.5, gt=0, description="increase of K_D0, in parts of it, that is asked after")
    coefficients: CoefficientSettings = CoefficientSettings()
    changes: ChangeSettings = ChangeSettings()

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.depth_band is not None and not 0.0 <= self.depth_band[0] < self.depth_band[1]:
            raise ValueError("a depth_band is two depths, the shallower one first")
        return self
