"""A whole synthetic mission into files: its observations, and the truth beside them."""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from gliderhpc.errors import InputError
from gliderhpc.flight.glider import Glider
from gliderhpc.observations.records import Fix, ProfileRecord
from gliderhpc.observations.synthetic.plan import plan_flight
from gliderhpc.observations.synthetic.profile import ProfileTruth, fly_profile
from gliderhpc.observations.synthetic.scenario import Scenario
from gliderhpc.observations.synthetic.truth_file import truth_path, write_truth
from gliderhpc.observations.writer import write_observations
from gliderhpc.platform import Platform

_DECIMALS = 9
"""Of degrees and cm3 in the file: undoes the rounding of the way to radians and back, so that quanta stay quanta."""


@dataclass(frozen=True)
class ProfileSummary:
    """One simulated profile in figures.

    Attributes
    ----------
    number : int
        Its number.
    start : numpy.datetime64
        Time of its first sample.
    duration, max_depth : float
        Of the dive, s and m.
    samples, impulses : int
        How many.
    current_north, current_east : float
        True current, m/s.
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
    """What `simulate_mission` wrote: the files and, in figures, their profiles."""

    path: Path
    truth_path: Path
    profiles: tuple[ProfileSummary, ...]


def simulate_mission(
    platform: Platform,
    path: str | Path,
    *,
    scenario: Scenario | None = None,
    seed: int = 0,
    report: Callable[[ProfileSummary], None] | None = None,
) -> MissionSummary:
    """Simulate a mission and write it as observations, with the truth beside it.

    Parameters
    ----------
    platform : Platform
        The hull.
    path : str or Path
        Observation file to write, ending in ``.nc``; the truth goes into ``.truth.nc``. Both are replaced.
    scenario : Scenario, optional
        What happens, by default four profiles of about 45 minutes.
    seed : int
        Not negative. The same seed gives the same bytes.
    report : callable, optional
        Called with each profile once it is done.

    Raises
    ------
    InputError
        The hull cannot fly the scenario, or a file cannot be written.
    """
    path, scenario = Path(path), scenario or Scenario()
    _check_path(path)
    records, truths, summaries = [], [], []
    glider = Glider(platform)
    plan = plan_flight(glider, scenario)
    time: np.datetime64 = np.datetime64(scenario.start, "ns")
    position = scenario.origin
    for number in range(1, scenario.profiles + 1):
        record, truth = fly_profile(glider, plan, scenario, seed, number, time, position)
        time, position = truth.surface_until, truth.end
        records.append(record)
        truths.append(truth)
        summaries.append(_summary(truth))
        if report is not None:
            report(summaries[-1])
    # The truth first: where the observations lie complete, so does their truth.
    truth_file = write_truth(truths, truth_path(path), _attributes(platform, scenario, seed, truth=True))
    write_observations(observation_variables(records), path, attributes=_attributes(platform, scenario, seed))
    return MissionSummary(path, truth_file, tuple(summaries))


def observation_variables(records: Sequence[ProfileRecord]) -> dict[str, npt.NDArray[np.generic]]:
    """Variables of the observation format, in its units, from records in the order of the mission.

    Fixes are taken from `ProfileRecord.surface_fixes_before` and `surface_fixes_after`.
    """
    columns = [_columns(record) for record in records]
    variables = {name: np.concatenate([column[name] for column in columns]) for name in columns[0]}
    fixes = [fix for record in records for fix in (*record.surface_fixes_before, *record.surface_fixes_after)]
    return variables | _fix_columns(fixes)


def _columns(record: ProfileRecord) -> dict[str, npt.NDArray[np.generic]]:
    return {
        "time": record.epoch + np.rint(record.time * 1e9).astype("timedelta64[ns]"),
        "profile": np.full(len(record.time), record.number, dtype=np.int32),
        "roll": np.round(np.degrees(record.roll), _DECIMALS),
        "pitch": np.round(np.degrees(record.pitch), _DECIMALS),
        "heading": np.mod(np.round(np.degrees(record.heading), _DECIMALS), 360.0),
        "depth": record.depth,
        "battery_position": record.battery_position,
        "battery_rotation": np.round(np.degrees(record.battery_rotation), _DECIMALS),
        "ballast_volume": np.round(record.ballast_volume * 1e6, _DECIMALS),
    }


def _fix_columns(fixes: Sequence[Fix]) -> dict[str, npt.NDArray[np.generic]]:
    return {
        "fix_time": np.array([fix.time for fix in fixes], dtype="datetime64[ns]"),
        "fix_latitude": np.array([fix.latitude for fix in fixes]),
        "fix_longitude": np.array([fix.longitude for fix in fixes]),
    }


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
        "source": "gliderhpc simulate-mission: a synthetic mission, no glider was at sea",
    }
    if truth:
        attributes |= {
            "title": "truth of a synthetic mission",
            "seed": seed,
            "scenario": scenario.model_dump_json(),
            "platform_parameters": json.dumps(platform.model_dump(mode="json")),
        }
    return attributes


def _check_path(path: Path) -> None:
    if path.suffix != ".nc" or path.name.endswith(".truth.nc"):
        raise InputError(f"{path}: give a name that ends in .nc (and not in .truth.nc, which is for the truth)")
    if not path.parent.is_dir():
        raise InputError(f"{path}: the folder {path.parent} does not exist; make it first")
