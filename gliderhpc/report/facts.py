"""Facts of an archive and of one profile, as text for tables and figures."""

import textwrap
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import xarray as xr

from gliderhpc.archive.current import adopted_current
from gliderhpc.archive.mission import MedianCurrent, Summary, platform_name
from gliderhpc.archive.profile import ProfileData
from gliderhpc.findings.formatting import iso_instant, polar, signed
from gliderhpc.wording import counted


def facts(summary: Summary) -> dict[str, str]:
    """Return mission, platform, versions, profiles, times, current and computing time; omit unknown ones."""
    attributes = summary.attributes
    platform = attributes.get("platform")
    values = {
        "mission": attributes.get("mission"),
        "platform": platform.get("name") if isinstance(platform, Mapping) else platform,
        "engine": attributes.get("engine"),
        "preset": attributes.get("preset"),
        "software version": attributes.get("software_version"),
        "schema version": attributes.get("schema_version"),
        "observations": attributes.get("observations"),
        "observations' digest": attributes.get("observations_digest"),
        "profiles": ", ".join(f"{count} {status}" for status, count in summary.statuses.items() if count),
        "from": iso_instant(summary.first_time),
        "to": iso_instant(summary.last_time),
        "median current": _describe_median_current(summary.current),
        "computing time": f"{summary.run_seconds:.0f} s" if summary.run_seconds else None,
    }
    return {name: str(value) for name, value in values.items() if value is not None}


def flatten_settings(settings: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield settings by dotted name, such as ``window.length``."""
    for key, value in settings.items():
        if isinstance(value, Mapping):
            yield from flatten_settings(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def _describe_median_current(current: MedianCurrent) -> str:
    if not current.count:
        return "none"
    origin = f"median of {counted(current.count, 'profile')}, {current.label}"
    return f"{current.north:+.3f} m/s north, {current.east:+.3f} m/s east ({origin})"


_TITLE_WIDTH, _MESSAGE_WIDTH = 80, 115


def failure_text(number: int, message: str) -> str:
    """Return a failed profile's message; most messages name the profile themselves."""
    return f"profile {number} failed: {message.removeprefix(f'profile {number}: ')}"


def title_of(data: ProfileData) -> str:
    """Return mission, platform and number of the profile."""
    attributes = data.attributes
    title = f"{attributes.get('mission') or 'mission'} · {platform_name(attributes)} · profile {data.number}"
    return textwrap.shorten(title, _TITLE_WIDTH)


def facts_of(data: ProfileData, truth: xr.Dataset | None) -> list[str]:
    """Return lines on the results of a profile; `message_lines` has its message."""
    attributes, table = data.attributes, data.table
    facts = (
        f"preset {attributes.get('preset', 'unknown')} · {counted(int(table['window_count']), 'window')}, "
        f"{table['converged_fraction']:.1%} converged · {data.time[-1] / 60.0:.0f} min, "
        f"to {table['max_depth']:.0f} m"
    )
    lines = [facts, _describe_adopted_current(data), *_describe_other_current(data)]
    if truth is not None:
        lines.append(_describe_true_current(data, truth))
    return lines


def message_lines(data: ProfileData) -> list[str]:
    """Return the message of a profile, shortened and wrapped to lines; empty if it has none."""
    message = str(data.table["message"])
    return textwrap.wrap(f"note: {message}", _MESSAGE_WIDTH, max_lines=3, placeholder=" ...") if message else []


def _describe_adopted_current(data: ProfileData) -> str:
    """Describe the adopted current and its estimator."""
    current = adopted_current(data.table)
    if not current.known:
        return "depth-averaged current unknown"
    north, east = float(current.north), float(current.east)
    return (
        f"depth-averaged current {polar(north, east)}: north {signed(north)} ± {float(current.north_std):.3f}, "
        f"east {signed(east)} ± {float(current.east_std):.3f} m/s ({current.label})"
    )


def _describe_other_current(data: ProfileData) -> list[str]:
    """Describe the inversion's current if the smoother's is adopted; empty if there is none."""
    values = [float(data.table.get(f"dac_{name}", np.nan)) for name in ("north", "north_std", "east", "east_std")]
    if not (adopted_current(data.table).smoothed and np.isfinite(values).all()):
        return []
    north, north_std, east, east_std = values
    return [f"from the adjoint: north {signed(north)} ± {north_std:.3f}, east {signed(east)} ± {east_std:.3f} m/s"]


def _describe_true_current(data: ProfileData, truth: xr.Dataset) -> str:
    north, east = float(truth["current_north"]), float(truth["current_east"])
    current = adopted_current(data.table)
    error = np.hypot(current.north - north, current.east - east)
    off = f"  (error {error:.4f} m/s)" if np.isfinite(error) else ""
    return f"true current {polar(north, east)}: north {signed(north)}, east {signed(east)} m/s{off}"
