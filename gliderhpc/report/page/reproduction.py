"""The commands that made an archive, and those that would make what it lacks."""

import json
import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import xarray as xr
from pydantic import ValidationError

from gliderhpc.archive.profile import SMOOTHED
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.platform import Platform, read_platform, shipped_platforms
from gliderhpc.report.facts import flattened
from gliderhpc.store_schema.place import Place

PLATFORM_FILE = "platform.yaml"
"""What the hull's file is called that a report leaves where none shipped is the same."""

_OF_MODELS = "reanalysis"
"""The study that takes files of ocean models."""

_CHOICES = ("preset", "engine", "start")
"""Settings that are options of their own."""


def run_command(archive: xr.DataTree, place: Place) -> str:
    """Command that estimates the mission anew, with the settings that are not the usual ones spelt out."""
    settings = dict(archive.attrs.get("settings") or {})
    options = [word for name in _CHOICES if name in settings for word in (f"--{name}", settings[name])]
    options += [word for key, value in _unusual(settings).items() for word in ("--set", f"{key}={json.dumps(value)}")]
    return _line(
        "run-mission", observations_of(archive.attrs), "--platform", platform_option(archive), "--store", place,
        *options,
    )  # fmt: skip


def _unusual(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Settings, sections spelt out, that differ from those that preset, engine and start bring with them."""
    chosen = {name: settings[name] for name in _CHOICES if name in settings}
    try:
        usual = dict(flattened(MissionSettings.model_validate(chosen).model_dump(mode="json")))
    except ValidationError:
        usual = {}
    return {key: value for key, value in flattened(settings) if key not in _CHOICES and usual.get(key) != value}


def study_command(name: str, archive: xr.DataTree, place: Place) -> str:
    """Command that makes a study, as it was made where the archive holds it."""
    made = archive[name].attrs if name in archive.children else {}
    if name == "validation":
        observations, platform = observations_of(archive.attrs), platform_option(archive)
        return _line("validate", observations, "--platform", platform, "--store", place)
    options = ["--quick"] if made.get("quick") else []
    if made.get("estimate") == SMOOTHED:
        options += ["--estimate", SMOOTHED]
    if made.get("with_truth"):
        options += ["--truth", "TRUTH.nc"]
    if name == _OF_MODELS:
        options += [word for label in _models(made) for word in ("--model", label)]
    return _line("analyze", place, name, *options)


def _models(made: Mapping[Any, Any]) -> list[str]:
    """Files of ocean models that a study was made with, or a name for one."""
    labels = [str(label) for files in dict(made.get("models") or {}).values() for label in files]
    return labels or ["MODEL.nc"]


def platform_option(archive: xr.DataTree) -> str:
    """The hull as ``--platform`` takes it: its name where it is as shipped, else the file that the report leaves."""
    platform = own_platform(archive)
    if platform is None:
        return PLATFORM_FILE
    shipped = platform.name in shipped_platforms() and read_platform(platform.name) == platform
    return platform.name if shipped else PLATFORM_FILE


def own_platform(archive: xr.DataTree) -> Platform | None:
    """The hull that an archive was made with, None where this program does not read it."""
    try:
        return Platform.model_validate(archive.attrs.get("platform"))
    except ValidationError:
        return None


def observations_of(attributes: Mapping[Any, Any]) -> str:
    """Name of the observation file, as an argument that is no option."""
    name = Path(str(attributes.get("observations") or "OBSERVATIONS.nc")).name
    return f"./{name}" if name.startswith("-") else name


def _line(*words: object) -> str:
    """Line for a shell, in which whatever an archive says is one word."""
    return shlex.join(["gliderhpc", *map(_visible, words)])


def _visible(word: object) -> str:
    return "".join(letter for letter in str(word) if letter.isprintable())
