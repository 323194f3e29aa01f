"""Settings of the study ``events``."""

from pydantic import Field

from gliderhpc.studies.library.turbulence.settings import FastSettings


class EventSettings(FastSettings):
    """What counts as an event."""

    threshold: float | None = Field(
        None, gt=0, description="least magnitude, N or N m; null for the nulls' ceiling, or without nulls for sigma"
    )
    sigma: float = Field(6.0, gt=0, description="least magnitude in noise floors, where there are no nulls")
    separation: float = Field(5.0, gt=0, description="of two peaks that lie nearer only the larger counts, s")
    actuated: bool = Field(False, description="whether to look where actuators move or the battery is rotated, too")
    strongest: int = Field(12, ge=1, description="events of the view of the strongest")
