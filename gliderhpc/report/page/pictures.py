"""Figures into files, and into the page itself."""

import base64
import io
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure

LARGEST_DRAWING = 150_000
"""Bytes up to which the page holds a figure as SVG, sharp at any size; a larger one as PNG."""

_SAME_NAMES = {"svg.hashsalt": "gliderhpc"}
"""SVG draws its identifiers from this instead of from chance, so that the same figure gives the same file."""


@dataclass(frozen=True)
class Embedded:
    """A figure in the page: its data as an address, its size in points of the screen, and its files' names."""

    address: str
    width: int
    height: int
    png: str
    svg: str


def embed(figure: Figure, folder: Path, stem: str) -> Embedded:
    """Write ``STEM.png`` and ``STEM.svg``, and return the smaller way of holding the figure in a page."""
    png, svg = _rendered(figure, "png"), _rendered(figure, "svg")
    files = (folder / f"{stem}.png", folder / f"{stem}.svg")
    for path, content in zip(files, (png, svg), strict=True):
        path.write_bytes(content)
    kind, content = ("svg+xml", svg) if len(svg) <= min(LARGEST_DRAWING, 2 * len(png)) else ("png", png)
    address = f"data:image/{kind};base64,{base64.b64encode(content).decode('ascii')}"
    width, height = (round(96.0 * float(inches)) for inches in figure.get_size_inches())
    return Embedded(address, width, height, files[0].name, files[1].name)


def _rendered(figure: Figure, form: str) -> bytes:
    buffer = io.BytesIO()
    metadata = {"Date": None} if form == "svg" else None
    with mpl.rc_context(_SAME_NAMES):
        figure.savefig(buffer, format=form, metadata=metadata)
    return buffer.getvalue()
