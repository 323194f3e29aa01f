"""Study ``reconstruction``: reproduction of the records by the estimated disturbances (section 5.1, Table 2)."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gliderhpc.angles import wrap
from gliderhpc.archive.profile import ADJOINT, SETTLING, TRACKED, ProfileData, uses_measured_density
from gliderhpc.archive.reader import Archive
from gliderhpc.errors import InputError, ProfileError
from gliderhpc.estimation.filter import run_filter
from gliderhpc.estimation.preparation import controls_of, prepare_profile
from gliderhpc.estimation.profile import ProfileEstimate, estimate_profile
from gliderhpc.estimation.quality import SEGMENT, first_stretch
from gliderhpc.estimation.resample import on_steps
from gliderhpc.estimation.self_motion import SelfMotion, model_motion
from gliderhpc.flight.glider import Glider
from gliderhpc.mission.input_digests import is_made_from
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.observations import ProfileRecord, Survey, open_observations
from gliderhpc.observations.truth import most_impulses, read_profile_truth
from gliderhpc.platform import Platform, with_overrides
from gliderhpc.store_schema.columns import tracked_column
from gliderhpc.studies.archived import platform_of, positions, series_of, settings_of, states_of
from gliderhpc.studies.library.filter_comparison import (
    TRUE_YAW,
    estimators,
    regime_row,
    true_yaw,
    truth_columns,
)
from gliderhpc.studies.library.scores import rms
from gliderhpc.studies.library.tracks import Motions, motions_of
from gliderhpc.studies.request import Request
from gliderhpc.studies.study import Preparation, ProfileContext, Row, Study
from gliderhpc.vocabulary import CHANNELS

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

NAME = "reconstruction"


HEAVE = 2


def vibration_records(data: ProfileData) -> Mask:
    """Mask ``(m,)`` of the records with measurements inside the vibration set, without the first minute."""
    vibrating = data.flagged("vibration") & ~data.flagged("gap_in_the_record") & (data.time >= SETTLING)
    return data.on_records(vibrating)


def tracking_row(data: ProfileData) -> dict[str, Any]:
    """Root mean square residual of every tracked quantity, over steady glide and over the vibration intervals."""
    residuals = data.residuals
    return {
        **named_rms("steady", residuals[data.steady_records]),
        **named_rms("vibration", residuals[vibration_records(data)]),
    }


def named_rms(prefix: str, residuals: Array) -> dict[str, Any]:
    """Root mean square of each column ``(k, 4)``, named ``PREFIX_roll`` and so on."""
    return {tracked_column(prefix, name): rms(column) for name, column in zip(TRACKED, residuals.T, strict=True)}


def steady_segment(data: ProfileData, length: float = SEGMENT) -> tuple[int, int] | None:
    """First stretch ``(begin, end)``, in records, of the given length (s) within steady glide, or None."""
    return first_stretch(data.steady_records, round(length / _interval(data)))


def open_loop_row(data: ProfileData, glider: Glider) -> dict[str, Any]:
    """Residuals of forward runs without feedback under each of the two disturbances (lower block of Table 2).

    Both runs start from the reconstructed state at the beginning of the segment.
    """
    segment = steady_segment(data)
    if segment is None:
        return {}
    start = data.epoch + np.timedelta64(round(data.record_time[segment[0]] * 1e9), "ns")
    row: dict[str, Any] = {"segment_start": start}
    for name, disturbances in ((data.estimate, data.disturbances), ("prior", data.prior)):
        row |= named_rms(f"open_loop_{name}", open_loop_residual(data, glider, disturbances, *segment))
    return row


def open_loop_residual(data: ProfileData, glider: Glider, disturbances: Array, begin: int, end: int) -> Array:
    """Simulated minus measured values ``(end - begin, 4)`` on the records of a segment, degree and m."""
    every = round(_interval(data) / data.step)
    series = series_of(data, glider.platform)
    steps = data.record_time[begin] + data.step * (np.arange((end - begin) * every) + 0.5)
    # The controls of a record are those of the step that begins there.
    at, recorded = data.record_time[:-1] + 0.5 * data.step, controls_of(glider.platform, series)
    controls = np.column_stack([np.interp(steps, at, column) for column in recorded.T])
    disturbances = disturbances[begin * every : end * every]
    flown = glider.simulate(states_of(data)[begin], controls, disturbances, data.step)[::every][1:]
    tracked = np.column_stack([np.degrees(flown[:, :3]), flown[:, 5]])
    residual: Array = tracked - data.measured[begin + 1 : end + 1]
    residual[:, 2] = wrap(residual[:, 2])
    return residual


def self_motion_row(data: ProfileData, motions: Motions) -> dict[str, Any]:
    """Relative differences between the two self-motions: over the dive, and in speed in steady glide."""
    estimated, reckoned = motions.estimate, motions.glide_angle
    steady = data.steady_records[:-1]
    speeds = [np.linalg.norm(motion.steps, axis=1)[steady] for motion in (estimated, reckoned)]
    return {
        "self_motion_spread": _ratio(np.linalg.norm(estimated.total - reckoned.total), np.linalg.norm(reckoned.total)),
        "self_motion_speed_spread": _ratio(rms(speeds[0] - speeds[1]), rms(speeds[1])),
    }


def vibration_row(data: ProfileData) -> dict[str, Any]:
    """Share of the vibration set in the dive's time and, through its displacement, in the current."""
    table = data.table
    speed = _ratio(float(table["vibration_displacement"]), float(table["duration"]))
    return {
        "vibration_fraction": float(table["vibration_fraction"]),
        "vibration_speed": speed,
        "vibration_share": _ratio(speed, float(np.hypot(table["dac_north"], table["dac_east"]))),
    }


def cost_row(archive: Archive, data: ProfileData) -> dict[str, Any]:
    """Iterations and computing time, as stored by the run (Table 2's upper block)."""
    iterations = archive["windows"].to_dataset()["iterations"].sel(profile=data.number).values
    known = iterations[np.isfinite(iterations)]
    low, middle, high = np.percentile(known, [25.0, 50.0, 75.0]) if known.size else [float("nan")] * 3
    seconds = float(data.table["run_seconds"])
    return {
        "iterations_median": float(middle),
        "iterations_spread": float(high - low),
        "iterations_most": float(known.max()) if known.size else float("nan"),
        "window_seconds": _ratio(seconds, float(data.table["window_count"])),
        "profile_seconds": seconds,
    }


def _interval(data: ProfileData) -> float:
    return float(data.attributes["output_interval"])


def _ratio(value: float | np.floating[Any], reference: float | np.floating[Any]) -> float:
    return float(value / reference) if reference > 0.0 else float("nan")


def without_depth_slope_row(
    data: ProfileData, nominal: SelfMotion, record: ProfileRecord, platform: Platform, settings: MissionSettings
) -> dict[str, Any]:
    """Invert a profile with ``k_z = 0``: effect on tracking, heave disturbance and self-motion.

    Parameters
    ----------
    data, nominal : ProfileData, SelfMotion
        Archived estimate with the hull's own ``k_z``, and its self-motion.
    record : ProfileRecord
        Record to invert.
    platform, settings : Platform, MissionSettings
        Platform and settings of the archive.

    Raises
    ------
    ProfileError
        The filter cannot follow the record without the compensation.

    Notes
    -----
    The heave disturbance has to replace the compensation that the model lacks with ``k_z = 0``. The slope with depth of
    its change should be about ``-k_z cos(theta)``.
    """
    glider = Glider(with_overrides(platform, {"buoyancy.depth_slope": "0"}))
    series = on_steps(record, settings, platform)
    estimate = estimate_profile(prepare_profile(glider, series), settings)
    residuals = estimate.residuals
    counted = (series.weights > 0.0) & (series.time - series.time[0] >= SETTLING)
    motion = model_motion(estimate.solution.states, estimate.vibrating, series.step)
    row = {
        **named_rms("no_slope_steady", residuals[counted & ~estimate.vibrating]),
        **named_rms("no_slope_vibration", residuals[counted & estimate.vibrating]),
        "no_slope_heave_slope": _heave_slope(data, estimate),
        "filter_seconds": _filter_seconds(estimate, settings),
    }
    before = nominal.total
    length = float(np.linalg.norm(before))
    change = float(np.linalg.norm(motion.total - before))
    row["no_slope_self_motion"] = change / length if length > 0.0 else float("nan")
    return row


def _heave_slope(data: ProfileData, estimate: ProfileEstimate) -> float:
    """Slope with depth (N/m) of the heave disturbance without the compensation minus that with it, in steady glide."""
    n = min(len(estimate.solution.disturbances), len(data.time))
    steady = data.steady[:n]
    difference = estimate.solution.disturbances[:n, HEAVE][steady] - data.disturbances[:n, HEAVE][steady]
    depth = estimate.series.measurements[:n, 3][steady]
    known = np.isfinite(difference)
    return float(np.polyfit(depth[known], difference[known], 1)[0]) if known.sum() > 1 else float("nan")


def _filter_seconds(estimate: ProfileEstimate, settings: MissionSettings) -> float:
    began = time.perf_counter()
    run_filter(estimate.profile, settings)
    return time.perf_counter() - began


Source = tuple[str, Survey, tuple[int, ...]]
"""Observation file, its survey, and the profiles to invert with ``k_z = 0``."""


def study_profile(data: ProfileData, context: ProfileContext) -> Row:
    """Study one profile: tracking, open loop, self-motion, cost, regimes, and errors if there is a truth."""
    archive, platform = context.archive, context.platform
    source, truth_file, impulses = context.inputs
    motions = motions_of(data, platform)
    row: dict[str, Any] = {
        **tracking_row(data),
        **open_loop_row(data, Glider(platform)),
        **self_motion_row(data, motions),
        **vibration_row(data),
        **cost_row(archive, data),
        **regime_row(data),
    }
    if source is not None and data.number in source[2]:
        path, survey, _ = source
        with open_observations(path, survey=survey.only([data.number])) as observations:
            try:
                record = observations.profile(data.number)
                row |= without_depth_slope_row(data, motions.estimate, record, platform, settings_of(archive))
            except ProfileError as error:
                row["message"] = f"not inverted with k_z = 0: {error}"
    if truth_file is None:
        return row
    truth = read_profile_truth(truth_file, data.number)
    return {**row, **truth_columns(data, truth, impulses), TRUE_YAW: true_yaw(data, truth)}


def prepare(request: Request, archive: Archive, numbers: tuple[int, ...], settings: None) -> Preparation:
    """Find the records to invert with ``k_z = 0``, and the number of true impulses.

    Raises
    ------
    InputError
        The observation file is not the archive's, or the truth cannot be read.
    """
    source, remarks = _source(request, archive, platform_of(archive), numbers)
    truth = None if request.truth is None else str(request.truth.resolve())
    # The axis needs at least one element, even without any impulse.
    impulses = 1 if truth is None else max(1, most_impulses(truth))
    return Preparation(
        inputs=(source, truth, impulses),
        sizes={"impulse": impulses},
        labels={"channel": list(CHANNELS), "estimator": estimators(request.estimate)},
        attributes={"with_truth": truth is not None},
        remarks=remarks,
    )


def _source(
    request: Request, archive: Archive, platform: Platform, numbers: tuple[int, ...]
) -> tuple[Source | None, tuple[str, ...]]:
    """Observations of the profiles to invert with k_z = 0, and remarks on why others are not inverted."""
    if request.estimate != ADJOINT:
        return None, ("the inversion with k_z = 0 is compared with the adjoint, so there is none here",)
    if platform.buoyancy.depth_slope == 0.0:
        return None, ("the hull's k_z is zero already, so there is no second inversion",)
    by_slope = tuple(number for number in numbers if not uses_measured_density(archive, number))
    remarks: tuple[str, ...] = ()
    if by_slope != numbers:
        why = "because k_z has no effect there"
        remarks = (f"where buoyancy is computed from measured density there is no inversion with k_z = 0, {why}",)
    if not by_slope:
        return None, remarks
    if request.observations is None:
        return None, ("no `observations` given: the inversion with k_z = 0 and the filter's time are left out",)
    with open_observations(request.observations) as opened:
        where = positions(archive)
        if not is_made_from(request.archive, opened, {number: where[number] for number in by_slope}):
            raise InputError(
                f"{request.observations}: is not the file that the archive was made from "
                f"({archive.attrs.get('observations')})"
            )
        path = str(Path(request.observations).resolve())
        chosen = by_slope[:1] if request.quick else by_slope
        return (path, opened.survey.only(list(chosen)), chosen), remarks


STUDY = Study(
    NAME,
    "how the estimated motion follows the records; filter against adjoint",
    prepare=prepare,
    profile=study_profile,
)
