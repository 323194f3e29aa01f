"""Rows of the archive derived from a profile's estimate: currents, flags, and the rows of every group."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gliderhpc.estimation.current_errors import CurrentErrors
from gliderhpc.estimation.currents import (
    DepthAveragedCurrent,
    SurfaceInterval,
    cycles_of,
    depth_averaged_current,
    glide_angle_current,
    smoothed_current,
    surface_drift,
    with_disagreement,
)
from gliderhpc.estimation.preparation import by_density
from gliderhpc.estimation.profile import ProfileEstimate
from gliderhpc.estimation.quality import buoyancy_remarks, quality_flags, remarks
from gliderhpc.estimation.self_motion import SelfMotion, glide_angle_motion, model_motion
from gliderhpc.estimation.smoother.estimate import SmoothedEstimate
from gliderhpc.flight.buoyancy import DENSITY, PRESSURE, TEMPERATURE
from gliderhpc.mission.hull_rows import hull_row
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.observations import Fix, ProfileRecord, ProfileSeries
from gliderhpc.observations.format import CONTROLS, MEASURED
from gliderhpc.outcomes import Outcome
from gliderhpc.store_schema import BUOYANCY, DISTURBANCE_PRIOR, ArchiveRows
from gliderhpc.store_schema.schema import SEAWATER
from gliderhpc.vocabulary import CHANNELS, STATES

Array = NDArray[np.float64]
Row = dict[str, Any]

_ANGLES = ("roll", "pitch", "heading", "p", "q", "r", "battery_rotation", "rudder")
_SECOND = np.timedelta64(1, "s")


def derive_and_write(
    rows: ArchiveRows,
    index: int,
    record: ProfileRecord,
    estimate: ProfileEstimate,
    settings: MissionSettings,
) -> Row:
    """Derive currents and other quantities from an estimate, write the profile's chunks, and return its table row.

    Parameters
    ----------
    rows : ArchiveRows
        Writer of the archive's rows.
    index : int
        Position of the profile along the archive's profile dimension.
    record, estimate : ProfileRecord, ProfileEstimate
        Record of the profile, and its estimate.
    settings : MissionSettings
        Settings of the run.
    """
    series, platform = estimate.series, estimate.profile.glider.platform
    motion = model_motion(estimate.solution.states, estimate.vibrating, series.step)
    conventional = glide_angle_motion(platform, series, estimate.vibrating)
    errors = settings.current.errors(platform)
    smoothed, by_hull = estimate.smoothed, settings.current.by_hull and estimate.hull is not None
    stated = smoothed.displacement_covariance if by_hull and smoothed is not None else None
    cycles = cycles_of(series)
    current = depth_averaged_current(record, series, motion, cycles, errors, stated)
    by_smoother = _usable_smoothed_current(record, estimate, errors, with_hull=by_hull)
    by_filter = _filter_current(record, estimate, cycles, errors) if estimate.solution.from_path else None
    if current is not None and by_smoother is not None:
        current, by_smoother = with_disagreement(current, by_smoother, errors, by_filter)
    groups = _groups(record, estimate, current, settings.steps_per_record)
    water = series.seawater if by_density(platform, series) else None
    if water is not None:
        groups["observed"] |= _seawater(water, settings.steps_per_record)
    for group, values in groups.items():
        rows.write(index, group, values)
    row = _estimate_row(estimate, motion, conventional)
    row["buoyancy"] = BUOYANCY.meanings["depth_slope" if water is None else "density"]
    row |= _current_row(record, current, glide_angle_current(record, series, conventional, errors))
    if estimate.smoothed is not None:
        clock = epoch_seconds(record.epoch) + series.time[:: settings.steps_per_record]
        rows.write(index, "smoothed", _smoothed_records(clock, estimate.smoothed))
        row |= _smoothed_row(estimate.smoothed)
        if estimate.hull is not None:
            rows.write(index, "hull", hull_row(estimate, estimate.smoothed, estimate.hull, settings.steps_per_record))
        row |= _smoothed_current_row(by_smoother) | _filter_current_row(by_filter)
    row["message"] = "; ".join([*record.notes, *buoyancy_remarks(platform, series), *remarks(platform, estimate)])
    return row


def _groups(
    record: ProfileRecord, estimate: ProfileEstimate, current: DepthAveragedCurrent | None, every: int
) -> dict[str, Row]:
    """Return the profile's rows by group; `every` is the number of steps from record to record."""
    series, solution = estimate.series, estimate.solution
    clock = epoch_seconds(record.epoch) + series.time
    flags, depth = quality_flags(estimate), series.measurements[:, 3]
    rows: dict[str, Row] = {
        "series": {
            "time": clock,
            "depth": depth,
            **_channels(solution.disturbances),
            "quality": flags,
        },
        "prior": _channels(estimate.filtered.disturbances),
        "state": {"time": clock[::every], **_states(solution.states[::every])},
        "observed": {"time": clock[::every], **observed_row(series, every)},
        "windows": _windows(estimate),
    }
    if current is not None:
        rows["drift_current"] = {
            "north": [segment.velocity[0] for segment in current.segments],
            "east": [segment.velocity[1] for segment in current.segments],
            "start": [segment.start for segment in current.segments],
            "stop": [segment.stop for segment in current.segments],
        }
    return rows


def _channels(disturbances: Array) -> Row:
    return {name: disturbances[:, i] for i, name in enumerate(CHANNELS)}


def _states(states: Array) -> Row:
    return _in_file_units(dict(zip(STATES, states.T, strict=True)))


def _smoothed_records(clock: Array, smoothed: SmoothedEstimate) -> Row:
    """Return the profile's row of group ``smoothed``; the last record has no disturbance if no step follows it."""
    return {
        "time": clock,
        **_channels(smoothed.disturbances),
        **_states(smoothed.states),
        **_in_file_units({f"{name}_std": column for name, column in zip(STATES, smoothed.states_std.T, strict=True)}),
        **{f"{name}_std": column for name, column in _channels(smoothed.disturbances_std).items()},
    }


def _smoothed_row(smoothed: SmoothedEstimate) -> Row:
    north, east = smoothed.displacement
    covariance = smoothed.displacement_covariance
    row = {
        "passes": smoothed.passes,
        "outcome": int(smoothed.outcome),
        "cost": smoothed.cost,
        "displacement_north": float(north),
        "displacement_east": float(east),
        "displacement_north_std": float(np.sqrt(covariance[0, 0])),
        "displacement_east_std": float(np.sqrt(covariance[1, 1])),
        "displacement_covariance": float(covariance[0, 1]),
        **{f"{name}_noise_factor": float(smoothed.noise_factor[i]) for i, name in enumerate(CHANNELS)},
    }
    return {f"smoothed/{name}": value for name, value in row.items()}


def _usable_smoothed_current(
    record: ProfileRecord, estimate: ProfileEstimate, errors: CurrentErrors, *, with_hull: bool
) -> DepthAveragedCurrent | None:
    """Return the smoother's current, or None if its outcome is not usable or a fix is missing."""
    smoothed = estimate.smoothed
    if smoothed is None or not smoothed.outcome.usable:
        return None
    covariance = smoothed.displacement_covariance
    if estimate.hull is not None and not with_hull:
        covariance = covariance - estimate.hull.displacement_covariance
    return smoothed_current(record, estimate.series, smoothed.displacement, covariance, errors, with_hull=with_hull)


def _filter_current(
    record: ProfileRecord, estimate: ProfileEstimate, cycles: NDArray[np.int64], errors: CurrentErrors
) -> DepthAveragedCurrent | None:
    """Return the current from the filter's motion."""
    motion = model_motion(estimate.filtered.states, estimate.vibrating, estimate.series.step)
    return depth_averaged_current(record, estimate.series, motion, cycles, errors)


def _filter_current_row(current: DepthAveragedCurrent | None) -> Row:
    if current is None:
        return {}
    return dict(zip(("dac_north_filter", "dac_east_filter"), current.velocity.tolist(), strict=True))


def _smoothed_current_row(current: DepthAveragedCurrent | None) -> Row:
    if current is None:
        return {}
    (north, east), covariance = current.velocity, current.covariance
    return {
        "dac_north_smoothed": float(north),
        "dac_east_smoothed": float(east),
        "dac_north_smoothed_std": float(np.sqrt(covariance[0, 0])),
        "dac_east_smoothed_std": float(np.sqrt(covariance[1, 1])),
        "dac_smoothed_covariance": float(covariance[0, 1]),
    }


def observed_row(series: ProfileSeries, every: int) -> Row:
    """Return the profile's row of group ``observed`` without times: missing in gaps, interpolated between samples."""
    measured = np.where(series.weights[:, None] > 0.0, series.measurements, np.nan)[::every]
    sampled = np.zeros(len(measured), dtype=np.int8)
    nearest = np.rint(series.sample_index / every).astype(np.int64)
    sampled[nearest[nearest < len(sampled)]] = 1
    controls = np.vstack([series.controls, series.controls[-1:]])[::every]
    columns = dict(zip(MEASURED, measured.T, strict=True)) | dict(zip((*CONTROLS, "rudder"), controls.T, strict=True))
    return {**_in_file_units(columns), "sampled": sampled}


def _seawater(water: Array, every: int) -> Row:
    """Return seawater at the records; as for the controls, it is that of the step that begins there."""
    on_records = np.vstack([water, water[-1:]])[::every]
    return dict(zip(SEAWATER, on_records[:, [DENSITY, TEMPERATURE, PRESSURE]].T, strict=True))


def _in_file_units(columns: dict[str, Array]) -> Row:
    """Convert columns and their standard deviations to the units of the archive: degrees, headings in [0, 360), cm3."""
    row: Row = dict(columns)
    for name, values in columns.items():
        if name.removesuffix("_std") in _ANGLES:
            row[name] = np.degrees(values)
        elif name == "ballast_volume":
            row[name] = values * 1e6
    if "heading" in row:
        row["heading"] = np.mod(row["heading"], 360.0)
    return row


def _windows(estimate: ProfileEstimate) -> Row:
    windows = estimate.solution.windows
    names = ("start", "stop", "cost", "iterations", "evaluations", "gradient_norm")
    row: Row = {name: np.array([getattr(window, name) for window in windows]) for name in names}
    row["retracted"] = np.array([window.retracted for window in windows], dtype=np.int8)
    row["outcome"] = np.array([window.outcome for window in windows], dtype=np.int8)
    return row


def _estimate_row(estimate: ProfileEstimate, motion: SelfMotion, conventional: SelfMotion) -> Row:
    windows, filtered = estimate.solution.windows, estimate.filtered
    return {
        "max_depth": float(estimate.series.measurements[:, 3].max()),
        "window_count": len(windows),
        "converged_fraction": float(np.mean([window.outcome == Outcome.CONVERGED for window in windows])),
        "iterations_median": float(np.median([window.iterations for window in windows])),
        "gated_count": filtered.gated,
        "inflated_count": filtered.inflated,
        "reset_count": filtered.reset,
        "disturbance_prior": DISTURBANCE_PRIOR.meanings[filtered.prior_name],
        "vibration_fraction": float(estimate.vibrating.mean()),
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
        row |= _surface_row("entry", current.entry) | _surface_row("exit", current.exit)
    if conventional is not None:
        row["dac_north_glide_angle"], row["dac_east_glide_angle"] = (float(value) for value in conventional)
    drifts = [d for d in map(surface_drift, (record.surface_fixes_before, record.surface_fixes_after)) if d is not None]
    if drifts:
        row["surface_drift_north"], row["surface_drift_east"] = (
            float(value) for value in np.mean([d.velocity for d in drifts], axis=0)
        )
    return row


def _surface_row(end: str, afloat: SurfaceInterval) -> Row:
    north, east = afloat.displacement
    return {
        f"{end}_surface_time": afloat.drift_removed,
        f"{end}_surface_north": float(north),
        f"{end}_surface_east": float(east),
    }


def _fix_row(end: str, fix: Fix) -> Row:
    return {
        f"{end}_time": epoch_seconds(fix.time),
        f"{end}_latitude": fix.latitude,
        f"{end}_longitude": fix.longitude,
    }


def epoch_seconds(time: np.datetime64) -> float:
    """Convert a time to seconds since 1970."""
    return float((time - np.datetime64(0, "s")) / _SECOND)
