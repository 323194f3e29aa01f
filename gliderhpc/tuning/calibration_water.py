"""How a calibration's buoyancy goes: by measured density where most of the steady flight has one, else by the slope."""

from collections.abc import Callable
from dataclasses import replace
from typing import Literal

import numpy as np

from gliderhpc.errors import InputError
from gliderhpc.platform import Platform
from gliderhpc.tuning.hull_parameters import TYPICAL_COMPRESSIBILITY, TYPICAL_EXPANSION, with_values
from gliderhpc.tuning.steady_segments import SteadySegments

LEAST_SHARE = 0.5
"""Part of the segments with a known density from which on it is used."""


def choose_buoyancy(
    platform: Platform, segments: SteadySegments, held_out: SteadySegments,
    choice: Literal["auto", "density", "depth_slope"], report: Callable[[str], None] = lambda _: None,
) -> tuple[Platform, SteadySegments, SteadySegments]:  # fmt: skip
    """Give hull and segments for one of the two ways, never mixed: the neutral volume is not the same in both.

    Parameters
    ----------
    platform : Platform
        The hull to start from.
    segments, held_out : SteadySegments
        To fit, and to score.
    choice : str
        The setting ``seawater``.
    report : callable
        Called with what is left out, and why.

    Returns
    -------
    platform, segments, held_out
        By density, with a compressibility to start from and without segments in unknown water; or by depth slope, the
        hull without a compressibility, since its neutral volume will not be one that belongs to a density.

    Raises
    ------
    InputError
        Density is asked for, and no segment has one.
    """
    known = segments.in_known_water
    if choice == "density" and not known.any():
        raise InputError("--set seawater=density: no steady flight of the profiles chosen has a known density")
    if choice == "density" or (choice == "auto" and known.any() and known.mean() >= LEAST_SHARE):
        for number in np.unique(segments.profile[~known]):
            report(f"profile {number} is left out: the density of its water is not known")
        return _compressible(platform), segments.of(known), held_out.of(held_out.in_known_water)
    if choice == "auto" and known.any():
        report(f"by depth slope: only {known.mean():.0%} of the steady flight has a known density")
    if platform.buoyancy.compressibility is not None:
        platform = with_values(platform, {"buoyancy.compressibility": None})
    return platform, _in_unknown_water(segments), _in_unknown_water(held_out)


def _in_unknown_water(segments: SteadySegments) -> SteadySegments:
    return replace(segments, seawater=np.full_like(segments.seawater, np.nan))


def _compressible(platform: Platform) -> Platform:
    """Give a hull a typical compressibility and thermal expansion to start from where it states none."""
    missing: dict[str, float | None] = {}
    if platform.buoyancy.compressibility is None:
        missing["buoyancy.compressibility"] = TYPICAL_COMPRESSIBILITY
    if "thermal_expansion" not in platform.buoyancy.model_fields_set:
        missing["buoyancy.thermal_expansion"] = TYPICAL_EXPANSION
    return with_values(platform, missing)
