"""Jobs of a mission: workers estimate and commit profiles in batches; a failed batch is retried profile by profile.

A job gets paths and numbers, never arrays; it writes each profile's chunks and, last, its commit marker. It is
idempotent, and skips the profiles that are committed already.
"""

import logging
import time
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from gliderhpc.errors import GliderhpcError, ProfileError
from gliderhpc.estimation.preparation import PreparedProfile, prepare_profile
from gliderhpc.estimation.profile import ProfileEstimate, estimate_profiles
from gliderhpc.estimation.resample import on_steps
from gliderhpc.flight.glider import Glider
from gliderhpc.kernels.elementwise import LANES
from gliderhpc.mission.executors import Executor, one_line, spare_threads, was_killed
from gliderhpc.mission.input_digests import common_digests, earliest_start, input_digests
from gliderhpc.mission.lock import check_held
from gliderhpc.mission.profile_rows import Row, derive_and_write, failed_row, recompute_currents
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.observations import Observations, ProfileRecord, Survey, open_observations
from gliderhpc.observations.times import epoch_seconds
from gliderhpc.platform import Platform
from gliderhpc.store_schema import ArchiveRows, Commit, read_commits
from gliderhpc.store_schema.commits import UNREADABLE, damages
from gliderhpc.store_schema.digests import Digests

log = logging.getLogger(__name__)

MAX_BATCH = {"lanes": 3 * LANES, "fortran": 3 * LANES, "scipy": 1}
"""Maximum number of profiles in a batch, by engine. The more profiles, the fewer lanes are idle at the end."""


@dataclass(frozen=True)
class BatchJob:
    """Job of a worker: input, profiles, settings and output.

    Attributes
    ----------
    profiles : tuple of (int, int)
        Each profile's number and its position along the archive's profile dimension.
    observations, store : str
        Paths of the file and of the archive.
    survey : Survey
        Survey of the file, restricted to these profiles.
    platform, settings : Platform, MissionSettings
        Hull and settings of the run.
    mission_start : numpy.datetime64
        Origin of `elapsed_days`.
    token : str, optional
        Token of the run's lock on the archive, by which the job recognises that the run has ended; it then stops.
    amendable : mapping of int to Commit
        Earlier commits, by position, of profiles that differ only in their fixes.
    threads : int
        Number of threads that the job may use.
    """

    profiles: tuple[tuple[int, int], ...]
    observations: str
    store: str
    survey: Survey
    platform: Platform
    settings: MissionSettings
    mission_start: np.datetime64
    token: str | None = None
    amendable: Mapping[int, Commit] = field(default_factory=dict)
    threads: int = 1

    @property
    def estimated_count(self) -> int:
        """Number of profiles that are not amendable."""
        return sum(index not in self.amendable for _, index in self.profiles)


@dataclass(frozen=True)
class ProfileResult:
    """Result of a profile: its row of the archive's table, and whether only its currents were recomputed (amended)."""

    number: int
    index: int
    row: Row
    amended: bool = False


def batch_results(job: BatchJob) -> Iterator[ProfileResult]:
    """Estimate profiles, write the chunks of each as soon as it is estimated, and yield its result.

    A profile that cannot be estimated yields status ``failed`` and its message; the others are not affected.
    """
    with open_observations(job.observations, survey=job.survey) as observations:
        yield from run_batch(observations, job)


def run_batch(observations: Observations, job: BatchJob) -> Iterator[ProfileResult]:
    """Run a job as `batch_results` does, on observations that are already open."""
    # On such short vectors, threads of linear algebra cost far more time than they save.
    with threadpool_limits(limits=1), spare_threads(job.threads - 1 if job.estimated_count == 1 else 0) as threads:
        batch = _BatchRunner(job, observations)
        for pending, estimate in estimate_profiles(batch.tasks(), job.settings, with_hull=True, threads=threads):
            batch.finish(pending, estimate)
            yield from batch.new_results()
        yield from batch.new_results()


@dataclass(frozen=True, eq=False)
class _PendingProfile:
    """A profile in progress: number, position, row so far, digests of its inputs, record, and computing time so far."""

    number: int
    index: int
    row: Row
    inputs: dict[str, str]
    record: ProfileRecord
    seconds: float


class _BatchRunner:
    """Reader of a job's records and writer of its estimates, profile by profile."""

    def __init__(self, job: BatchJob, observations: Observations) -> None:
        self._job, self._observations = job, observations
        self._rows = ArchiveRows(job.store)
        self._commits = read_commits(job.store, [index for _, index in job.profiles])
        self._results: deque[ProfileResult] = deque()

    def new_results(self) -> Iterator[ProfileResult]:
        """Yield the results since the last call."""
        while self._results:
            yield self._results.popleft()

    def tasks(self) -> Iterator[tuple[_PendingProfile, PreparedProfile]]:
        """Read and prepare each profile; unusable ones are committed as failed, and those already committed skipped."""
        settings, glider = self._job.settings, Glider(self._job.platform)
        common = common_digests(self._job.platform, settings)
        for number, index in self._job.profiles:
            began = time.perf_counter()
            inputs = input_digests(self._observations, number, self._job.mission_start, common)
            commit = self._commits.get(index)
            if isinstance(commit, Commit) and commit.inputs == inputs:
                self._results.append(ProfileResult(number, index, dict(commit.row)))
                continue
            check_held(self._job.store, self._job.token)
            amendable = self._job.amendable.get(index)
            if amendable is not None and self._amend(number, index, amendable, inputs):
                continue
            row = profile_extent(self._observations, number, self._job.mission_start)
            record = None
            try:
                record = self._observations.profile(number)
                series = on_steps(record, settings, self._job.platform)
            except ProfileError as error:
                self._rows.begin(index)
                self._commit(number, index, row | failed_row(str(error), record), inputs, time.perf_counter() - began)
            else:
                pending = _PendingProfile(number, index, row, inputs, record, time.perf_counter() - began)
                yield pending, prepare_profile(glider, series)

    def finish(self, profile: _PendingProfile, estimate: ProfileEstimate | ProfileError) -> None:
        """Write and commit a profile's estimate, or the error that prevented one."""
        began, seconds = time.perf_counter(), profile.seconds
        check_held(self._job.store, self._job.token)
        self._rows.begin(profile.index)
        extra: Row = {}
        if isinstance(estimate, ProfileError):
            row = failed_row(str(estimate), profile.record)
        else:
            seconds += estimate.seconds
            try:
                row, extra = derive_and_write(self._rows, profile.index, profile.record, estimate, self._job.settings)
                row["status"] = "done"
            except ProfileError as error:
                row = failed_row(str(error), profile.record)
        seconds += time.perf_counter() - began
        self._commit(profile.number, profile.index, profile.row | row, profile.inputs, seconds, extra)

    def _amend(self, number: int, index: int, commit: Commit, inputs: dict[str, str]) -> bool:
        """Recompute the currents of an earlier commit from the new fixes; return False if that is impossible."""
        if damages(self._job.store, {index: commit}):
            log.warning("profile %d: chunks are damaged; it will be recomputed", number)
            return False
        try:
            record = self._observations.profile(number)
            row, segments = recompute_currents(record, commit, self._job.settings, self._job.platform)
        except (ProfileError, *UNREADABLE) as error:
            log.warning("profile %d: its currents cannot be updated (%s); all of it will be recomputed", number, error)
            return False
        self._rows.begin(index)
        self._rows.write(index, "drift_current", segments)
        commit_profile(self._rows, index, row, inputs, extra=commit.extra, amended=commit.manifest)
        self._results.append(ProfileResult(number, index, row, amended=True))
        return True

    def _commit(
        self, number: int, index: int, row: Row, inputs: dict[str, str], seconds: float, extra: Row | None = None
    ) -> None:
        row["run_seconds"] = seconds
        commit_profile(self._rows, index, row, inputs, extra=extra)
        self._results.append(ProfileResult(number, index, row))


def profile_extent(observations: Observations, number: int, mission_start: np.datetime64) -> Row:
    """Return a profile's table entries that are known before the estimation."""
    start = observations.start_time(number)
    return {
        "start_time": epoch_seconds(start),
        "elapsed_days": (epoch_seconds(start) - epoch_seconds(mission_start)) / 86400.0,
        "duration": observations.duration(number),
        "sample_count": observations.sample_count(number),
    }


def commit_profile(
    rows: ArchiveRows,
    index: int,
    row: Row,
    inputs: dict[str, str],
    *,
    extra: Mapping[str, Any] | None = None,
    amended: Digests | None = None,
) -> None:
    """Commit a profile (`ArchiveRows.commit`); NaN, which JSON cannot represent, is left out and read as missing."""
    finite = {key: value for key, value in row.items() if not (isinstance(value, float) and not np.isfinite(value))}
    finished = datetime.now(UTC).isoformat(timespec="seconds")
    rows.commit(index, finite, inputs, finished, extra=extra, amended=amended)


@dataclass(frozen=True)
class RunInputs:
    """Inputs and archive of a run."""

    observations: Observations
    platform: Platform
    settings: MissionSettings
    store: str
    amendable: Mapping[int, Commit] = field(default_factory=dict)

    @cached_property
    def start(self) -> np.datetime64:
        """Origin of the mission's `elapsed_days`."""
        return earliest_start(self.observations)

    @cached_property
    def _common(self) -> dict[str, str]:
        return common_digests(self.platform, self.settings)

    def inputs(self, number: int) -> dict[str, str]:
        """Return the digests of a profile's inputs."""
        return input_digests(self.observations, number, self.start, self._common)

    def job(self, profiles: tuple[tuple[int, int], ...], token: str | None) -> BatchJob:
        """Return the job of some profiles, given by number and position."""
        return BatchJob(
            profiles, str(Path(self.observations.path).resolve()), self.store,
            self.observations.survey.only(number for number, _ in profiles), self.platform, self.settings, self.start,
            token, {index: self.amendable[index] for _, index in profiles if index in self.amendable},
        )  # fmt: skip


def batch_size(settings: MissionSettings, profiles: int, workers: int) -> int:
    """Return the largest number of profiles in a batch, as the engine's lanes and a share for every worker allow."""
    return min(MAX_BATCH[settings.engine], -(-profiles // workers))


def batch_sizes(settings: MissionSettings, profiles: int, workers: int) -> list[int]:
    """Return the numbers of profiles in the batches of a run, in the order in which they are assigned to workers.

    A batch has half of a worker's share of the remaining profiles, but at least as many as the engine has lanes, as
    long as all workers are occupied. Batches are therefore small towards the end of the run, and the workers end at
    about the same time.
    """
    sizes: list[int] = []
    remaining = profiles
    while remaining:
        half_share = -(-remaining // (2 * workers))
        sizes.append(min(batch_size(settings, remaining, workers), max(half_share, LANES)))
        remaining -= sizes[-1]
    return sizes


def profile_results(
    executor: Executor, run: RunInputs, token: str, profiles: Sequence[tuple[int, int]]
) -> Iterator[ProfileResult]:
    """Run batches of profiles, and retry the unfinished profiles of failed batches singly.

    Each result is yielded once, as soon as its profile is committed.

    When a worker dies, the jobs queued on it fail too, even if another job killed it. The profiles of a batch whose
    worker died are therefore retried one by one.
    """
    remaining, sizes = iter(profiles), batch_sizes(run.settings, len(profiles), executor.workers)
    batches = [run.job(tuple(islice(remaining, size)), token) for size in sizes]
    threads = executor.threads(sum(batch.estimated_count > 0 for batch in batches))
    batches = [replace(batch, threads=threads) for batch in batches]
    raised: list[BatchJob] = []
    killed: list[BatchJob] = []
    finished: set[int] = set()
    for attempt in executor.stream(batch_results, batches):
        if attempt.error is None:
            yield from _without_repeats(attempt.result, finished)
        else:
            _raise_if_permanent(attempt.error)
            unfinished = tuple(profile for profile in attempt.job.profiles if profile[0] not in finished)
            log.warning(
                "%s: %s; each will be retried on its own", _describe_profiles(unfinished), one_line(attempt.error)
            )
            retries = [run.job((profile,), token) for profile in unfinished]
            (killed if was_killed(attempt.error) else raised).extend(retries)
    for jobs in (raised, *([job] for job in killed)):
        for attempt in executor.stream(batch_results, jobs):
            if attempt.error is None:
                yield from _without_repeats(attempt.result, finished)
            elif attempt.job.profiles[0][0] not in finished:
                _raise_if_permanent(attempt.error)
                log.error("%s: failed twice", _describe_profiles(attempt.job.profiles), exc_info=attempt.error)
                yield _commit_failed(run, token, attempt.job, one_line(attempt.error))


def _raise_if_permanent(error: Exception) -> None:
    """Raise an error that a second attempt cannot avoid: a full or lost disk, unusable input, a run that has ended."""
    if isinstance(error, OSError | GliderhpcError):
        raise error


def _commit_failed(run: RunInputs, token: str, job: BatchJob, reason: str) -> ProfileResult:
    """Commit a profile as failed, on behalf of its worker."""
    ((number, index),) = job.profiles
    check_held(run.store, token)
    row = profile_extent(run.observations, number, run.start) | failed_row(reason)
    rows = ArchiveRows(run.store)
    rows.begin(index)
    commit_profile(rows, index, row, run.inputs(number))
    return ProfileResult(number, index, row)


def _without_repeats(result: ProfileResult, finished: set[int]) -> Iterator[ProfileResult]:
    """Yield a result unless it was yielded before."""
    if result.number not in finished:
        finished.add(result.number)
        yield result


def _describe_profiles(profiles: Sequence[tuple[int, int]]) -> str:
    return "profile " + ", ".join(str(number) for number, _ in profiles)
