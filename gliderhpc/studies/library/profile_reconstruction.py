"""Agreement of one profile's estimated motion with its record: figures of section 5.1.1 and Table 2."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gliderhpc.archive.profile import SETTLING, TRACKED, ProfileData, wrap
from gliderhpc.estimation.preparation import controls_of
from gliderhpc.estimation.quality import SEGMENT, first_stretch
from gliderhpc.estimation.self_motion import SelfMotion, glide_angle_motion, model_motion
from gliderhpc.flight.glider import Glider
from gliderhpc.platform import Platform
from gliderhpc.store_schema.studies.reconstruction import tracked_column
from gliderhpc.studies.archived import series_of, states_of
from gliderhpc.studies.library.scores import rms

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Row = dict[str, Any]


@dataclass(frozen=True, eq=False)
class Motions:
    """The profile's displacement through the water on the records, by the estimate and by the glide angle."""

    estimate: SelfMotion
    glide_angle: SelfMotion


def vibration_records(data: ProfileData) -> Mask:
    """Records ``(m,)`` inside the vibration set that have measurements, the first minute left out."""
    vibrating = data.flagged("vibration") & ~data.flagged("gap_in_the_record") & (data.time >= SETTLING)
    return data.on_records(vibrating)


def tracking_row(data: ProfileData) -> Row:
    """Root mean square residual of every tracked quantity, over steady glide and over the vibration intervals."""
    residuals = data.residuals
    return {
        **named_rms("steady", residuals[data.steady_records]),
        **named_rms("vibration", residuals[vibration_records(data)]),
    }


def named_rms(prefix: str, residuals: Array) -> Row:
    """Root mean square a column ``(k, 4)``, named ``PREFIX_roll`` and so on."""
    return {tracked_column(prefix, name): rms(column) for name, column in zip(TRACKED, residuals.T, strict=True)}


def steady_segment(data: ProfileData, length: float = SEGMENT) -> tuple[int, int] | None:
    """First stretch ``(begin, end)`` in records of that length (s) inside steady glide, or None."""
    return first_stretch(data.steady_records, round(length / _interval(data)))


def open_loop_row(data: ProfileData, glider: Glider) -> Row:
    """Residual of one forward run under either identified disturbance, no feedback (Table 2's lower block).

    Both runs start from the reconstructed state at the segment's beginning.
    """
    segment = steady_segment(data)
    if segment is None:
        return {}
    row: Row = {"segment_start": data.epoch + np.timedelta64(round(data.record_time[segment[0]] * 1e9), "ns")}
    for name, disturbances in ((data.estimate, data.disturbances), ("prior", data.prior)):
        row |= named_rms(f"open_loop_{name}", open_loop_residual(data, glider, disturbances, *segment))
    return row


def open_loop_residual(data: ProfileData, glider: Glider, disturbances: Array, begin: int, end: int) -> Array:
    """Flown minus measured ``(end - begin, 4)`` on the records of a segment, degree and m."""
    every = round(_interval(data) / data.step)
    series = series_of(data, glider.platform)
    steps = data.record_time[begin] + data.step * (np.arange((end - begin) * every) + 0.5)
    # A record holds the control of the step that begins there.
    at, recorded = data.record_time[:-1] + 0.5 * data.step, controls_of(glider.platform, series)
    controls = np.column_stack([np.interp(steps, at, column) for column in recorded.T])
    flown = glider.simulate(
        states_of(data)[begin], controls, disturbances[begin * every : end * every], data.step
    )[::every][1:]  # fmt: skip
    tracked = np.column_stack([np.degrees(flown[:, :3]), flown[:, 5]])
    residual: Array = tracked - data.measured[begin + 1 : end + 1]
    residual[:, 2] = wrap(residual[:, 2])
    return residual


def motions_of(data: ProfileData, platform: Platform) -> Motions:
    """Both self-motions, vibration intervals bridged."""
    vibrating = data.on_records(data.flagged("vibration"))
    series = series_of(data, platform)
    return Motions(
        model_motion(states_of(data), vibrating, series.step), glide_angle_motion(platform, series, vibrating)
    )


def self_motion_row(data: ProfileData, motions: Motions) -> Row:
    """Differences of the two self-motions: over the dive, and in speed over steady glide."""
    estimated, reckoned = motions.estimate, motions.glide_angle
    steady = data.steady_records[:-1]
    speeds = [np.linalg.norm(motion.steps, axis=1)[steady] for motion in (estimated, reckoned)]
    return {
        "self_motion_spread": _ratio(np.linalg.norm(estimated.total - reckoned.total), np.linalg.norm(reckoned.total)),
        "self_motion_speed_spread": _ratio(rms(speeds[0] - speeds[1]), rms(speeds[1])),
    }


def vibration_row(data: ProfileData) -> Row:
    """The vibration set's share of the dive's time and, by the displacement inside it, of the current."""
    table = data.table
    speed = _ratio(float(table["vibration_displacement"]), float(table["duration"]))
    return {
        "vibration_fraction": float(table["vibration_fraction"]),
        "vibration_speed": speed,
        "vibration_share": _ratio(speed, float(np.hypot(table["dac_north"], table["dac_east"]))),
    }


def cost_row(archive: xr.DataTree, data: ProfileData) -> Row:
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
