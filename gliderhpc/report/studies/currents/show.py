"""Tables, comparisons, figures and captions of study ``currents``, from its group of an archive alone."""

import pandas as pd
import xarray as xr

from gliderhpc.archive.profile import read_profile_data
from gliderhpc.findings.comparison import Comparison
from gliderhpc.findings.findings import Findings, archive_findings
from gliderhpc.report.studies.currents.captions import captions
from gliderhpc.report.studies.currents.figure_7 import figure_7
from gliderhpc.report.studies.currents.reference_table import reference_rows
from gliderhpc.studies.archived import column_medians, failed_profiles, study_table
from gliderhpc.studies.currents.settings import DepthResolvedSettings
from gliderhpc.studies.currents.study import NAME
from gliderhpc.studies.provenance import provenance_of

DRAWN = 3
"""Profiles that get a figure."""

PAPER_COEFFICIENT_SHARE, PAPER_ABSOLUTE_SHARE = 0.30, 0.015
"""Effect of 15 % on the moment coefficients on shear and on the absolute current, by the paper."""


def show(archive: xr.DataTree) -> Findings:
    """Show the study of an archive."""
    made, table = provenance_of(archive, NAME), study_table(archive, NAME)
    settings = DepthResolvedSettings.model_validate(made.settings)
    refused, retrieved = failed_profiles(table)
    remarks = made.remarks
    if refused:
        remarks = (*remarks, f"{len(refused)} of {len(table)} profiles: {next(iter(refused.values()))}")
    facts = {
        "profiles": list(made.profiles),
        "estimate": made.estimate,
        "quick": made.quick,
        "settings": settings.model_dump(),
        "medians": column_medians(table),
    }
    drawn = {f"figure_7_profile_{number}": number for number in retrieved["profile"][:DRAWN].tolist()}
    figures = {
        stem: figure_7(archive, read_profile_data(archive, number, made.estimate), settings)
        for stem, number in drawn.items()
    }
    return archive_findings(
        NAME, _comparisons(table), {"currents": table}, figures, facts, {}, remarks,
        captions=captions(made, table, settings, drawn),
    )  # fmt: skip


def _comparisons(table: pd.DataFrame) -> tuple[Comparison, ...]:
    def median(name: str) -> float:
        return float(table[name].median()) if name in table and table[name].notna().any() else float("nan")

    return (
        Comparison("speed of the depth-averaged current, median", "m/s", median("speed"), (0.04, 0.42)),
        Comparison("longer semi-axis of the 1-sigma ellipse, median", "m/s", median("ellipse_major")),
        Comparison("shorter semi-axis of the 1-sigma ellipse, median", "m/s", median("ellipse_minor")),
        Comparison(
            "lateral current, root mean square, median", "m/s", median("shear_rms"),
            remark="shear-sensitive part, a lower bound: the hull follows slow changes",
        ),
        Comparison(
            "its scatter under 15 % on the moment coefficients", "1", median("coefficient_share"),
            PAPER_COEFFICIENT_SHARE,
        ),
        Comparison(
            "the same over the absolute current", "1", median("coefficient_share_absolute"), PAPER_ABSOLUTE_SHARE,
            paper_said="< 0.015",
        ),
        Comparison("share of records beyond twice the noise floor", "1", median("significant_fraction")),
        Comparison("share of the steady glide with a lateral current", "1", median("retrieved_fraction")),
        *reference_rows(table),
    )  # fmt: skip
