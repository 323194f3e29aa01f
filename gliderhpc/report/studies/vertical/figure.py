"""The figure of the study of vertical velocities: a profile, the mission, and what the hull's numbers do."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
import xarray as xr

from gliderhpc.findings.drawing import FILTER, LANDSCAPE, MEASURED, MODEL, label, legend, limits, panels
from gliderhpc.studies.archived import mission_of
from gliderhpc.studies.vertical.velocity import NAMES

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_CM = 100.0
_SHOWN = ("water_up", "water_up_std", "depth_rate", "depth_rate_still")
_LEGS = {"dive": MODEL, "climb": FILTER}


def vertical_figure(archive: xr.DataTree, table: pd.DataFrame) -> Figure:
    """Draw (a) rates in time and (b) the water's velocity over depth of a profile, (c) the mission, (d) the hull.

    Parameters
    ----------
    archive : xarray.DataTree
        With the group `vertical` filled.
    table : pandas.DataFrame
        A row a profile that has velocities, as the study writes it.
    """
    title = f"Vertical velocity of the water: {mission_of(archive)}"
    figure, (rates, depths, mission, hull) = panels(2, 2, LANDSCAPE, title)
    number = int(table["profile"].iloc[0])
    found, observed = (archive[name].to_dataset().sel(profile=number) for name in ("vertical", "observed"))
    rows = found[[*_SHOWN]].assign({name: observed[name] for name in ("time", "depth")}).load()
    _draw_rates(rates, rows, number)
    _draw_depths(depths, rows, number)
    _draw_mission(mission, table)
    _draw_hull(hull, table)
    return figure


def _draw_rates(axes: Axes, rows: xr.Dataset, number: int) -> None:
    minutes = (rows["time"].values - rows["time"].values[0]) / np.timedelta64(60, "s")
    label(axes, f"(a) depth rate, profile {number}", "minutes", "cm/s, positive down")
    axes.plot(minutes, _CM * rows["depth_rate"], ".", color=MEASURED, markersize=2.0, label="measured, filtered")
    axes.plot(minutes, _CM * rows["depth_rate_still"], ".", color=MODEL, markersize=1.5, label="hull in still water")
    legend(axes)


def _draw_depths(axes: Axes, rows: xr.Dataset, number: int) -> None:
    label(axes, f"(b) the water's velocity with one standard deviation, profile {number}", "cm/s, upward", "depth (m)")
    for leg, colour in _LEGS.items():
        own = (rows["depth_rate_still"] > 0.0) if leg == "dive" else (rows["depth_rate_still"] < 0.0)
        part = rows.where(own, drop=True)
        velocity, deviation = _CM * part["water_up"].values, _CM * part["water_up_std"].values
        axes.errorbar(
            velocity, part["depth"].values, xerr=deviation, fmt=".", color=colour, ecolor=(*_rgb(colour), 0.15),
            markersize=2.0, elinewidth=0.8, label=leg,
        )  # fmt: skip
    axes.invert_yaxis()
    axes.axvline(0.0, color="#666666", linewidth=0.6)
    legend(axes)


def _draw_mission(axes: Axes, table: pd.DataFrame) -> None:
    label(axes, "(c) means over dives and climbs, and their deviation by hull and pitch", "days", "cm/s, upward")
    for leg, colour in _LEGS.items():
        if f"mean_{leg}" in table:
            axes.errorbar(
                table["elapsed_days"], _CM * table[f"mean_{leg}"], yerr=_CM * table[f"mean_std_{leg}"], fmt=".",
                color=colour, ecolor=(*_rgb(colour), 0.3), markersize=5.0, elinewidth=1.0, label=leg,
            )  # fmt: skip
            axes.set_ylim(
                *limits(_CM * table[[n for n in table if n in ("mean_dive", "mean_climb")]].to_numpy(), room=0.5)
            )
    axes.axhline(0.0, color="#666666", linewidth=0.6)
    legend(axes)


def _draw_hull(axes: Axes, table: pd.DataFrame) -> None:
    names = [name for name in NAMES if any(f"by_{name}_{leg}" in table for leg in _LEGS)]
    label(axes, "(d) change of the mean by a plausible deviation of each number, medians", "cm/s", "")
    place = np.arange(len(names))
    for shift, (leg, colour) in zip((-0.2, 0.2), _LEGS.items(), strict=True):
        if f"by_{names[0]}_{leg}" in table:
            changes = [_CM * float(table[f"by_{name}_{leg}"].median()) for name in names]
            axes.barh(place + shift, changes, height=0.35, color=colour, label=leg)
    axes.set_yticks(place, names)
    axes.axvline(0.0, color="#666666", linewidth=0.6)
    legend(axes)


def _rgb(colour: str) -> tuple[float, float, float]:
    red, green, blue = (int(colour[i : i + 2], 16) / 255.0 for i in (1, 3, 5))
    return red, green, blue
