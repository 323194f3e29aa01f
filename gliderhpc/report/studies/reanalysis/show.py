"""Tables, comparisons, figures and captions of study ``reanalysis``, from its group of an archive alone."""

from dataclasses import replace

import numpy as np
import pandas as pd
import xarray as xr

from gliderhpc.findings.findings import Findings, archive_findings
from gliderhpc.report.studies.reanalysis.captions import captions
from gliderhpc.report.studies.reanalysis.figure_8 import figure_8
from gliderhpc.report.studies.reanalysis.table_4 import table_4, table_4_text
from gliderhpc.studies.archived import as_cells, failed_profiles, mission_of
from gliderhpc.studies.library.ellipses import studied
from gliderhpc.studies.provenance import Provenance, kept, provenance_of
from gliderhpc.studies.reanalysis.agreement import agreement_rows, agreements, comparisons
from gliderhpc.studies.reanalysis.beside_models import COUNTS
from gliderhpc.studies.reanalysis.compared import compare
from gliderhpc.studies.reanalysis.study import NAME

_OTHER_ELLIPSES = (
    "the ellipses are drawn by the study currents as it stands, the distances were found before it was run; run "
    "reanalysis again"
)


def show(archive: xr.DataTree) -> Findings:
    """Show the study of an archive."""
    made = provenance_of(archive, NAME)
    compared = compare(archive, made.profiles, made.estimate)
    found, places = agreements(compared), compared.panels()
    table = _by_model(archive, made)
    agreement, nine = agreement_rows(compared, found), table_4(compared, places)
    facts = {
        "profiles": list(made.profiles),
        "estimate": made.estimate,
        "quick": made.quick,
        "models": kept(archive, NAME, "models"),
        "agreement": agreement,
    }
    by_study = studied(archive, made.estimate)
    other = () if by_study == kept(archive, NAME, "ellipses_of_study") else (_OTHER_ELLIPSES,)
    findings = archive_findings(
        NAME, comparisons(compared, found),
        {"table_4": pd.DataFrame(nine), "agreement": pd.DataFrame(agreement), "profiles": table},
        {"figure_8": figure_8(compared, places, mission_of(archive))} if places else {}, facts, {},
        (*made.remarks, *other, *_left_out(table)), captions=captions(made, compared, places, by_study=by_study),
    )  # fmt: skip
    return replace(findings, documents={"table_4.md": table_4_text(nine)})


def _by_model(archive: xr.DataTree, made: Provenance) -> pd.DataFrame:
    """One line a profile and model."""
    group = archive[NAME].to_dataset().sel(profile=list(made.profiles)).load()
    names = [str(name) for name in group["model"].values]
    shape = (len(made.profiles), len(names))
    columns = {"profile": np.array(made.profiles)[:, None], "model": np.array(names, dtype=object)[None]}
    columns |= {name: as_cells(group[name].values).reshape(len(made.profiles), -1) for name in made.columns[1:]}
    return pd.DataFrame({name: np.broadcast_to(values, shape).ravel() for name, values in columns.items()})


def _left_out(table: pd.DataFrame) -> list[str]:
    """Say for how many profiles each model has no value, and of what most of their records lie outside."""
    failed, sampled = failed_profiles(table)
    remarks = [f"profile {number}: {message}" for number, message in failed.items()]
    for name in dict.fromkeys(sampled["model"]):
        own = sampled[sampled["model"] == name]
        without = own[own["north"].isna()]
        if len(without):
            # Why a model says nothing at most of the records at which it says nothing.
            reasons = without[list(COUNTS.values())].idxmax(axis=1).tolist()
            told = ", ".join(
                f"{reason.replace('_', ' ')} {reasons.count(reason)}" for reason in COUNTS.values() if reason in reasons
            )
            remarks.append(f"{name} has no value for {len(without)} of {len(own)} profiles: {told}")
    return remarks
