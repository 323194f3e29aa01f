"""What an archive is, as names and values: for the terminal and for the report's page."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from gliderhpc.archive.opening import Summary


def facts(summary: Summary) -> dict[str, str]:
    """Mission, platform, versions, profiles, time, current and computing time; what is unknown is left out."""
    attributes = summary.attributes
    values = {
        "mission": attributes.get("mission"),
        "platform": _platform_name(attributes.get("platform")),
        "engine": attributes.get("engine"),
        "preset": attributes.get("preset"),
        "software version": attributes.get("software_version"),
        "schema version": attributes.get("schema_version"),
        "observations": attributes.get("observations"),
        "observations' digest": attributes.get("observations_digest"),
        "profiles": ", ".join(f"{count} {status}" for status, count in summary.statuses.items() if count),
        "from": _instant(summary.first_time),
        "to": _instant(summary.last_time),
        "median current": _current(summary),
        "computing time": f"{summary.run_seconds:.0f} s" if summary.run_seconds else None,
    }
    return {what: str(value) for what, value in values.items() if value is not None}


def flattened(settings: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Settings with the names of their sections before them: ``window.length``."""
    for key, value in settings.items():
        if isinstance(value, Mapping):
            yield from flattened(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def _platform_name(platform: object) -> object:
    return platform.get("name") if isinstance(platform, Mapping) else platform


def _instant(time: np.datetime64) -> str | None:
    return None if np.isnat(time) else str(np.datetime_as_string(time, unit="s")) + "Z"


def _current(summary: Summary) -> str:
    current = summary.current
    if not current.count:
        return "none"
    origin = f"median of {current.count} profiles, {current.label}"
    return f"{current.north:+.3f} m/s north, {current.east:+.3f} m/s east ({origin})"
