"""Sizes, colours, panels and shading shared by the studies' figures."""

from __future__ import annotations

import io
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from gliderhpc.observations.profiles import stretches

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

# Okabe and Ito's palette, whose colours colour-blind readers can distinguish.
MEASURED = "#E69F00"
MODEL = "#0072B2"
ESTIMATE = ADJOINT = MODEL
SMOOTHER = "#009E73"
FILTER = "#D55E00"
GLIDE_ANGLE = "#CC79A7"
TRUTH = "#000000"
SHADE = "#999999"

SMALL, TEXT = 7.0, 8.5
DPI = 200
LANDSCAPE = (11.0, 7.6)
_OPAQUE = 255
_COMPRESSION = 3
"""Level of the PNG compression, 0 to 9."""

_LETTERS_PER_INCH = 18.0
"""Letters of the small type per inch, a low estimate."""

_LETTERS_PER_LINE = 36
"""Letters of the larger type per line in the narrowest panels."""


def new_figure(size: tuple[float, float], dpi: int = DPI) -> Figure:
    """Return an empty figure of a size in inches, without pyplot's global state: any thread or worker can draw it."""
    # Importing Matplotlib takes half as long as all other imports together, and most commands draw nothing.
    from matplotlib.figure import Figure

    return Figure(figsize=size, dpi=dpi, layout="constrained")


def panels(
    rows: int, columns: int, size: tuple[float, float], title: str, share_x: bool = False
) -> tuple[Figure, list[Axes]]:
    """Return a figure with a title and a grid of styled panels, row by row."""
    figure = new_figure(size)
    figure.suptitle(title, fontsize=11, fontweight="bold", parse_math=False)
    grid = figure.subplots(rows, columns, squeeze=False, sharex="col" if share_x else False)
    axes = [panel for row in grid for panel in row]
    for panel in axes:
        style_axes(panel)
    return figure, axes


def panel_letters(count: int) -> list[str]:
    """Return the letters of panels in order: a to z, then aa, ab ..."""
    letters = "abcdefghijklmnopqrstuvwxyz"
    names = [*letters, *(first + second for first in letters for second in letters)]
    return names[:count]


def style_axes(axes: Axes) -> None:
    """Style a panel: small labels, a faint grid, and no frame at the top and on the right."""
    axes.tick_params(labelsize=SMALL, length=2.0, width=0.6, pad=2.0)
    axes.tick_params(which="minor", labelsize=SMALL)
    axes.grid(True, linewidth=0.3, color="#CCCCCC")
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def render_image(figure: Figure, form: Literal["png", "svg"]) -> bytes:
    """Return the image of a figure, drawn once. `Figure.savefig` would draw it twice, first for a needless layout."""
    return _svg(figure) if form == "svg" else _png(figure)


def _png(figure: Figure) -> bytes:
    """Encode a figure as PNG with fast compression, and without an alpha channel if every pixel is opaque.

    Matplotlib's own PNG encoder takes nearly twice as long for the same pixels, and its file is as large.
    """
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    canvas = FigureCanvasAgg(figure)
    canvas.draw()  # type: ignore[no-untyped-call]
    metadata, buffer = PngInfo(), io.BytesIO()
    pixels = np.asarray(canvas.buffer_rgba())  # type: ignore[no-untyped-call]
    image = Image.fromarray(pixels)
    if pixels[..., 3].min() == _OPAQUE:
        image = image.convert("RGB")
    metadata.add_text("Software", f"Matplotlib version {mpl.__version__}, https://matplotlib.org/")
    image.save(buffer, "png", compress_level=_COMPRESSION, dpi=(figure.dpi, figure.dpi), pnginfo=metadata)
    return buffer.getvalue()


def _svg(figure: Figure) -> bytes:
    import matplotlib as mpl
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    buffer = io.StringIO()
    # Without a fixed salt the identifiers in an SVG are random, so equal figures would give different files.
    with mpl.rc_context({"svg.hashsalt": "gliderhpc"}):
        FigureCanvasSVG(figure).print_svg(buffer, metadata={"Date": None})  # type: ignore[no-untyped-call]
    return buffer.getvalue().encode()


@dataclass(frozen=True)
class Images:
    """Images of a figure as PNG and SVG, and its width and height in inches."""

    png: bytes
    svg: bytes
    size: tuple[float, float]


def images_of(figure: Figure) -> Images:
    """Draw a figure as PNG and SVG; the figure must not be drawn again, since its layout engine is removed."""
    png = render_image(figure, "png")
    # The SVG uses the layout of the PNG; a second layout would take as long as the drawing.
    figure.set_layout_engine("none")
    width, height = (float(inches) for inches in figure.get_size_inches())
    return Images(png, render_image(figure, "svg"), (width, height))


def footnote(figure: Figure, text: str) -> None:
    """Write a note on the reading and the limits of a figure below its panels, wrapped to its width."""
    width = int(_LETTERS_PER_INCH * figure.get_figwidth())
    lines = [line for part in text.splitlines() for line in textwrap.wrap(part, width)]
    figure.supxlabel("\n".join(lines), fontsize=SMALL)


def label(axes: Axes, title: str = "", x: str = "", y: str = "") -> None:
    """Write a panel's title and the names of its axes."""
    # With a given height, Matplotlib does not search for labels above the panel; there are none.
    axes.set_title(title, fontsize=TEXT, loc="left", y=1.0, parse_math=False)
    axes.set_xlabel(x, fontsize=SMALL + 0.5)
    axes.set_ylabel(y, fontsize=SMALL + 0.5)


def legend(axes: Axes, where: Literal["best", "upper right", "lower right"] = "best") -> None:
    """Draw a panel's legend if any of its curves has a name."""
    if axes.get_legend_handles_labels()[1]:
        axes.legend(loc=where, fontsize=SMALL, framealpha=0.8, edgecolor="none", borderpad=0.3)


def outer_legend(figure: Figure, axes: Sequence[Axes]) -> None:
    """Draw one legend of all curves of some panels to their right, where it covers none; equal names appear once."""
    named: dict[str, Artist] = {}
    for panel in axes:
        for handle, name in zip(*panel.get_legend_handles_labels(), strict=True):
            named.setdefault(name, handle)
    if named:
        figure.legend(
            list(named.values()), list(named), loc="outside right upper", fontsize=SMALL, frameon=False, borderpad=0.3
        )


def mark_empty(axes: Axes, text: str) -> None:
    """Write into an empty panel the reason why nothing is drawn, and remove the ticks of its axes."""
    axes.set(xticks=[], yticks=[])
    axes.text(
        0.5,
        0.5,
        "\n".join(textwrap.wrap(text, _LETTERS_PER_LINE)),
        transform=axes.transAxes,
        ha="center",
        va="center",
        fontsize=TEXT,
    )


def shade(axes: Axes, time: Array, mask: NDArray[np.bool_], name: str | None = None, colour: str = SHADE) -> None:
    """Shade the intervals of a mask along time in a panel's background."""
    step = float(np.median(np.diff(time))) if len(time) > 1 else 1.0
    bars = [(float(time[a]), float(time[b - 1] - time[a]) + step) for a, b in stretches(mask)]
    if bars:
        axes.broken_barh(
            bars,
            (0.0, 1.0),
            transform=axes.get_xaxis_transform(),
            facecolor=colour,
            alpha=0.3,
            linewidth=0.0,
            zorder=0.5,
            label=name,
        )


def limits(values: Array, share: float = 0.5, margin: float = 0.08) -> tuple[float, float]:
    """Return limits of an axis around the percentiles `share` to 100 - `share` of the finite values."""
    known = values[np.isfinite(values)]
    if not known.size:
        return -1.0, 1.0
    low, high = (float(value) for value in np.percentile(known, [share, 100.0 - share]))
    pad = margin * max(high - low, 1e-3)
    return low - pad, high + pad
