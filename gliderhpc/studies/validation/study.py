"""Section 3 of the paper: the fixed-parameter forward model against the records, profile by profile."""

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from threadpoolctl import threadpool_limits

from gliderhpc.archive.opening import open_for_reading
from gliderhpc.errors import InputError, ProfileError
from gliderhpc.estimation.preparation import check_seawater, on_steps
from gliderhpc.estimation.self_motion import SelfMotion, glide_angle_motion
from gliderhpc.estimation.vibration import vibration_set
from gliderhpc.flight.glider import Glider
from gliderhpc.mission.executors import Executor
from gliderhpc.mission.planning import select_profiles
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.observations import Observations, ProfileRecord, Survey, open_observations
from gliderhpc.platform import Platform
from gliderhpc.store_schema import create_study, write_profile, write_table_rows
from gliderhpc.studies.archived import positions
from gliderhpc.studies.provenance import Provenance
from gliderhpc.studies.study import finish_study_group
from gliderhpc.studies.validation.forward_model import Flight, compared_samples, fly, horizontal_errors, vertical_errors

GROUP = "validation"

TITLE = "the fixed-parameter forward model against the records"
"""One line about it."""

NO_ESTIMATE = "none"
"""Whose estimate is validated: the forward model is flown without any."""

_ON_RECORDS = ("step", "output_interval")
"""Settings that fix the archive's axes, and so cannot differ from the archive's."""


@dataclass(frozen=True)
class ValidationJob:
    """One profile to fly: where to read, with what, where to write."""

    number: int
    index: int
    observations: str
    store: str
    survey: Survey
    platform: Platform
    settings: MissionSettings


@dataclass(frozen=True)
class ValidationResult:
    """The profile's row of the group's table; a profile that could not be flown has a message instead."""

    number: int
    index: int
    row: Mapping[str, Any]

    @property
    def failed(self) -> bool:
        """Whether the profile could not be flown."""
        return bool(self.row.get("message"))


def validate(
    observations: Observations,
    platform: Platform,
    settings: MissionSettings,
    store: str | Path,
    executor: Callable[[], AbstractContextManager[Executor]],
    *,
    profiles: str | None = None,
    report: Callable[[int], None] = lambda _: None,
) -> None:
    """Fly every chosen profile of an archive open loop, and leave the comparison in its group ``validation``.

    Parameters
    ----------
    observations : Observations
        The open file that the archive was made from.
    platform, settings : Platform, MissionSettings
        The hull to validate, which need not be the archive's; the settings' step and output interval must be.
    store : path
        The archive.
    executor : callable
        Opens where jobs run.
    profiles : str, optional
        Which of the archive's profiles, as ``18:20,68``.
    report : callable
        Called with the number of each profile when it is done.

    Raises
    ------
    InputError
        The archive was made from other observations or on other axes, or has no such profile; or density is asked for
        with a hull that states no compressibility.
    """
    check_seawater(platform, settings)
    with open_for_reading(store) as archive:
        _check_belongs(archive, observations, settings, store)
        where = positions(archive)
    chosen = select_profiles(list(where), profiles)
    jobs = [
        ValidationJob(
            number, where[number], str(Path(observations.path).resolve()), str(Path(store).resolve()),
            observations.survey.only([number]), platform, settings,
        )
        for number in chosen
    ]  # fmt: skip
    create_study(store, GROUP)
    results = []
    with executor() as opened:
        for result in opened.run(validate_profile, jobs):
            results.append(result)
            report(result.number)
    write_table_rows(store, {result.index: result.row for result in results}, GROUP)
    _conclude(store, platform, settings, sorted(results, key=lambda result: result.number))


def _conclude(
    store: str | Path, platform: Platform, settings: MissionSettings, results: list[ValidationResult]
) -> None:
    """Close the group, unless nothing could be flown."""
    if all(result.failed for result in results):
        raise InputError(f"{store}: no profile could be flown; {results[0].row['message']}")
    columns = dict.fromkeys(("profile", "elapsed_days", *(name for result in results for name in result.row)))
    made = Provenance(
        tuple(result.number for result in results), tuple(columns), NO_ESTIMATE, False,
        settings.model_dump(mode="json"), (),
    )  # fmt: skip
    finish_study_group(store, GROUP, made, {"platform": platform.model_dump(mode="json")})


def validate_profile(job: ValidationJob) -> ValidationResult:
    """Fly one profile and write its rows; the job of a worker."""
    with threadpool_limits(limits=1), open_observations(job.observations, survey=job.survey) as observations:
        try:
            row = _fly(job, observations.profile(job.number))
        except ProfileError as error:
            row = {"message": str(error)}
    return ValidationResult(job.number, job.index, row)


def _fly(job: ValidationJob, record: ProfileRecord) -> dict[str, Any]:
    series = on_steps(record, job.settings)
    shaken = vibration_set(job.platform, series)
    flight = fly(Glider(job.platform), series)
    conventional = glide_angle_motion(job.platform, series, shaken)
    _write(job, flight, conventional)
    return {
        **vertical_errors(flight, series, compared_samples(flight, series, shaken)),
        **horizontal_errors(flight, series, record, conventional),
        "flown_fraction": min(flight.surfaced, len(series.time)) / len(series.time),
    }


def _write(job: ValidationJob, flight: Flight, conventional: SelfMotion) -> None:
    every = job.settings.steps_per_record
    states = flight.states[::every]
    reckoned = np.concatenate([np.zeros((1, 2)), np.cumsum(conventional.steps, axis=0)])[::every]
    write_profile(
        job.store, job.index, GROUP,
        {
            "roll": np.degrees(states[:, 0]),
            "pitch": np.degrees(states[:, 1]),
            "heading": np.mod(np.degrees(states[:, 2]), 360.0),
            "depth": states[:, 5],
            "X": states[:, 3],
            "Y": states[:, 4],
            "X_glide_angle": reckoned[:, 0],
            "Y_glide_angle": reckoned[:, 1],
        },
    )  # fmt: skip


def _check_belongs(
    archive: xr.DataTree, observations: Observations, settings: MissionSettings, store: str | Path
) -> None:
    if archive.attrs.get("observations_digest") != observations.digest():
        raise InputError(
            f"{store}: was not made from {observations.path}; give the observation file that run-mission read "
            f"({archive.attrs.get('observations')})"
        )
    for key in _ON_RECORDS:
        if archive.attrs[key] != getattr(settings, key):
            raise InputError(f"--set {key}: the archive's is {archive.attrs[key]:g} s, and its records are fixed to it")
