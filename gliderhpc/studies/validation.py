"""Section 3 of the paper: the fixed-parameter forward model compared with the records, profile by profile.

Each profile is simulated once over the whole dive, without feedback or disturbance, as in the paper's Figure 1. The run
starts from the first state (measured attitude and depth, speed of the glide). The drift of the model is not corrected.
The statistics of the mission therefore use pitch and depth *rate*, whose errors do not accumulate; depth, heading and
track are reported as computed.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gliderhpc.angles import principal_angle
from gliderhpc.archive.profile import SETTLING
from gliderhpc.archive.reader import Archive
from gliderhpc.errors import InputError, ProfileError
from gliderhpc.estimation.currents import local_displacement
from gliderhpc.estimation.preparation import check_seawater, controls_of, vibration_set
from gliderhpc.estimation.resample import on_steps
from gliderhpc.estimation.self_motion import SelfMotion, flight_guesses, glide_angle_motion, smoothed_slope
from gliderhpc.flight.glider import Glider
from gliderhpc.mission.input_digests import is_made_from
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.observations import Observations, ProfileRecord, ProfileSeries, Survey, open_observations
from gliderhpc.platform import Platform
from gliderhpc.studies.archived import positions
from gliderhpc.studies.library.scores import rms
from gliderhpc.studies.request import Request, Simulation
from gliderhpc.studies.study import Preparation, ProfileContext, RecordStudy, Row

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

GROUP = "validation"

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


Inputs = tuple[str, Survey, Platform, MissionSettings]
"""Observation file with its survey, and hull and settings of the simulation."""


def prepare(request: Request, archive: Archive, numbers: tuple[int, ...], settings: MissionSettings) -> Preparation:
    """Check that the records to simulate are those of the archive.

    Raises
    ------
    InputError
        The archive was made from other observations or on other axes; or the settings request density and the hull has
        no compressibility.
    """
    simulation = _simulation_of(request)
    observations, platform = simulation.observations, simulation.platform
    check_seawater(platform, settings)
    where = positions(archive)
    _check_belongs(archive, observations, {number: where[number] for number in numbers}, settings, request.archive)
    survey = observations.survey.only(list(numbers))
    return Preparation(
        inputs=(str(Path(observations.path).resolve()), survey, platform, settings),
        attributes={"platform": platform.model_dump(mode="json")},
    )


def _simulation_of(request: Request) -> Simulation:
    if request.simulation is None:
        raise InputError(f"{GROUP}: needs records, hull and settings; run it with gliderhpc.validate")
    return request.simulation


def fly_profile(_: Any, context: ProfileContext) -> Row:
    """Simulate one profile open loop: errors, and the track on the records.

    Raises
    ------
    ProfileError
        The profile cannot be read or simulated.
    """
    path, survey, platform, settings = context.inputs
    with open_observations(path, survey=survey.only([context.number])) as observations:
        return _fly(observations.profile(context.number), platform, settings)


def check(request: Request, rows: Mapping[int, Row]) -> None:
    """Check that some profile could be simulated.

    Raises
    ------
    InputError
        None could.
    """
    if all("message" in row for row in rows.values()):
        first = next(iter(rows.values()))
        raise InputError(f"{request.archive}: no profile could be simulated; {first['message']}")


def _fly(record: ProfileRecord, platform: Platform, settings: MissionSettings) -> Row:
    """Row of the group's table, and the track on the records."""
    series = on_steps(record, settings, platform)
    vibrating = vibration_set(platform, series)
    flight = run_forward(Glider(platform), series)
    conventional = glide_angle_motion(platform, series, vibrating)
    every = settings.steps_per_record
    states = flight.states[::every]
    reckoned = np.concatenate([np.zeros((1, 2)), np.cumsum(conventional.steps, axis=0)])[::every]
    return {
        **vertical_errors(flight, series, compared_samples(flight, series, vibrating)),
        **horizontal_errors(flight, series, record, conventional),
        "flown_fraction": min(flight.surfaced, len(series.time)) / len(series.time),
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
        stored, chosen = archive.attrs[key], getattr(settings, key)
        if stored != chosen:
            raise InputError(f"`{key}={chosen:g}`: the archive's value is {stored:g} s, and its records require it")


STUDY = RecordStudy(
    GROUP,
    "the fixed-parameter forward model against the records",
    settings=lambda request: _simulation_of(request).settings,
    prepare=prepare,
    profile=fly_profile,
    check=check,
    mission_columns=("elapsed_days",),
)
