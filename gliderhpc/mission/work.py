"""The coordinator's side of a run: profiles shared out as jobs, those of a failed job tried once more, each alone."""

import logging
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from gliderhpc.errors import GliderhpcError
from gliderhpc.mission.batch_job import BatchJob, ProfileResult, batch_results, close_profile, extent_of, failed_row
from gliderhpc.mission.executors import Executor, told, was_killed
from gliderhpc.mission.inputs import inputs_of
from gliderhpc.mission.lock import check_held
from gliderhpc.mission.planning import batch_size
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.observations import Observations
from gliderhpc.platform import Platform
from gliderhpc.store_schema import ArchiveRows

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class MissionWork:
    """What a run does to which archive."""

    observations: Observations
    platform: Platform
    settings: MissionSettings
    store: str

    @cached_property
    def start(self) -> np.datetime64:
        """Where the mission's `elapsed_days` count from."""
        return min(self.observations.start_time(number) for number in self.observations.profile_numbers)

    def inputs(self, number: int) -> dict[str, str]:
        """Digests of what a profile is made from."""
        return inputs_of(self.observations, number, self.start, self.platform, self.settings)

    def job(self, profiles: tuple[tuple[int, int], ...], token: str) -> BatchJob:
        """Job of some profiles (numbers, positions)."""
        return BatchJob(
            profiles, str(Path(self.observations.path).resolve()), self.store,
            self.observations.survey.only(number for number, _ in profiles), self.platform, self.settings, self.start,
            token,
        )  # fmt: skip


def profile_results(
    opened: Executor, work: MissionWork, token: str, profiles: Sequence[tuple[int, int]]
) -> Iterator[ProfileResult]:
    """Run batches, and what is left of those that end in an error once more, a profile at a time.

    Each result comes once, as soon as its profile is committed.

    A job dies with its worker even where it only waits there beside one that kills it, so after a worker's death no
    profile is on its way beside another.
    """
    size = batch_size(work.settings, len(profiles), opened.workers)
    shares = [tuple(profiles[first : first + size]) for first in range(0, len(profiles), size)]
    raised: list[BatchJob] = []
    killed: list[BatchJob] = []
    finished: set[int] = set()
    for attempt in opened.streamed(batch_results, [work.job(share, token) for share in shares]):
        if attempt.error is None:
            yield from _unseen(attempt.result, finished)
        else:
            _stop_at(attempt.error)
            left = tuple(profile for profile in attempt.job.profiles if profile[0] not in finished)
            log.warning("%s: %s; each is tried once more, alone", _named(left), told(attempt.error))
            alone = [work.job((profile,), token) for profile in left]
            (killed if was_killed(attempt.error) else raised).extend(alone)
    for jobs in (raised, *([job] for job in killed)):
        for attempt in opened.streamed(batch_results, jobs):
            if attempt.error is None:
                yield from _unseen(attempt.result, finished)
            elif attempt.job.profiles[0][0] not in finished:
                _stop_at(attempt.error)
                log.error("%s: given up", _named(attempt.job.profiles), exc_info=attempt.error)
                yield _given_up(work, token, attempt.job, told(attempt.error))


def _stop_at(error: Exception) -> None:
    """Raise what no second attempt can help: a full or lost disk, unusable input, a run that has ended."""
    if isinstance(error, OSError | GliderhpcError):
        raise error


def _given_up(work: MissionWork, token: str, job: BatchJob, why: str) -> ProfileResult:
    """Commit a profile as failed in the place of the worker that could not."""
    ((number, index),) = job.profiles
    check_held(work.store, token)
    row = extent_of(work.observations, number, work.start) | failed_row(why)
    rows = ArchiveRows(work.store)
    rows.begin(index)
    close_profile(rows, index, row, work.inputs(number))
    return ProfileResult(number, index, row)


def _unseen(result: ProfileResult, finished: set[int]) -> Iterator[ProfileResult]:
    """Yield a result that has not come before."""
    if result.number not in finished:
        finished.add(result.number)
        yield result


def _named(profiles: Sequence[tuple[int, int]]) -> str:
    return "profile " + ", ".join(str(number) for number, _ in profiles)
