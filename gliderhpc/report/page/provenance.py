"""The end of the page: what everything was made with, and how to make it again."""

import platform as machine
from collections.abc import Iterable, Mapping
from importlib import metadata
from typing import Any

import xarray as xr

from gliderhpc.report.facts import flattened
from gliderhpc.report.page.content import Block, Commands, Facts, Grid, Section
from gliderhpc.report.page.reproduction import PLATFORM_FILE, platform_option, run_command, study_command
from gliderhpc.report.studies.registry import studies_in
from gliderhpc.store_schema.place import Place
from gliderhpc.version import __version__

_LIBRARIES = ("numpy", "numba", "scipy", "xarray", "zarr", "matplotlib")


def provenance_section(archive: xr.DataTree, place: Place, command: str) -> Section:
    """Settings, hull, versions, digests, and the commands, of which `command` makes the page."""
    studies = studies_in(archive)
    commands = (
        run_command(archive, place), *(study_command(name, archive, place) for name in studies),
        command,
    )  # fmt: skip
    blocks: list[Block] = [
        Facts(_versions(archive.attrs)),
        Commands(_how(archive), commands),
        Grid("settings", "Settings of the run, all of them.", _rows(archive.attrs.get("settings"))),
        Grid("platform", "The hull, in the units of the platform file.", _rows(archive.attrs.get("platform"))),
    ]
    made = list(_study_rows(archive, studies))
    if made:
        blocks.append(Grid("study_settings", "How the studies were made.", made))
    return Section("provenance", "Settings, versions, and how to reproduce this", tuple(blocks))


def _how(archive: xr.DataTree) -> str:
    beside = f" {PLATFORM_FILE} lies beside this page." if platform_option(archive) == PLATFORM_FILE else ""
    return (
        "These commands make the archive and this page again, from an observation file of the digest above. The same "
        f"version on the same machine gives the same numbers, but for the times.{beside}"
    )


def _versions(attributes: Mapping[Any, Any]) -> dict[str, str]:
    return {
        "estimated by": f"gliderhpc {attributes.get('software_version', 'of an unknown version')}",
        "schema of the archive": str(attributes.get("schema_version", "unknown")),
        "observations": str(attributes.get("observations", "unknown")),
        "their origin": str(attributes.get("observations_source") or "not told"),
        "their digest (SHA-256)": str(attributes.get("observations_digest", "unknown")),
        "drawn by": f"gliderhpc {__version__}, Python {machine.python_version()}",
        "with": ", ".join(f"{name} {metadata.version(name)}" for name in _LIBRARIES),
    }


def _rows(settings: object) -> list[dict[str, Any]]:
    if not isinstance(settings, Mapping):
        return []
    return [{"setting": key, "value": _text(value)} for key, value in flattened(settings)]


def _study_rows(archive: xr.DataTree, studies: Iterable[str]) -> Iterable[dict[str, Any]]:
    for name in studies:
        attributes = archive[name].attrs
        for key in ("estimate", "quick", "software_version"):
            if key in attributes:
                yield {"study": name, "setting": key, "value": _text(attributes[key])}
        own = attributes.get("settings")
        for key, value in flattened(own if isinstance(own, Mapping) else {}):
            yield {"study": name, "setting": key, "value": _text(value)}


def _text(value: Any) -> str:
    return "not set" if value is None else str(value)
