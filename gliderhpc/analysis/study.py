"""What a study is: what it is asked, what it finds, and what it leaves in files.

A study is a module of this package with a module-level ``STUDY``; the registry names it. It reads an archive, writes
the archive's group of its name, and returns its findings, which are written here, the same way for every study.
"""

import json
import math
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from gliderhpc.analysis.comparison import Comparison
from gliderhpc.errors import InputError
from gliderhpc.mission.executors import Executor

DPI = 200


@dataclass(frozen=True)
class Request:
    """What a study is asked to do.

    Attributes
    ----------
    archive : Path
        The finished mission.
    executor : callable
        Opens where jobs run.
    profiles : str, optional
        Which profiles, as ``18:20,68``; all that are done when None.
    quick : bool
        A size for a first look, under two minutes on two cores.
    estimate : str
        Whose disturbances: ``adjoint``.
    observations, truth : Path, optional
        The mission's observation file, and a synthetic mission's truth.
    report : callable
        Called with the number of a profile when it is done.
    """

    archive: Path
    executor: Callable[[], AbstractContextManager[Executor]]
    profiles: str | None = None
    quick: bool = False
    estimate: str = "adjoint"
    observations: Path | None = None
    truth: Path | None = None
    report: Callable[[int], None] = lambda _: None


@dataclass(frozen=True)
class Findings:
    """What a study found.

    Attributes
    ----------
    comparisons : tuple of Comparison
        The paper's figures beside ours.
    tables : mapping of str to pandas.DataFrame
        Written as CSV, by the file's stem.
    figures : mapping of str to matplotlib.figure.Figure
        Written as PNG, by the file's stem.
    facts : mapping
        Further figures for the JSON, plain values.
    failed : mapping of int to str
        Profiles that could not be studied, and why.
    remarks : tuple of str
        What the reader should know, such as an input that was not given.
    """

    comparisons: tuple[Comparison, ...]
    tables: Mapping[str, pd.DataFrame]
    figures: Mapping[str, Figure]
    facts: Mapping[str, Any] = field(default_factory=dict)
    failed: Mapping[int, str] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True)
class Study:
    """A study: its name (that of its group and of its module), what it is, what it lacks, and how to run it.

    Attributes
    ----------
    name, title : str
        The verb's argument, and one line for people.
    missing : callable
        Says which of its inputs a request lacks, None where nothing does.
    run : callable
        Does it, group and all.
    """

    name: str
    title: str
    missing: Callable[[Request], str | None]
    run: Callable[[Request], Findings]


def default_folder(archive: str | Path, study: str) -> Path:
    """Where a study's files go unless told otherwise: ``ARCHIVE-studies/STUDY`` beside ``ARCHIVE.zarr``."""
    path = Path(archive)
    return path.with_name(f"{path.stem}-studies") / study


def write_findings(findings: Findings, study: str, folder: str | Path) -> list[Path]:
    """Write a study's tables, figures and JSON.

    Parameters
    ----------
    findings : Findings
        What was found.
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
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        written = [_write_csv(table, folder / f"{stem}.csv") for stem, table in findings.tables.items()]
        written += [_write_png(figure, folder / f"{stem}.png") for stem, figure in findings.figures.items()]
        written.append(_write_json(findings, folder / f"{study}.json"))
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({error.strerror or error}); give another --out") from None
    return written


def as_plain(value: Any) -> Any:
    """Turn numpy's and missing values into what JSON holds: NaN becomes null."""
    if isinstance(value, Mapping):
        return {str(key): as_plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [as_plain(entry) for entry in value]
    if isinstance(value, np.generic):
        return as_plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def _write_csv(table: pd.DataFrame, path: Path) -> Path:
    table.to_csv(path, index=False, float_format="%.6g")
    return path


def _write_png(figure: Figure, path: Path) -> Path:
    figure.savefig(path, dpi=DPI)
    return path


def _write_json(findings: Findings, path: Path) -> Path:
    content = {
        "comparisons": [row.as_json() for row in findings.comparisons],
        "facts": findings.facts,
        "failed": findings.failed,
        "remarks": findings.remarks,
    }
    path.write_text(json.dumps(as_plain(content), indent=2, allow_nan=False) + "\n", "utf-8")
    return path
