"""Figures into files, and into the page itself."""

from __future__ import annotations

import base64
import io
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LARGEST_DRAWING = 150_000
"""Bytes up to which the page holds a figure as SVG, sharp at any size; a larger one as PNG."""


@dataclass(frozen=True)
class Embedded:
    """A figure in the page: its data as an address, its size in points of the screen, and its files' names."""

    address: str
    width: int
    height: int
    png: str
    svg: str | None


def embed(figure: Figure | Path, folder: Path, stem: str) -> Embedded:
    """Write ``STEM.png`` and ``STEM.svg``, and return the smaller way of holding the figure in a page.

    A file of PNG stays what it is, and has no SVG.
    """
    if isinstance(figure, Path):
        content = figure.read_bytes()
        (folder / f"{stem}.png").write_bytes(content)
        return Embedded(_address("png", content), *_size_of(content), f"{stem}.png", None)
    contents = {form: _rendered(figure, form) for form in ("png", "svg")}
    for form, content in contents.items():
        (folder / f"{stem}.{form}").write_bytes(content)
    small = len(contents["svg"]) <= min(LARGEST_DRAWING, 2 * len(contents["png"]))
    address = _address("svg+xml", contents["svg"]) if small else _address("png", contents["png"])
    width, height = (round(96.0 * float(inches)) for inches in figure.get_size_inches())
    return Embedded(address, width, height, f"{stem}.png", f"{stem}.svg")


def _address(kind: str, content: bytes) -> str:
    return f"data:image/{kind};base64,{base64.b64encode(content).decode('ascii')}"


def _size_of(png: bytes) -> tuple[int, int]:
    """Width and height in the header of a PNG file."""
    width, height = struct.unpack(">II", png[16:24])
    return int(width), int(height)


def _rendered(figure: Figure, form: str) -> bytes:
    buffer = io.BytesIO()
    metadata = {"Date": None} if form == "svg" else None
    # SVG draws its identifiers from this instead of from chance, so that the same figure gives the same file.
    import matplotlib as mpl

    with mpl.rc_context({"svg.hashsalt": "gliderhpc"}):
        figure.savefig(buffer, format=form, metadata=metadata)
    return buffer.getvalue()
