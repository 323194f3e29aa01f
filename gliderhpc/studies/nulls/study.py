"""The study over a mission: nulls in batches, the archive's group, Table 3 with its verdict, the figure."""

from typing import Any

import numpy as np

from gliderhpc.archive.opening import open_for_reading
from gliderhpc.errors import InputError
from gliderhpc.mission.planning import batch_size
from gliderhpc.mission.settings import MissionSettings, build_settings_of
from gliderhpc.store_schema import write_whole
from gliderhpc.store_schema.studies import study_called
from gliderhpc.studies.archived import platform_of, settings_of
from gliderhpc.studies.library.turbulence.band import missing_band
from gliderhpc.studies.library.turbulence.ensembles import stored_measured
from gliderhpc.studies.nulls.batch import NullJob, NullResult, run_nulls
from gliderhpc.studies.nulls.missions import Realisation, coefficient_names, realisations
from gliderhpc.studies.nulls.settings import NullSettings
from gliderhpc.studies.provenance import Provenance
from gliderhpc.studies.study import Request, Study, begin_study, choose, finish_study_group, own_assignments

NAME = "nulls"
QUICK = {"noise_only": 2, "model_error": 2, "gaussian": 2}
QUICK_SURROGATES = 9


def run(request: Request) -> None:
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
    finish_study_group(request.archive, NAME, made)


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


def missing(request: Request) -> str | None:
    """Say why the records are sampled too rarely for this study, None where they are not."""
    return missing_band(request, _settings(request).statistics)


STUDY = Study(NAME, "what the pipeline makes of missions without turbulence", missing, run)
"""What the registry finds."""
