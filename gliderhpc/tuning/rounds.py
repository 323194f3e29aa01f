"""Settings of the rounds by which a mission's dives determine its hull."""

from pydantic import Field

from gliderhpc.estimation.settings import Settings


class RoundSettings(Settings):
    """Settings of the rounds over the dives, which start from the trim in steady glides."""

    most: int = Field(0, ge=0, description="rounds at most, 4 as a rule; 0: the fit of the steady glides alone")
    tolerance: float = Field(0.1, gt=0, description="move of a last round, in plausible deviations")
    misfit: float = Field(
        1.2,
        ge=0,
        description="square of the errors that are the same in all dives, over what one dive states of its own",
    )
    step: float = Field(0.25, ge=1e-3, le=0.25, description="integration step of the rounds, s")
    robust: bool = Field(
        True, description="whether dives are believed less where they differ, and those that do not fit the least"
    )
