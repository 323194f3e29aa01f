"""Tables, comparisons, figures and captions of study ``drift``, from its group of an archive alone."""

from dataclasses import replace

import pandas as pd
import xarray as xr

from gliderhpc.findings.findings import Findings, archive_findings
from gliderhpc.report.studies.drift.captions import captions
from gliderhpc.report.studies.drift.compared import comparisons
from gliderhpc.report.studies.drift.figure_9 import drag_figure, figure_9
from gliderhpc.report.studies.drift.table_5 import table_5, table_5_text
from gliderhpc.report.studies.drift.table_6 import table_6, table_6_text
from gliderhpc.studies.archived import failed_profiles, mission_of, platform_of, study_table
from gliderhpc.studies.drift.change_store import kept_changes
from gliderhpc.studies.drift.change_text import change_rows
from gliderhpc.studies.drift.found import DriftFindings, find_drift, slopes_of_all_samples
from gliderhpc.studies.drift.medians import PRIMARY
from gliderhpc.studies.drift.mission import NAME
from gliderhpc.studies.drift.series import of_epochs
from gliderhpc.studies.drift.settings import DriftSettings
from gliderhpc.studies.drift.spread import kept_slopes
from gliderhpc.studies.drift.verdict import verdict_lines
from gliderhpc.studies.provenance import kept, provenance_of


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
