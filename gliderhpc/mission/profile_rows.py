"""Rows of the archive derived from a profile's estimate: currents, flags, and the rows of every group."""

from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gliderhpc.estimation.currents import describe_implausible_current
from gliderhpc.estimation.preparation import by_density
from gliderhpc.estimation.profile import ProfileEstimate
from gliderhpc.estimation.quality import buoyancy_remarks, quality_flags, remarks
from gliderhpc.estimation.self_motion import SelfMotion, glide_angle_motion, model_motion
from gliderhpc.estimation.smoother.estimate import SmoothedEstimate
from gliderhpc.estimation.smoother.posterior import HullContribution, adjoint_deviation
from gliderhpc.flight.buoyancy import DENSITY, PRESSURE, TEMPERATURE
from gliderhpc.flight.hull_parameters import among_parameters
from gliderhpc.mission.profile_currents import (
    BY_FIXES,
    current_rows,
    tracks_as_json,
    tracks_from_json,
    tracks_of,
)
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.observations import ProfileRecord, ProfileSeries
from gliderhpc.observations.format import CONTROLS, MEASURED
from gliderhpc.observations.times import epoch_seconds
from gliderhpc.outcomes import Outcome
from gliderhpc.platform import Platform
from gliderhpc.store_schema import BUOYANCY, DISTURBANCE_PRIOR, ArchiveRows, Commit
from gliderhpc.store_schema.schema import SEAWATER
from gliderhpc.vocabulary import CHANNELS, STATES

Array = NDArray[np.float64]
Row = dict[str, Any]

_ANGLES = ("roll", "pitch", "heading", "p", "q", "r", "battery_rotation", "rudder")


def derive_and_write(
    rows: ArchiveRows,
    index: int,
    record: ProfileRecord,
    estimate: ProfileEstimate,
    settings: MissionSettings,
) -> tuple[Row, Row]:
    """Derive currents and other quantities from an estimate, and write the profile's chunks.

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

    Returns
    -------
    row : dict
        The profile's row of the table.
    extra : dict
        Content to store with the commit, from which other fixes give new currents (`recompute_currents`).
    """
    series, platform = estimate.series, estimate.profile.glider.platform
    motion = model_motion(estimate.solution.states, estimate.vibrating, series.step)
    conventional = glide_angle_motion(platform, series, estimate.vibrating)
    tracks = tracks_of(estimate, motion, conventional, by_hull=settings.current.by_hull)
    currents, segments = current_rows(record, tracks, settings.current.errors(platform))
    groups = _groups(record, estimate, settings.steps_per_record) | {"drift_current": segments}
    water = series.seawater if by_density(platform, series) else None
    if water is not None:
        groups["observed"] |= _seawater(water, settings.steps_per_record)
    for group, values in groups.items():
        rows.write(index, group, values)
    row = _estimate_row(estimate, motion, conventional) | currents
    row["buoyancy"] = BUOYANCY.meanings["depth_slope" if water is None else "density"]
    if estimate.smoothed is not None:
        clock = epoch_seconds(record.epoch) + series.time[:: settings.steps_per_record]
        rows.write(index, "smoothed", _smoothed_records(clock, estimate.smoothed))
        row |= _smoothed_row(estimate.smoothed)
        if estimate.hull is not None:
            rows.write(index, "hull", hull_row(estimate.hull))
    estimate_remarks = [*buoyancy_remarks(platform, series), *remarks(platform, estimate)]
    row["message"] = _message(record, currents, estimate_remarks)
    return row, tracks_as_json(tracks, estimate_remarks)


def _message(record: ProfileRecord, currents: Row, estimate_remarks: list[str]) -> str:
    """Join the notes on a record, the warning about its current if there is one, and the remarks on its estimate."""
    velocity = np.array([currents.get(f"dac_{name}", np.nan) for name in ("north", "east")])
    return "; ".join([*record.notes, *describe_implausible_current(velocity), *estimate_remarks])


def failed_row(message: str, record: ProfileRecord | None = None) -> Row:
    """Return the table entries of a failed profile; its message includes the notes on its record."""
    return {"status": "failed", "message": "; ".join([*(() if record is None else record.notes), message])}


def recompute_currents(
    record: ProfileRecord, commit: Commit, settings: MissionSettings, platform: Platform
) -> tuple[Row, Row]:
    """Recompute the currents of a committed profile from other fixes.

    Parameters
    ----------
    record : ProfileRecord
        Record of the profile, with the new fixes.
    commit : Commit
        Commit of the profile, made from the same samples, hull and settings.
    settings, platform : MissionSettings, Platform
        Settings and hull of the run.

    Returns
    -------
    row, segments : dict
        The profile's row of the table, and of group ``drift_current``.

    Raises
    ------
    KeyError, TypeError, ValueError
        The content stored with the commit does not have this version's form.
    """
    tracks, estimate_remarks = tracks_from_json(commit.extra)
    currents, segments = current_rows(record, tracks, settings.current.errors(platform))
    unaffected = {name: value for name, value in commit.row.items() if not name.startswith(BY_FIXES)}
    return unaffected | currents | {"message": _message(record, currents, estimate_remarks)}, segments


def _groups(record: ProfileRecord, estimate: ProfileEstimate, every: int) -> dict[str, Row]:
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
        "state": {"time": clock[::every], **_states(solution.states[::every]), **_adjoint_deviations(estimate, every)},
        "observed": {"time": clock[::every], **observed_row(series, every)},
        "windows": _windows(estimate),
    }
    return rows


def _channels(disturbances: Array) -> Row:
    return {name: disturbances[:, i] for i, name in enumerate(CHANNELS)}


def _adjoint_deviations(estimate: ProfileEstimate, every: int) -> Row:
    """Return the standard deviations of the windows' disturbances; none without a smoothed estimate."""
    if estimate.smoothed is None:
        return {}
    deviation = adjoint_deviation(estimate.solution, estimate.smoothed, every, every * estimate.series.step)
    return {f"{name}_std": column for name, column in _channels(deviation).items()}


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
        **{f"{name}_noise": column for name, column in _channels(smoothed.standardised_noise).items()},
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


def hull_row(hull: HullContribution) -> dict[str, Array]:
    """Return a profile's row of group ``hull``, with missing values for parameters without effect."""
    information = hull.information
    expanded = partial(among_parameters, keys=information.names)
    estimate = np.array([hull.errors.mean, np.sqrt(np.diag(hull.errors.covariance))])
    if not information.is_sound:
        estimate[:] = np.nan
    return {
        "value": expanded(information.value),
        "plausible_deviation": expanded(information.plausible_deviation),
        "score": expanded(information.score),
        "information": expanded(expanded(information.information).T).T,
        "score_other": np.array([expanded(score) for score, _ in information.others]),
        "information_other": np.array([expanded(expanded(matrix).T).T for _, matrix in information.others]),
        "estimate_alone": expanded(estimate[0]),
        "estimate_alone_std": expanded(estimate[1]),
        "displacement_sensitivity": expanded(information.displacement),
        "median_sensitivity": expanded(hull.glide.medians),
        "speed_sensitivity": expanded(hull.glide.speeds),
        "displacement_covariance": hull.displacement_covariance,
        "variance_share": hull.share,
    }


def observed_row(series: ProfileSeries, every: int) -> Row:
    """Return the profile's row of group ``observed`` without times: missing in gaps, interpolated between samples."""
    measured = np.where(series.weights[:, None] > 0.0, series.measurements, np.nan)[::every]
    sampled = series.sampled_records(every).astype(np.int8)
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
