"""What the figures of the twin experiments share."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gliderhpc.findings.drawing import SMALL, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DPI = 130
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")


def sheet(width: float, height: float) -> Figure:
    """Empty figure of a size in inches."""
    return new_figure((width, height), DPI)


def dress(axes: Axes, x: str, y: str) -> None:
    """Name a panel's axes, small, and take its frame off on two sides."""
    axes.set_xlabel(x, fontsize=SMALL)
    axes.set_ylabel(y, fontsize=SMALL)
    axes.tick_params(which="both", labelsize=SMALL)
    axes.tick_params(which="minor", labelsize=SMALL - 2)
    axes.spines[["top", "right"]].set_visible(False)
