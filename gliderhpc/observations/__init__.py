"""Input of records: the observation format, its checks, and the readers of the instruments' files."""

from gliderhpc.observations.dataset import Observations, open_observations
from gliderhpc.observations.profiles import cycle_boundaries, detect_profiles
from gliderhpc.observations.records import Fix, ProfileRecord
from gliderhpc.observations.series import ProfileSeries
from gliderhpc.observations.surface_intervals import ProfileSpan
from gliderhpc.observations.survey import Survey
from gliderhpc.observations.writer import write_observations

__all__ = [
    "Fix",
    "Observations",
    "ProfileRecord",
    "ProfileSeries",
    "ProfileSpan",
    "Survey",
    "cycle_boundaries",
    "detect_profiles",
    "open_observations",
    "write_observations",
]
