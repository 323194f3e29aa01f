"""Hypothesis strategies of recipes: JSON values that define a change of a valid input and the command that reads it."""

from __future__ import annotations

from typing import Any

from hypothesis import strategies as st

Recipe = dict[str, Any]
Recipes = st.SearchStrategy[Recipe]

FRACTIONS = st.floats(0.0, 0.999)
NUMBERS = st.one_of(
    st.sampled_from(
        [float("nan"), float("inf"), float("-inf"), 0.0, -1.0, 1e30, -1e30, 9.96921e36, 1e308, 5e-324, -9999.0, 2.0**63]
    ),
    st.floats(-1e6, 1e6),
    st.floats(),
)
TEXTS = st.one_of(
    st.sampled_from(
        [
            "", " ", "nan", "NaN", "inf", "-inf", "-9999", "1e999", "0x10", "1,5", "1_000", "--", "a" * 5000, "\t", "\\",
            "[bold red]x[/bold red]", "[/]", "\x1b[31mred", "None", "true", "x;y", "°", "\u0661\u0662", "\U0001f40b",
            "2023-13-45", "31/02/2023 10:00:00", "05/07/1600 10:00:00", "05/07/9999 10:00:00", "00/00/0000 00:00:00",
            "1e400", "9" * 400, "-0", ".", "+", "1e", "NULL", "99999999999999999999",
        ]
    ),
    st.text(max_size=12).filter(lambda text: max(text, default="a") < "\ud800" or max(text) > "\udfff"),
    NUMBERS.map(repr),
)  # fmt: skip
CODES = st.one_of(
    st.sampled_from(
        ["efbbbf", "fffe", "00", "00000000", "ff", "0d0a", "1b5b33316d", "c3", "e9", "1f8b0800", "0c", "85"]
    ),
    st.binary(min_size=1, max_size=12).map(bytes.hex),
)
UNITS = st.one_of(
    st.sampled_from(
        [
            "", "1", "m", "km", "degree", "radian", "rad", "cm3", "m3", "cc", "dbar", "bar", "Pa", "degC", "K", "1e-3",
            "seconds since 1970-01-01", "seconds since 1970-01-01 EST", "days since 1600-01-01", "hours since 0000-00-00",
            "months since 2000-01-01", "seconds since yesterday", "seconds since 2000-01-01 00:00:00 +99:99",
            "microseconds since 9999-12-31", "seconds", "since", "m m m", "degrees_north",
        ]
    ),
    TEXTS,
)  # fmt: skip
ATTRIBUTE_VALUES = st.one_of(
    TEXTS, NUMBERS, st.lists(NUMBERS, max_size=3), CODES.map(lambda code: {"hex": code}), st.integers(-5, 2**31)
)
ATTRIBUTE_NAMES = st.sampled_from(
    ["units", "calendar", "scale_factor", "add_offset", "missing_value", "standard_name", "dtype", "coordinates",
     "valid_range", "flag_values", "_Unsigned", "long_name", "comment", "grid_mapping"]
)  # fmt: skip
GLOBAL_NAMES = st.sampled_from(
    ["Conventions", "platform", "mission", "source", "history", "featureType", "controls_absent", "heading_comment"]
)
WHICH = st.integers(0, 60)
COUNTS = st.sampled_from([1, 1, 2, 7, 50, 100_000])
JSON_VALUES = st.one_of(
    TEXTS, NUMBERS, st.none(), st.booleans(), st.integers(-(2**70), 2**70), st.just([]), st.just({}), st.just([[]]),
    st.lists(st.integers(-3, 10**7), max_size=4),
)  # fmt: skip


def _edit(name: str, *parts: Any) -> st.SearchStrategy[list[Any]]:
    drawn = [part if isinstance(part, st.SearchStrategy) else st.just(part) for part in parts]
    return st.tuples(st.just(name), *drawn).map(list)


def netcdf_edits(variables: tuple[str, ...] = ()) -> st.SearchStrategy[list[Any]]:
    """One edit of a netCDF file by variable; those named are drawn more often than the rest."""
    which = st.one_of(WHICH, st.sampled_from(variables)) if variables else WHICH
    kinds = st.sampled_from(["f4", "i2", "i4", "u1", "i8", "u8", "f8", "i1", "str", "S1"])
    shifts = st.one_of(
        st.sampled_from([-3600.0, -1.0, 86400.0, 3.15e8, 3.15e17, -3.15e9, 1e-9, 27.0, 180.0, 360.0]), NUMBERS
    )
    return st.one_of(
        _edit("drop", which),
        _edit("rename", which, st.sampled_from(["TIME", "Depth", "x", "profile", "time", "pitch_2", "é"])),
        _edit("type", which, kinds),
        _edit("fill", which, NUMBERS, FRACTIONS, COUNTS),
        _edit("put", which, NUMBERS, FRACTIONS, COUNTS),
        _edit("put", which, NUMBERS, FRACTIONS, COUNTS),
        _edit("constant", which, NUMBERS),
        _edit("scale", which, st.sampled_from([-1.0, 0.0, 1e-6, 1e-3, 0.0174533, 57.29578, 1e3, 86400.0, 1e9, 1e-9])),
        _edit("shift", which, shifts, FRACTIONS),
        _edit("shift", which, shifts, FRACTIONS),
        _edit("reverse", which),
        _edit("reverse-dimension", st.integers(0, 4)),
        _edit("shuffle", st.integers(0, 4), st.integers(0, 99)),
        _edit("repeat", st.integers(0, 4), FRACTIONS, st.sampled_from([1, 2, 300])),
        _edit("cut", st.integers(0, 4), st.sampled_from([0, 1, 2, 3, 10])),
        _edit("attribute", which, "units", UNITS),
        _edit("attribute", which, ATTRIBUTE_NAMES, ATTRIBUTE_VALUES),
        _edit("global", GLOBAL_NAMES, ATTRIBUTE_VALUES),
        _edit("drop-attribute", which, "units"),
        _edit("dimensions", which, st.sampled_from(["scalar", "two", "own"])),
        _edit("group", st.sampled_from(["g", "data"])),
        _edit("layout", st.sampled_from(["NETCDF3_CLASSIC", "NETCDF3_64BIT_OFFSET", "NETCDF4_CLASSIC"])),
    )


def byte_edits() -> st.SearchStrategy[list[Any]]:
    """One edit of a file as bytes."""
    return st.one_of(
        _edit("flip", FRACTIONS, st.integers(0, 7)),
        _edit("flip", st.floats(0.0, 0.05), st.integers(0, 7)),
        _edit("overwrite", FRACTIONS, CODES),
        _edit("insert", FRACTIONS, CODES),
        _edit("insert", 0.0, CODES),
        _edit("truncate", FRACTIONS),
        _edit("gzip"),
        _edit("empty"),
        _edit("swap-bytes"),
    )


def place_edits() -> st.SearchStrategy[list[Any]]:
    """Replace a file by something else that has a name."""
    return st.sampled_from(["gone", "folder", "fifo", "dangling", "loop", "socket", "device"]).map(lambda name: [name])


def text_edits() -> st.SearchStrategy[list[Any]]:
    """One edit of a text file by lines."""
    return st.one_of(
        _edit("line-drop", FRACTIONS, st.sampled_from([1, 2, 20, 1000])),
        _edit("line-repeat", FRACTIONS, st.sampled_from([1, 2, 100])),
        _edit("line-swap", FRACTIONS, FRACTIONS),
        _edit("line-add", FRACTIONS, TEXTS),
        _edit("encode", st.sampled_from(["utf-16", "utf-8-sig", "latin-1", "utf-32", "cp500"])),
        _edit("newline", st.sampled_from(["0d0a", "0d", "0a0a", "00", "20"])),
    )


def table_edits() -> st.SearchStrategy[list[Any]]:
    """One edit of a file of semicolon-separated columns."""
    columns = st.integers(0, 22)
    return st.one_of(
        _edit("field", FRACTIONS, columns, TEXTS),
        _edit("field", FRACTIONS, 0, TEXTS),
        _edit("column", columns, TEXTS),
        _edit("heading", columns, st.one_of(TEXTS, st.sampled_from(["Timestamp", "Depth", "Pitch", "Lat"]))),
        text_edits(),
    )


def _some(edits: st.SearchStrategy[list[Any]], most: int = 3) -> st.SearchStrategy[list[list[Any]]]:
    return st.lists(edits, min_size=1, max_size=most)


def _recipe(kind: str, **parts: Any) -> Recipes:
    drawn = {key: part if isinstance(part, st.SearchStrategy) else st.just(part) for key, part in parts.items()}
    return st.fixed_dictionaries({"kind": st.just(kind), **drawn})


def _files(netcdf: st.SearchStrategy[list[list[Any]]]) -> dict[str, Any]:
    """Edits by variable, by byte, and of the place: mostly one of them."""
    none = st.just([])
    return {
        "edits": netcdf,
        "bytes": st.one_of(none, none, none, none, _some(byte_edits(), 2), place_edits().map(lambda edit: [edit])),
    }


OBSERVED = (
    "time", "depth", "roll", "pitch", "heading", "battery_position", "battery_rotation", "ballast_volume", "profile",
    "fix_time", "fix_latitude", "fix_longitude",
)  # fmt: skip
OBSERVATION_COMMANDS = ("run", "run", "run", "run", "dry-run", "dry-run", "inspect", "append", "tune", "calibrate")


def observations() -> Recipes:
    """Observation files."""
    return _recipe(
        "observation", command=st.sampled_from(OBSERVATION_COMMANDS), **_files(_some(netcdf_edits(OBSERVED), 2))
    )


def seaexplorer() -> Recipes:
    """SeaExplorer's navigation and payload files."""
    edits = st.one_of(_some(table_edits(), 2), _some(table_edits(), 2), _some(byte_edits(), 2), _some(place_edits(), 1))
    return _recipe("seaexplorer", which=st.integers(0, 5), packed=st.booleans(), edits=edits, bytes=_after())


def _after() -> st.SearchStrategy[list[list[Any]]]:
    """Now and then, damage after what was edited before (and compressed)."""
    return st.one_of(st.just([]), st.just([]), _some(byte_edits(), 1))


def slocum() -> Recipes:
    """Slocum's binary files: header lines, sensors, cycles."""
    tags = st.sampled_from(
        ["dbd_label", "encoding_ver", "num_ascii_tags", "all_sensors", "the8x3_filename", "full_filename",
         "filename_extension", "mission_name", "fileopen_time", "total_num_sensors", "sensors_per_cycle",
         "state_bytes_per_cycle", "sensor_list_crc", "sensor_list_factored"]
    )  # fmt: skip
    values = st.one_of(
        TEXTS, st.sampled_from(["0", "-1", "1000000", "../x", "/etc/passwd", "../../../tmp/x", "T", "1", "4294967295"])
    )
    tag = _edit("tag", tags, values)
    sensor = _edit("sensor", st.integers(0, 20), st.integers(0, 6), values)
    edits = st.one_of(
        _some(tag, 2), _some(sensor, 2), _some(byte_edits(), 2), _some(st.one_of(tag, sensor, byte_edits()), 3),
        _some(place_edits(), 1),
    )  # fmt: skip
    return _recipe("slocum", which=st.integers(0, 3), edits=edits, bytes=_after())


def slocum_netcdf() -> Recipes:
    """Slocum's native sensors as netCDF."""
    names = ("m_present_time", "sci_m_present_time", "m_depth", "m_pitch", "m_gps_lat", "m_gps_lon", "m_battpos")
    return _recipe("slocum-netcdf", **_files(_some(netcdf_edits(names))))


def seaglider() -> Recipes:
    """Seaglider's files of dives."""
    names = ("time", "depth", "eng_pitchAng", "log_gps_time", "log_gps_lat", "gc_st_secs", "log_C_VBD", "ctd_time")
    return _recipe("seaglider", which=st.integers(0, 2), **_files(_some(netcdf_edits(names))))


def og1() -> Recipes:
    """OG1 trajectory files."""
    names = ("TIME", "DEPTH", "PITCH", "HEADING", "VBD_CC", "divenum", "LATITUDE_GPS", "PLATFORM_SERIAL_NUMBER")
    return _recipe("og1", **_files(_some(netcdf_edits(names))))


YAML_VALUES = st.one_of(
    st.sampled_from(
        [
            ".nan", ".inf", "-.inf", "1e308", "-1", "0", "''", "text", "[]", "{}", "[1, 2]", "{a: 1}", "true", "null", "~",
            "2024-01-01", "1e400", "9" * 5000, "!!python/object/apply:os.system [ls]", "*unknown", "&a [*a]", "!!binary aGk=",
            "0o7", "0x1F", "1:30", "yes", "'[bold]x[/bold]'", '"\\x1b[31m"', "!!float text", "!!int 1.5", "!!set {a}",
            "<<", "%", "@x", "`x`", "- 1", "? x", "1__0", "1e", "10:00:00", "=", "[" * 3000, "{a: " * 500,
        ]
    ),
    TEXTS.map(lambda text: text.replace("\n", " ")),
    NUMBERS.map(repr),
)  # fmt: skip


def yaml_edits() -> st.SearchStrategy[list[Any]]:
    """One edit of a YAML file: the value of a key, a key, or its text."""
    return st.one_of(
        _edit("value", st.integers(0, 80), YAML_VALUES),
        _edit("value", st.integers(0, 80), YAML_VALUES),
        _edit("twice", st.integers(0, 40)),
        _edit("key", st.integers(0, 80), st.sampled_from(["kay", "", "1", "true", "[a]", "{}", "<<", "é", "x" * 3000])),
        _edit("bomb", st.integers(2, 9)),
        text_edits(),
        byte_edits(),
    )


def yaml_files() -> Recipes:
    """Platform, scenario and budget files."""
    commands = st.sampled_from(["platforms", "platforms", "dry-run", "simulate", "simulate", "budget"])
    return _recipe("yaml", command=commands, edits=_some(yaml_edits(), 2), bytes=_rarely(place_edits()))


def _rarely(edit: st.SearchStrategy[list[Any]]) -> st.SearchStrategy[list[list[Any]]]:
    return st.one_of(*[st.just([])] * 9, edit.map(lambda one: [one]))


RANGES = st.one_of(
    st.sampled_from(
        ["1", "1:2", "2:1", "0", "-1", "1:", ":2", ",", "1,,2", "1:2:3", "99", "1:99999999999", "1e3", "1.5", "a", "1-2",
         "1:1000000000", "1,1,1", " 1 ", "0x1", "9" * 30]
    ),
    TEXTS,
)  # fmt: skip
SETTINGS = st.sampled_from(
    ["step", "output_interval", "window.length", "window.margin", "filter.max_rejected_fraction", "engine", "preset",
     "smoother", "inspect.profiles", "records.pitch_offset", "records.pitch_scale", "platform.mass.total",
     "platform.buoyancy.neutral_volume", "platform.viscous.K_L", "platform.position.hull", "platform.name", "x", "",
     "platform", "platform.", ".", "window", "current", "tuning.longest", "calibration.hold", "currents.bin"]
)  # fmt: skip
WORDS = st.one_of(NUMBERS.map(repr), TEXTS, YAML_VALUES).filter(lambda text: "\x00" not in text)


def command_lines() -> Recipes:
    """Numbers, profile ranges and settings on the command line."""
    templates = st.sampled_from(
        [
            "run-profiles", "run-set", "run-set", "run-workers", "run-platform", "simulate-depth", "simulate-seed",
            "simulate-profiles", "platforms-mass", "platforms-pitch", "platforms-depth", "import-scale", "import-zero",
            "import-declination", "import-battery", "info-set", "report-profile", "export-attribute", "analyze-set",
            "analyze-profiles", "tune-set", "calibrate-set", "calibrate-hold", "inspect-set", "twin-seeds", "any",
        ]
    )  # fmt: skip
    ranges = RANGES.filter(lambda text: "\x00" not in text)
    return _recipe(
        "command-line", template=templates, word=WORDS, range=ranges, setting=SETTINGS, more=st.lists(WORDS, max_size=3)
    )


ARCHIVE_COMMANDS = (
    "info", "info", "check", "check", "deep", "deep", "compare", "compare", "compare-reversed", "analyze-reconstruction",
    "analyze-drift", "analyze-currents", "analyze-vertical", "report", "report-profile", "og1", "og1", "currents",
    "currents", "validate", "resume", "resume", "resume", "resume", "append", "overwrite",
)  # fmt: skip
LOCKS = (
    st.sampled_from(
        [
            "",
            "00",
            "7b7d",
            "5b5d",
            "ff",
            "31",
            "6e756c6c",
            "7b2270696422203a20317d",
            "22" * 40,
            "folder",
            "dangling",
            "fifo",
        ]
    )
    | CODES
)


def archive_edits() -> st.SearchStrategy[list[Any]]:
    """One damage of an archive."""
    which = st.integers(0, 2000)
    sorts = st.sampled_from(["chunk", "chunk", "metadata", "metadata", "root", "any", "marker"])
    strays = st.sampled_from(["", "series", "windows", "reconstruction", "new", "series/B_cu", "series/B_cu/c"])
    names = st.sampled_from(["zarr.json", "c.0.0", "x.partial", "é", ".zgroup", "c.99.99", "notes.txt"])
    bytewise = byte_edits().flatmap(lambda edit: st.tuples(sorts, which).map(lambda at: [*at, *edit]))
    place = place_edits().flatmap(lambda edit: st.tuples(sorts, which).map(lambda at: [*at, *edit]))
    return st.one_of(
        bytewise,
        bytewise,
        place,
        _edit("metadata", which, "json", which, st.sampled_from(["set", "set", "drop", "add"]), JSON_VALUES),
        _edit("metadata", which, "json", which, st.sampled_from(["set", "drop"]), JSON_VALUES),
        _edit("marker", which, "json", which, st.sampled_from(["set", "drop"]), JSON_VALUES),
        _edit("any", which, "remove-folder"),
        _edit("chunk", which, "copy-of", which),
        _edit("lock", 0, LOCKS),
        _edit("stray", strays, names),
    )


def archives() -> Recipes:
    """Damaged archives under every command that reads one."""
    return _recipe("archive", command=st.sampled_from(ARCHIVE_COMMANDS), edits=_some(archive_edits(), 2))


ALL_COMMANDS = (
    "run", "dry-run", "simulate", "inspect", "info", "check", "compare", "report", "og1", "reconstruction",
    "import-seaexplorer", "import-seaglider", "platforms", "tune", "doctor",
)  # fmt: skip


def permissions() -> Recipes:
    """Files and folders that another user may not read or write."""
    what = st.sampled_from(["input", "folder", "output", "archive-file", "archive-folder", "archive", "lock-folder"])
    return _recipe(
        "permissions", command=st.sampled_from(ALL_COMMANDS), what=what, mode=st.sampled_from([0, 0o111, 0o444, 0o555]),
        which=st.integers(0, 2000),
    )  # fmt: skip


def streams() -> Recipes:
    """Closed, full and broken streams."""
    return _recipe(
        "streams", command=st.sampled_from(ALL_COMMANDS),
        how=st.sampled_from(["no-out", "no-err", "none", "full", "pipe"]),
    )  # fmt: skip


def places() -> Recipes:
    """Something else where a file or folder is to be read or written."""
    return _recipe(
        "places", command=st.sampled_from(ALL_COMMANDS), where=st.sampled_from(["input", "output", "log", "parent"]),
        edit=place_edits(),
    )  # fmt: skip


def full_disks() -> Recipes:
    """Disks that fill up while a command writes."""
    return _recipe("full-disk", command=st.sampled_from(ALL_COMMANDS), kilobytes=st.integers(0, 1500))


KINDS: dict[str, tuple[Recipes, float]] = {
    "observation": (observations(), 4.0),
    "seaexplorer": (seaexplorer(), 2.0),
    "slocum": (slocum(), 2.0),
    "slocum-netcdf": (slocum_netcdf(), 1.0),
    "seaglider": (seaglider(), 2.0),
    "og1": (og1(), 2.0),
    "yaml": (yaml_files(), 2.0),
    "command-line": (command_lines(), 2.0),
    "archive": (archives(), 4.0),
    "permissions": (permissions(), 0.7),
    "streams": (streams(), 0.7),
    "places": (places(), 0.7),
    "full-disk": (full_disks(), 0.7),
}
"""Recipes by kind, and the share of the time that each kind gets."""
