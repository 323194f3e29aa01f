"""The measured profiles among the nulls: amplitude, exponent, flatness and spectrum, a point a profile or null."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from gliderhpc.findings.drawing import FILTER, MODEL, SMOOTHER, TRUTH, label, legend, panels
from gliderhpc.report.studies.turbulence.table_3 import unit_of
from gliderhpc.studies.library.turbulence.ensembles import FAMILIES, Ensembles
from gliderhpc.studies.library.turbulence.verdict import SHE_LEVEQUE, TOLERANCE

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_STYLES = {"noise_only": (MODEL, "s"), "model_error": (FILTER, "^"), "gaussian": (SMOOTHER, "D")}


def nulls_figure(ensembles: Ensembles, title: str) -> Figure:
    """Draw (a) relative exponent over largest amplitude and (b) flatness over the exponent of the spectrum."""
    settings = ensembles.settings
    figure, (exponents, spectra) = panels(1, 2, (10.5, 5.0), f"{settings.channel}, measured and nulls: {title}")
    for axes, x, y in ((exponents, "peak", "zeta_ratio"), (spectra, "beta_resolved", "flatness")):
        for family, (colour, marker) in _STYLES.items():
            _points(axes, ensembles.family(family), x, y, colour, marker, FAMILIES[family])
        _points(axes, ensembles.measured, x, y, TRUTH, "o", "measured")
    exponents.axhspan(SHE_LEVEQUE - TOLERANCE, SHE_LEVEQUE + TOLERANCE, color="#999999", alpha=0.3, linewidth=0.0)
    if np.isfinite(ensembles.ceiling):
        exponents.axvline(ensembles.ceiling, color=TRUTH, linewidth=0.7, linestyle="--", label="null ceiling")
    exponents.set_xscale("log")
    spectra.set_yscale("log")
    unit = unit_of(settings.channel)
    label(exponents, "(a) band: She-Leveque within 0.05", f"largest amplitude ({unit})", "zeta_6 / zeta_3 (1)")
    label(spectra, "(b)", "exponent of the spectrum, resolved part (1)", f"flatness over {settings.lag:g} s (1)")
    legend(exponents)
    legend(spectra)
    return figure


def _points(axes: Axes, table: pd.DataFrame, x: str, y: str, colour: str, marker: str, name: str) -> None:
    if len(table):
        axes.plot(table[x], table[y], marker, color=colour, markersize=4.5, alpha=0.8, label=f"{name} ({len(table)})")
