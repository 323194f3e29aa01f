"""Tables, comparisons, figures and captions of study ``spectra``, from its group of an archive alone."""

from dataclasses import replace
from typing import Any

import pandas as pd
import xarray as xr

from gliderhpc.findings.files import as_plain
from gliderhpc.findings.findings import Findings, archive_findings
from gliderhpc.report.captions import data_said
from gliderhpc.report.studies.spectra.figure_4 import figure_4
from gliderhpc.report.studies.spectra.table_1 import comparisons, table_1, table_1_text
from gliderhpc.report.studies.turbulence.captions import resolved_said, series_said
from gliderhpc.report.studies.turbulence.remarks import about_the_band
from gliderhpc.studies.archived import failed_profiles, study_table
from gliderhpc.studies.library.turbulence.channel import series_step
from gliderhpc.studies.library.turbulence.settings import SpectraSettings
from gliderhpc.studies.provenance import Provenance, provenance_of
from gliderhpc.studies.spectra.study import NAME


def show(archive: xr.DataTree) -> Findings:
    """Show the study of an archive."""
    made, table = provenance_of(archive, NAME), study_table(archive, NAME)
    settings = SpectraSettings.model_validate(made.settings)
    failed, studied = failed_profiles(table)
    facts = {
        "profiles": list(made.profiles),
        "estimate": made.estimate,
        "quick": made.quick,
        "settings": settings.model_dump(mode="json"),
        "group_means": as_plain(_group_means(studied)),
    }
    by_depth = table_1(studied)
    findings = archive_findings(
        NAME, comparisons(studied), {"table_1": pd.DataFrame(by_depth), "profiles": table},
        {"figure_4": figure_4(archive, studied, settings)} if len(studied) else {}, facts, failed,
        made.remarks + about_the_band(table, settings, series_step(archive, made.estimate)),
        captions=_captions(made, table, studied, settings),
    )  # fmt: skip
    return replace(findings, documents={"table_1.md": table_1_text(by_depth)} if by_depth else {})


def _exponents(series: str, data: str, settings: SpectraSettings) -> str:
    return (
        f"Exponents of the spectrum of {series}, of each profile and of its thirds by depth: {data}. Intervals are of "
        f"95 % by {settings.draws} draws of Welch's segments and hold scatter alone, no error of the estimate's own "
        "response."
    )


def _captions(
    made: Provenance, table: pd.DataFrame, studied: pd.DataFrame, settings: SpectraSettings
) -> dict[str, str]:
    """Say what figure and table are made from, and how far up the records carry them."""
    low, high = settings.band
    series, data = series_said(made, settings), data_said(made, studied["profile"].tolist())
    resolved = resolved_said(table, settings)
    return {
        "figure_4": (
            f"Power spectra of {series}: {data}, in groups by the speed of their depth-averaged current, each spectrum "
            f"over the variance that it holds; Welch's segments of {settings.segment:g} s. Exponents are fitted over "
            f"{low:g} to {high:g} Hz (dotted) and over what of it the records resolve. {resolved}"
        ),
        "table_1": f"{_exponents(series, data, settings)} {resolved}",
        "profiles": f"A row a profile. {_exponents(series, data, settings)} {resolved}",
    }


def _group_means(table: pd.DataFrame) -> dict[str, dict[Any, Any]]:
    """Mean exponents of each group."""
    names = [name for name in ("whole_beta", "whole_beta_resolved", "speed") if name in table]
    return {str(group): own[names].mean().to_dict() for group, own in table.groupby("group")} if len(table) else {}
