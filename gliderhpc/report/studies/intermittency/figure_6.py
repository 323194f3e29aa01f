"""Figure 6 of the paper for any profiles: flatness by lag and relative exponents, beside the surrogates' envelopes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
import xarray as xr

from gliderhpc.findings.drawing import MODEL, SHADE, footnote, label, legend, panels
from gliderhpc.she_leveque import she_leveque
from gliderhpc.studies.archived import mission_of
from gliderhpc.studies.library.turbulence.settings import IntermittencySettings
from gliderhpc.studies.library.turbulence.structure import ORDERS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_NAMED = 9
_STYLES = ("-", "--", ":")
_COLOURS = (MODEL, "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")


def figure_6(archive: xr.DataTree, table: pd.DataFrame, settings: IntermittencySettings) -> Figure:
    """Draw (a) the flatness of the increments and (b) the relative exponents of the profiles of a table."""
    title = f"Increments of {settings.channel}, fast part: {mission_of(archive)}"
    figure, (flatness, exponents) = panels(1, 2, (11.0, 5.4), title)
    study = archive["intermittency"].to_dataset().sel(profile=table["profile"].tolist()).load()
    _draw_flatness(flatness, study, table, settings)
    _draw_exponents(exponents, study)
    low, high = settings.scaling
    label(flatness, "(a) flatness", "lag (s)", "flatness of the increments (1)")
    label(exponents, f"(b) relative exponents over {low:g} to {high:g} s", "order p", "zeta_p / zeta_3 (1)")
    legend(flatness)
    legend(exponents)
    footnote(
        figure,
        f"Shaded: envelope of {settings.surrogates} surrogates a profile. Grey band: lags shorter than the records' "
        "sample interval, which are not resolved. Bars: 95 % by a block bootstrap.",
    )
    return figure


def _draw_flatness(axes: Axes, study: xr.Dataset, table: pd.DataFrame, settings: IntermittencySettings) -> None:
    for place, number in enumerate(study["profile"].values[:_NAMED]):
        at = study.sel(profile=number)
        lag, colour = at["lag_time"].values, _COLOURS[place % len(_COLOURS)]
        style = _STYLES[place // len(_COLOURS) % len(_STYLES)]
        axes.plot(lag, at["flatness_by_lag"], style, color=colour, linewidth=1.1, label=f"profile {number}")
        axes.fill_between(
            lag, at["surrogate_flatness_by_lag_least"], at["surrogate_flatness_by_lag_most"], color=colour, alpha=0.12,
            linewidth=0.0,
        )  # fmt: skip
    axes.axhline(3.0, color="black", linewidth=0.7, linestyle=":", label="Gaussian")
    axes.axvline(settings.lag, color="black", linewidth=0.7, linestyle="--", label="lag of the test")
    axes.set_xscale("log")
    axes.set_yscale("log")
    interval = 0.5 / float(table["nyquist"].median())
    left = axes.get_xlim()[0]
    if interval > left:
        axes.axvspan(left, interval, color=SHADE, alpha=0.2, linewidth=0.0, zorder=0.1)
        axes.set_xlim(left=left)


def _draw_exponents(axes: Axes, study: xr.Dataset) -> None:
    orders = np.array(ORDERS, dtype=np.float64)
    axes.fill_between(
        orders, study["surrogate_zeta_least"].min("profile"), study["surrogate_zeta_most"].max("profile"), color=SHADE,
        alpha=0.3, linewidth=0.0, label="surrogates of all profiles",
    )  # fmt: skip
    for place, number in enumerate(study["profile"].values[:_NAMED]):
        at = study.sel(profile=number)
        middle = at["zeta"].values
        errors = np.abs(np.stack([at["zeta_low"].values, at["zeta_high"].values]) - middle)
        shift = 0.03 * (place - 0.5 * min(_NAMED, study.sizes["profile"]))
        axes.errorbar(
            orders + shift, middle, yerr=errors, fmt="o", markersize=2.5, linewidth=0.7,
            color=_COLOURS[place % len(_COLOURS)],
        )  # fmt: skip
    axes.plot(orders, orders / 3.0, "-", color="black", linewidth=0.9, label="K41, p / 3")
    axes.plot(orders, [she_leveque(p) for p in orders], "--", color="black", linewidth=0.9, label="She-Leveque")
