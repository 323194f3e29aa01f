"""Effect of a calibration on some profiles of a real mission on the others."""

from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr

import gliderhpc as gh
from gliderhpc.calibration.estimated_hulls import CalibratedHull
from gliderhpc.calibration.glides.text import SCORES, figures
from gliderhpc.errors import CalibrationError, InputError
from gliderhpc.observations import Observations
from gliderhpc.observations.profile_numbers import evenly_spaced
from gliderhpc.platform import Platform
from gliderhpc.vocabulary import QUALITY

MOST_FITTED = 30
"""Profiles that a hull is calibrated on."""

CHANNELS = {"B_cu": "axial force `B_cu`", "B_cw": "heave force `B_cw`"}
GROUPS = {"series": "adjoint", "smoothed": "smoothed"}
ARROW = " → "

Rows = list[tuple[str, str]]


def shares(observations: Observations, every: int) -> tuple[list[int], list[int]]:
    """Complete profiles to invert, one in so many, and those of the others to calibrate on, spread out."""
    complete = [number for number in observations.profile_numbers if number not in observations.faults]
    inverted = complete[::every]
    rest = [number for number in complete if number not in inverted]
    return inverted, evenly_spaced(rest, MOST_FITTED) if rest else []


def calibrated(
    observations: Observations, platform: Platform, fitted: Sequence[int], inverted: Sequence[int]
) -> CalibratedHull | None:
    """Calibrate a hull on some profiles, as the command does, and score it on those that are inverted; else None."""
    try:
        return gh.calibrate(observations.path, platform, profiles=fitted, hold_out=inverted)
    except (InputError, CalibrationError) as error:
        print(f"{observations.path.name} is not calibrated: {error}")
        return None


def balance_rows(found: CalibratedHull) -> Rows:
    """Errors of the balance at the held-out profiles, before and after."""
    pairs = zip(SCORES[2:], figures(found.held_out.before), figures(found.held_out.after), strict=True)
    return [
        ("calibrated on profiles, segments", f"{len(found.fitted.profiles)}, {found.fitted.segments}"),
        *((f"balance, RMS of {name}", ARROW.join(values)) for name, *values in pairs),
    ]


def disturbance_rows(tree: xr.DataTree) -> Rows:
    """Medians of the longitudinal forces in steady glide: over dives, over climbs, and of their size."""
    table = tree.ds.load()
    done = table.profile.to_numpy()[(table.status == "done").to_numpy()]
    return [
        (f"{what}, {estimate}: median in dives, in climbs, of the magnitude, N", medians(tree, group, channel, done))
        for group, estimate in GROUPS.items()
        for channel, what in CHANNELS.items()
    ]


def medians(tree: xr.DataTree, group: str, channel: str, numbers: Sequence[int]) -> str:
    """Medians of one channel of one estimate over the steady-glide records of some profiles."""
    dives, climbs = [], []
    for number in numbers:
        values, flags = tree[group].ds[channel].sel(profile=number).to_numpy(), flags_of(tree, number)
        if group == "series":
            values = values[:: record_steps(tree)]
        known = np.isfinite(values[: flags.size])
        steady = known & (flags[: known.size] & QUALITY.meanings["vibration"] == 0)
        climbing = flags[: known.size] & QUALITY.meanings["climbing"] > 0
        dives.append(values[: known.size][steady & ~climbing])
        climbs.append(values[: known.size][steady & climbing])
    down, up = np.concatenate(dives), np.concatenate(climbs)
    middles = [np.median(down), np.median(up), np.median(np.abs(np.concatenate([down, up])))]
    return "{:+.2f}, {:+.2f}, {:.2f}".format(*middles)


def flags_of(tree: xr.DataTree, number: int) -> np.ndarray:
    """Flags of a profile on its records."""
    flags = tree["series"].ds.quality.sel(profile=number).to_numpy()
    return np.nan_to_num(flags[:: record_steps(tree)]).astype(int)


def record_steps(tree: xr.DataTree) -> int:
    """Steps from one record to the next."""
    return round(tree.attrs["output_interval"] / tree.attrs["step"])


def changes(before: Rows, after: Rows) -> Rows:
    """Rows of before and after in one; a row that did not change stands once."""
    return [
        (what, old if old == new else f"{old}{ARROW}{new}") for (what, old), (_, new) in zip(before, after, strict=True)
    ]


def merged(columns: Mapping[str, tuple[Rows, Rows | None]]) -> dict[str, Rows]:
    """Before and after in one column a mission, for those that have both."""
    return {name: changes(before, after) for name, (before, after) in columns.items() if after is not None}
