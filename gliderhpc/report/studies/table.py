"""Findings of a study that has no figures of its own: its table, with the meaning of every column."""

import xarray as xr

from gliderhpc.findings.findings import Findings, archive_findings
from gliderhpc.report.captions import data_said
from gliderhpc.store_schema.studies import study_called
from gliderhpc.studies.archived import column_medians, failed_profiles, study_table
from gliderhpc.studies.provenance import provenance_of


def show_table(name: str, archive: xr.DataTree) -> Findings:
    """Make the findings of a study of an archive from its rows a profile and what its schema says of them."""
    made, table = provenance_of(archive, name), study_table(archive, name)
    failed, known = failed_profiles(table)
    variables = {variable.name: variable for variable in study_called(name).variables}
    meanings = "; ".join(
        f"{column} ({variables[column].units}): {variables[column].long_name}"
        for column in table
        if column in variables and column not in ("profile", "message")
    )
    caption = f"A row a profile: {data_said(made, known['profile'].tolist())}. Columns: {meanings}."
    facts = {"profiles": list(made.profiles), "quick": made.quick, "medians": column_medians(known)}
    return archive_findings(name, (), {name: table}, {}, facts, failed, made.remarks, captions={name: caption})
