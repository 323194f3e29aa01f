"""Figures 2 and 3, recovery of a truth, tables and captions of study ``reconstruction``, from its group alone."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from gliderhpc.archive.profile import TRACKED, ProfileData, read_profile_data
from gliderhpc.findings.drawing import (
    ESTIMATE,
    FILTER,
    GLIDE_ANGLE,
    LANDSCAPE,
    MEASURED,
    SHADE,
    TRUTH,
    label,
    legend,
    limits,
    panels,
    shade,
)
from gliderhpc.report.studies.reconstruction.comparisons import LABELS
from gliderhpc.studies.archived import mission_of, platform_of
from gliderhpc.studies.library.profile_reconstruction import motions_of
from gliderhpc.studies.library.scores import rms
from gliderhpc.studies.library.tracks import anchored_tracks
from gliderhpc.studies.reconstruction.comparison import YAW, stored_yaw

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
from gliderhpc.findings.findings import Findings, archive_findings
from gliderhpc.report.studies.reconstruction.comparisons import captions, comparisons
from gliderhpc.studies.archived import column_medians, failed_profiles, study_table
from gliderhpc.studies.provenance import provenance_of, stored_attribute
from gliderhpc.studies.reconstruction.comparison import (
    channel_table,
    impulse_table,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure
from gliderhpc.studies.reconstruction.study import NAME

Array = NDArray[np.float64]

_UNITS = {"degree": "°", "m": "m"}
_ROTATED = "#56B4E9"


def figure_2(archive: xr.DataTree, number: int, estimate: str) -> Figure:
    """Draw one profile: attitude and depth over the records, X and Y with dead reckoning and fixes."""
    data = read_profile_data(archive, number, estimate)
    title = f"Reconstruction of profile {number}: {mission_of(archive)}"
    figure, axes = panels(3, 2, LANDSCAPE, title)
    minutes = data.record_time / 60.0
    for column, (name, unit) in enumerate(TRACKED.items()):
        _draw_tracked(axes[column], data, column, name, unit)
    motions = motions_of(data, platform_of(archive))
    tracks = anchored_tracks(archive, data, motions.estimate, motions.glide_angle)
    for axis, (panel, name) in enumerate(zip(axes[4:], ("X, north", "Y, east"), strict=True)):
        apart = "" if tracks is None else f" (the two tracks {tracks.spread:.0f} m apart, RMS)"
        label(panel, f"{name} of the entry fix{apart}", "minutes", "m")
        if tracks is None:
            label(panel, f"{name}: no fix on either side")
            continue
        panel.plot(
            minutes, tracks.estimate[:, axis], color=ESTIMATE, linewidth=1.0,
            label=f"{LABELS[estimate]}, closed on the fixes",
        )  # fmt: skip
        panel.plot(
            minutes, tracks.glide_angle[:, axis], color=GLIDE_ANGLE, linewidth=1.0, linestyle="--",
            label="glide-angle dead reckoning, closed on the fixes",
        )  # fmt: skip
        panel.plot(tracks.fix_time / 60.0, tracks.fixes[:, axis], "^", color=TRUTH, markersize=5, label="GPS fix")
        legend(panel)
    return figure


def _draw_tracked(axes: Axes, data: ProfileData, column: int, name: str, unit: str) -> None:
    minutes, steady = data.record_time / 60.0, data.steady_records
    residual = rms(data.residuals[steady, column])
    space = "" if unit == "degree" else " "
    label(
        axes,
        f"{name}: residual {residual:.3g}{space}{_UNITS[unit]} RMS in steady glide",
        "minutes",
        f"{name} ({_UNITS[unit]})",
    )
    axes.plot(minutes, data.measured[:, column], ".", color=MEASURED, markersize=2.5, label="measured")
    axes.plot(minutes, data.reconstructed[:, column], color=ESTIMATE, linewidth=0.8, label="reconstructed")
    shade(axes, minutes, data.on_records(data.flagged("vibration")), "actuators moving")
    if name == "depth":
        axes.invert_yaxis()
    if column == 0:
        legend(axes)


def figure_3(archive: xr.DataTree, numbers: list[int], estimate: str) -> Figure:
    """Draw yaw moment of adjoint (or smoother) and filter with heading and battery rotation, a column a profile.

    The truth is drawn where the study was given one.
    """
    title = f"Yaw moment by {LABELS[estimate]} and filter: {mission_of(archive)}"
    figure, axes = panels(4, len(numbers), LANDSCAPE, title, share_x=True)
    count = len(numbers)
    for column, number in enumerate(numbers):
        data = read_profile_data(archive, number, estimate)
        own = [axes[row * count + column] for row in range(4)]
        _draw_estimators(own, data, stored_yaw(archive, data), first=column == 0)
    return figure


def _draw_estimators(axes: list[Axes], data: ProfileData, truth: Array | None, first: bool) -> None:
    minutes = data.time / 60.0
    curves = {
        LABELS[data.estimate]: (data.disturbances[:, YAW], ESTIMATE), LABELS["prior"]: (data.prior[:, YAW], FILTER),
    }  # fmt: skip
    span = limits(np.concatenate([values[data.steady] for values, _ in curves.values()]), 0.02)
    for panel, (name, (values, colour)) in zip(axes, curves.items(), strict=False):
        if truth is not None:
            panel.plot(minutes, truth, color=TRUTH, linewidth=0.5, label="truth")
        panel.plot(minutes, values, color=colour, linewidth=0.8, label=name)
        panel.set_ylim(*span)
        label(panel, f"profile {data.number}" if panel is axes[0] else "", y="$B_{cr}$ (N m)" if first else "")
        legend(panel, "upper right")
    records = data.record_time / 60.0
    axes[2].plot(records, data.measured[:, 2], color=MEASURED, linewidth=0.8)
    label(axes[2], y="heading (°)" if first else "")
    axes[3].plot(records, data.controls[:, 1], color=TRUTH, linewidth=0.8)
    axes[3].set_ylim(*_at_least_a_degree(data.controls[:, 1]))
    label(axes[3], x="minutes", y="battery rotation (°)" if first else "")
    for panel in axes:
        shade(
            panel, minutes, data.flagged("battery_rotated"), "battery rotated" if panel is axes[3] else None, _ROTATED
        )
        shade(panel, minutes, data.flagged("vibration"), "actuators moving" if panel is axes[3] else None, SHADE)
    if first:
        legend(axes[3], "upper right")


def _at_least_a_degree(degrees: Array) -> tuple[float, float]:
    low, high = limits(degrees, 0.0)
    return min(low, -1.0), max(high, 1.0)


def recovery_figure(channels: pd.DataFrame, impulses: pd.DataFrame, estimate: str) -> Figure:
    """Draw lag and gain a channel, and the true impulses' delay and height as both estimators see them."""
    figure, (lag, gain, delay, height) = panels(
        2, 2, LANDSCAPE, f"{LABELS[estimate].capitalize()} and filter against the truth"
    )
    styles = {estimate: ESTIMATE, "prior": FILTER}
    names = list(dict.fromkeys(channels["channel"]))
    for shift, (estimator, colour) in enumerate(styles.items()):
        rows = channels[channels["estimator"] == estimator].groupby("channel", sort=False).median(numeric_only=True)
        places = np.array([names.index(str(name)) for name in rows.index]) + 0.36 * shift - 0.18
        text = LABELS[estimator]
        lag.bar(places, rows["lag"], 0.34, color=colour, label=text)
        gain.bar(places, rows["gain"], 0.34, color=colour, label=text)
        if not impulses.empty:
            bins = np.arange(-3.0, 6.5, 0.5).tolist()
            delay.hist(impulses[f"{estimator}_delay"], bins=bins, color=colour, alpha=0.6, label=text)
            height.plot(impulses["amplitude"].abs(), impulses[f"{estimator}_ratio"], ".", color=colour, label=text)
    titles = ("lag behind the truth (none: no best one within 30 s)", "gain at that lag (1: not attenuated)")
    for axes, title, unit in zip((lag, gain), titles, ("s", ""), strict=True):
        axes.set_xticks(range(len(names)), names)
        label(axes, title, y=unit)
        legend(axes)
    gain.axhline(1.0, color=TRUTH, linewidth=0.6)
    label(delay, f"delay of the peak of {len(impulses)} yaw impulses", "s", "impulses")
    label(height, "their height over the true height", "true height (N m)", "ratio")
    height.axhline(1.0, color=TRUTH, linewidth=0.6)
    for axes in (delay, height):
        legend(axes)
    return figure


FIGURE_3_PROFILES = 3


def show(archive: xr.DataTree) -> Findings:
    """Show the study of an archive."""
    made, table, platform = provenance_of(archive, NAME), study_table(archive, NAME), platform_of(archive)
    numbers = list(made.profiles)
    channels, impulses = channel_table(archive, numbers), impulse_table(archive, numbers)
    remarks = made.remarks
    if f"open_loop_{made.estimate}_roll" not in table:
        remarks = (*remarks, "no profile has 600 s of steady glide on end: there is no open-loop comparison")
    tables = {"profiles": table}
    if stored_attribute(archive, NAME, "with_truth"):
        tables |= {"channels": channels, "impulses": impulses}
    facts = {
        "profiles": numbers,
        "estimate": made.estimate,
        "quick": made.quick,
        "medians": column_medians(table),
    }
    return archive_findings(
        NAME, comparisons(table, channels, impulses, platform, made.estimate), tables,
        _figures(archive, made.estimate, numbers, channels, impulses), facts, failed_profiles(table)[0], remarks,
        captions=captions(made, table, channels, impulses, numbers[:FIGURE_3_PROFILES]),
    )  # fmt: skip


def _figures(
    archive: xr.DataTree, estimate: str, numbers: list[int], channels: pd.DataFrame, impulses: pd.DataFrame
) -> dict[str, Figure]:
    figures = {
        "figure_2": figure_2(archive, numbers[0], estimate),
        "figure_3": figure_3(archive, numbers[:FIGURE_3_PROFILES], estimate),
    }
    if not channels.empty:
        figures["recovery"] = recovery_figure(channels, impulses, estimate)
    return figures
