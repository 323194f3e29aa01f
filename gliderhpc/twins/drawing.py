"""Size, colours and axes of the figures of all twin experiments."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gliderhpc.findings.drawing import SMALL, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DPI = 130
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")


def new_sheet(width: float, height: float) -> Figure:
    """Return an empty figure of a size in inches."""
    return new_figure((width, height), DPI)


def label_axes(axes: Axes, x: str, y: str, title: str = "") -> None:
    """Label a panel's axes, add a title if one is given, and remove the frame on two sides."""
    axes.set_xlabel(x, fontsize=SMALL)
    axes.set_ylabel(y, fontsize=SMALL)
    axes.tick_params(which="both", labelsize=SMALL)
    axes.tick_params(which="minor", labelsize=SMALL - 2)
    axes.spines[["top", "right"]].set_visible(False)
    if title:
        axes.set_title(title, loc="left", fontsize=SMALL + 1, parse_math=False)
