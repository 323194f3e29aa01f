"""Names by which other programs' files carry what an observation file needs, and the importer for each kind of file."""

from collections.abc import Iterable, Sequence

HELPFUL_ORDER = (
    "ballast_volume", "battery_position", "battery_rotation", "pitch", "roll", "heading", "depth", "time"
)  # fmt: skip
"""Required variables, the one without which nothing else helps first: only the glider's own files have it."""

ALIASES = {
    "time": ("time",),
    "depth": ("depth", "glider_depth"),
    "pitch": ("pitch", "glider_pitch", "platform_pitch"),
    "roll": ("roll", "glider_roll", "platform_roll"),
    "heading": ("heading", "glider_heading", "platform_heading"),
    "ballast_volume": ("ballast_volume", "vbd_cc"),
    "battery_position": ("battery_position", "pitch_ctl"),
    "battery_rotation": ("battery_rotation", "roll_ctl"),
}
"""Names by variable, in small letters; they may be written in capitals too."""

_KINDS = (
    ("slocum", "the sensors of a Slocum", ("m_present_time", "m_battpos", "m_de_oil_vol", "m_ballast_pumped")),
    ("seaglider", "a Seaglider's dive", ("log_gps_lat", "eng_vbdcc", "eng_pitchang", "gc_vbd_ad")),
    ("og1", "a Seaglider's controls", ("vbd_cc",)),
)
"""Importer, contents, and the names that only such a file has."""

OWN_FILES = (
    "import the glider's own files instead (`gliderhpc import`: SeaExplorer text, Slocum binary, Seaglider dives)"
)


def find_name(names: Iterable[str], wanted: Sequence[str]) -> str | None:
    """First of the wanted names that is among some names: as it stands, else in other letters.

    Parameters
    ----------
    names : iterable of str
        Names of a file's variables.
    wanted : sequence of str
        In order of preference.
    """
    there = list(names)
    folded = {name.casefold(): name for name in reversed(there)}
    exact = next((name for name in wanted if name in there), None)
    return exact or next((folded[name.casefold()] for name in wanted if name.casefold() in folded), None)


def importer_of(names: Iterable[str]) -> tuple[str, str] | None:
    """Importer that reads a file with these variables, and the file's contents in words; None where none does."""
    folded = {name.casefold() for name in names}
    return next(((importer, held) for importer, held, marks in _KINDS if not folded.isdisjoint(marks)), None)


def describe_found(names: Iterable[str], variables: Iterable[str]) -> str:
    """List required variables that a file has under another name, ``pitch as GLIDER_PITCH``; empty where there is none.

    Parameters
    ----------
    names : iterable of str
        Names of the file's variables.
    variables : iterable of str
        The variables to look for.
    """
    there = list(names)
    found = {variable: find_name(there, ALIASES[variable]) for variable in variables}
    return ", ".join(f"{variable} as {name}" for variable, name in found.items() if name is not None)
