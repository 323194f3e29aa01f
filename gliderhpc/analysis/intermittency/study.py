"""The study over a mission: a job a profile, the archive's group, Figure 6, and Table 3 with its verdict."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from gliderhpc.analysis.archived import failed_profiles, platform_of, study_table
from gliderhpc.analysis.captions import data_said
from gliderhpc.analysis.findings import Findings
from gliderhpc.analysis.intermittency.figure_6 import figure_6
from gliderhpc.analysis.intermittency.profile_intermittency import profile_intermittency
from gliderhpc.analysis.profile_jobs import StudiedProfile, study_profiles
from gliderhpc.analysis.provenance import Provenance, provenance_of
from gliderhpc.analysis.study import (
    Request,
    Study,
    archive_findings,
    begin_study,
    choose,
    conclude_study,
    own_assignments,
    provenance,
)
from gliderhpc.analysis.turbulence.band import missing_band
from gliderhpc.analysis.turbulence.captions import of_table_3, resolved_said, series_said
from gliderhpc.analysis.turbulence.channel import channel_of, series_step
from gliderhpc.analysis.turbulence.ensembles import Ensembles, stored_nulls
from gliderhpc.analysis.turbulence.remarks import about_the_band
from gliderhpc.analysis.turbulence.settings import IntermittencySettings
from gliderhpc.analysis.turbulence.structure import ORDERS, lag_samples
from gliderhpc.analysis.turbulence.table_3 import comparisons, table_3, table_3_text
from gliderhpc.analysis.turbulence.verdict import verdict, verdict_text
from gliderhpc.mission.archive import open_for_reading
from gliderhpc.mission.profile_data import read_profile_data
from gliderhpc.mission.settings import build_settings_of
from gliderhpc.store_schema import write_table_rows, write_whole

NAME = "intermittency"
QUICK_SURROGATES = 9

_OF_RANGE = ("zeta_ratio", "zeta_ratio_low", "zeta_ratio_high")
"""What a profile has over each range of lags."""


@dataclass(frozen=True)
class IntermittencyJob:
    """One profile to study."""

    number: int
    index: int
    estimate: str
    settings: IntermittencySettings


@dataclass(frozen=True)
class Intermittent(StudiedProfile):
    """What a profile gives: its row, and its values by range of lags, none where it has no statistics."""

    ranges: Mapping[str, Any]


def study_profile(archive: xr.DataTree, job: IntermittencyJob) -> Intermittent:
    """Study one profile: its rows on lags and orders, and of the table; the job of a worker."""
    data = read_profile_data(archive, job.number, job.estimate)
    series = channel_of(data, job.settings.channel, platform_of(archive))
    found = profile_intermittency(series, job.settings, job.number)
    row, rows = {"nyquist": series.nyquist, **found.row}, {**found.on_lags, **found.on_orders}
    return Intermittent(job.number, job.index, row, _by_range(found.ranges), rows=rows)


def _by_range(rows: Sequence[Mapping[str, float]]) -> dict[str, Any]:
    return {f"range_{name}": np.array([row[name] for row in rows]) for name in _OF_RANGE} if rows else {}


def run(request: Request) -> Findings:
    """Study the chosen profiles, into the archive's group ``intermittency``.

    Raises
    ------
    InputError
        No such profile is done, the archive has no such estimate, or a setting is wrong.
    """
    settings = _settings(request)
    with open_for_reading(request.archive) as archive:
        chosen, step = choose(archive, request), series_step(archive, request.estimate)
    interval = max(1, int(settings.interval / step + 1e-9)) * step
    jobs = [IntermittencyJob(number, chosen.where[number], request.estimate, settings) for number in chosen.numbers]
    ranges = np.array([settings.scaling, *settings.scaling_varied])
    sizes = {"lag": len(lag_samples(settings.every_lag, interval)), "order": len(ORDERS), "range": len(ranges)}
    remarks = chosen.remarks + begin_study(request, NAME, sizes)
    results = study_profiles(request, NAME, study_profile, jobs)
    write_table_rows(request.archive, {result.index: result.ranges for result in results}, NAME)
    write_whole(request.archive, NAME, {"range_from": ranges[:, 0], "range_to": ranges[:, 1]})
    rows = {result.number: result.row for result in results}
    made = provenance(request, rows, settings.model_dump(mode="json"), remarks)
    return conclude_study(request.archive, STUDY, made)


def _settings(request: Request) -> IntermittencySettings:
    base = {"surrogates": QUICK_SURROGATES} if request.quick else {}
    return build_settings_of(IntermittencySettings, base, own_assignments(request, NAME))


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
    columns = {name: group[f"range_{name}"].values for name in _OF_RANGE}
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


def missing(request: Request) -> str | None:
    """Say why the records are sampled too rarely for this study, None where they are not."""
    return missing_band(request, _settings(request))


STUDY = Study(NAME, "increments of a disturbance's fast part beside surrogates", show, missing, run)
"""What the registry finds."""
