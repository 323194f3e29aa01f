"""One profile in, one profile's chunks out: the job that a worker runs.

A job gets paths and numbers, never arrays; it writes its own chunks and, last, its commit marker. Run twice it leaves
what running it once leaves.
"""

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from gliderhpc.errors import ProfileError
from gliderhpc.estimation.currents import (
    DepthAveragedCurrent,
    cycles_of,
    depth_averaged_current,
    glide_angle_current,
    surface_drift,
)
from gliderhpc.estimation.diagnosis import quality_flags, remarks
from gliderhpc.estimation.outcomes import Outcome
from gliderhpc.estimation.profile import ProfileEstimate, estimate_profile, on_steps
from gliderhpc.estimation.self_motion import SelfMotion, glide_angle_motion, model_motion
from gliderhpc.flight.glider import Glider
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.observations import Fix, ProfileRecord, ProfileSeries, Survey, open_observations
from gliderhpc.platform import Platform
from gliderhpc.store_schema import DISTURBANCE_PRIOR, write_marker, write_profile
from gliderhpc.store_schema.schema import CHANNELS

Array = NDArray[np.float64]
Row = dict[str, Any]

STATES = ("roll", "pitch", "heading", "X", "Y", "depth", "u", "v", "w", "p", "q", "r")
_IN_DEGREES = ("roll", "pitch", "heading", "p", "q", "r")
_SECOND = np.timedelta64(1, "s")


@dataclass(frozen=True)
class ProfileJob:
    """What a worker needs to know: where to read, what to do, where to write.

    Attributes
    ----------
    number, index : int
        The profile's number and its position along the archive's profile dimension.
    observations, store : str
        Paths.
    survey : Survey
        The file's survey, cut down to this profile.
    platform, settings : Platform, MissionSettings
        The hull and the run's settings.
    mission_start : numpy.datetime64
        Where `elapsed_days` counts from.
    """

    number: int
    index: int
    observations: str
    store: str
    survey: Survey
    platform: Platform
    settings: MissionSettings
    mission_start: np.datetime64


@dataclass(frozen=True)
class ProfileResult:
    """What comes back from a job: the profile's row of the archive's table, nothing larger."""

    number: int
    index: int
    row: Row


def run_profile(job: ProfileJob) -> ProfileResult:
    """Estimate one profile and write its chunks; a profile that cannot be estimated comes back ``failed``, with why."""
    began = time.perf_counter()
    # Threads of linear algebra on vectors this short cost far more than they gain.
    with threadpool_limits(limits=1), open_observations(job.observations, survey=job.survey) as observations:
        row: Row = {
            "start_time": _epoch_seconds(observations.start_time(job.number)),
            "elapsed_days": float((observations.start_time(job.number) - job.mission_start) / _SECOND) / 86400.0,
            "duration": observations.duration(job.number),
            "sample_count": observations.sample_count(job.number),
        }
        try:
            record = observations.profile(job.number)
            row |= _process(job, record)
            row["status"] = "done"
        except ProfileError as error:
            row |= {"status": "failed", "message": str(error)}
    row["run_seconds"] = time.perf_counter() - began
    write_marker(job.store, job.index, _plain(row))
    return ProfileResult(job.number, job.index, row)


def _process(job: ProfileJob, record: ProfileRecord) -> Row:
    platform, settings = job.platform, job.settings
    series = on_steps(record, settings)
    estimate = estimate_profile(Glider(platform), series, settings)
    motion = model_motion(estimate.solution.states, estimate.shaken, series.step)
    conventional = glide_angle_motion(platform, series, estimate.shaken)
    current = depth_averaged_current(record, series, motion, cycles_of(series), settings.current)
    _write(job, record, estimate, current)
    row = _estimate_row(estimate, motion, conventional)
    row |= _current_row(record, current, glide_angle_current(record, series, conventional))
    row["message"] = "; ".join([*record.notes, *remarks(estimate)])
    return row


def _write(
    job: ProfileJob, record: ProfileRecord, estimate: ProfileEstimate, current: DepthAveragedCurrent | None
) -> None:
    """Write the profile's row of every group it owns."""
    series, solution = estimate.series, estimate.solution
    every = job.settings.steps_per_record
    clock = _epoch_seconds(record.epoch) + series.time
    flags, depth = quality_flags(estimate), series.measurements[:, 3]
    rows: dict[str, Row] = {
        "series": {
            "time": clock,
            "depth": depth,
            **_channels(solution.disturbances),
            "quality": flags,
        },
        "prior": _channels(estimate.prior.disturbances),
        "state": {"time": clock[::every], **_states(solution.states[::every])},
        "observed": {"time": clock[::every], **_observed(series, every)},
        "windows": _windows(estimate),
    }
    if current is not None:
        rows["drift_current"] = {
            "north": [segment.velocity[0] for segment in current.segments],
            "east": [segment.velocity[1] for segment in current.segments],
            "start": [segment.start for segment in current.segments],
            "stop": [segment.stop for segment in current.segments],
        }
    for group, values in rows.items():
        write_profile(job.store, job.index, group, values)


def _channels(disturbances: Array) -> Row:
    return {name: disturbances[:, i] for i, name in enumerate(CHANNELS)}


def _states(states: Array) -> Row:
    return {name: _in_file_units(name, states[:, i]) for i, name in enumerate(STATES)}


def _observed(series: ProfileSeries, every: int) -> Row:
    measured = np.where(series.weights[:, None] > 0.0, series.measurements, np.nan)[::every]
    position, rotation, volume, rudder = np.vstack([series.controls, series.controls[-1:]])[::every].T
    return {
        **{name: _in_file_units(name, measured[:, i]) for i, name in enumerate(("roll", "pitch", "heading", "depth"))},
        "battery_position": position,
        "battery_rotation": np.degrees(rotation),
        "ballast_volume": volume * 1e6,
        "rudder": np.degrees(rudder),
    }


def _in_file_units(name: str, values: Array) -> Array:
    if name not in _IN_DEGREES:
        return values
    degrees = np.degrees(values)
    return np.mod(degrees, 360.0) if name == "heading" else degrees


def _windows(estimate: ProfileEstimate) -> Row:
    windows = estimate.solution.windows
    names = ("start", "stop", "cost", "iterations", "evaluations", "gradient_norm")
    row: Row = {name: np.array([getattr(window, name) for window in windows]) for name in names}
    row["retracted"] = np.array([window.retracted for window in windows], dtype=np.int8)
    row["outcome"] = np.array([window.outcome for window in windows], dtype=np.int8)
    return row


def _estimate_row(estimate: ProfileEstimate, motion: SelfMotion, conventional: SelfMotion) -> Row:
    windows, prior = estimate.solution.windows, estimate.prior
    return {
        "max_depth": float(estimate.series.measurements[:, 3].max()),
        "window_count": len(windows),
        "converged_fraction": float(np.mean([window.outcome == Outcome.CONVERGED for window in windows])),
        "iterations_median": float(np.median([window.iterations for window in windows])),
        "gated_count": prior.gated,
        "inflated_count": prior.inflated,
        "reset_count": prior.reset,
        "disturbance_prior": DISTURBANCE_PRIOR.meanings[estimate.disturbance_prior],
        "vibration_fraction": float(estimate.shaken.mean()),
        "vibration_displacement": motion.bridged,
        "glide_angle_masked_fraction": conventional.masked_fraction,
    }


def _current_row(record: ProfileRecord, current: DepthAveragedCurrent | None, conventional: Array | None) -> Row:
    row: Row = {}
    for end, fix in (("entry", record.entry_fix), ("exit", record.exit_fix)):
        if fix is not None:
            row |= _fix_row(end, fix)
    if current is not None:
        row["dac_north"], row["dac_east"] = (float(value) for value in current.velocity)
        row["dac_north_std"], row["dac_east_std"] = (float(value) for value in np.sqrt(np.diag(current.covariance)))
        row["dac_covariance"] = float(current.covariance[0, 1])
    if conventional is not None:
        row["dac_north_glide_angle"], row["dac_east_glide_angle"] = (float(value) for value in conventional)
    drifts = [d for d in map(surface_drift, (record.surface_fixes_before, record.surface_fixes_after)) if d is not None]
    if drifts:
        row["surface_drift_north"], row["surface_drift_east"] = (float(value) for value in np.mean(drifts, axis=0))
    return row


def _fix_row(end: str, fix: Fix) -> Row:
    return {
        f"{end}_time": _epoch_seconds(fix.time),
        f"{end}_latitude": fix.latitude,
        f"{end}_longitude": fix.longitude,
    }


def _epoch_seconds(time: np.datetime64) -> float:
    return float((time - np.datetime64(0, "s")) / _SECOND)


def _plain(row: Row) -> Row:
    """Leave out what JSON cannot hold (NaN is what an unwritten value reads as anyway)."""
    return {key: value for key, value in row.items() if not (isinstance(value, float) and not np.isfinite(value))}
