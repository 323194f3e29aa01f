"""Provenance of an archive, and the commands that reproduce it."""

import json
import platform as machine
import shlex
from collections.abc import Iterable, Mapping
from importlib import metadata
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from gliderhpc.archive.profile import SMOOTHED
from gliderhpc.archive.reader import Archive
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.observations.profile_numbers import as_ranges
from gliderhpc.platform import read_platform, shipped_platforms
from gliderhpc.report.facts import flatten_settings
from gliderhpc.report.page.content import Block, Commands, Facts, PageSection, Table
from gliderhpc.report.studies import studies_in
from gliderhpc.store_schema.location import Location
from gliderhpc.studies.archived import platform_or_none
from gliderhpc.version import __version__

PLATFORM_FILE = "platform.yaml"
"""Name of the platform file that a report writes if no shipped platform is identical."""

_MODEL_STUDY = "reanalysis"
"""Name of the study that uses files of ocean models."""

_OPTION_SETTINGS = ("preset", "engine", "start")
"""Settings with a command-line option of their own."""


def run_command(archive: Archive, place: Location) -> str:
    """Return the command that repeats the run, with all settings that differ from the defaults."""
    settings = dict(archive.attrs.get("settings") or {})
    options = [word for name in _OPTION_SETTINGS if settings.get(name) for word in (f"--{name}", settings[name])]
    options += [
        word for key, value in _changed_settings(settings).items() for word in ("--set", f"{key}={json.dumps(value)}")
    ]
    return _line(
        "run-mission",
        observations_of(archive.attrs),
        "--platform",
        platform_option(archive),
        "--store",
        place,
        "--profiles",
        as_ranges(archive.to_dataset()["profile"].values.tolist()),
        *options,
    )


def _changed_settings(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return the settings, by dotted name, that differ from the defaults of preset, engine and start."""
    chosen = {name: settings[name] for name in _OPTION_SETTINGS if name in settings}
    try:
        defaults = dict(flatten_settings(MissionSettings.model_validate(chosen).model_dump(mode="json")))
    except ValidationError:
        defaults = {}
    return {
        key: value
        for key, value in flatten_settings(settings)
        if key not in _OPTION_SETTINGS and defaults.get(key) != value
    }


def study_command(name: str, archive: Archive, place: Location) -> str:
    """Return the command that runs a study, with the options of the archived run if there is one."""
    attributes = archive[name].attrs if name in archive.children else {}
    if name == "validation":
        observations, platform = observations_of(archive.attrs), platform_option(archive)
        return _line("validate", observations, "--platform", platform, "--store", place)
    options = ["--quick"] if attributes.get("quick") else []
    if attributes.get("estimate") == SMOOTHED:
        options += ["--estimate", SMOOTHED]
    options += list(map(str, attributes.get("options") or ()))
    if attributes.get("with_truth") and "--truth" not in options:  # An archive of an earlier version has no options.
        options += ["--truth", "TRUTH.nc"]
    if name == _MODEL_STUDY:
        options += [word for label in _models(attributes) for word in ("--model", label)]
    return _line("analyze", place, name, *options)


def _models(attributes: Mapping[Any, Any]) -> list[str]:
    """Return the files of ocean models used in a study, or a placeholder."""
    labels = [str(label) for files in dict(attributes.get("models") or {}).values() for label in files]
    return labels or ["MODEL.nc"]


def platform_option(archive: Archive) -> str:
    """Return the value of ``--platform``: the name of a shipped platform, or the file that the report writes."""
    platform = platform_or_none(archive)
    if platform is None:
        return PLATFORM_FILE
    shipped = platform.name in shipped_platforms() and read_platform(platform.name) == platform
    return platform.name if shipped else PLATFORM_FILE


def observations_of(attributes: Mapping[Any, Any]) -> str:
    """Return the name of the observation file, safe as a command-line argument."""
    name = Path(str(attributes.get("observations") or "OBSERVATIONS.nc")).name
    return f"./{name}" if name.startswith("-") else name


def _line(*words: object) -> str:
    """Return a shell command in which every text from an archive is quoted."""
    return shlex.join(["gliderhpc", *map(_printable, words)])


def _printable(word: object) -> str:
    return "".join(letter for letter in str(word) if letter.isprintable())


_LIBRARIES = ("numpy", "numba", "scipy", "xarray", "zarr", "matplotlib")


def provenance_section(archive: Archive, place: Location, command: str) -> PageSection:
    """Return versions, digests, settings and platform, and the commands that reproduce archive and page."""
    studies = studies_in(archive)
    commands = (run_command(archive, place), *(study_command(name, archive, place) for name in studies), command)
    blocks: list[Block] = [
        Facts(_versions(archive.attrs)),
        Commands(_describe_commands(archive), commands),
        Table("settings", "All settings of the run.", _rows(archive.attrs.get("settings"))),
        Table("platform", "The platform, in the units of its file.", _rows(archive.attrs.get("platform"))),
    ]
    study_rows = list(_study_rows(archive, studies))
    if study_rows:
        blocks.append(Table("study_settings", "Settings of the studies.", study_rows))
    return PageSection("provenance", "Settings, versions, and how to reproduce this", tuple(blocks))


def _describe_commands(archive: Archive) -> str:
    file = f" {PLATFORM_FILE} is in the folder of this page." if platform_option(archive) == PLATFORM_FILE else ""
    return (
        "These commands reproduce the archive and this page from the observation file with the digest above. The same "
        f"version on the same machine gives the same numbers, except for computing times.{file}"
    )


def _versions(attributes: Mapping[Any, Any]) -> dict[str, str]:
    return {
        "estimated by": f"gliderhpc {attributes.get('software_version', 'of an unknown version')}",
        "schema of the archive": str(attributes.get("schema_version", "unknown")),
        "observations": str(attributes.get("observations", "unknown")),
        "their source": str(attributes.get("observations_source") or "unknown"),
        "their digest (SHA-256)": str(attributes.get("observations_digest", "unknown")),
        "drawn by": f"gliderhpc {__version__}, Python {machine.python_version()}",
        "with": ", ".join(f"{name} {metadata.version(name)}" for name in _LIBRARIES),
    }


def _rows(settings: object) -> list[dict[str, Any]]:
    if not isinstance(settings, Mapping):
        return []
    return [{"setting": key, "value": _text(value)} for key, value in flatten_settings(settings)]


def _study_rows(archive: Archive, studies: Iterable[str]) -> Iterable[dict[str, Any]]:
    for name in studies:
        attributes = archive[name].attrs
        for key in ("estimate", "quick", "software_version"):
            if key in attributes:
                yield {"study": name, "setting": key, "value": _text(attributes[key])}
        own = attributes.get("settings")
        for key, value in flatten_settings(own if isinstance(own, Mapping) else {}):
            yield {"study": name, "setting": key, "value": _text(value)}


def _text(value: Any) -> str:
    return "not set" if value is None else str(value)
