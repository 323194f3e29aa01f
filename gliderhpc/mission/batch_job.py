"""Profiles in, their chunks out: what a worker runs.

A job gets paths and numbers, never arrays; it writes each profile's chunks and, last, its commit marker. Run twice it
leaves what running it once leaves, and does only what the first time did not come to.
"""

import time
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np
from threadpoolctl import threadpool_limits

from gliderhpc.errors import ProfileError
from gliderhpc.estimation.preparation import ProfileTask, on_steps
from gliderhpc.estimation.profile import ProfileEstimate, estimate_profiles
from gliderhpc.flight.glider import Glider
from gliderhpc.mission.inputs import inputs_of
from gliderhpc.mission.lock import check_held
from gliderhpc.mission.profile_rows import Row, derive_and_write, epoch_seconds
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.observations import Observations, ProfileRecord, Survey, open_observations
from gliderhpc.platform import Platform
from gliderhpc.store_schema import ArchiveRows, Commit, read_commits


@dataclass(frozen=True)
class BatchJob:
    """What a worker needs to know: where to read, what to do, where to write.

    Attributes
    ----------
    profiles : tuple of (int, int)
        Each profile's number and its position along the archive's profile dimension.
    observations, store : str
        Paths.
    survey : Survey
        The file's survey, cut down to these profiles.
    platform, settings : Platform, MissionSettings
        The hull and the run's settings.
    mission_start : numpy.datetime64
        Where `elapsed_days` counts from.
    token : str, optional
        That of the run's lock on the archive: once the run has ended, nothing more is written for it.
    """

    profiles: tuple[tuple[int, int], ...]
    observations: str
    store: str
    survey: Survey
    platform: Platform
    settings: MissionSettings
    mission_start: np.datetime64
    token: str | None = None


@dataclass(frozen=True)
class ProfileResult:
    """What comes back of a profile: its row of the archive's table, nothing larger."""

    number: int
    index: int
    row: Row


def batch_results(job: BatchJob) -> Iterator[ProfileResult]:
    """Estimate profiles, write each one's chunks as it is done, and yield its result then.

    A profile that cannot be estimated comes back ``failed``, with why; the others are not touched by it.
    """
    # Threads of linear algebra on vectors this short cost far more than they gain.
    with threadpool_limits(limits=1), open_observations(job.observations, survey=job.survey) as observations:
        batch = _Batch(job, observations)
        for work, estimate in estimate_profiles(batch.tasks(), job.settings, smooth=True):
            batch.finish(work, estimate)
            yield from batch.new_results()
        yield from batch.new_results()


@dataclass(frozen=True, eq=False)
class _Work:
    """A profile under way: number and position, its row so far, what it is made from, and the computing time so far."""

    number: int
    index: int
    row: Row
    inputs: dict[str, str]
    record: ProfileRecord
    seconds: float


class _Batch:
    """Reads records as they are asked for and writes estimates as they come."""

    def __init__(self, job: BatchJob, observations: Observations) -> None:
        self._job, self._observations = job, observations
        self._rows = ArchiveRows(job.store)
        self._commits = read_commits(job.store, [index for _, index in job.profiles])
        self._results: deque[ProfileResult] = deque()

    def new_results(self) -> Iterator[ProfileResult]:
        """Yield the results since the last call."""
        while self._results:
            yield self._results.popleft()

    def tasks(self) -> Iterator[tuple[_Work, ProfileTask]]:
        """Read each profile's record; one that cannot be used fails here, one that is committed already is left."""
        settings, glider = self._job.settings, Glider(self._job.platform)
        for number, index in self._job.profiles:
            began = time.perf_counter()
            inputs = inputs_of(self._observations, number, self._job.mission_start, self._job.platform, settings)
            commit = self._commits.get(index)
            if isinstance(commit, Commit) and commit.inputs == inputs:
                self._results.append(ProfileResult(number, index, dict(commit.row)))
                continue
            check_held(self._job.store, self._job.token)
            row = extent_of(self._observations, number, self._job.mission_start)
            try:
                record = self._observations.profile(number)
                series = on_steps(record, settings)
            except ProfileError as error:
                self._rows.begin(index)
                self._close(number, index, row | failed_row(str(error)), inputs, time.perf_counter() - began)
            else:
                work = _Work(number, index, row, inputs, record, time.perf_counter() - began)
                yield work, ProfileTask(glider, series)

    def finish(self, work: _Work, estimate: ProfileEstimate | ProfileError) -> None:
        """Write what came of a profile."""
        began, seconds = time.perf_counter(), work.seconds
        check_held(self._job.store, self._job.token)
        self._rows.begin(work.index)
        if isinstance(estimate, ProfileError):
            row = failed_row(str(estimate))
        else:
            seconds += estimate.seconds
            try:
                row = derive_and_write(
                    self._rows, work.index, work.record, estimate, self._job.platform, self._job.settings
                ) | {"status": "done"}
            except ProfileError as error:
                row = failed_row(str(error))
        self._close(work.number, work.index, work.row | row, work.inputs, seconds + time.perf_counter() - began)

    def _close(self, number: int, index: int, row: Row, inputs: dict[str, str], seconds: float) -> None:
        row["run_seconds"] = seconds
        close_profile(self._rows, index, row, inputs)
        self._results.append(ProfileResult(number, index, row))


def extent_of(observations: Observations, number: int, mission_start: np.datetime64) -> Row:
    """What the table says of a profile before anything is estimated."""
    start = observations.start_time(number)
    return {
        "start_time": epoch_seconds(start),
        "elapsed_days": (epoch_seconds(start) - epoch_seconds(mission_start)) / 86400.0,
        "duration": observations.duration(number),
        "sample_count": observations.sample_count(number),
    }


def close_profile(rows: ArchiveRows, index: int, row: Row, inputs: dict[str, str]) -> None:
    """Commit a profile that was begun; what JSON cannot hold (NaN) reads as missing anyway."""
    plain = {key: value for key, value in row.items() if not (isinstance(value, float) and not np.isfinite(value))}
    rows.commit(index, plain, inputs, datetime.now(UTC).isoformat(timespec="seconds"))


def failed_row(message: str) -> Row:
    """What the table says of a profile that failed."""
    return {"status": "failed", "message": message}
