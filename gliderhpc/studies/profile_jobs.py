"""Jobs of a study, one for each profile: workers process them in runs and write the rows into the study's group."""

from __future__ import annotations

import uuid
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

from numpy.typing import ArrayLike
from threadpoolctl import threadpool_limits

from gliderhpc.archive.mission import open_for_reading
from gliderhpc.archive.reader import Archive
from gliderhpc.store_schema import ArchiveRows, Digests
from gliderhpc.studies.request import Request

Job = TypeVar("Job")

RUNS_PER_WORKER, MAX_RUN = 4, 8
"""Number of runs of jobs for each worker, and largest number of profiles in a run."""

OpenInputs = Callable[[Any], AbstractContextManager[Any]]
"""Function that opens the inputs shared by the jobs of a run."""


@dataclass(frozen=True)
class StudiedProfile:
    """Result of a study of one profile.

    Attributes
    ----------
    number, index : int
        Profile number, and position in the archive.
    table_row : mapping of str to value
        Values for the coordinator: the profile's row of the group's table, and inputs of the mission's function.
    chunk_rows : mapping of str to array_like
        Profile's rows of the group's other variables; the worker writes them.
    """

    number: int
    index: int
    table_row: Mapping[str, Any]
    chunk_rows: Mapping[str, ArrayLike] = field(default_factory=dict)


@dataclass(frozen=True)
class ProfileRun:
    """Profiles that a worker studies one after the other; all runs of a study have the same token."""

    token: str
    archive: Path
    name: str
    study: Callable[[Archive, Any, Any], StudiedProfile]
    jobs: tuple[Any, ...]
    inputs: Any
    opened: OpenInputs


def run_jobs(
    request: Request,
    name: str,
    study: Callable[[Archive, Job, Any], StudiedProfile],
    jobs: Sequence[Job],
    inputs: Any = None,
    opened: OpenInputs = nullcontext,
) -> tuple[list[StudiedProfile], dict[int, Digests]]:
    """Run a study's jobs, one for each profile.

    Parameters
    ----------
    request : Request
        Archive, executor and progress.
    name : str
        Name of the study and its group.
    study : callable
        ``(archive, job, inputs) -> StudiedProfile``; runs in a worker.
    jobs : sequence
        Jobs, one for each profile.
    inputs : object
        Inputs shared by all jobs.
    opened : callable
        Context manager that opens the inputs, once for each run of jobs.

    Returns
    -------
    results : list of StudiedProfile
        Results, in order of profile number.
    digests : dict of int to mapping
        Digests of the chunks that the workers wrote, by position of the profile.
    """
    results: list[StudiedProfile] = []
    digests: dict[int, Digests] = {}
    with request.executor() as executor:
        size = run_length(len(jobs), executor.workers, long=opened is not nullcontext)
        token = uuid.uuid4().hex
        runs = [
            ProfileRun(token, request.archive.resolve(), name, study, tuple(jobs[first : first + size]), inputs, opened)
            for first in range(0, len(jobs), size)
        ]
        for studied in executor.run(study_run, runs):
            for result, written in studied:
                results.append(result)
                digests[result.index] = written
                request.on_profile(result.number)
    return sorted(results, key=lambda result: result.number), digests


def run_length(jobs: int, workers: int, *, long: bool = False) -> int:
    """Return the number of jobs in a run.

    Each worker gets several runs: the workers then end at about the same time, and progress is visible. Runs are
    `long` if opening the inputs takes most of the time.
    """
    if long:
        return max(1, -(-jobs // (RUNS_PER_WORKER * workers)))
    runs = RUNS_PER_WORKER * workers if workers > 1 else 1
    return max(1, min(MAX_RUN, jobs // runs))


def study_run(run: ProfileRun) -> list[tuple[StudiedProfile, Digests]]:
    """Study a run's profiles and write their rows; return the coordinator's part and the digests of the chunks."""
    writer = ArchiveRows(run.archive)
    archive = _archive_of(run.token, run.archive)
    with threadpool_limits(limits=1), run.opened(run.inputs) as inputs:
        return [_study_and_write(run, archive, writer, job, inputs) for job in run.jobs]


@lru_cache(maxsize=1)
def _archive_of(token: str, archive: Path) -> Archive:
    """Open an archive once in a worker for all runs of a study; it does not change during the study."""
    return open_for_reading(archive)


def _study_and_write(
    run: ProfileRun, archive: Archive, writer: ArchiveRows, job: Any, inputs: Any
) -> tuple[StudiedProfile, Digests]:
    result = run.study(archive, job, inputs)
    if result.chunk_rows:
        writer.write(result.index, run.name, result.chunk_rows)
    return replace(result, chunk_rows={}), writer.taken_digests()
