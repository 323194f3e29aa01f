"""Findings of any study: comparisons with the paper, tables, figures, and their files."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from rich.table import Table
from rich.text import Text

from gliderhpc.findings.drawing import render_image
from gliderhpc.output_files import filled_aside

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Row = Mapping[str, Any]

_ABSENT = "–"

COLUMNS = ("quantity", "unit", "paper", "ours", "spread", "ratio", "remark")
"""Columns of the table of comparisons."""

NUMBER_COLUMNS = ("paper", "ours", "spread", "ratio")
"""Those that hold numbers."""

_OPTIONAL = ("spread", "remark")


Paper = float | tuple[float, float] | None
"""Value of the paper, its range (lower end first), or None if the paper states none."""


def number(value: float | None) -> str:
    """Format a number with three significant digits, without an exponent if legible; a missing one as a dash."""
    if value is None or not math.isfinite(value):
        return _ABSENT
    if value != 0.0 and not 1e-3 <= abs(value) < 1e5:
        return f"{value:.2e}"
    digits = 2 if value == 0.0 else max(0, 2 - math.floor(math.log10(abs(value))))
    return f"{value:.{digits}f}"


def markdown(columns: Sequence[str], rows: Iterable[Sequence[str]], of_numbers: Collection[str] = ()) -> str:
    """Format cells as a Markdown table, with the columns `of_numbers` right-aligned."""
    rules = ["---:" if column in of_numbers else "---" for column in columns]
    lines = [columns, rules, *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)


def write_csv(path: Path, rows: Sequence[Row]) -> Path:
    """Write rows as CSV; the columns are all keys in order of appearance, and NaN and None are left empty."""
    names = list(dict.fromkeys(name for row in rows for name in row))
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(names)
        writer.writerows([_csv_cell(row.get(name)) for name in names] for row in rows)
    return path


def write_json(path: Path, content: Mapping[str, Any]) -> Path:
    """Write content as JSON, with NaN and infinities as null."""
    path.write_text(json.dumps(as_plain(content), indent=1, ensure_ascii=False, allow_nan=False) + "\n", "utf-8")
    return path


def as_plain(value: Any) -> Any:
    """Convert values of numpy into plain values for JSON; NaN and infinities become None."""
    if isinstance(value, Mapping):
        return {str(key): as_plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [as_plain(entry) for entry in value]
    if isinstance(value, np.generic):
        return as_plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def _csv_cell(value: Any) -> Any:
    if isinstance(value, float):
        return "" if math.isnan(value) else f"{value:.8g}"
    return "" if value is None else value


@dataclass(frozen=True)
class Comparison:
    """Value of one quantity in the paper and in this study.

    Attributes
    ----------
    quantity : str
        Name of the quantity.
    unit : str
        Unit of all its numbers; ``1`` for a ratio or a count.
    ours : float
        Value of this study, NaN if there is none.
    paper : float, (float, float), optional
        Value of the paper, or its range with the lower end first; None if the paper states none.
    spread : (float, float), optional
        Range of our values over the runs: quartiles, unless `remark` states otherwise.
    paper_text : str
        Text of the paper if neither a number nor a range can express it (``<= 0.24``).
    remark : str
        Note for the reader, such as the data behind our value.
    """

    quantity: str
    unit: str
    ours: float
    paper: Paper = None
    spread: tuple[float, float] | None = None
    paper_text: str = ""
    remark: str = ""

    @property
    def ratio(self) -> float | None:
        """Ratio of our value to the paper's (the nearest end of a range, 1 inside it); None if that is meaningless."""
        reference = self.paper
        if isinstance(reference, tuple):
            reference = min(max(self.ours, reference[0]), reference[1])
        if reference is None or reference == 0.0 or not math.isfinite(self.ours):
            return None
        return self.ours / reference

    @property
    def cells(self) -> tuple[str, ...]:
        """Texts of the row, in the order of `COLUMNS`."""
        paper = self.paper_text or figure_text(self.paper)
        return (
            self.quantity,
            self.unit,
            paper,
            number(self.ours),
            figure_text(self.spread),
            number(self.ratio),
            self.remark,
        )


def figure_text(value: Paper) -> str:
    """Format a value or a range as text; a range without ends is a dash, as a missing value is."""
    if not isinstance(value, tuple):
        return number(value)
    low, high = map(number, value)
    return low if low == high == _ABSENT else f"{low} to {high}"


def comparison_table(rows: Sequence[Comparison], title: str) -> Table:
    """Format comparisons as a table for a terminal, with spread and remark only if a row has one."""
    shown = [name not in _OPTIONAL or any(getattr(row, name) for row in rows) for name in COLUMNS]
    table = Table(title=Text(title), title_justify="left")
    for column in _selected(COLUMNS, shown):
        table.add_column(column, justify="right" if column in NUMBER_COLUMNS else "left", overflow="fold")
    for row in rows:
        table.add_row(*map(Text, _selected(row.cells, shown)))
    return table


def comparisons_as_json(rows: Iterable[Comparison]) -> list[dict[str, Any]]:
    """Return comparisons as plain values, including the ratio."""
    return [{**asdict(row), "ratio": row.ratio} for row in rows]


def comparison_from_json(content: Mapping[str, Any]) -> Comparison:
    """Restore a comparison from an entry of `comparisons_as_json` that was read from a JSON file."""
    values = {name: value for name, value in content.items() if name != "ratio"}
    if "paper_said" in values:  # its name in files of earlier versions
        values["paper_text"] = values.pop("paper_said")
    values["ours"] = _known(values["ours"])
    for name in ("paper", "spread"):
        if isinstance(values.get(name), list):
            values[name] = tuple(_known(end) for end in values[name])
    return Comparison(**values)


def _known(value: float | None) -> float:
    return float("nan") if value is None else value


def _selected(values: Sequence[str], shown: Sequence[bool]) -> list[str]:
    return [value for value, is_shown in zip(values, shown, strict=True) if is_shown]


class Drawings(Mapping[str, "Figure"]):
    """Figures by stem, each drawn at its first use, since most runs of a study need only its numbers.

    Parameters
    ----------
    draw : mapping of str to callable
        Function that draws each figure, by stem.
    """

    def __init__(self, draw: Mapping[str, Callable[[], Figure]]) -> None:
        self._draw = dict(draw)
        self._drawn: dict[str, Figure] = {}

    def __getitem__(self, stem: str) -> Figure:
        if stem not in self._drawn:
            self._drawn[stem] = self._draw[stem]()
        return self._drawn[stem]

    def __iter__(self) -> Iterator[str]:
        return iter(self._draw)

    def __len__(self) -> int:
        return len(self._draw)


@dataclass(frozen=True)
class Findings:
    """Comparisons, tables, figures and remarks of a study.

    Attributes
    ----------
    comparisons : mapping of str to sequence of Comparison
        Comparisons with the paper, by the title of their table.
    tables : mapping of str to sequence of mapping
        Rows by stem of the CSV file.
    figures : mapping of str to matplotlib.figure.Figure
        Figures by stem of the PNG file, written at the figure's own resolution.
    content : mapping
        Content of the study's JSON.
    documents : mapping of str to str
        Further text files, by name.
    failed : mapping of int to str
        Profiles that could not be studied, with the reason.
    remarks : tuple of str
        Remarks for the reader, such as a note on an input that was not supplied.
    captions : mapping of str to str
        Captions by stem of a figure or table: method, data, uncertainty and limits of resolution.
    """

    comparisons: Mapping[str, Sequence[Comparison]]
    tables: Mapping[str, Sequence[Row]]
    figures: Mapping[str, Figure]
    content: Mapping[str, Any]
    documents: Mapping[str, str] = field(default_factory=dict)
    failed: Mapping[int, str] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()
    captions: Mapping[str, str] = field(default_factory=dict)


def write_findings(findings: Findings, study: str, folder: str | Path) -> list[Path]:
    """Write a study's tables, figures, JSON and further documents.

    Parameters
    ----------
    findings : Findings
        Findings to write.
    study : str
        Name of the study; the JSON file is ``STUDY.json``.
    folder : str or Path
        Output folder, created if missing; files of the same names are replaced.

    Returns
    -------
    list of Path
        The files, tables first.

    Raises
    ------
    InputError
        The folder cannot be written.
    """
    with filled_aside(Path(folder)) as aside:
        written = [write_csv(aside / f"{stem}.csv", rows) for stem, rows in findings.tables.items()]
        written += [_write_png(aside / f"{stem}.png", figure) for stem, figure in findings.figures.items()]
        written.append(write_json(aside / f"{study}.json", findings.content))
        for name, text in findings.documents.items():
            written.append(aside / name)
            written[-1].write_text(text, "utf-8")
    return [Path(folder) / path.name for path in written]


def _write_png(path: Path, figure: Figure) -> Path:
    path.write_bytes(render_image(figure, "png"))
    return path


def archive_findings(
    study: str,
    *,
    comparisons: Sequence[Comparison],
    tables: Mapping[str, pd.DataFrame],
    figures: Mapping[str, Callable[[], Figure]],
    facts: Mapping[str, Any],
    failed: Mapping[int, str],
    captions: Mapping[str, str],
    remarks: tuple[str, ...] = (),
    documents: Mapping[str, str] | None = None,
) -> Findings:
    """Assemble the findings of a study of an archive: one table of comparisons, and JSON content with it and the facts.

    Figures are passed as functions that draw them. Every figure and table needs a caption; superfluous captions are
    dropped.
    """
    return Findings(
        comparisons={study: comparisons},
        tables={stem: _rows(table) for stem, table in tables.items()},
        figures=Drawings(figures),
        content={
            "comparisons": comparisons_as_json(comparisons),
            "facts": facts,
            "failed": failed,
            "remarks": remarks,
        },
        failed=failed,
        remarks=remarks,
        captions={stem: captions[stem] for stem in (*figures, *tables)},
        documents=documents or {},
    )


def _rows(table: pd.DataFrame) -> list[dict[str, Any]]:
    return [{str(name): value for name, value in row.items()} for row in table.to_dict("records")]
