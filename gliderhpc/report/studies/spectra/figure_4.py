"""Figure 4 of the paper for any profiles: normalised spectra by group, with the band and what the records resolve."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
import xarray as xr

from gliderhpc.findings.drawing import FILTER, MODEL, SHADE, SMOOTHER, footnote, label, legend, panels
from gliderhpc.report.studies.spectra.table_1 import KOLMOGOROV
from gliderhpc.studies.archived import mission_of
from gliderhpc.studies.library.turbulence.settings import SpectraSettings

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLOURS = (MODEL, FILTER, SMOOTHER, "#CC79A7", "#56B4E9", "#E69F00")
_SHOWN = 6
"""Profiles a panel names; more are drawn thin and grey."""


def figure_4(archive: xr.DataTree, table: pd.DataFrame, settings: SpectraSettings) -> Figure:
    """Draw a panel a group, calm to harsh; each spectrum over the variance that it holds above the cutoff."""
    groups = list(dict.fromkeys(table.sort_values("speed")["group"]))
    title = f"Spectra of {settings.channel}, fast part: {mission_of(archive)}"
    figure, axes = panels(1, len(groups), (max(5.0, 3.9 * len(groups)), 4.8), title)
    study = archive["spectra"].to_dataset()
    for one, (group, place) in zip(axes, zip(groups, "abcdefgh", strict=False), strict=True):
        own = table[table["group"] == group]
        _draw(one, study, own, settings)
        label(one, f"({place}) {group}: {_speeds(own)}", "frequency (Hz)", "density over variance (1/Hz)")
        legend(one)
    footnote(
        figure,
        "Grey: above the records' Nyquist frequency, where the series is what interpolation between samples and "
        "windows make of it.",
    )
    return figure


def _speeds(own: pd.DataFrame) -> str:
    if not own["speed"].notna().any():
        return "current not known"
    return f"{100 * own['speed'].min():.0f} to {100 * own['speed'].max():.0f} cm/s"


def _draw(axes: Axes, study: xr.Dataset, own: pd.DataFrame, settings: SpectraSettings) -> None:
    top, bottom = 0.0, np.inf
    for place, (_, row) in enumerate(own.iterrows()):
        at = study.sel(profile=int(row["profile"]))
        frequency, density = at["frequency_hz"].values, at["density"].values
        shown = (frequency >= settings.cutoff) & np.isfinite(density)
        if not shown.any():
            continue
        variance = float(np.sum(density[shown]) * (frequency[1] - frequency[0]))
        named = place < _SHOWN
        axes.loglog(
            frequency[shown], density[shown] / variance, color=_COLOURS[place] if named else SHADE,
            linewidth=0.9 if named else 0.4, label=_name(row) if named else None,
        )  # fmt: skip
        top = max(top, float(np.max(density[shown] / variance)))
        bottom = min(bottom, float(np.percentile(density[shown] / variance, 2.0)))
        _draw_limits(axes, float(row["nyquist"]), float(frequency[-1]))
    if top == 0.0:
        axes.text(0.5, 0.5, "no spectrum", ha="center", transform=axes.transAxes, fontsize=8)
        return
    band = np.array(settings.band)
    axes.loglog(band, 0.3 * top * (band / band[0]) ** -KOLMOGOROV, "-.", color="black", linewidth=1.0, label="-11/3")
    for end in band:
        axes.axvline(end, color="black", linewidth=0.5, linestyle=":")
    axes.set_ylim(0.1 * bottom, top * 3.0)


def _draw_limits(axes: Axes, nyquist: float, end: float) -> None:
    if nyquist < end:
        axes.axvspan(nyquist, end, color=SHADE, alpha=0.08, linewidth=0.0, zorder=0.1)


def _name(row: pd.Series) -> str:
    return f"{row['profile']}: {row['whole_beta']:.2f}, resolved {row['whole_beta_resolved']:.2f}"
