"""The jobs of a study, one a profile: run in lots on workers, which write the rows into the study's group."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import xarray as xr
from numpy.typing import ArrayLike
from threadpoolctl import threadpool_limits

from gliderhpc.archive.mission import open_for_job
from gliderhpc.store_schema import ArchiveRows, Digests, write_manifests, write_table_rows

if TYPE_CHECKING:
    from gliderhpc.studies.study import Request

Job = TypeVar("Job")
Studied = TypeVar("Studied", bound="StudiedProfile")

RUNS_PER_WORKER, MAX_RUN = 4, 8
"""Runs of jobs a worker, and profiles in a run at most."""


@dataclass(frozen=True)
class StudiedProfile:
    """Result of a study of one profile.

    Attributes
    ----------
    number, index : int
        The profile's number, and its place in the archive.
    row : mapping of str to value
        Its row of the table of the study's group.
    rows : mapping of str to array_like
        Its rows of the group's other variables; the worker writes them.
    """

    number: int
    index: int
    row: Mapping[str, Any]
    rows: Mapping[str, ArrayLike] = field(default_factory=dict, kw_only=True)


@dataclass(frozen=True)
class Run:
    """Profiles that a worker studies one after the other: an archive takes longer to open than a profile to study."""

    archive: Path
    name: str
    study: Callable[[xr.DataTree, Any], StudiedProfile]
    jobs: tuple[Any, ...]


def study_profiles(
    request: Request, name: str, study: Callable[[xr.DataTree, Job], Studied], jobs: Sequence[Job]
) -> list[Studied]:
    """Run a study's jobs, one a profile, and leave their rows in its group; results by number of profile."""
    results, digests = run_jobs(request, name, study, jobs)
    write_table_rows(request.archive, {result.index: result.row for result in results}, name)
    write_manifests(request.archive, name, digests)
    return results


def run_jobs(
    request: Request, name: str, study: Callable[[xr.DataTree, Job], Studied], jobs: Sequence[Job]
) -> tuple[list[Studied], dict[int, Digests]]:
    """Run a study's jobs, one a profile: results by number of profile, and digests of the chunks by its position."""
    results: list[Studied] = []
    digests: dict[int, Digests] = {}
    with request.executor() as opened:
        size = run_length(len(jobs), opened.workers)
        runs = [
            Run(request.archive.resolve(), name, study, tuple(jobs[first : first + size]))
            for first in range(0, len(jobs), size)
        ]
        for studied in opened.run(study_run, runs):
            for result, written in studied:
                results.append(result)
                digests[result.index] = written
                request.report(result.number)
    return sorted(results, key=lambda result: result.number), digests


def run_length(jobs: int, workers: int) -> int:
    """Return the jobs of a run: several runs a worker, so that all end at about the same time with visible progress."""
    runs = RUNS_PER_WORKER * workers if workers > 1 else 1
    return max(1, min(MAX_RUN, jobs // runs))


def study_run(run: Run) -> list[tuple[Any, Digests]]:
    """Study a run's profiles and write their rows; returns the coordinator's part, with the digests of the chunks."""
    writer = ArchiveRows(run.archive)
    with threadpool_limits(limits=1), open_for_job(run.archive) as archive:
        return [_study_and_write(run, archive, writer, job) for job in run.jobs]


def _study_and_write(run: Run, archive: xr.DataTree, writer: ArchiveRows, job: Any) -> tuple[StudiedProfile, Digests]:
    result = run.study(archive, job)
    if result.rows:
        writer.write(result.index, run.name, result.rows)
    return replace(result, rows={}), writer.taken_digests()
