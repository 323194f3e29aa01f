"""Loading a platform for use: the file's own checks, and whether the hull can glide at all."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from gliderhpc.errors import InputError
from gliderhpc.flight.glider import Glider
from gliderhpc.flight.steady_glide import glides_stably
from gliderhpc.platform import Platform, read_platform, with_overrides


def load_platform(name_or_path: str | Path, overrides: Mapping[str, str] | None = None) -> Platform:
    """Read a platform, apply overrides, and refuse a hull that cannot glide.

    Parameters
    ----------
    name_or_path : str or Path
        A shipped hull's name or the path of a platform file.
    overrides : mapping of str to str, optional
        Dotted keys with values as YAML, ``{"buoyancy.neutral_volume": "-215"}``.

    Returns
    -------
    Platform

    Raises
    ------
    InputError
        As :func:`gliderhpc.platform.read_platform`, or the hull has no stable steady dive or no stable steady climb.
    """
    platform = with_overrides(read_platform(name_or_path), overrides or {})
    if not glides_stably(Glider(platform)):
        raise InputError(
            f"{name_or_path}: this hull has no stable steady dive and climb at usual ballast and pitch; "
            "check that its masses hang below the centre of buoyancy (z positive), its damping, and K_M and K_MY"
        )
    return platform
