"""Tables, comparisons, figures and captions of the validation, from its group of an archive alone."""

import xarray as xr

from gliderhpc.findings.files import as_plain
from gliderhpc.findings.findings import Findings, archive_findings
from gliderhpc.report.studies.validation.figure import figure_1
from gliderhpc.report.studies.validation.table import captions, comparisons
from gliderhpc.studies.archived import column_medians, failed_profiles, study_table
from gliderhpc.studies.library.trend import find_trend
from gliderhpc.studies.provenance import kept, provenance_of
from gliderhpc.studies.validation.study import GROUP


def show(archive: xr.DataTree) -> Findings:
    """Show the validation of an archive."""
    made = provenance_of(archive, GROUP)
    failed, flown = failed_profiles(study_table(archive, GROUP))
    table = flown.drop(columns="message", errors="ignore").reset_index(drop=True)
    trend, platform = find_trend(table["elapsed_days"], table["longitudinal_rmse"]), kept(archive, GROUP, "platform")
    facts = {
        "trend": as_plain(trend.as_json()),
        "platform": platform,
        "settings": made.settings,
        "medians": column_medians(table),
    }
    return archive_findings(
        GROUP, comparisons(table, trend), {"profiles": table}, {"figure_1": figure_1(archive, table, trend)}, facts,
        failed, made.remarks, captions=captions(made, table, trend, platform),
    )  # fmt: skip
