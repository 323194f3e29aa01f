"""Nulls as workers do them: several at a time, side by side in the lanes of the engine."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from gliderhpc.archive.opening import open_for_job
from gliderhpc.archive.profile import SMOOTHED
from gliderhpc.errors import InputError, ProfileError
from gliderhpc.estimation.preparation import ProfileTask
from gliderhpc.estimation.profile import ProfileEstimate, estimate_profiles
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.outcomes import Outcome
from gliderhpc.studies.archived import platform_of, settings_of
from gliderhpc.studies.library.turbulence.channel import channel_of_estimate
from gliderhpc.studies.library.turbulence.settings import IntermittencySettings
from gliderhpc.studies.library.turbulence.statistics import (
    fast_part,
    statistics_row,
    structure_of,
    surrogate_test,
    thinned,
)
from gliderhpc.studies.nulls.missions import Flown, Realisation, fly_null, uncorrected
from gliderhpc.studies.nulls.settings import NullSettings

Row = dict[str, Any]


@dataclass(frozen=True)
class NullJob:
    """Some nulls of an archive."""

    nulls: tuple[Realisation, ...]
    archive: str
    estimate: str
    settings: NullSettings


@dataclass(frozen=True, eq=False)
class NullResult:
    """What comes of a null: its row, and the factors on the coefficients that it was flown with."""

    null: Realisation
    row: Row
    factors: NDArray[np.float64] | None = None


def run_nulls(job: NullJob) -> list[NullResult]:
    """Fly, record, invert and judge some nulls; the job of a worker.

    The inversion is the mission's own: its settings, its engine, the platform that it believed in.
    """
    with threadpool_limits(limits=1), open_for_job(job.archive) as archive:
        batch = _Batch(job, archive)
        settings = uncorrected(batch.mission)
        for flown, estimate in estimate_profiles(batch.tasks(), settings, smooth=job.estimate == SMOOTHED):
            batch.judge(flown, estimate)
    return batch.results


class _Batch:
    """Flies nulls as they are asked for and judges estimates as they come."""

    def __init__(self, job: NullJob, archive: xr.DataTree) -> None:
        self._job, self._archive = job, archive
        self._platform = platform_of(archive)
        self.mission: MissionSettings = settings_of(archive)
        self.results: list[NullResult] = []

    def tasks(self) -> Iterator[tuple[tuple[Realisation, Flown], ProfileTask]]:
        """Fly each null; one that cannot be flown is done with."""
        for null in self._job.nulls:
            try:
                flown = fly_null(
                    self._archive, null, self._platform, self.mission, self._job.settings, self._job.estimate
                )
            except (ProfileError, InputError) as error:
                self.results.append(NullResult(null, _refused(null, error)))
            else:
                yield (null, flown), flown.task

    def judge(self, key: tuple[Realisation, Flown], estimate: ProfileEstimate | ProfileError) -> None:
        """Take the statistics of what came of a null."""
        null, flown = key
        if isinstance(estimate, ProfileError):
            row = flown.row | {"message": str(estimate)}
        else:
            row = flown.row | self._row(null, estimate)
        self.results.append(NullResult(null, row, flown.factors))

    def _row(self, null: Realisation, estimate: ProfileEstimate) -> Row:
        settings = self._job.settings.statistics
        every = self.mission.steps_per_record
        series = channel_of_estimate(estimate, settings.channel, self._job.estimate, every)
        windows = estimate.solution.windows
        converged = float(np.mean([window.outcome == Outcome.CONVERGED for window in windows]))
        part = fast_part(series, settings, actuated=False)
        if part.message:
            return {"converged_fraction": converged, "message": part.message}
        fast = thinned(part.pieces, settings.interval)
        found = structure_of(fast, settings, series.sample_interval)
        row = {"converged_fraction": converged, **statistics_row(part.pieces, found, series, settings)}
        return row | {"p_value": _p_value(fast, row, settings, null)}


def _p_value(fast: Any, row: Row, settings: IntermittencySettings, null: Realisation) -> float:
    """Rank test of the null among its own surrogates: how often an artefact passes is what the test is worth."""
    if not np.isfinite(row["flatness"]):
        return float("nan")
    return surrogate_test(fast, settings, np.random.default_rng([null.seed, 2])).p_value


def _refused(null: Realisation, error: Exception) -> Row:
    return {
        "family": null.family,
        "source_profile": null.profile,
        "realisation_seed": null.seed,
        "message": str(error),
    }
