"""Section 3 of the paper: the fixed-parameter forward model compared with the records, profile by profile.

Each profile is simulated once over the whole dive, without feedback or disturbance, as in the paper's Figure 1. The run
starts from the first state (measured attitude and depth, speed of the glide). The drift of the model is not corrected.
The statistics of the mission therefore use pitch and depth *rate*, whose errors do not accumulate; depth, heading and
track are reported as computed.
"""

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gliderhpc.angles import principal_angle
from gliderhpc.archive.mission import open_for_reading
from gliderhpc.archive.profile import SETTLING
from gliderhpc.archive.reader import Archive
from gliderhpc.errors import InputError, ProfileError
from gliderhpc.estimation.currents import local_displacement
from gliderhpc.estimation.preparation import check_seawater, controls_of, vibration_set
from gliderhpc.estimation.resample import on_steps
from gliderhpc.estimation.self_motion import SelfMotion, flight_guesses, glide_angle_motion, smoothed_slope
from gliderhpc.findings.findings import as_plain
from gliderhpc.flight.glider import Glider
from gliderhpc.mission.executors import Executor
from gliderhpc.mission.inputs import is_made_from
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.observations import Observations, ProfileRecord, ProfileSeries, Survey, open_observations
from gliderhpc.platform import Platform
from gliderhpc.store_schema import create_study, finish_study, write_manifests, write_table_rows
from gliderhpc.studies.archived import Provenance, chosen_among, positions
from gliderhpc.studies.library.scores import rms
from gliderhpc.studies.profile_jobs import StudiedProfile, run_jobs
from gliderhpc.studies.request import Request

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

GROUP = "validation"

TITLE = "the fixed-parameter forward model against the records"
"""Title of the study."""

NO_ESTIMATE = "none"
"""Name stored as the estimate: the forward model does not use one."""

_ON_RECORDS = ("step", "output_interval")
"""Settings that determine the archive's axes; they must equal the archive's."""


RATE_SMOOTHING = 60.0
"""Interval over which depth rates of both model and record are computed, s (three sample intervals, if longer)."""
SURFACED_HEIGHT = 0.5
"""Height (m) above both the surface and its first depth at which the modelled glider is taken to have surfaced."""


@dataclass(frozen=True, eq=False)
class ForwardRun:
    """A forward run.

    Attributes
    ----------
    states : (n+1, 12)
        States of eq. 16; from `surfaced` on, the glider stays where it surfaced.
    surfaced : int
        First sample at the surface; n + 1 if the glider never surfaced.
    """

    states: Array
    surfaced: int


def run_forward(glider: Glider, series: ProfileSeries) -> ForwardRun:
    """Simulate a profile open loop with its recorded controls.

    Raises
    ------
    ProfileError
        The trajectory left the model's domain.
    """
    controls = controls_of(glider.platform, series)
    state0 = flight_guesses(glider.platform, series)[0]
    states = glider.simulate(state0, controls, np.zeros((len(controls), 6)), series.step)
    up = np.flatnonzero(states[:, 5] < min(0.0, state0[5]) - SURFACED_HEIGHT)
    surfaced = int(up[0]) if len(up) else len(states)
    if not np.isfinite(states[:surfaced]).all():
        raise ProfileError("the forward model diverged under the recorded controls: check the hull")
    # The model is not valid above the surface; a glider that surfaces early waits there.
    states[surfaced:] = states[max(surfaced - 1, 0)]
    return ForwardRun(states, surfaced)


def compared_samples(flight: ForwardRun, series: ProfileSeries, vibrating: Mask) -> Mask:
    """Mask ``(n+1,)`` of the samples used for statistics: measured, in steady glide, settled, before surfacing."""
    counted: Mask = ~vibrating & (series.weights > 0.0) & (series.time - series.time[0] >= SETTLING)
    counted[flight.surfaced :] = False
    return counted


def vertical_errors(flight: ForwardRun, series: ProfileSeries, counted: Mask) -> dict[str, float]:
    """Root mean square errors of depth (m), pitch and heading (degree), and of pitch and depth rate together (1).

    Notes
    -----
    ``longitudinal_rmse = sqrt((e_theta^2 + e_w^2) / 2)`` with ``e_theta = rms(theta - theta_g) / rms(theta_g)`` and
    ``e_w = rms(Zdot - Zdot_g) / rms(Zdot_g)``: dimensionless, and independent of the dive's length. The paper does not
    define its own measure.
    """
    residual = flight.states[:, [0, 1, 2, 5]] - series.measurements
    residual[:, 2] = principal_angle(residual[:, 2])
    width = max(RATE_SMOOTHING, 3.0 * series.sample_interval)
    rates = smoothed_slope(np.column_stack([flight.states[:, 5], series.measurements[:, 3]]), series.step, width)
    pitch = rms(residual[counted, 1]) / rms(series.measurements[counted, 1])
    rate = rms(rates[counted, 0] - rates[counted, 1]) / rms(rates[counted, 1])
    return {
        "depth_rmse": rms(residual[counted, 3]),
        "pitch_rmse": float(np.degrees(rms(residual[counted, 1]))),
        "heading_rmse": float(np.degrees(rms(residual[counted, 2]))),
        "longitudinal_rmse": float(np.sqrt(0.5 * (pitch**2 + rate**2))),
    }


def horizontal_errors(
    flight: ForwardRun, series: ProfileSeries, record: ProfileRecord, conventional: SelfMotion
) -> dict[str, float]:
    """Distances (m) at the end of the profile, and their ratios to the path length (1).

    The end of the modelled track is compared with that of the glide-angle dead reckoning (both through the water) and,
    if there are fixes, with the fix-to-fix displacement, which unlike the tracks includes the current.
    """
    track = flight.states[:, 3:5]
    reckoned = conventional.total
    path = float(np.linalg.norm(conventional.steps, axis=1).sum())
    error = float(np.linalg.norm(track[-1] - track[0] - reckoned))
    row = {
        "path_length": path,
        "horizontal_error": error,
        "horizontal_error_rate": error / path if path > 0.0 else float("nan"),
        "horizontal_error_on_course": float(np.linalg.norm(_on_recorded_course(flight, series) - reckoned)),
    }
    if record.entry_fix is not None and record.exit_fix is not None:
        moved = local_displacement(record.entry_fix, record.exit_fix)
        row["surfacing_error"] = float(np.linalg.norm(track[-1] - track[0] - moved))
        row["surfacing_error_rate"] = row["surfacing_error"] / path if path > 0.0 else float("nan")
        row["surfacing_error_glide_angle"] = float(np.linalg.norm(reckoned - moved))
    return row


def _on_recorded_course(flight: ForwardRun, series: ProfileSeries) -> Array:
    """Displacement ``(2,)`` at the modelled speed along the measured heading, which isolates the error of the speed."""
    lengths = np.linalg.norm(np.diff(flight.states[:, 3:5], axis=0), axis=1)
    heading = series.measurements[:-1, 2]
    return np.array([lengths @ np.cos(heading), lengths @ np.sin(heading)])


def validated_profiles(archive: Archive, text: str | None, quick: bool = False) -> tuple[int, ...]:
    """Choose among all profiles of an archive; those without an estimate can be simulated too.

    Raises
    ------
    InputError
        The text names a profile that the archive does not have.
    """
    return chosen_among(list(positions(archive)), text, quick)


def validate(
    observations: Observations,
    platform: Platform,
    settings: MissionSettings,
    store: str | Path,
    executor: Callable[[], AbstractContextManager[Executor]],
    *,
    profiles: str | None = None,
    quick: bool = False,
    on_profile: Callable[[int], None] = lambda _: None,
) -> None:
    """Simulate every chosen profile of an archive open loop, and write the comparison into its group ``validation``.

    Parameters
    ----------
    observations : Observations
        The open file that the archive was made from.
    platform, settings : Platform, MissionSettings
        Hull to validate, which may differ from the archive's, and settings, whose step and output interval must equal
        the archive's.
    store : path
        The archive.
    executor : callable
        Context manager that opens the executor of the jobs.
    profiles : str, optional
        Profiles of the archive to simulate, such as ``18:20,68``.
    quick : bool
        True to simulate only the first few of these.
    on_profile : callable
        Function called with the number of each finished profile.

    Raises
    ------
    InputError
        The archive was made from other observations or on other axes, or has no such profile; or the settings request
        density and the hull has no compressibility.
    """
    check_seawater(platform, settings)
    with open_for_reading(store) as archive:
        where = positions(archive)
        chosen = {number: where[number] for number in validated_profiles(archive, profiles, quick)}
        _check_belongs(archive, observations, chosen, settings, store)
    jobs = [(number, index, observations.survey.only([number])) for number, index in chosen.items()]
    create_study(store, GROUP)
    request = Request(Path(store), executor, on_profile=on_profile)
    inputs = (str(Path(observations.path).resolve()), platform, settings)
    results, digests = run_jobs(request, GROUP, fly_profile, jobs, inputs)
    write_table_rows(store, {result.index: result.table_row for result in results}, GROUP)
    if all("message" in result.table_row for result in results):
        raise InputError(f"{store}: no profile could be simulated; {results[0].table_row['message']}")
    write_manifests(store, GROUP, digests)
    columns = dict.fromkeys(("profile", "elapsed_days", *(name for result in results for name in result.table_row)))
    made = Provenance(
        profiles=tuple(result.number for result in results),
        columns=tuple(columns),
        estimate=NO_ESTIMATE,
        quick=quick,
        settings=settings.model_dump(mode="json"),
        remarks=(),
    )
    finish_study(store, GROUP, as_plain({**made.attributes(), "platform": platform.model_dump(mode="json")}))


def fly_profile(
    archive: Archive, job: tuple[int, int, Survey], inputs: tuple[str, Platform, MissionSettings]
) -> StudiedProfile:
    """Simulate one profile in a worker.

    Parameters
    ----------
    archive : Archive
        The archive, which is not read.
    job : (int, int, Survey)
        Number of the profile, its position in the archive, and its part of the observations' survey.
    inputs : (str, Platform, MissionSettings)
        Observation file, and hull and settings of the simulation.
    """
    (number, index, survey), (path, platform, settings) = job, inputs
    with open_observations(path, survey=survey) as observations:
        try:
            row, rows = _fly(observations.profile(number), platform, settings)
        except ProfileError as error:
            return StudiedProfile(number, index, {"message": str(error)})
    return StudiedProfile(number, index, row, rows)


def _fly(
    record: ProfileRecord, platform: Platform, settings: MissionSettings
) -> tuple[dict[str, float], dict[str, Array]]:
    """Row of the group's table, and the track on the records."""
    series = on_steps(record, settings, platform)
    vibrating = vibration_set(platform, series)
    flight = run_forward(Glider(platform), series)
    conventional = glide_angle_motion(platform, series, vibrating)
    row = {
        **vertical_errors(flight, series, compared_samples(flight, series, vibrating)),
        **horizontal_errors(flight, series, record, conventional),
        "flown_fraction": min(flight.surfaced, len(series.time)) / len(series.time),
    }
    every = settings.steps_per_record
    states = flight.states[::every]
    reckoned = np.concatenate([np.zeros((1, 2)), np.cumsum(conventional.steps, axis=0)])[::every]
    return row, {
        "roll": np.degrees(states[:, 0]),
        "pitch": np.degrees(states[:, 1]),
        "heading": np.mod(np.degrees(states[:, 2]), 360.0),
        "depth": states[:, 5],
        "X": states[:, 3],
        "Y": states[:, 4],
        "X_glide_angle": reckoned[:, 0],
        "Y_glide_angle": reckoned[:, 1],
    }


def _check_belongs(
    archive: Archive,
    observations: Observations,
    profiles: Mapping[int, int],
    settings: MissionSettings,
    store: str | Path,
) -> None:
    if not is_made_from(store, observations, profiles):
        raise InputError(
            f"{store}: was not made from {observations.path}; give the observation file that run-mission read "
            f"({archive.attrs.get('observations')})"
        )
    for key in _ON_RECORDS:
        if archive.attrs[key] != getattr(settings, key):
            raise InputError(f"`{key}`: the archive's value is {archive.attrs[key]:g} s, and its records require it")
