"""Suitability of other programs' files for depth-averaged currents and for the inversion for forces and moments."""

from gliderhpc.observations.files.columns import NamedColumns, Term
from gliderhpc.observations.files.foreign import IN_THE_FORMAT, importer_of, is_in_the_format
from gliderhpc.observations.format import VELOCITY
from gliderhpc.observations.instruments.og1_variables import ATTITUDE, BALLAST, DEPTH, TIME

_ATTITUDE = {
    name: Term((name, *term.names, f"platform_{turn}_angle"), term.unit, term.standard_names)
    for (name, term), turn in zip(ATTITUDE.items(), ("roll", "pitch", "yaw"), strict=True)
}
CURRENT_TERMS = {
    "time": Term(("time", "TIME", "m_present_time"), "s"),
    "depth": Term(("depth", "DEPTH", "GLIDER_DEPTH", "depth_z"), "m", ("depth",)),
    "pressure": Term(("pressure", "PRES", "PRESSURE", "sea_water_pressure"), "dbar", ("sea_water_pressure",)),
    **_ATTITUDE,
    "fix_time": Term(("fix_time", "TIME_GPS", "gps_time"), "s"),
    "fix_latitude": Term(("fix_latitude", "LATITUDE_GPS", "lat_gps", "gps_lat"), "degrees_north"),
    "fix_longitude": Term(("fix_longitude", "LONGITUDE_GPS", "lon_gps", "gps_lon"), "degrees_east"),
    "latitude": Term(("latitude", "LATITUDE", "lat"), "degrees_north"),
    "longitude": Term(("longitude", "LONGITUDE", "lon"), "degrees_east"),
    "profile": Term(("profile",), "1"),
    **{name: Term((name,), "m s-1") for name in VELOCITY},
}
"""Quantities needed or used for a current, by name; matching of names ignores case."""


def lacking_for_currents(columns: NamedColumns) -> list[str]:
    """List the quantities needed for a depth-averaged current that a file lacks."""
    found = {quantity for quantity, term in CURRENT_TERMS.items() if term.find(columns) is not None}
    lacking = [name for name in ("time", "pitch", "heading") if name not in found]
    if found.isdisjoint(("depth", "pressure")):
        lacking.insert(0, "depth or pressure")
    if not any({f"{kind}latitude", f"{kind}longitude"} <= found for kind in ("fix_", "")):
        lacking.append("GPS fixes (or latitude and longitude)")
    return lacking


def needs_of_inversion(columns: NamedColumns) -> str:
    """Describe in a clause the quantities needed for the inversion that a file lacks."""
    terms = {"ballast volume": BALLAST, **ATTITUDE, "depth": DEPTH, "time": TIME}
    lacking = [what for what, term in terms.items() if term.find(columns) is None]
    kind = importer_of(columns.names)
    if is_in_the_format(columns.names) or not lacking or (kind is not None and kind[0] != "og1"):
        return "the inversion has everything that it needs"
    return f"the inversion lacks {', '.join(lacking)}"


def describe_suitability(columns: NamedColumns) -> str:
    """Describe in one line the kind of a file, and the quantities that it lacks for currents and for the inversion."""
    if is_in_the_format(columns.names):
        return f"{columns.source}: {IN_THE_FORMAT}"
    lacking = lacking_for_currents(columns)
    currents = f"currents lack {', '.join(lacking)}" if lacking else "`gliderhpc currents` reads it without conversion"
    return f"{columns.source}: is {_kind(columns)}; {currents}; {needs_of_inversion(columns)}"


def _kind(columns: NamedColumns) -> str:
    """Kind of a file in words, from its attributes and variable names."""
    attributes = ("Conventions", "format_version", "title", "history", "featureType")
    described = " ".join(columns.attribute(name) for name in attributes).lower()
    names = {name.casefold() for name in columns.names}
    if "og-1" in described:
        return "an OG1 file"
    if {"profile_index", "profile_direction"} <= names:
        return "a pyglider timeseries"
    if "erddap" in described:
        return "an ERDDAP file"
    if "ioos_glider" in described:
        return "an IOOS glider file"
    return "a file of another program"
