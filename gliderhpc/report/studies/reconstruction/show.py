"""Tables, comparisons, figures and captions of study ``reconstruction``, from its group of an archive alone."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pandas as pd
import xarray as xr

from gliderhpc.findings.findings import Findings, archive_findings
from gliderhpc.report.studies.reconstruction.captions import captions
from gliderhpc.report.studies.reconstruction.figures import figure_2, figure_3, recovery_figure
from gliderhpc.report.studies.reconstruction.table import comparisons
from gliderhpc.studies.archived import column_medians, failed_profiles, platform_of, study_table
from gliderhpc.studies.provenance import kept, provenance_of
from gliderhpc.studies.reconstruction.truth import (
    channel_table,
    impulse_table,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure
from gliderhpc.studies.reconstruction.study import NAME

FIGURE_3_PROFILES = 3


def show(archive: xr.DataTree) -> Findings:
    """Show the study of an archive."""
    made, table, platform = provenance_of(archive, NAME), study_table(archive, NAME), platform_of(archive)
    numbers = list(made.profiles)
    channels, impulses = channel_table(archive, numbers), impulse_table(archive, numbers)
    remarks = made.remarks
    if f"open_loop_{made.estimate}_roll" not in table:
        remarks = (*remarks, "no profile has 600 s of steady glide on end: there is no open-loop comparison")
    tables = {"profiles": table}
    if kept(archive, NAME, "with_truth"):
        tables |= {"channels": channels, "impulses": impulses}
    facts = {
        "profiles": numbers,
        "estimate": made.estimate,
        "quick": made.quick,
        "medians": column_medians(table),
    }
    return archive_findings(
        NAME, comparisons(table, channels, impulses, platform, made.estimate), tables,
        _figures(archive, made.estimate, numbers, channels, impulses), facts, failed_profiles(table)[0], remarks,
        captions=captions(made, table, channels, impulses, numbers[:FIGURE_3_PROFILES]),
    )  # fmt: skip


def _figures(
    archive: xr.DataTree, estimate: str, numbers: list[int], channels: pd.DataFrame, impulses: pd.DataFrame
) -> dict[str, Figure]:
    figures = {
        "figure_2": figure_2(archive, numbers[0], estimate),
        "figure_3": figure_3(archive, numbers[:FIGURE_3_PROFILES], estimate),
    }
    if not channels.empty:
        figures["recovery"] = recovery_figure(channels, impulses, estimate)
    return figures
