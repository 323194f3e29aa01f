"""Profiles sorted by how fast the water moved, from calm to harsh."""

from collections.abc import Sequence

import numpy as np
import xarray as xr

from gliderhpc.archive.profile import SMOOTHED

UNKNOWN = "unknown"


def speeds(archive: xr.DataTree, numbers: Sequence[int], estimate: str) -> dict[int, float]:
    """Speed of each profile's depth-averaged current (m/s), NaN where there is none."""
    suffix = "_smoothed" if estimate == SMOOTHED else ""
    table = archive.to_dataset()[[f"dac_north{suffix}", f"dac_east{suffix}"]].sel(profile=list(numbers)).load()
    values = np.hypot(table[f"dac_north{suffix}"].values, table[f"dac_east{suffix}"].values)
    return dict(zip(numbers, values.tolist(), strict=True))


def groups_by_speed(speed: dict[int, float], count: int) -> dict[int, str]:
    """Group of each profile: as many of about the same size as asked for, or as there are profiles with a current."""
    known = sorted((number for number in speed if np.isfinite(speed[number])), key=lambda number: speed[number])
    groups = dict.fromkeys(speed, UNKNOWN)
    for name, part in zip(names(min(count, len(known))), np.array_split(known, max(1, count)), strict=False):
        groups |= {int(number): name for number in part}
    return groups


def names(count: int) -> list[str]:
    """Names of so many groups, from calm to harsh."""
    if count < 2:
        return ["all"][:count]
    between = ["middle"] if count == 3 else [f"middle {i + 1}" for i in range(count - 2)]
    return ["calm", *between, "harsh"]
