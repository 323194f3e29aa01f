"""The study over a mission: nulls in batches, the archive's group, Table 3 with its verdict, the figure."""

from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from gliderhpc.analysis.archived import about_the_estimate, chosen_profiles, platform_of, settings_of
from gliderhpc.analysis.comparison import comparisons_as_json
from gliderhpc.analysis.files import as_plain
from gliderhpc.analysis.findings import Findings
from gliderhpc.analysis.nulls.batch import NullJob, NullResult, run_nulls
from gliderhpc.analysis.nulls.figure import nulls_figure
from gliderhpc.analysis.nulls.missions import coefficient_names, realisations
from gliderhpc.analysis.nulls.settings import NullSettings
from gliderhpc.analysis.study import Request, Study, archive_findings, begin_study, own_assignments
from gliderhpc.analysis.turbulence.ensembles import Ensembles, alike, stored_measured
from gliderhpc.analysis.turbulence.table_3 import comparisons, table_3, table_3_text
from gliderhpc.analysis.turbulence.verdict import verdict, verdict_text
from gliderhpc.errors import InputError
from gliderhpc.mission.archive import open_mission
from gliderhpc.mission.planning import batch_size
from gliderhpc.mission.settings import build_settings_of
from gliderhpc.store_schema import finish_study, write_whole
from gliderhpc.store_schema.studies import study_called

NAME = "nulls"
QUICK = {"noise_only": 2, "model_error": 2, "gaussian": 2}
QUICK_SURROGATES = 9


def missing_input(request: Request) -> str | None:
    """Say what is lacking: nothing ever is; the actuation is the archive's."""
    return None


def run(request: Request) -> Findings:
    """Fly and invert nulls of the chosen profiles, into the archive's group ``nulls``.

    Raises
    ------
    InputError
        No such profile is done, the archive has no such estimate, a setting is wrong, or no null is asked for.
    """
    measured, of_measured = stored_measured(request.archive, request.estimate)
    settings = _settings(request, of_measured)
    with open_mission(request.archive) as archive:
        numbers = chosen_profiles(archive, request.profiles, request.quick)
        remarks = about_the_estimate(archive, request.estimate, numbers)
        names, mission = coefficient_names(platform_of(archive)), settings_of(archive)
        title = str(archive.attrs.get("mission") or "mission")
    planned = realisations(settings, numbers)
    if not planned:
        raise InputError("--set nulls: no realisation of any kind is asked for; give one of them a number above zero")
    remarks += begin_study(request, NAME, {"null": len(planned)}, {"coefficient": names})
    seen: set[int] = set()
    results: list[NullResult] = []
    with request.executor() as opened:
        size = batch_size(mission, len(planned), opened.workers)
        jobs = [
            NullJob(tuple(planned[first : first + size]), str(request.archive.resolve()), request.estimate, settings)
            for first in range(0, len(planned), size)
        ]
        for batch in opened.run(run_nulls, jobs):
            results += batch
            for number in {result.null.profile for result in batch} - seen:
                seen.add(number)
                request.report(number)
    results.sort(key=lambda result: result.null.index)
    _write(request, results, names)
    if of_measured is None or not alike(of_measured.model_dump(mode="json"), settings.statistics):
        measured = pd.DataFrame()
        remarks += ("the archive holds no intermittency of this estimate and these settings: the nulls stand alone",)
    table = pd.DataFrame([result.row for result in results])
    return _conclude(request, table, Ensembles(measured, _padded(table), settings.statistics), settings, title, remarks)


def _settings(request: Request, of_measured: Any) -> NullSettings:
    """Settings as asked; the statistics are those of the measured profiles unless something else is said."""
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


def _padded(table: pd.DataFrame) -> pd.DataFrame:
    """Table with every column that a verdict reads, missing where no null has it."""
    names = ("peak", "flatness", "zeta_ratio", "kurtosis", "rms", "beta", "beta_resolved", "p_value")
    return table.assign(**{name: np.nan for name in names if name not in table})


def _conclude(
    request: Request, table: pd.DataFrame, ensembles: Ensembles, settings: NullSettings, title: str,
    remarks: tuple[str, ...],
) -> Findings:  # fmt: skip
    rows, found = comparisons(ensembles), verdict(ensembles)
    facts = {
        "estimate": request.estimate,
        "quick": request.quick,
        "settings": settings.model_dump(mode="json"),
        "ceiling": ensembles.ceiling,
        "verdict": found.as_json() if len(ensembles.measured) else None,
    }
    finish_study(request.archive, NAME, as_plain({**facts, "comparisons": comparisons_as_json(rows)}))
    messages = table["message"].dropna() if "message" in table else pd.Series(dtype=object)
    if len(messages):
        remarks = (*remarks, f"{len(messages)} of {len(table)} nulls have no statistics: {messages.iloc[0]}")
    text = table_3_text(ensembles)
    if len(ensembles.measured):
        remarks = (*remarks, found.sentence)
        text += "\n" + verdict_text(found)
    figures = {"nulls": nulls_figure(ensembles, title)} if np.isfinite(ensembles.nulls["peak"]).any() else {}
    tables = {"nulls": table, "table_3": table_3(ensembles)}
    findings = archive_findings(NAME, rows, tables, figures, facts, {}, remarks)
    return replace(findings, documents={"verdict.md": text})


STUDY = Study(NAME, "what the pipeline makes of missions without turbulence", missing_input, run)
"""What the registry finds."""
