"""Settings of the studies of turbulence."""

from typing import Self

from pydantic import Field, model_validator

from gliderhpc.estimation.settings import Channel, Settings

CUTOFF = 0.05
"""Cutoff of the high-pass, Hz: slower disturbances are the model's bias."""

Range = tuple[float, float]


class FastSettings(Settings):
    """Channel, high-pass and band of a disturbance's fast part."""

    channel: Channel = Field("B_cr", description="which of the six disturbances")
    cutoff: float = Field(CUTOFF, gt=0, description="of the high-pass, Hz")
    band: Range = Field((0.15, 0.80), description="in which turbulence is looked for, Hz; spectra are fitted over it")

    @model_validator(mode="after")
    def _band_ordered(self) -> Self:
        if not 0.0 < self.band[0] < self.band[1]:
            raise ValueError(f"band must be two frequencies above zero, the lower one first, not {list(self.band)}")
        return self


class SpectraSettings(FastSettings):
    """Spectra and the power laws fitted to them (docs/turbulence.md)."""

    segment: float = Field(100.0, gt=0, description="length of Welch's segments, s")
    shallowest: float = Field(
        0.0, ge=0, description="samples above this depth are left out, m; the paper's begin at 200"
    )
    groups: int = Field(3, ge=1, description="groups of profiles by their depth-averaged current")
    draws: int = Field(200, ge=0, description="of the intervals' bootstrap")
    seed: int = Field(0, ge=0, description="of all random numbers of the study")


class IntermittencySettings(SpectraSettings):
    """Increments, surrogates and the rank test (docs/turbulence.md)."""

    interval: float = Field(
        0.5, gt=0, description="the series is averaged over so long, s, or less by a part of a step"
    )
    lags: tuple[float, ...] = Field(
        (0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 10.0, 14.0, 20.0), min_length=4, description="of the increments, s"
    )
    lag: float = Field(1.0, gt=0, description="of the flatness that is tested, fixed beforehand, s")
    scaling: Range = Field((1.0, 10.0), description="lags over which exponents are fitted, s")
    scaling_varied: tuple[Range, ...] = Field(
        ((1.0, 6.0), (2.0, 10.0), (2.0, 20.0), (1.0, 20.0)), description="other ranges, beside the first"
    )
    block: float = Field(60.0, gt=0, description="of the block bootstrap, s")
    block_draws: int = Field(500, ge=10, description="of that bootstrap")
    surrogates: int = Field(39, ge=1, description="of each profile")
    iterations: int = Field(200, ge=1, description="cap of a surrogate's iterations")
    tolerance: float = Field(1e-2, gt=0, lt=1, description="gain of an iteration below which a surrogate has converged")
    fade: float = Field(2.0, gt=0, description="over which stretches are faded in and out before surrogates, s")

    @property
    def every_lag(self) -> tuple[float, ...]:
        """Lags with that of the test, in ascending order, s."""
        return tuple(sorted({*self.lags, self.lag}))

    @property
    def scaling_ranges(self) -> tuple[Range, ...]:
        """Ranges of lags that exponents are fitted over, `scaling` first, s."""
        return (self.scaling, *self.scaling_varied)

    @model_validator(mode="after")
    def _ranges_ordered(self) -> Self:
        for low, high in self.scaling_ranges:
            if not 0.0 < low < high:
                raise ValueError(
                    f"a range of lags must be two times above zero, the lower one first, not {[low, high]}"
                )
        return self
