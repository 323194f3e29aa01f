"""Sections of the studies and of the twin experiment on windows; index of the paper's figures and tables."""

import csv
import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import xarray as xr

from gliderhpc.archive.mission import Summary
from gliderhpc.archive.reader import Archive
from gliderhpc.errors import InputError
from gliderhpc.findings.comparison import COLUMNS, Comparison, comparison_from_json, range_text
from gliderhpc.findings.results import Findings
from gliderhpc.report.page.content import (
    Block,
    Commands,
    FigureBlock,
    Index,
    Notice,
    PageSection,
    Paragraph,
    Remarks,
    Row,
    Table,
    heading,
    limited_warnings,
)
from gliderhpc.report.page.reproduction import study_command
from gliderhpc.report.studies import show_study, studies_in
from gliderhpc.store_schema.location import Location
from gliderhpc.store_schema.schema import COMPLETE
from gliderhpc.studies.registry import ALL_STUDIES, load_study
from gliderhpc.wording import capitalised, counted

_MAX_COLUMNS = 14
"""Maximum number of columns of a study's table on the page, except for the paper's own tables."""


HEADINGS = {
    "validation": ("Forward model against the records", "Figure 1"),
    "reconstruction": ("Reconstruction of the motion", "Figures 2 and 3, Table 2"),
    "spectra": ("Spectra of the yaw moment", "Figure 4, Table 1"),
    "intermittency": ("Intermittency and its surrogates", "Figure 6"),
    "nulls": ("Missions without turbulence", "Table 3"),
    "events": ("Impulsive events and the verdict on turbulence", "section 5.4"),
    "currents": ("Currents, depth-averaged and by depth", "Figure 7"),
    "reanalysis": ("Current compared with ocean models", "Figure 8, Table 4"),
    "vertical": ("Vertical velocity of the water", ""),
    "hull": ("Hull estimated from the dives", ""),
    "drift": ("Drift of the hull over the mission", "Figure 9, Tables 5 and 6"),
}
"""Heading of each study's section and the paper's figures and tables in it, in the paper's order."""


def study_names() -> list[str]:
    """Return the names of all studies in the order of the paper."""
    return [*HEADINGS, *(name for name in ALL_STUDIES if name not in HEADINGS)]


def study_section(name: str, archive: Archive, summary: Summary, place: Location) -> PageSection:
    """Return the section of one study: its findings, or the reason why there are none and the command for them."""
    heading_text, published = HEADINGS.get(name, (name.capitalize(), ""))
    command = study_command(name, archive, place)
    present = name in studies_in(archive)
    blocks = _present(name, archive, summary, command) if present else _absent(name, archive, command)
    title, reference = load_study(name).title, f" ({published} of the paper)" if published else ""
    introduction = Paragraph(f"{capitalised(title)}{reference}.")
    return PageSection(name, heading_text, (introduction, *blocks))


def _present(name: str, archive: Archive, summary: Summary, command: str) -> list[Block]:
    try:
        findings = show_study(name, archive)
        shown = _study_blocks(name, findings, _headings(name, archive))
    except InputError as error:
        return [Notice(f"this study cannot be shown: {error}", "warning"), _rerun(command)]
    return [*_notes(name, archive, summary, findings, command), *shown]


def _absent(name: str, archive: Archive, command: str) -> list[Block]:
    # A group that the mission writes and a study extends has this attribute only after the study has begun.
    if name in archive.children and COMPLETE in archive[name].attrs:
        return [Notice("this study was interrupted, so its results are not shown", "warning"), _rerun(command)]
    return [Commands("This study is not in the archive. To run it:", (command,))]


def _rerun(command: str) -> Commands:
    return Commands("To run it again:", (command,))


def _notes(name: str, archive: Archive, summary: Summary, findings: Findings, command: str) -> list[Block]:
    """Collect the caveats of the findings."""
    notes: list[Block] = []
    if archive[name].attrs.get("quick"):
        notes.append(Notice("a quick study with few profiles or small ensembles: a preview, not a result"))
    if findings.remarks:
        notes.append(Remarks(findings.remarks))
    if summary.notes.get(name):
        notes += [Notice(f"outdated: {summary.notes[name]}", "warning"), _rerun(command)]
    failed = [f"profile {number} is left out: {why}" for number, why in findings.failed.items()]
    return [*notes, *limited_warnings(failed, "profiles are left out")]


def _headings(name: str, archive: Archive) -> dict[str, str]:
    """Return the headings, with units, of a study's columns that come from its group or from the mission's table."""
    variables = {**archive.to_dataset().variables, **archive[name].to_dataset().variables}
    return {str(column): heading(xr.DataArray(variable, name=column)) for column, variable in variables.items()}


def _study_blocks(name: str, findings: Findings, headings: Mapping[str, str]) -> list[Block]:
    """Return figures, then the comparison, then tables."""
    blocks: list[Block] = [
        FigureBlock(f"{name}_{stem}", findings.captions.get(stem, ""), _alternative(name, stem, findings), figure)
        for stem, figure in findings.figures.items()
    ]
    blocks += [
        comparison_block(f"{name}_comparison" + (f"_{index}" if index else ""), rows)
        for index, rows in enumerate(findings.comparisons.values())
        if rows
    ]
    blocks += [
        Table(
            f"{name}_{stem}",
            findings.captions.get(stem, ""),
            [{headings.get(column, column): value for column, value in row.items()} for row in rows],
            None if stem.startswith("table_") else _MAX_COLUMNS,
        )
        for stem, rows in findings.tables.items()
    ]
    return blocks


_COMPARISON_CAPTION = (
    "The paper's values and this mission's, with their ratio (to the nearest end of a range). Another "
    "hull, place or season may give different values."
)


def _alternative(name: str, stem: str, findings: Findings) -> str:
    """Describe a figure by its title and those of its panels."""
    figure = findings.figures[stem]
    panels = [title for axes in figure.axes if (title := axes.get_title(loc="left") or axes.get_title())]
    title = figure.get_suptitle() or f"{name}, {stem.replace('_', ' ')}"
    return f"{title}. Panels: {'; '.join(panels)}." if panels else f"{title}."


def comparison_block(stem: str, rows: Sequence[Comparison], title: str = "") -> Table:
    """Return a table that compares the paper's values with ours."""
    return Table(stem, f"{title}{_COMPARISON_CAPTION}", [comparison_row(row) for row in rows])


def comparison_row(row: Comparison) -> Row:
    """Return the row of one comparison, with numbers left unformatted."""
    values = (
        row.quantity,
        row.unit,
        row.paper_text or range_text(row.paper),
        row.ours,
        range_text(row.spread),
        row.ratio,
        row.remark,
    )
    return dict(zip(COLUMNS, values, strict=True))


_WINDOWS = "windows"
_WINDOWS_TITLE = "Window length, from twin experiments"

_WINDOWS_INTRODUCTION = (
    "Simulated dives whose disturbance is known, inverted with windows of several lengths, margins and tolerances, "
    "overlapping and non-overlapping (Figure 5 of the paper). The study does not depend on the mission; the default "
    "windows were chosen from it."
)
_WINDOWS_CAPTION = (
    "(a) and (b): the identified yaw moment and the truth, with overlapping and non-overlapping windows. (c): errors "
    "relative to the truth, cost and discontinuities at the seams, as functions of the window length; (d) to (f): as "
    "functions of other settings. Markers are medians over the twins, whose number is in the table."
)


def windows_section(twins: Path | None, platform: str) -> PageSection:
    """Return the section of the twin experiment in a folder; without a folder, it has the command that runs it."""
    if twins is None:
        command = f"gliderhpc twin windows --platform {platform} --out twins"
        remedy = "They were not given. To run them, for `gliderhpc report ... --twins twins`:"
        return PageSection(_WINDOWS, _WINDOWS_TITLE, (Paragraph(_WINDOWS_INTRODUCTION), Commands(remedy, (command,))))
    content, rows = _read_twins(twins)
    blocks: list[Block] = [Paragraph(_WINDOWS_INTRODUCTION)]
    if content.get("quick"):
        blocks.append(Notice("a quick study with few twins and settings: a preview, not a result"))
    hulls, seeds = ", ".join(content["platforms"]), len(content["seeds"])
    caption = f"{hulls}, {counted(seeds, 'twin')} per setting. {_WINDOWS_CAPTION}"
    shown = "Yaw moment from overlapping and non-overlapping windows with the truth, and scores over the window length."
    blocks.append(FigureBlock("windows_windows", caption, shown, twins / f"{_WINDOWS}.png"))
    blocks += [
        comparison_block(f"windows_comparison_{index}", [comparison_from_json(row) for row in table], f"{title}. ")
        for index, (title, table) in enumerate(content["comparisons"].items())
        if table
    ]
    blocks.append(Table("windows_runs", "All inverted twins.", rows, shown=12))
    return PageSection(_WINDOWS, _WINDOWS_TITLE, tuple(blocks))


def _read_twins(twins: Path) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Read the output of ``twin windows`` in a folder: the content of its JSON file, and the rows of its CSV file.

    Raises
    ------
    InputError
        The folder does not contain this output.
    """
    try:
        content: dict[str, Any] = json.loads((twins / f"{_WINDOWS}.json").read_text("utf-8"))
        with (twins / f"{_WINDOWS}.csv").open(encoding="utf-8", newline="") as file:
            rows = [{name: _number_or_text(text) for name, text in row.items()} for row in csv.DictReader(file)]
        (twins / f"{_WINDOWS}.png").stat()
    except OSError as error:
        raise InputError(
            f"{error.filename}: cannot be read ({error.strerror}); give the output folder of `gliderhpc twin windows`"
        ) from None
    except (json.JSONDecodeError, UnicodeDecodeError):
        raise _not_of_twins(twins) from None
    if not isinstance(content, dict) or not {"platforms", "seeds", "comparisons"} <= content.keys():
        raise _not_of_twins(twins)
    return content, rows


def _not_of_twins(twins: Path) -> InputError:
    return InputError(f"{twins / _WINDOWS}.json: not an output of `gliderhpc twin windows`; run it again")


def _number_or_text(text: str) -> Any:
    for kind in (int, float):
        with suppress(ValueError):
            return kind(text)
    return text or None


PUBLISHED = (
    ("Figure 1", "forward model against the records, and its error over the mission", "validation"),
    ("Figure 2", "motion reconstructed and measured", "reconstruction"),
    ("Figure 3", "yaw moment by adjoint and filter", "reconstruction"),
    ("Table 1", "exponents of the spectra by depth", "spectra"),
    ("Figure 4", "spectra of the yaw moment, from calm to harsh", "spectra"),
    ("Table 2", "cost and accuracy of the reconstruction", "reconstruction"),
    ("Figure 5", "window length, from twin experiments", "windows"),
    ("Table 3", "missions without turbulence", "nulls"),
    ("Figure 6", "flatness and exponents, with surrogates", "intermittency"),
    ("Figure 7", "depth-resolved current of a profile", "currents"),
    ("Figure 8", "depth-averaged current and ocean models", "reanalysis"),
    ("Table 4", "the same in numbers", "reanalysis"),
    ("Figure 9", "drift of the six disturbances", "drift"),
    ("Table 5", "statistics of the drift", "drift"),
    ("Table 6", "robustness of the drift", "drift"),
)
"""Name, subject and study of the paper's figures and tables; the study is the anchor of its section."""


def published_section(archive: Archive, with_windows: bool) -> PageSection:
    """Return an index of the paper's figures and tables, with a remark on those that are missing."""
    present = [*studies_in(archive), *(["windows"] if with_windows else [])]
    missing = "missing; its section gives the command that creates it"
    entries = tuple(
        {"name": name, "subject": subject, "anchor": study, "remark": "" if study in present else missing}
        for name, subject, study in PUBLISHED
    )
    introduction = Paragraph("The paper's figures and tables for this mission.")
    return PageSection("published", "Index of the paper's figures and tables", (introduction, Index(entries)))
