"""What study ``events`` adds to an archive."""

from gliderhpc.store_schema.schema import (
    TIME_UNITS,
    Dtype,
    Group,
    Variable,
    index_coordinate,
    of_profile,
    profile_coordinate,
)
from gliderhpc.vocabulary import QUALITY

EVENT = "event"
"""Dimension of the catalogue."""


def _of_event(
    name: str, units: str, long_name: str, standard_name: str | None = None, dtype: Dtype = "float64"
) -> Variable:
    return Variable(name, (EVENT,), dtype, units, long_name, standard_name)


def events_group() -> Group:
    """Declare group ``events``."""
    return Group(
        "events",
        "impulsive events of a disturbance's fast part above what nulls reach, strongest first (section 5.3)",
        (
            profile_coordinate(),
            index_coordinate(EVENT, "rank of the event, from 0; where there is none, the one entry is missing"),
            of_profile("message", "1", "why the profile has no events", dtype="string"),
            of_profile("noise", "1", "noise floor of the fast part, in the channel's unit (N or N m)"),
            of_profile("count", "1", "events of the profile"),
            _of_event("source_profile", "1", "profile that the event belongs to"),
            _of_event("time", TIME_UNITS, "time of the peak", "time"),
            _of_event("depth", "m", "depth at the peak", "depth"),
            _of_event("latitude", "degrees_north", "latitude of the track at the peak", "latitude"),
            _of_event("longitude", "degrees_east", "longitude of the track at the peak", "longitude"),
            _of_event("channel", "1", "disturbance channel", dtype="string"),
            _of_event("amplitude", "1", "value at the peak with its sign, in the channel's unit (N or N m)"),
            _of_event("width", "s", "full width of the peak at half its amplitude"),
            _of_event("sigma", "1", "magnitude of the amplitude over the noise floor"),
            _of_event("over_ceiling", "1", "magnitude of the amplitude over the threshold"),
            Variable(
                "quality", (EVENT,), "uint8", "1", "quality of the sample at the peak", "quality_flag", flags=QUALITY
            ),
        ),
    )
