"""What the figures of the twin experiments share."""

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gliderhpc.analysis.drawing import SMALL

DPI = 130
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")


def sheet(width: float, height: float) -> Figure:
    """Figure of a size in inches, built from objects alone so that any thread or worker can draw."""
    return Figure(figsize=(width, height), dpi=DPI, layout="constrained")


def dress(axes: Axes, x: str, y: str) -> None:
    """Name a panel's axes, small, and take its frame off on two sides."""
    axes.set_xlabel(x, fontsize=SMALL)
    axes.set_ylabel(y, fontsize=SMALL)
    axes.tick_params(which="both", labelsize=SMALL)
    axes.tick_params(which="minor", labelsize=SMALL - 2)
    axes.spines[["top", "right"]].set_visible(False)
