"""Findings of a study and their files, the same for every study."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from gliderhpc.findings.comparison import Comparison, comparisons_as_json
from gliderhpc.findings.tables import Row, write_csv, write_json
from gliderhpc.output_files import filled_aside

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Findings:
    """Comparisons, tables, figures and remarks of a study.

    Attributes
    ----------
    comparisons : mapping of str to sequence of Comparison
        Comparisons with the paper, by the title of their table.
    tables : mapping of str to sequence of mapping
        Rows, written as CSV by the file's stem.
    figures : mapping of str to matplotlib.figure.Figure
        Written as PNG by the file's stem, at the figure's own resolution.
    content : mapping
        Content of the study's JSON.
    documents : mapping of str to str
        Further files of text, by name.
    failed : mapping of int to str
        Profiles that could not be studied, and why.
    remarks : tuple of str
        For the reader, such as an input that was not given.
    captions : mapping of str to str
        By stem of a figure or table: what was done, on which data, how sure it is and what it does not resolve.
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
        To write.
    study : str
        Its name; the JSON is ``STUDY.json``.
    folder : str or Path
        Made where it is missing; files of the same names are replaced.

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
        written += [_write_text(aside / name, text) for name, text in findings.documents.items()]
    return [Path(folder) / path.name for path in written]


def _write_png(path: Path, figure: Figure) -> Path:
    figure.savefig(path)
    return path


def _write_text(path: Path, text: str) -> Path:
    path.write_text(text, "utf-8")
    return path


def archive_findings(
    study: str,
    comparisons: Sequence[Comparison],
    tables: Mapping[str, pd.DataFrame],
    figures: Mapping[str, Figure],
    facts: Mapping[str, Any],
    failed: Mapping[int, str],
    remarks: tuple[str, ...] = (),
    *,
    captions: Mapping[str, str],
) -> Findings:
    """Findings of a study of an archive: one table of comparisons, and a JSON that holds it and the facts.

    Every figure and table needs its caption; captions of what is not there are left out.
    """
    return Findings(
        comparisons={study: comparisons},
        tables={stem: _rows(table) for stem, table in tables.items()},
        figures=figures,
        content={
            "comparisons": comparisons_as_json(comparisons), "facts": facts, "failed": failed, "remarks": remarks,
        },
        failed=failed,
        remarks=remarks,
        captions={stem: captions[stem] for stem in (*figures, *tables)},
    )  # fmt: skip


def _rows(table: pd.DataFrame) -> list[dict[str, Any]]:
    return [{str(name): value for name, value in row.items()} for row in table.to_dict("records")]
