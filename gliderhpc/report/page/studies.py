"""One section a study: what it found, or the command that makes it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import xarray as xr

from gliderhpc.archive.opening import Summary
from gliderhpc.errors import InputError
from gliderhpc.findings.comparison import COLUMNS, Comparison, figure_text
from gliderhpc.findings.findings import Findings
from gliderhpc.report.page.content import Block, Commands, Grid, Notice, Picture, Remarks, Row, Section, Words
from gliderhpc.report.page.mission_table import heading
from gliderhpc.report.page.reproduction import study_command
from gliderhpc.report.studies.registry import SHOWN, show_study, studies_in, study_title
from gliderhpc.store_schema.place import Place

_SHOWN_FAILURES = 10

_MOST_COLUMNS = 14
"""Of a study's table on the page, but for those that the publication has."""


@dataclass(frozen=True)
class Heading:
    """A study's heading on the page, and which of the publication's figures and tables it holds."""

    title: str
    published: str


HEADINGS = {
    "validation": Heading("Forward model against the records", "Figure 1"),
    "reconstruction": Heading("Reconstruction of the motion", "Figures 2 and 3, Table 2"),
    "currents": Heading("Currents, depth-averaged and by depth", "Figure 7"),
    "reanalysis": Heading("Current beside ocean models", "Figure 8, Table 4"),
    "vertical": Heading("Vertical velocity of the water", ""),
    "spectra": Heading("Spectra of the yaw moment", "Figure 4, Table 1"),
    "intermittency": Heading("Intermittency and its surrogates", "Figure 6"),
    "nulls": Heading("Missions without turbulence", "Table 3"),
    "events": Heading("Impulsive events and the verdict on turbulence", "section 5.4"),
    "drift": Heading("Drift of the hull over the mission", "Figure 9, Tables 5 and 6"),
}
"""By name of the study."""

ORDER = ("validation", "reconstruction", "spectra", "intermittency", "nulls", "events", "currents", "reanalysis",
         "vertical", "drift")  # fmt: skip
"""Sections in the order of the publication."""


def study_sections(archive: xr.DataTree, summary: Summary, place: Place) -> list[Section]:
    """All studies in the order of the publication, those that are missing too."""
    known = [*ORDER, *(name for name in SHOWN if name not in ORDER)]
    return [study_section(name, archive, summary, place) for name in known]


def study_section(name: str, archive: xr.DataTree, summary: Summary, place: Place) -> Section:
    """One study: its findings, or why there are none and the command that makes them."""
    about = HEADINGS.get(name, Heading(name.capitalize(), ""))
    command = study_command(name, archive, place)
    present = name in studies_in(archive)
    blocks = _present(name, archive, summary, command) if present else _absent(name, archive, command)
    return Section(name, about.title, (Words(_introduction(name, about)), *blocks))


def _present(name: str, archive: xr.DataTree, summary: Summary, command: str) -> list[Block]:
    try:
        found = show_study(name, archive)
    except InputError as error:
        return [Notice(f"this study cannot be shown: {error}", "warning"), _again(command)]
    return [*_notes(name, archive, summary, found, command), *_shown(name, found, _headings(name, archive))]


def _introduction(name: str, about: Heading) -> str:
    title = study_title(name)
    published = f" ({about.published} of the publication)" if about.published else ""
    return f"{title[0].upper()}{title[1:]}{published}."


def _absent(name: str, archive: xr.DataTree, command: str) -> list[Block]:
    if name in archive.children:
        return [Notice("this study was interrupted, so nothing of it is shown", "warning"), _again(command)]
    return [Commands("The archive does not hold this study. This makes it:", (command,))]


def _again(command: str) -> Commands:
    return Commands("This makes it anew:", (command,))


def _notes(name: str, archive: xr.DataTree, summary: Summary, found: Findings, command: str) -> list[Block]:
    """What the reader must know before looking at the findings."""
    notes: list[Block] = []
    if archive[name].attrs.get("quick"):
        notes.append(Notice("a quick study: few profiles or small ensembles, for a first look and not for a result"))
    if found.remarks:
        notes.append(Remarks(found.remarks))
    if summary.notes.get(name):
        notes += [Notice(f"outdated: {summary.notes[name]}", "warning"), _again(command)]
    failed = [f"profile {number} is left out: {why}" for number, why in found.failed.items()]
    notes += [Notice(text, "warning") for text in failed[:_SHOWN_FAILURES]]
    if len(failed) > _SHOWN_FAILURES:
        notes.append(Notice(f"{len(failed) - _SHOWN_FAILURES} more profiles are left out", "warning"))
    return notes


def _headings(name: str, archive: xr.DataTree) -> dict[str, str]:
    """Heads of the columns that a study's tables take from its group or from the mission's table, with their units."""
    variables = {**archive.to_dataset().variables, **archive[name].to_dataset().variables}
    return {
        str(column): heading(xr.DataArray(variable, name=column)) for column, variable in variables.items()
    }  # fmt: skip


def _shown(name: str, found: Findings, headings: Mapping[str, str]) -> list[Block]:
    """Figures, then the comparison, then tables."""
    blocks: list[Block] = [
        Picture(f"{name}_{stem}", found.captions.get(stem, ""), _alternative(name, stem, found), figure)
        for stem, figure in found.figures.items()
    ]
    blocks += [
        comparison_grid(f"{name}_comparison" + (f"_{index}" if index else ""), rows)
        for index, rows in enumerate(found.comparisons.values()) if rows
    ]  # fmt: skip
    blocks += [
        Grid(
            f"{name}_{stem}",
            found.captions.get(stem, ""),
            [{headings.get(column, column): value for column, value in row.items()} for row in rows],
            None if stem.startswith("table_") else _MOST_COLUMNS,
        )
        for stem, rows in found.tables.items()
    ]
    return blocks


_COMPARED = (
    "The publication's figures beside this mission's, with their ratio (to the nearest end of a range). Another "
    "hull, place or season need not give the same."
)


def _alternative(name: str, stem: str, found: Findings) -> str:
    """Say in a sentence what a figure shows: its title, and what its panels are."""
    figure = found.figures[stem]
    panels = [title for axes in figure.axes if (title := axes.get_title(loc="left") or axes.get_title())]
    title = figure.get_suptitle() or f"{name}, {stem.replace('_', ' ')}"
    return f"{title}. Panels: {'; '.join(panels)}." if panels else f"{title}."


def comparison_grid(stem: str, rows: Sequence[Comparison], title: str = "") -> Grid:
    """A table of the publication's figures beside ours."""
    return Grid(stem, f"{title}{_COMPARED}", [comparison_row(row) for row in rows])


def comparison_row(row: Comparison) -> Row:
    """One figure of the publication beside ours, numbers as numbers."""
    values = (
        row.quantity, row.unit, row.paper_said or figure_text(row.paper), row.ours, figure_text(row.spread), row.ratio,
        row.remark,
    )  # fmt: skip
    return dict(zip(COLUMNS, values, strict=True))
