"""Simulation of a whole synthetic mission, which is written as observations with the truth next to them.

Every profile is one job. Its result is stored in its own file until it is written to the files of the mission.
"""

import json
import pickle
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gliderhpc.errors import InputError
from gliderhpc.flight.glider import Glider
from gliderhpc.observations.records import ProfileRecord
from gliderhpc.observations.times import SECOND
from gliderhpc.observations.truth import read_currents, truth_path
from gliderhpc.output_files import check_output, output_file
from gliderhpc.platform import Platform
from gliderhpc.simulator.files import append_truth, observation_columns, observation_file, truth_file
from gliderhpc.simulator.plan import courses, plan_flight
from gliderhpc.simulator.profile import ProfileTruth, fly_profile, place_profile
from gliderhpc.simulator.scenario import Scenario


@dataclass(frozen=True)
class PartJob:
    """Input of a worker that simulates one profile; the course is in degrees, and the folder receives its result."""

    number: int
    course: float
    platform: Platform
    scenario: Scenario
    seed: int
    folder: str


RunJobs: TypeAlias = Callable[[Callable[[PartJob], int], Sequence[PartJob]], Iterator[int]]
"""Function that runs another one over jobs and yields the results in any order, like the executors of
``gliderhpc.mission``."""


def one_by_one(function: Callable[[PartJob], int], jobs: Sequence[PartJob]) -> Iterator[int]:
    """Run the jobs one after the other in this process."""
    return map(function, jobs)


def make_part(job: PartJob) -> int:
    """Simulate one profile, write it to its part file and return its number."""
    flown = fly_profile(Glider(job.platform), job.scenario, job.seed, job.number, job.course)
    aside = part_path(job.folder, job.number).with_suffix(".partial")
    with aside.open("wb") as file:
        pickle.dump(flown, file, protocol=5)
    # A worker that dies leaves no incomplete part.
    aside.replace(part_path(job.folder, job.number))
    return job.number


def parts_in_order(jobs: Sequence[PartJob], run: RunJobs) -> Iterator[tuple[ProfileRecord, ProfileTruth]]:
    """Run the jobs and yield their results in the order of the jobs, independent of the order of completion."""
    waiting = [job.number for job in jobs]
    done: set[int] = set()
    for number in run(make_part, jobs):
        done.add(number)
        while waiting and waiting[0] in done:
            yield _taken(part_path(jobs[0].folder, waiting.pop(0)))


def part_path(folder: str, number: int) -> Path:
    """Path of the temporary file with the result of one profile."""
    return Path(folder) / f"profile_{number:06d}.part"


def _taken(path: Path) -> tuple[ProfileRecord, ProfileTruth]:
    with path.open("rb") as file:
        record, truth = pickle.load(file)
    path.unlink()
    return record, truth


@dataclass(frozen=True)
class ProfileSummary:
    """Summary of one simulated profile.

    Attributes
    ----------
    number : int
        Number of the profile.
    start : numpy.datetime64
        Time of its first sample.
    duration, max_depth : float
        Duration (s) and greatest depth (m) of the dive.
    samples, impulses : int
        Numbers of samples and of impulses.
    current_north, current_east : float
        True depth-averaged current, m/s.
    """

    number: int
    start: np.datetime64
    duration: float
    max_depth: float
    samples: int
    impulses: int
    current_north: float
    current_east: float


@dataclass(frozen=True)
class MissionSummary:
    """Result of `simulate_mission`: the files, summaries of their profiles, and the duration of the mission (s)."""

    path: Path
    truth_path: Path
    profiles: tuple[ProfileSummary, ...]
    elapsed: float


def simulate_mission(
    platform: Platform,
    path: str | Path,
    *,
    scenario: Scenario | None = None,
    seed: int = 0,
    run: RunJobs = one_by_one,
    on_profile: Callable[[ProfileSummary], None] | None = None,
    overwrite: bool = False,
) -> MissionSummary:
    """Simulate a mission and write it as observations, with the truth next to it.

    Parameters
    ----------
    platform : Platform
        The hull.
    path : str or Path
        Observation file to write, ending in ``.nc``; the truth is written to ``.truth.nc``.
    scenario : Scenario, optional
        The scenario, by default four profiles of about 45 minutes.
    seed : int
        Seed of the random numbers, not negative. The same seed gives the same bytes.
    run : callable, optional
        Function that runs the simulation of the profiles, such as ``Executor.run`` of ``gliderhpc.mission``; by default
        they run in this process. The bytes do not depend on it, and only a few profiles are in memory at a time.
    on_profile : callable, optional
        Function that is called with the summary of each profile after it has been written.
    overwrite : bool
        Replace existing files.

    Raises
    ------
    InputError
        The hull cannot fly the scenario, or a file exists and may not be replaced, or cannot be written.
    """
    path, scenario = Path(path), scenario or Scenario()
    check_mission_path(path, overwrite=overwrite)
    summaries = []
    # The truth is closed first, so complete observations always have their truth.
    with (
        tempfile.TemporaryDirectory(prefix=f".{path.name}.", dir=path.parent) as folder,
        observation_file(path, _attributes(platform, scenario, seed), overwrite=overwrite) as observed,
        truth_file(truth_path(path), _attributes(platform, scenario, seed, truth=True), overwrite=overwrite) as true,
    ):
        for record, truth in _mission(platform, scenario, seed, folder, run):
            observed.append(observation_columns(record))
            append_truth(true, truth)
            summaries.append(_summary(truth))
            if on_profile is not None:
                on_profile(summaries[-1])
    elapsed = float((truth.surface_until - np.datetime64(scenario.start, "ns")) / SECOND)
    return MissionSummary(path, truth_path(path), tuple(summaries), elapsed)


def _mission(
    platform: Platform, scenario: Scenario, seed: int, folder: str, run: RunJobs
) -> Iterator[tuple[ProfileRecord, ProfileTruth]]:
    """Fly the profiles with `run`, and place them one after the other in time and space."""
    time: np.datetime64 = np.datetime64(scenario.start, "ns")
    position = scenario.origin
    for flown in parts_in_order(_jobs(platform, scenario, seed, folder), run):
        record, truth = place_profile(*flown, scenario, seed, time, position)
        time, position = truth.surface_until, truth.end
        yield record, truth


def _jobs(platform: Platform, scenario: Scenario, seed: int, folder: str) -> list[PartJob]:
    # The plan is made here too, which refuses a scenario that the hull cannot fly before any worker starts.
    plan = plan_flight(Glider(platform), scenario)
    steered = courses(scenario, plan, seed, scenario.profiles)
    return [PartJob(number, course, platform, scenario, seed, folder) for number, course in enumerate(steered, start=1)]


def _summary(truth: ProfileTruth) -> ProfileSummary:
    return ProfileSummary(
        number=truth.number,
        start=truth.epoch,
        duration=truth.duration,
        max_depth=float(truth.states[:, 5].max()),
        samples=len(truth.time),
        impulses=len(truth.impulses),
        current_north=float(truth.current[0]),
        current_east=float(truth.current[1]),
    )


def _attributes(platform: Platform, scenario: Scenario, seed: int, *, truth: bool = False) -> dict[str, str | int]:
    attributes: dict[str, str | int] = {
        "platform": platform.name,
        "mission": f"synthetic {scenario.name}, seed {seed}",
        "source": "gliderhpc simulate-mission: a synthetic mission; no glider was at sea",
    }
    if truth:
        attributes |= {
            "title": "truth of a synthetic mission",
            "seed": seed,
            "scenario": scenario.model_dump_json(),
            "platform_parameters": json.dumps(platform.model_dump(mode="json")),
        }
    return attributes


def check_mission_path(path: Path, *, overwrite: bool, inputs: Iterable[Path | str] = ()) -> None:
    """Refuse an unusable path of a mission's observations or their truth, before the mission is flown.

    Raises
    ------
    InputError
        As for `check_output`, or the name does not end in ``.nc`` or ends in ``.truth.nc``.
    """
    if path.suffix != ".nc" or path.name.endswith(".truth.nc"):
        raise InputError(f"{path}: give a name that ends in .nc (and not in .truth.nc, which is for the truth)")
    for place in (path, truth_path(path)):
        check_output(place, overwrite=overwrite, inputs=inputs)


INTERVAL = np.timedelta64(6, "h")
"""Interval between the fields of the ocean model."""

ERROR = 0.05
"""Standard deviation of the error of either component, m/s; the error is constant over the depths of a dive and
independent between dives."""

_MARGIN = 0.5
"""Margin of the grid around the dives, degree."""

_NAMES = {
    "vo": ("northward_sea_water_velocity", "profile_current_north"),
    "uo": ("eastward_sea_water_velocity", "profile_current_east"),
}


def write_ocean_model(truth: str | Path, out: Path, seed: int) -> Path:
    """Write the file of an ocean model with random errors.

    The fields are horizontally uniform and six hours apart. Each is the true current of the dive nearest in time plus
    its error, at the depths of the truth.

    Parameters
    ----------
    truth : str or Path
        Truth file of a synthetic mission.
    out : Path
        The file to write; an existing file is replaced.
    seed : int
        Seed of the errors.

    Raises
    ------
    InputError
        The truth cannot be read, or the file cannot be written.
    """
    currents = read_currents(truth)
    times, dives = _fields(currents["entry_time"].values)
    errors = ERROR * np.random.default_rng(seed).standard_normal((2, len(currents["dive"])))
    corners = {axis: _corners(currents, axis) for axis in ("latitude", "longitude")}
    shape = (len(times), len(currents["level"]), 2, 2)
    dataset = xr.Dataset(
        {
            name: (
                ("time", "depth", "latitude", "longitude"),
                np.broadcast_to((currents[column].values + error[:, None])[dives][:, :, None, None], shape),
                {"standard_name": standard, "units": "m s-1"},
            )
            for error, (name, (standard, column)) in zip(errors, _NAMES.items(), strict=True)
        },
        coords={
            "time": ("time", times, {"standard_name": "time", "axis": "T"}),
            "depth": ("depth", currents["level"].values, {"units": "m", "positive": "down", "axis": "Z"}),
            "latitude": ("latitude", corners["latitude"], {"units": "degrees_north", "axis": "Y"}),
            "longitude": ("longitude", corners["longitude"], {"units": "degrees_east", "axis": "X"}),
        },
        attrs={
            "Conventions": "CF-1.11",
            "title": "true currents of a synthetic mission with random errors; no ocean model was run",
            "seed": seed,
        },
    )
    with output_file(out, overwrite=True) as aside:
        dataset.to_netcdf(aside, engine="netcdf4")
    return out


def _fields(entries: NDArray[np.datetime64]) -> tuple[NDArray[np.datetime64], NDArray[np.int64]]:
    """Times of the fields, and for each the index of the dive nearest in time."""
    times = np.arange(entries[0] - 4 * INTERVAL, entries[-1] + 4 * INTERVAL, INTERVAL)
    return times, np.abs(times[:, None] - entries).argmin(axis=1)


def _corners(currents: xr.Dataset, axis: str) -> NDArray[np.float64]:
    """Ends of an axis of the grid, which covers all dives."""
    places = np.concatenate([currents[f"{end}_{axis}"].values for end in ("entry", "exit")])
    return np.array([places.min() - _MARGIN, places.max() + _MARGIN])
