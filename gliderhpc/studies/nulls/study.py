"""Nulls of a mission: flown and inverted in batches by workers, judged, and stored in the archive's group."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from gliderhpc.archive.mission import open_for_job, open_for_reading
from gliderhpc.archive.profile import SMOOTHED
from gliderhpc.errors import InputError, ProfileError
from gliderhpc.estimation.preparation import ProfileTask
from gliderhpc.estimation.profile import ProfileEstimate, estimate_profiles
from gliderhpc.mission.planning import batch_size
from gliderhpc.mission.settings import MissionSettings, build_settings_of
from gliderhpc.outcomes import Outcome
from gliderhpc.store_schema import write_whole
from gliderhpc.store_schema.studies.nulls import COEFFICIENT, FAMILIES, NULL, REALISATIONS
from gliderhpc.studies.archived import platform_of, settings_of
from gliderhpc.studies.library.turbulence.series import (
    averaged_over,
    channel_of_estimate,
    describe_missing_band,
    fast_part,
)
from gliderhpc.studies.library.turbulence.statistics import resolved_structure_functions, statistics_row
from gliderhpc.studies.library.turbulence.surrogates import surrogate_test
from gliderhpc.studies.library.turbulence.verdict import stored_measured
from gliderhpc.studies.nulls.missions import (
    FlownNull,
    NullSettings,
    Realisation,
    coefficient_names,
    fly_null,
    realisations,
    without_corrections,
)
from gliderhpc.studies.provenance import Provenance
from gliderhpc.studies.study import Request, Study, begin_study, choose, finish_study_group, own_assignments

NAME = "nulls"
QUICK_REALISATIONS = 2
QUICK_SURROGATES = 9

Row = dict[str, Any]


# A batch of nulls


@dataclass(frozen=True)
class NullJob:
    """Some nulls of an archive, inverted side by side in the lanes of the engine."""

    nulls: tuple[Realisation, ...]
    archive: str
    estimate: str
    settings: NullSettings


@dataclass(frozen=True, eq=False)
class NullResult:
    """Result of a null: its row, and the factors on the coefficients that it was flown with."""

    null: Realisation
    row: Row
    factors: NDArray[np.float64] | None = None


def run_nulls(job: NullJob) -> list[NullResult]:
    """Fly, record, invert and judge some nulls; the job of a worker.

    The inversion is the mission's own: its settings, its engine, the platform that it assumed.
    """
    with threadpool_limits(limits=1), open_for_job(job.archive) as archive:
        batch = _Batch(job, archive)
        settings = without_corrections(batch.mission)
        for flown, estimate in estimate_profiles(batch.tasks(), settings, smooth=job.estimate == SMOOTHED):
            batch.judge(flown, estimate)
    return batch.results


class _Batch:
    """Nulls that are flown as the engine asks for them and judged as their estimates come."""

    def __init__(self, job: NullJob, archive: xr.DataTree) -> None:
        self._job, self._archive = job, archive
        self._platform = platform_of(archive)
        self.mission: MissionSettings = settings_of(archive)
        self.results: list[NullResult] = []

    def tasks(self) -> Iterator[tuple[tuple[Realisation, FlownNull], ProfileTask]]:
        """Fly each null; one that cannot be flown has its result at once."""
        for null in self._job.nulls:
            try:
                flown = fly_null(
                    self._archive, null, self._platform, self.mission, self._job.settings, self._job.estimate
                )
            except (ProfileError, InputError) as error:
                self.results.append(NullResult(null, _refused_row(null, error)))
            else:
                yield (null, flown), flown.task

    def judge(self, key: tuple[Realisation, FlownNull], estimate: ProfileEstimate | ProfileError) -> None:
        """Add the result of a null whose inversion has ended."""
        null, flown = key
        if isinstance(estimate, ProfileError):
            row = flown.row | {"message": str(estimate)}
        else:
            row = flown.row | self._row(null, estimate)
        self.results.append(NullResult(null, row, flown.factors))

    def _row(self, null: Realisation, estimate: ProfileEstimate) -> Row:
        """Statistics of a null, with the rank test among its own surrogates: the false positives of that test."""
        settings = self._job.settings.statistics
        every = self.mission.steps_per_record
        channel = channel_of_estimate(estimate, settings.channel, self._job.estimate, every)
        windows = estimate.solution.windows
        converged = float(np.mean([window.outcome == Outcome.CONVERGED for window in windows]))
        part = fast_part(channel, settings, actuated=False)
        if part.message:
            return {"converged_fraction": converged, "message": part.message}
        fast = averaged_over(part.series, settings.interval)
        found = resolved_structure_functions(fast, settings, channel.sample_interval)
        row = {"converged_fraction": converged, **statistics_row(part.series, found, channel, settings)}
        if not np.isfinite(row["flatness"]):
            return row | {"p_value": float("nan")}
        return row | {"p_value": surrogate_test(fast, settings, np.random.default_rng([null.seed, 2])).p_value}


def _refused_row(null: Realisation, error: Exception) -> Row:
    return {
        "family": null.family,
        "source_profile": null.profile,
        "realisation_seed": null.seed,
        "message": str(error),
    }


# The mission


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
    remarks = chosen.remarks + begin_study(request, NAME, {NULL: len(planned)}, {COEFFICIENT: names})
    results = _run_batches(request, planned, mission, settings)
    _write(request, results, names)
    columns = dict.fromkeys(name for result in results for name in result.row)
    made = Provenance(
        chosen.numbers, tuple(columns), request.estimate, request.quick, settings.model_dump(mode="json"), remarks
    )
    finish_study_group(request.archive, NAME, made)


def _run_batches(
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


def _write(request: Request, results: list[NullResult], names: list[str]) -> None:
    columns: dict[str, Any] = {
        variable.name: [result.row.get(variable.name, variable.fill_value) for result in results]
        for variable in REALISATIONS
    }
    unknown = np.full(len(names), np.nan)
    columns["factor"] = np.array([unknown if result.factors is None else result.factors for result in results])
    write_whole(request.archive, NAME, columns)


def missing(request: Request) -> str | None:
    """Say why the records are sampled too rarely for this study, None where they are not."""
    return describe_missing_band(request, _settings(request).statistics)


def _settings(request: Request) -> NullSettings:
    """Settings as asked; the statistics are those of the measured profiles unless they are set."""
    with open_for_reading(request.archive) as archive:
        _, of_measured = stored_measured(archive, request.estimate)
    base: dict[str, Any] = dict.fromkeys(FAMILIES, QUICK_REALISATIONS) if request.quick else {}
    if of_measured is not None:
        base["statistics"] = of_measured.model_dump()
    elif request.quick:
        base["statistics"] = {"surrogates": QUICK_SURROGATES}
    return build_settings_of(NullSettings, base, own_assignments(request, NAME))


STUDY = Study(NAME, "what the pipeline makes of missions without turbulence", missing, run)
"""The study that the registry finds."""
