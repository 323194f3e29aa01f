"""Tables, comparisons, figures and captions of study ``nulls``, from its group of an archive alone."""

from dataclasses import replace

import numpy as np
import pandas as pd
import xarray as xr

from gliderhpc.findings.findings import Findings, archive_findings
from gliderhpc.findings.tables import number
from gliderhpc.report.captions import data_said
from gliderhpc.report.studies.nulls.figure import nulls_figure
from gliderhpc.report.studies.turbulence.captions import of_table_3, series_said
from gliderhpc.report.studies.turbulence.table_3 import comparisons, table_3, table_3_text, unit_of
from gliderhpc.studies.archived import mission_of
from gliderhpc.studies.library.turbulence.ensembles import Ensembles, alike, null_table, stored_measured
from gliderhpc.studies.library.turbulence.verdict import verdict, verdict_text
from gliderhpc.studies.nulls.settings import NullSettings
from gliderhpc.studies.nulls.study import NAME
from gliderhpc.studies.provenance import Provenance, provenance_of


def show(archive: xr.DataTree) -> Findings:
    """Show the nulls of an archive, beside the measured profiles where it has their intermittency."""
    made, nulls = provenance_of(archive, NAME), null_table(archive)
    settings = NullSettings.model_validate(made.settings)
    measured, remarks = _measured(archive, made, settings)
    ensembles = Ensembles(measured, nulls, settings.statistics)
    found = verdict(ensembles)
    facts = {
        "estimate": made.estimate,
        "quick": made.quick,
        "settings": settings.model_dump(mode="json"),
        "ceiling": ensembles.ceiling,
        "verdict": found.as_json() if len(measured) else None,
    }
    messages = nulls["message"].dropna()
    if len(messages):
        remarks = (*remarks, f"{len(messages)} of {len(nulls)} nulls have no statistics: {messages.iloc[0]}")
    text = table_3_text(ensembles)
    if len(measured):
        remarks = (*remarks, found.sentence)
        text += "\n" + verdict_text(found)
    known = np.isfinite(nulls["peak"]).any()
    findings = archive_findings(
        NAME, comparisons(ensembles), {"nulls": nulls[list(made.columns)], "table_3": table_3(ensembles)},
        {"nulls": nulls_figure(ensembles, mission_of(archive))} if known else {}, facts, {}, remarks,
        captions=_captions(made, ensembles, settings),
    )  # fmt: skip
    return replace(findings, documents={"verdict.md": text})


def _measured(archive: xr.DataTree, made: Provenance, settings: NullSettings) -> tuple[pd.DataFrame, tuple[str, ...]]:
    """Measured profiles that the nulls can stand beside, and what is to be said."""
    measured, of_measured = stored_measured(archive, made.estimate)
    if of_measured is not None and alike(of_measured.model_dump(mode="json"), settings.statistics):
        return measured, made.remarks
    alone = "the archive holds no intermittency of this estimate and these settings: the nulls stand alone"
    return pd.DataFrame(), (*made.remarks, alone)


def _captions(made: Provenance, ensembles: Ensembles, settings: NullSettings) -> dict[str, str]:
    """Say what figure and tables are made from, and how few realisations are behind them."""
    told, unit = len(ensembles.artefacts), unit_of(ensembles.settings.channel)
    nulls = (
        f"{len(ensembles.nulls)} missions without turbulence, flown under the recorded actuation of "
        f"{data_said(made)} and inverted as the archive was"
    )
    text = (
        f"Statistics of {series_said(made, ensembles.settings)}: {nulls}; coefficients of the model error are off by "
        f"up to {settings.spread:.0%}. The ceiling, {number(ensembles.ceiling)} {unit}, is the largest of {told} "
        "realisations with noise or model error alone: with more of them it can only rise, and artefacts of other "
        "kinds are not among them."
    )
    return {
        # One text serves the figure and its table, which have the same name.
        "nulls": f"{text} Beside them {len(ensembles.measured)} measured profiles.",
        "table_3": of_table_3(made, ensembles),
    }
