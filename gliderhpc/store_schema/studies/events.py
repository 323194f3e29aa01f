"""Group ``events``: its variables, and the columns of its catalogue."""

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


def _event_variable(
    name: str, units: str, long_name: str, standard_name: str | None = None, dtype: Dtype = "float64"
) -> Variable:
    return Variable(name, (EVENT,), dtype, units, long_name, standard_name)


CATALOGUE = (
    _event_variable("source_profile", "1", "profile that the event belongs to"),
    _event_variable("time", TIME_UNITS, "time of the peak", "time"),
    _event_variable("depth", "m", "depth at the peak", "depth"),
    _event_variable("latitude", "degrees_north", "latitude of the track at the peak", "latitude"),
    _event_variable("longitude", "degrees_east", "longitude of the track at the peak", "longitude"),
    _event_variable("channel", "1", "disturbance channel", dtype="string"),
    _event_variable("amplitude", "1", "value at the peak with its sign, in the channel's unit (N or N m)"),
    _event_variable("width", "s", "full width of the peak at half its amplitude"),
    _event_variable("sigma", "1", "magnitude of the amplitude over the noise floor"),
    _event_variable("over_ceiling", "1", "magnitude of the amplitude over the threshold"),
    Variable("quality", (EVENT,), "uint8", "1", "quality of the sample at the peak", "quality_flag", flags=QUALITY),
)
"""Variables with one value an event, in the order of the catalogue."""


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
            *CATALOGUE,
        ),
    )
