"""Files of a page: tables, figures and HTML."""

from __future__ import annotations

import base64
import datetime
import math
import struct
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from jinja2 import Environment, PackageLoader, StrictUndefined

from gliderhpc.errors import InputError
from gliderhpc.findings.drawing import Images, images_of
from gliderhpc.findings.formatting import number
from gliderhpc.findings.results import write_csv
from gliderhpc.output_files import filled_aside
from gliderhpc.report.page.content import FigureBlock, LinkedTable, Page, Table
from gliderhpc.store_schema.location import Location, absolute, is_address
from gliderhpc.version import __version__

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MAX_TABLE_ROWS = 60
"""Maximum number of rows of a table on the page; the CSV file has all rows."""

_PLACES = ("latitude", "longitude")

_PROSE_LENGTH = 30
"""Number of characters above which a text is regarded as prose."""


@dataclass(frozen=True)
class PageColumn:
    """A column of a table on the page; `numeric` sets its alignment."""

    name: str
    numeric: bool


def columns_of(grid: Table) -> list[PageColumn]:
    """Return the columns that the page shows, in order of appearance."""
    return [PageColumn(name, _holds_numbers(row.get(name) for row in grid.rows)) for name in _names(grid)[: grid.shown]]


def shown_rows(grid: Table) -> Sequence[Any]:
    """Return the rows that the page shows."""
    return grid.rows[:MAX_TABLE_ROWS]


def describe_omitted(grid: Table) -> str:
    """Describe the rows and columns that the page does not show; empty if it shows all."""
    rows = max(0, len(grid.rows) - MAX_TABLE_ROWS)
    columns = 0 if grid.shown is None else max(0, len(_names(grid)) - grid.shown)
    parts = [f"{count} more {what}" for count, what in ((rows, "rows"), (columns, "columns")) if count]
    return f"{' and '.join(parts)} are in {grid.stem}.csv." if parts else ""


def _names(grid: Table) -> list[str]:
    return list(dict.fromkeys(name for row in grid.rows for name in row))


def is_number(value: Any) -> bool:
    """Return whether a value is a number, which is aligned to the right."""
    return isinstance(value, int | float | np.number) and not isinstance(value, bool | np.bool_)


def is_prose(value: Any) -> bool:
    """Return whether a value is a text long enough to need a wide column."""
    return isinstance(value, str) and len(value) > _PROSE_LENGTH


def _holds_numbers(values: Iterable[Any]) -> bool:
    known = [value for value in values if value is not None]
    return bool(known) and all(is_number(value) for value in known)


def cell(value: Any, column: str = "") -> str:
    """Format one value: three significant digits, positions to 10 m, times to the second, a dash if missing."""
    if value is None:
        return number(None)
    if isinstance(value, np.datetime64 | datetime.datetime):
        instant = pd.Timestamp(value)
        return number(None) if pd.isna(instant) else f"{instant:%Y-%m-%d %H:%M:%S}"
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    if isinstance(value, float | np.floating):
        is_position = column.partition(",")[0].endswith(_PLACES) and math.isfinite(value)
        return f"{value:.4f}".replace("-", "−") if is_position else _decimal(float(value))
    return str(value)


def _decimal(value: float) -> str:
    if math.isfinite(value) and value == round(value) and abs(value) < 1e5:
        return f"{value:.0f}".replace("-", "−")
    return number(value).replace("-", "−", 1) if math.isfinite(value) and value < 0.0 else number(value)


def check_outside_archives(places: Sequence[Location], folders: Sequence[Path]) -> None:
    """Check that no page is written into an archive.

    Raises
    ------
    InputError
        One of the folders is in an archive.
    """
    stores = {Path(absolute(place)): place for place in places if not is_address(place)}
    for folder in folders:
        inside = {folder.resolve(), *folder.resolve().parents} & set(stores)
        if inside:
            raise InputError(f"{folder}: a page would be written into {stores[inside.pop()]}; give another `out`")


MAX_SVG_BYTES = 150_000
"""Largest SVG figure that is embedded in the page; a larger one is embedded as PNG."""


@dataclass(frozen=True)
class Embedded:
    """A figure embedded in the page: data URL, size in CSS pixels, and the names of its files."""

    address: str
    width: int
    height: int
    png: str
    svg: str | None


def embed(figure: Figure | Images | Path, folder: Path, stem: str) -> Embedded:
    """Write ``STEM.png`` and ``STEM.svg``, and return the more compact of the two for embedding.

    A PNG file is copied, without an SVG.
    """
    if isinstance(figure, Path):
        content = figure.read_bytes()
        (folder / f"{stem}.png").write_bytes(content)
        return Embedded(_address("png", content), *_size_of(content), f"{stem}.png", None)
    images = figure if isinstance(figure, Images) else images_of(figure)
    for form, content in (("png", images.png), ("svg", images.svg)):
        (folder / f"{stem}.{form}").write_bytes(content)
    small = len(images.svg) <= min(MAX_SVG_BYTES, 2 * len(images.png))
    address = _address("svg+xml", images.svg) if small else _address("png", images.png)
    width, height = (round(96.0 * inches) for inches in images.size)
    return Embedded(address, width, height, f"{stem}.png", f"{stem}.svg")


def _address(kind: str, content: bytes) -> str:
    return f"data:image/{kind};base64,{base64.b64encode(content).decode('ascii')}"


def _size_of(png: bytes) -> tuple[int, int]:
    """Read width and height from the header of a PNG file."""
    width, height = struct.unpack(">II", png[16:24])
    return int(width), int(height)


@dataclass(frozen=True)
class ReportFiles:
    """Files of a report: page, tables and figures (as PNG); for several archives, also a line for each failure."""

    page: Path
    tables: tuple[Path, ...]
    figures: tuple[Path, ...]
    failed: tuple[str, ...] = ()


def write_page(page: Page, folder: Path, name: str, footer: str) -> ReportFiles:
    """Render a page into a folder.

    Parameters
    ----------
    page : Page
        Content.
    folder : Path
        Output folder, created if missing; files of the same names are replaced.
    name : str
        Name of the page's file.
    footer : str
        Line at the foot of the page, with time and source.

    Raises
    ------
    InputError
        The folder cannot be written.
    """
    blocks = [block for section in page.sections for block in section.blocks]
    with filled_aside(folder) as aside:
        figures = {
            block.stem: embed(block.figure, aside, block.stem) for block in blocks if isinstance(block, FigureBlock)
        }
        tables = [
            write_csv(aside / f"{block.stem}.csv", block.rows)
            for block in blocks
            if isinstance(block, Table | LinkedTable)
        ]
        (aside / name).write_text(_html(page, figures, footer), "utf-8", "replace")
    return ReportFiles(
        folder / name, tuple(folder / table.name for table in tables), tuple(folder / f.png for f in figures.values())
    )


def _html(page: Page, figures: dict[str, Embedded], footer: str) -> str:
    environment = Environment(
        loader=PackageLoader("gliderhpc.report.page"),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=StrictUndefined,
    )
    environment.filters["cell"] = cell
    environment.tests["prose"] = is_prose
    environment.globals.update(columns_of=columns_of, shown_rows=shown_rows, left_out=describe_omitted)
    return environment.get_template("page.html").render(page=page, figures=figures, footer=footer, version=__version__)
