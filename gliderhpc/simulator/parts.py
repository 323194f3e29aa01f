"""A synthetic mission in parts: one job a profile, its result in a file of its own until the mission takes it up."""

import pickle
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

from gliderhpc.flight.glider import Glider
from gliderhpc.observations.records import ProfileRecord
from gliderhpc.platform import Platform
from gliderhpc.simulator.profile import ProfileTruth, fly_profile
from gliderhpc.simulator.scenario import Scenario


@dataclass(frozen=True)
class PartJob:
    """What a worker needs to simulate one profile: its number, its course (degree), and the folder for its part."""

    number: int
    course: float
    platform: Platform
    scenario: Scenario
    seed: int
    folder: str


RunJobs: TypeAlias = Callable[[Callable[[PartJob], int], Sequence[PartJob]], Iterator[int]]
"""Runs a function over jobs and yields the results in any order, as the executors of ``gliderhpc.mission`` do."""


def one_by_one(function: Callable[[PartJob], int], jobs: Sequence[PartJob]) -> Iterator[int]:
    """Run the jobs in this process."""
    return map(function, jobs)


def make_part(job: PartJob) -> int:
    """Simulate one profile, leave it in its file and return its number."""
    flown = fly_profile(Glider(job.platform), job.scenario, job.seed, job.number, job.course)
    aside = part_path(job.folder, job.number).with_suffix(".partial")
    with aside.open("wb") as file:
        pickle.dump(flown, file, protocol=5)
    # A worker that dies leaves no half of a part.
    aside.replace(part_path(job.folder, job.number))
    return job.number


def parts_in_order(jobs: Sequence[PartJob], run: RunJobs) -> Iterator[tuple[ProfileRecord, ProfileTruth]]:
    """Run the jobs and yield what they made in the jobs' own order, whatever the order they finish in."""
    waiting = [job.number for job in jobs]
    made: set[int] = set()
    for number in run(make_part, jobs):
        made.add(number)
        while waiting and waiting[0] in made:
            yield _taken(part_path(jobs[0].folder, waiting.pop(0)))


def part_path(folder: str, number: int) -> Path:
    """Where a part lies until it is taken up."""
    return Path(folder) / f"profile_{number:06d}.part"


def _taken(path: Path) -> tuple[ProfileRecord, ProfileTruth]:
    with path.open("rb") as file:
        record, truth = pickle.load(file)
    path.unlink()
    return record, truth
