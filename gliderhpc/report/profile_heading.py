"""What stands above a profile's figure, in words: whose profile it is, what became of it, and the current."""

import textwrap
from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from gliderhpc.archive.profile import ProfileData
from gliderhpc.archive.taken_current import taken_current

_WIDEST_TITLE, _WIDEST_MESSAGE = 80, 115


def title_of(data: ProfileData) -> str:
    """Mission, platform and number of the profile."""
    attributes = data.attributes
    title = f"{attributes.get('mission') or 'mission'} · {platform_name(attributes)} · profile {data.number}"
    return textwrap.shorten(title, _WIDEST_TITLE)


def facts_of(data: ProfileData, truth: xr.Dataset | None) -> list[str]:
    """Lines on what came out of the profile, its message last."""
    attributes, table = data.attributes, data.table
    facts = (
        f"preset {attributes.get('preset', 'unknown')} · {int(table['window_count'])} windows, "
        f"{table['converged_fraction']:.1%} converged · {data.time[-1] / 60.0:.0f} min, "
        f"to {table['max_depth']:.0f} m"
    )
    lines = [facts, _current(data), *_other_current(data)]
    if truth is not None:
        lines.append(_true_current(data, truth))
    message = str(table["message"])
    if message:
        lines += textwrap.wrap(f"note: {message}", _WIDEST_MESSAGE, max_lines=3, placeholder=" ...")
    return lines


def instant(epoch: np.datetime64) -> str:
    """A time to the second, UTC."""
    return str(np.datetime_as_string(epoch, unit="s")).replace("T", " ") + " UTC"


def signed(value: float, form: str = ".3f") -> str:
    """Signed number with a real minus sign, as on the axes."""
    return f"{value:+{form}}".replace("-", "−")


def polar(north: float, east: float) -> str:
    """A current by speed and the direction it flows to."""
    towards = round(np.degrees(np.arctan2(east, north))) % 360
    return f"{np.hypot(north, east):.3f} m/s towards {towards:03d}°"


def platform_name(attributes: Mapping[str, Any]) -> str:
    """Name of the hull of an archive, by its root attributes."""
    platform = attributes.get("platform")
    return str(platform.get("name")) if isinstance(platform, Mapping) else "unknown platform"


def _current(data: ProfileData) -> str:
    """Line about the current that is taken, and what it is made by."""
    current = taken_current(data.table)
    if not current.known:
        return "depth-averaged current unknown"
    north, east = float(current.north), float(current.east)
    return (
        f"depth-averaged current {polar(north, east)}: north {signed(north)} ± {float(current.north_std):.3f}, "
        f"east {signed(east)} ± {float(current.east_std):.3f} m/s ({current.label})"
    )


def _other_current(data: ProfileData) -> list[str]:
    """Line about the inversion's current where the smoother's is taken, none where there is none."""
    values = [float(data.table.get(f"dac_{name}", np.nan)) for name in ("north", "north_std", "east", "east_std")]
    if not (taken_current(data.table).smoothed and np.isfinite(values).all()):
        return []
    north, north_std, east, east_std = values
    return [f"by the inversion: north {signed(north)} ± {north_std:.3f}, east {signed(east)} ± {east_std:.3f} m/s"]


def _true_current(data: ProfileData, truth: xr.Dataset) -> str:
    north, east = float(truth["current_north"]), float(truth["current_east"])
    current = taken_current(data.table)
    error = np.hypot(current.north - north, current.east - east)
    off = f"  (error {error:.4f} m/s)" if np.isfinite(error) else ""
    return f"true current {polar(north, east)}: north {signed(north)}, east {signed(east)} m/s{off}"
