"""Settings of the rounds by which a mission's dives determine its hull."""

from pydantic import Field

from gliderhpc.estimation.settings import Settings


class RoundSettings(Settings):
    """Settings of the rounds over the dives, which start from the trim in steady glides."""

    most: int = Field(0, ge=0, description="largest number of rounds, usually 4; 0: only the fit of the steady glides")
    tolerance: float = Field(
        0.1, gt=0, description="the rounds end at a largest move smaller than this, in plausible deviations"
    )
    misfit: float = Field(
        1.2,
        ge=0,
        description="variance of the errors common to all dives, relative to the variance stated by one dive",
    )
    step: float = Field(0.25, ge=1e-3, le=0.25, description="integration step of the rounds, s")
    robust: bool = Field(True, description="whether dives get less weight where they disagree, and outliers least")
