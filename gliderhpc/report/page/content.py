"""Content of a page, independent of its rendering: sections of blocks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
import xarray as xr

from gliderhpc.findings.drawing import Images, images_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure


Row = Mapping[str, Any]


@dataclass(frozen=True)
class Paragraph:
    """A paragraph."""

    kind: ClassVar[str] = "paragraph"
    text: str


@dataclass(frozen=True)
class Notice:
    """A remark set apart from the text: a caveat (`note`) or a problem (`warning`)."""

    kind: ClassVar[str] = "notice"
    text: str
    level: Literal["note", "warning"] = "note"


@dataclass(frozen=True)
class Remarks:
    """A list of remarks under a heading."""

    kind: ClassVar[str] = "remarks"
    texts: tuple[str, ...]
    title: str = "Caveats"


@dataclass(frozen=True)
class Commands:
    """Shell commands, with a sentence on their purpose."""

    kind: ClassVar[str] = "commands"
    text: str
    lines: tuple[str, ...]


@dataclass(frozen=True)
class Facts:
    """Names and values outside any table."""

    kind: ClassVar[str] = "facts"
    rows: Mapping[str, str]


@dataclass(frozen=True)
class Table:
    """A table.

    Attributes
    ----------
    stem : str
        Stem of its CSV file's name.
    caption : str
        Caption.
    rows : sequence of mapping
        Values by column name; the columns are all keys in order of appearance.
    shown : int, optional
        Number of columns on the page, None for all; the CSV file has all of them.
    """

    kind: ClassVar[str] = "table"
    stem: str
    caption: str
    rows: Sequence[Row]
    shown: int | None = None


@dataclass(frozen=True, eq=False)
class FigureBlock:
    """A figure.

    Attributes
    ----------
    stem : str
        Stem of the names of its PNG and SVG files.
    caption : str
        Method, data and uncertainty.
    alternative : str
        Description for readers who cannot see the figure.
    figure : matplotlib.figure.Figure, Images or Path
        Figure to draw, its images, or a PNG file to copy.
    """

    kind: ClassVar[str] = "figure"
    stem: str
    caption: str
    alternative: str
    figure: Figure | Images | Path


@dataclass(frozen=True)
class Index:
    """Links to sections of the page, each with name, subject, anchor of the section, and a remark."""

    kind: ClassVar[str] = "index"
    entries: tuple[Mapping[str, str], ...]


@dataclass(frozen=True)
class LinkedTableEntry:
    """Row of a linked table.

    Attributes
    ----------
    title, detail : str
        Heading of the row, and a line below it.
    address : str or None
        Address of the separate page for this row, relative to this page; None if there is none.
    cells : mapping of str to tuple of str
        Lines by column.
    fault : str
        Reason why the row cannot be shown; empty if it can.
    """

    title: str
    detail: str
    address: str | None
    cells: Mapping[str, tuple[str, ...]]
    fault: str = ""


@dataclass(frozen=True)
class LinkedTable:
    """A table with links in its rows, which narrow screens show as a list.

    Attributes
    ----------
    stem, caption : str
        Stem of the CSV file's name, and caption.
    columns : tuple of str
        Headings; the first is that of the entries' titles, the others are those of the cells.
    entries : tuple of LinkedTableEntry
        Rows on the page.
    rows : sequence of mapping
        Rows of the CSV file.
    """

    kind: ClassVar[str] = "linked_table"
    stem: str
    caption: str
    columns: tuple[str, ...]
    entries: tuple[LinkedTableEntry, ...]
    rows: Sequence[Row]


Block = Paragraph | Notice | Remarks | Commands | Facts | Table | LinkedTable | FigureBlock | Index


@dataclass(frozen=True)
class PageSection:
    """Blocks under a heading; `anchor` is the fragment of its address."""

    anchor: str
    title: str
    blocks: tuple[Block, ...]


def drawn(section: PageSection) -> PageSection:
    """Return a section with its figures drawn."""
    return replace(section, blocks=tuple(_drawn(block) for block in section.blocks))


def _drawn(block: Block) -> Block:
    if not isinstance(block, FigureBlock) or isinstance(block.figure, Images | Path):
        return block
    return replace(block, figure=images_of(block.figure))


@dataclass(frozen=True)
class Page:
    """A page: its heading, a line below it, its sections, and the style sheet that it needs in addition."""

    title: str
    subtitle: str
    sections: tuple[PageSection, ...]
    stylesheet: str | None = None


_MAX_WARNINGS = 10


def limited_warnings(texts: Sequence[str], remainder: str) -> list[Block]:
    """Return at most ten warnings, and one more with the number of the others, followed by `remainder`."""
    blocks: list[Block] = [Notice(text, "warning") for text in texts[:_MAX_WARNINGS]]
    if len(texts) > _MAX_WARNINGS:
        blocks.append(Notice(f"{len(texts) - _MAX_WARNINGS} more {remainder}", "warning"))
    return blocks


def heading(variable: xr.DataArray) -> str:
    """Return a variable's name with its unit, as the heading of a column."""
    units = str(variable.attrs.get("units", "1"))
    timed = np.issubdtype(variable.dtype, np.datetime64)
    return str(variable.name) if units == "1" or timed else f"{variable.name}, {units}"
