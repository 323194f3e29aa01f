"""Study ``drift``: long-term drift of the disturbances, and what it says of the hull (section 5.6)."""

from dataclasses import replace
from typing import Any

import pandas as pd
import xarray as xr

from gliderhpc.analysis.archived import failed_profiles, mission_of, platform_of, study_table
from gliderhpc.analysis.drift.captions import captions
from gliderhpc.analysis.drift.change_store import changes_to_keep, kept_changes
from gliderhpc.analysis.drift.change_text import change_rows
from gliderhpc.analysis.drift.compared import comparisons
from gliderhpc.analysis.drift.figure_9 import drag_figure, figure_9
from gliderhpc.analysis.drift.found import DriftFindings, find_drift, slopes_of_all_samples
from gliderhpc.analysis.drift.medians import PRIMARY
from gliderhpc.analysis.drift.mission import NAME, Studied, study_mission
from gliderhpc.analysis.drift.series import of_epochs
from gliderhpc.analysis.drift.settings import DriftSettings
from gliderhpc.analysis.drift.spread import kept_slopes, slope_labels, slopes_to_keep
from gliderhpc.analysis.drift.table_5 import table_5, table_5_text
from gliderhpc.analysis.drift.table_6 import table_6, table_6_text
from gliderhpc.analysis.drift.verdict import verdict_lines
from gliderhpc.analysis.findings import Findings
from gliderhpc.analysis.provenance import Provenance, kept, provenance_of
from gliderhpc.analysis.study import Request, Study, archive_findings, begin_study, conclude_study, own_assignments
from gliderhpc.analysis.trend import LEAST
from gliderhpc.mission.archive import open_for_reading
from gliderhpc.mission.planning import select_profiles
from gliderhpc.mission.profile_data import ADJOINT, done_profiles
from gliderhpc.mission.settings import build_settings_of
from gliderhpc.store_schema import write_table_rows, write_whole
from gliderhpc.store_schema.studies.drift import CHANGE

_OF_ARCHIVE = ("profile", "elapsed_days")
"""Columns that the archive holds elsewhere."""

QUICK_EPOCHS, QUICK_DRAWS = 4, 10
"""What a first look takes."""


def missing_input(request: Request) -> str | None:
    """Say what is lacking: profiles enough for a trend."""
    with open_for_reading(request.archive) as archive:
        done = done_profiles(archive)
    count = len(select_profiles(done, request.profiles)) if done else 0
    return None if count >= LEAST else f"a trend takes {LEAST} finished profiles or more, and these are {count}"


def run(request: Request) -> Findings:
    """Study the epochs of a mission and its change points, into the archive's group ``drift``.

    Raises
    ------
    InputError
        Fewer than four profiles have medians, or a setting is wrong.
    """
    settings = _settings(request)
    studied = study_mission(request, settings)
    changes = studied.changes
    sizes = {CHANGE: max(1, len(changes.found))}
    remarks = begin_study(request, NAME, sizes, labels=slope_labels(studied.slopes))
    if request.estimate != ADJOINT:
        remarks += ("all estimates stand side by side in this study, so --estimate changes nothing",)
    write_table_rows(request.archive, _stored(studied), NAME)
    write_whole(request.archive, NAME, {**slopes_to_keep(studied.slopes), **changes_to_keep(changes)})
    band = studied.mission.band
    made = Provenance(
        tuple(studied.mission.numbers), tuple(map(str, studied.table)), request.estimate, request.quick,
        settings.model_dump(mode="json"), (*remarks, band.remark) if band.remark else remarks,
    )  # fmt: skip
    more = {"depth_band": (band.low, band.high), "segments": studied.segments, "p_of_next_change": changes.p}
    return conclude_study(request.archive, STUDY, made, more)


def _settings(request: Request) -> DriftSettings:
    settings = build_settings_of(DriftSettings, {}, own_assignments(request, NAME))
    if not request.quick:
        return settings
    coefficients = settings.coefficients
    few = coefficients.model_copy(update={"draws": min(coefficients.draws, QUICK_DRAWS)})
    epochs = QUICK_EPOCHS if settings.epochs is None else min(settings.epochs, QUICK_EPOCHS)
    none = settings.changes.model_copy(update={"most": 0})
    return settings.model_copy(update={"epochs": epochs, "coefficients": few, "changes": none})


def _stored(studied: Studied) -> dict[int, dict[str, Any]]:
    """Rows of the archive's table by position, without what is missing."""
    return {
        studied.mission.where[row["profile"]]: {
            str(name): value for name, value in row.items() if name not in _OF_ARCHIVE and not pd.isna(value)
        }
        for row in studied.table.to_dict("records")
    }


def show(archive: xr.DataTree) -> Findings:
    """Show the study of an archive: trends, drag and verdict are found anew in the medians and slopes that it keeps."""
    made, table, slopes = provenance_of(archive, NAME), study_table(archive, NAME), kept_slopes(archive)
    settings = DriftSettings.model_validate(made.settings)
    changes = kept_changes(archive)
    found = find_drift(table, platform_of(archive), settings, slopes, changes)
    increase = settings.drag_increase
    rows_5 = table_5(found.trends)
    rows_6 = table_6(slopes, slopes_of_all_samples(found)) if slopes else []
    band, segments = kept(archive, NAME, "depth_band"), kept(archive, NAME, "segments")
    change_table = change_rows(changes, found.verdict.drags[0].reference)
    facts = {
        "profiles": list(made.profiles),
        "epochs": [tuple(epoch["profile"].tolist()) for _, epoch in of_epochs(table).groupby("epoch")],
        "depth_band": band,
        "quick": made.quick,
        "settings": settings.model_dump(),
        "verdict": found.verdict.as_json(increase),
        "segments": segments,
        "table_5": rows_5,
        "table_6": rows_6,
    }
    further = {"table_6": rows_6, "changes": change_table}
    tables = {"medians": table, "table_5": pd.DataFrame(rows_5)}
    tables |= {stem: pd.DataFrame(rows) for stem, rows in further.items() if rows}
    figures = {
        "figure_9": figure_9(mission_of(archive), table, found.primary, changes.found),
        "drag": drag_figure(mission_of(archive), table, found.verdict.drags, changes.found),
    }
    said = (*made.remarks, *_inputs(found), *verdict_lines(found.verdict, found.primary, increase))
    findings = archive_findings(
        NAME, comparisons(found.trends, found.verdict, slopes, found.witness, increase), tables, figures, facts,
        failed_profiles(table)[0], said,
        captions=captions(made, table, found, settings, band, segments),
    )  # fmt: skip
    documents = {
        "table_5.md": table_5_text(rows_5),
        "table_6.md": table_6_text(rows_6, settings.coefficients, found.witness),
    }
    return replace(findings, documents=documents)


def _inputs(found: DriftFindings) -> tuple[str, ...]:
    """Say what of the study's inputs was not there."""
    remarks = []
    if found.witness is None:
        remarks.append("no second witness: run `gliderhpc validate` on the archive first for the forward model's error")
    if not found.slopes:
        remarks.append(
            "no coefficients drawn: the intervals hold the scatter of the profiles and an unknown heave alone"
        )
    if len(found.verdict.drags) < len(PRIMARY):
        remarks.append("the archive holds no smoothed estimate: the verdict is the adjoint's alone")
    return tuple(remarks)


STUDY = Study(NAME, "long-term drift: is the hull fouling, since when, how much, how sure", show, missing_input, run)
"""What the registry finds."""
