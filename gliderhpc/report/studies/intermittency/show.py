"""Tables, comparisons, figures and captions of study ``intermittency``, from its group of an archive alone."""

from dataclasses import replace

import pandas as pd
import xarray as xr

from gliderhpc.findings.findings import Findings, archive_findings
from gliderhpc.report.captions import data_said
from gliderhpc.report.studies.intermittency.figure_6 import figure_6
from gliderhpc.report.studies.turbulence.captions import of_table_3, resolved_said, series_said
from gliderhpc.report.studies.turbulence.remarks import about_the_band
from gliderhpc.report.studies.turbulence.table_3 import comparisons, table_3, table_3_text
from gliderhpc.studies.archived import failed_profiles, study_table
from gliderhpc.studies.intermittency.study import NAME, OF_RANGE
from gliderhpc.studies.library.turbulence.channel import series_step
from gliderhpc.studies.library.turbulence.ensembles import Ensembles, stored_nulls
from gliderhpc.studies.library.turbulence.settings import IntermittencySettings
from gliderhpc.studies.library.turbulence.verdict import verdict, verdict_text
from gliderhpc.studies.provenance import Provenance, provenance_of


def show(archive: xr.DataTree) -> Findings:
    """Show the study of an archive, beside its nulls where it has them."""
    made, table = provenance_of(archive, NAME), study_table(archive, NAME)
    settings = IntermittencySettings.model_validate(made.settings)
    failed, studied = failed_profiles(table)
    nulls, about_nulls = stored_nulls(archive, made.estimate, settings)
    ensembles = Ensembles(studied, nulls, settings)
    found = verdict(ensembles)
    facts = {
        "profiles": list(made.profiles),
        "estimate": made.estimate,
        "quick": made.quick,
        "settings": settings.model_dump(mode="json"),
        "verdict": found.as_json(),
    }
    tables = {
        "profiles": table,
        "ranges": _ranges(archive, studied["profile"].tolist()),
        "table_3": table_3(ensembles),
    }
    about_band = about_the_band(table, settings, series_step(archive, made.estimate))
    findings = archive_findings(
        NAME, comparisons(ensembles), tables,
        {"figure_6": figure_6(archive, studied, settings)} if len(studied) else {}, facts, failed,
        (*made.remarks, *about_band, *about_nulls, found.sentence), captions=_captions(made, table, ensembles),
    )  # fmt: skip
    return replace(findings, documents={"verdict.md": table_3_text(ensembles) + "\n" + verdict_text(found)})


def _ranges(archive: xr.DataTree, numbers: list[int]) -> pd.DataFrame:
    """Relative exponent over every range of lags, a row a profile and range."""
    group = archive[NAME].to_dataset().sel(profile=numbers)
    columns = {name: group[f"range_{name}"].values for name in OF_RANGE}
    ends = list(zip(group["range_from"].values.tolist(), group["range_to"].values.tolist(), strict=True))
    return pd.DataFrame(
        [
            {"profile": number, "from": first, "to": last}
            | {name: float(column[place, at]) for name, column in columns.items()}
            for place, number in enumerate(numbers)
            for at, (first, last) in enumerate(ends)
        ]
    )


def _captions(made: Provenance, table: pd.DataFrame, ensembles: Ensembles) -> dict[str, str]:
    """Say what figure and tables are made from, and what they exclude and leave open."""
    settings = ensembles.settings
    series, data = series_said(made, settings), data_said(made, ensembles.measured["profile"].tolist())
    resolved = resolved_said(table, settings)
    low, high = settings.scaling
    open_question = "A passed test excludes a Gaussian linear process of the same spectrum, and nothing else."
    return {
        "figure_6": (
            f"Flatness by lag and relative exponents of the increments of {series}: {data}, each beside the "
            f"envelope of {settings.surrogates} surrogates of its spectrum. The lag of the test, {settings.lag:g} s, "
            f"and the range of the fit, {low:g} to {high:g} s, were fixed beforehand; bars are of 95 % by blocks of "
            f"{settings.block:g} s. {open_question} {resolved}"
        ),
        "profiles": (
            f"A row a profile: statistics of {series}, without and with (all) the samples at which actuators move: "
            f"{data}; p is of a rank test among {settings.surrogates} surrogates, so no less than "
            f"{1.0 / (1 + settings.surrogates):.3g}. {open_question} {resolved}"
        ),
        "ranges": (
            f"Relative exponent zeta_6 / zeta_3 of {series} over {1 + len(settings.scaling_varied)} ranges of lags, a "
            f"row a profile and range, with intervals of 95 % by {settings.block_draws} draws of blocks of "
            f"{settings.block:g} s: {data}. What changes with the range is not a scaling law's."
        ),
        "table_3": of_table_3(made, ensembles),
    }
