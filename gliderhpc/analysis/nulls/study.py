"""The study over a mission: nulls in batches, the archive's group, Table 3 with its verdict, the figure."""

from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from gliderhpc.analysis.archived import mission_of, platform_of, settings_of
from gliderhpc.analysis.captions import data_said
from gliderhpc.analysis.findings import Findings
from gliderhpc.analysis.nulls.batch import NullJob, NullResult, run_nulls
from gliderhpc.analysis.nulls.figure import nulls_figure
from gliderhpc.analysis.nulls.missions import Realisation, coefficient_names, realisations
from gliderhpc.analysis.nulls.settings import NullSettings
from gliderhpc.analysis.provenance import Provenance, provenance_of
from gliderhpc.analysis.study import (
    Request,
    Study,
    archive_findings,
    begin_study,
    choose,
    conclude_study,
    own_assignments,
)
from gliderhpc.analysis.tables import number
from gliderhpc.analysis.turbulence.band import missing_band
from gliderhpc.analysis.turbulence.captions import of_table_3, series_said
from gliderhpc.analysis.turbulence.ensembles import Ensembles, alike, null_table, stored_measured
from gliderhpc.analysis.turbulence.table_3 import comparisons, table_3, table_3_text, unit_of
from gliderhpc.analysis.turbulence.verdict import verdict, verdict_text
from gliderhpc.errors import InputError
from gliderhpc.mission.archive import open_for_reading
from gliderhpc.mission.planning import batch_size
from gliderhpc.mission.settings import MissionSettings, build_settings_of
from gliderhpc.store_schema import write_whole
from gliderhpc.store_schema.studies import study_called

NAME = "nulls"
QUICK = {"noise_only": 2, "model_error": 2, "gaussian": 2}
QUICK_SURROGATES = 9


def run(request: Request) -> Findings:
    """Fly and invert nulls of the chosen profiles, into the archive's group ``nulls``.

    Raises
    ------
    InputError
        No such profile is done, the archive has no such estimate, a setting is wrong, or no null is asked for.
    """
    settings = _settings(request)
    with open_for_reading(request.archive) as archive:
        chosen = choose(archive, request)
        names, mission = coefficient_names(platform_of(archive)), settings_of(archive)
    planned = realisations(settings, chosen.numbers)
    if not planned:
        raise InputError("--set nulls: no realisation of any kind is asked for; give one of them a number above zero")
    remarks = chosen.remarks + begin_study(request, NAME, {"null": len(planned)}, {"coefficient": names})
    results = _fly(request, planned, mission, settings)
    _write(request, results, names)
    columns = dict.fromkeys(name for result in results for name in result.row)
    made = Provenance(
        chosen.numbers, tuple(columns), request.estimate, request.quick, settings.model_dump(mode="json"), remarks
    )
    return conclude_study(request.archive, STUDY, made)


def _fly(
    request: Request, planned: list[Realisation], mission: MissionSettings, settings: NullSettings
) -> list[NullResult]:
    """Have the nulls flown and inverted in batches; a profile is reported with the first of its nulls."""
    seen: set[int] = set()
    results: list[NullResult] = []
    with request.executor() as opened:
        size = batch_size(mission, len(planned), opened.workers)
        jobs = [
            NullJob(tuple(planned[first : first + size]), request.path, request.estimate, settings)
            for first in range(0, len(planned), size)
        ]
        for batch in opened.run(run_nulls, jobs):
            results += batch
            for profile in {result.null.profile for result in batch} - seen:
                seen.add(profile)
                request.report(profile)
    return sorted(results, key=lambda result: result.null.index)


def _settings(request: Request) -> NullSettings:
    """Settings as asked; the statistics are those of the measured profiles unless something else is said."""
    with open_for_reading(request.archive) as archive:
        _, of_measured = stored_measured(archive, request.estimate)
    base: dict[str, Any] = dict(QUICK) if request.quick else {}
    if of_measured is not None:
        base["statistics"] = of_measured.model_dump()
    elif request.quick:
        base["statistics"] = {"surrogates": QUICK_SURROGATES}
    return build_settings_of(NullSettings, base, own_assignments(request, NAME))


def _write(request: Request, results: list[NullResult], names: list[str]) -> None:
    rows = [result.row for result in results]
    columns: dict[str, Any] = {}
    for variable in study_called(NAME).variables:
        if variable.dims != ("null",) or variable.name == "null":
            continue
        missing = "" if variable.dtype == "string" else float("nan")
        columns[variable.name] = [row.get(variable.name, missing) for row in rows]
    unknown = np.full(len(names), np.nan)
    columns["factor"] = np.array([unknown if result.factors is None else result.factors for result in results])
    write_whole(request.archive, NAME, columns)


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


def missing(request: Request) -> str | None:
    """Say why the records are sampled too rarely for this study, None where they are not."""
    return missing_band(request, _settings(request).statistics)


STUDY = Study(NAME, "what the pipeline makes of missions without turbulence", show, missing, run)
"""What the registry finds."""
