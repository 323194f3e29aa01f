"""What a page consists of, before anything is drawn or written: sections of blocks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal

if TYPE_CHECKING:
    from matplotlib.figure import Figure


Row = Mapping[str, Any]


@dataclass(frozen=True)
class Words:
    """A paragraph."""

    kind: ClassVar[str] = "words"
    text: str


@dataclass(frozen=True)
class Notice:
    """A remark that must not be overlooked: to mind (`note`), or something wrong (`warning`)."""

    kind: ClassVar[str] = "notice"
    text: str
    level: Literal["note", "warning"] = "note"


@dataclass(frozen=True)
class Remarks:
    """What to mind, one after the other."""

    kind: ClassVar[str] = "remarks"
    texts: tuple[str, ...]


@dataclass(frozen=True)
class Commands:
    """Lines for a shell, and what they do."""

    kind: ClassVar[str] = "commands"
    text: str
    lines: tuple[str, ...]


@dataclass(frozen=True)
class Facts:
    """Names and values, none of which is a table's."""

    kind: ClassVar[str] = "facts"
    rows: Mapping[str, str]


@dataclass(frozen=True)
class Grid:
    """A table.

    Attributes
    ----------
    stem : str
        Of its CSV file.
    caption : str
        What it shows.
    rows : sequence of mapping
        By name of the column; columns are all keys in order of appearance.
    shown : int, optional
        How many of the columns the page shows, all of them when None; the CSV has all.
    """

    kind: ClassVar[str] = "grid"
    stem: str
    caption: str
    rows: Sequence[Row]
    shown: int | None = None


@dataclass(frozen=True, eq=False)
class Picture:
    """A figure.

    Attributes
    ----------
    stem : str
        Of its PNG and SVG files.
    caption : str
        What was done, on which data, and how sure it is.
    alternative : str
        What it shows, for those who do not see it.
    figure : matplotlib.figure.Figure or Path
        Drawn, not yet rendered; or a PNG file, which stays one.
    """

    kind: ClassVar[str] = "picture"
    stem: str
    caption: str
    alternative: str
    figure: Figure | Path


@dataclass(frozen=True)
class Entry:
    """One line of an index: a name, what it is, the anchor of its place, and what to mind."""

    name: str
    what: str
    anchor: str
    remark: str = ""


@dataclass(frozen=True)
class Index:
    """Where on the page something is."""

    kind: ClassVar[str] = "index"
    entries: tuple[Entry, ...]


Block = Words | Notice | Remarks | Commands | Facts | Grid | Picture | Index


@dataclass(frozen=True)
class Section:
    """Blocks under a heading; `anchor` is its place in the page's address."""

    anchor: str
    title: str
    blocks: tuple[Block, ...]


@dataclass(frozen=True)
class Page:
    """A page: its heading, a line below it, and its sections."""

    title: str
    subtitle: str
    sections: tuple[Section, ...]
