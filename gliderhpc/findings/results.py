"""Findings of any study: its comparisons, tables, figures and remarks together, and the files that contain them."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from gliderhpc.findings.comparison import Comparison, comparisons_as_json
from gliderhpc.findings.drawing import render_image
from gliderhpc.output_files import filled_aside

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Row = Mapping[str, Any]


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
