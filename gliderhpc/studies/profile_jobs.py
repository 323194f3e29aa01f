"""The jobs of a study, one a profile: run in lots on workers, which write the rows into the study's group."""

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

from gliderhpc.archive.mission import open_for_job
from gliderhpc.archive.reader import Archive
from gliderhpc.store_schema import ArchiveRows, Digests
from gliderhpc.studies.request import Request

Job = TypeVar("Job")

RUNS_PER_WORKER, MAX_RUN = 4, 8
"""Runs of jobs a worker, and profiles in a run at most."""

OpenInputs = Callable[[Any], AbstractContextManager[Any]]
"""Opens the inputs that the jobs of a run share."""


@dataclass(frozen=True)
class StudiedProfile:
    """Result of a study of one profile.

    Attributes
    ----------
    number, index : int
        The profile's number, and its place in the archive.
    row : mapping of str to value
        Values for the coordinator: the profile's row of the group's table, and what the study of the mission takes.
    rows : mapping of str to array_like
        Its rows of the group's other variables; the worker writes them.
    """

    number: int
    index: int
    row: Mapping[str, Any]
    rows: Mapping[str, ArrayLike] = field(default_factory=dict, kw_only=True)


@dataclass(frozen=True)
class Run:
    """Profiles that a worker studies one after the other; the runs of a study have its token in common."""

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
    """Run a study's jobs, one a profile.

    Parameters
    ----------
    request : Request
        Archive, executor and progress.
    name : str
        Of the study and its group.
    study : callable
        ``(archive, job, inputs) -> StudiedProfile``, in a worker.
    jobs : sequence
        One a profile.
    inputs : object
        Shared by all jobs.
    opened : callable
        Opens the inputs, once a run of jobs.

    Returns
    -------
    results : list of StudiedProfile
        By number of profile.
    digests : dict of int to mapping
        Of the chunks that the workers wrote, by position of the profile.
    """
    results: list[StudiedProfile] = []
    digests: dict[int, Digests] = {}
    with request.executor() as executor:
        size = run_length(len(jobs), executor.workers, long=opened is not nullcontext)
        token = uuid.uuid4().hex
        runs = [
            Run(token, request.archive.resolve(), name, study, tuple(jobs[first : first + size]), inputs, opened)
            for first in range(0, len(jobs), size)
        ]
        for studied in executor.run(study_run, runs):
            for result, written in studied:
                results.append(result)
                digests[result.index] = written
                request.report(result.number)
    return sorted(results, key=lambda result: result.number), digests


def run_length(jobs: int, workers: int, *, long: bool = False) -> int:
    """Return the jobs of a run: several runs a worker, so that all end at about the same time with visible progress.

    Runs are long where opening their inputs is what takes time.
    """
    if long:
        return max(1, -(-jobs // (RUNS_PER_WORKER * workers)))
    runs = RUNS_PER_WORKER * workers if workers > 1 else 1
    return max(1, min(MAX_RUN, jobs // runs))


def study_run(run: Run) -> list[tuple[StudiedProfile, Digests]]:
    """Study a run's profiles and write their rows; returns the coordinator's part, with the digests of the chunks."""
    writer = ArchiveRows(run.archive)
    archive = _archive_of(run.token, run.archive)
    with threadpool_limits(limits=1), run.opened(run.inputs) as inputs:
        return [_study_and_write(run, archive, writer, job, inputs) for job in run.jobs]


@lru_cache(maxsize=1)
def _archive_of(token: str, archive: Path) -> Archive:
    """Open an archive once in a worker for all runs of a study, as it does not change meanwhile."""
    return open_for_job(archive)


def _study_and_write(
    run: Run, archive: Archive, writer: ArchiveRows, job: Any, inputs: Any
) -> tuple[StudiedProfile, Digests]:
    result = run.study(archive, job, inputs)
    if result.rows:
        writer.write(result.index, run.name, result.rows)
    return replace(result, rows={}), writer.taken_digests()
