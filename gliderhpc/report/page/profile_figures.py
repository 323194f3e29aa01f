"""Figures of one profile beside its reconstruction: controls with the vibration set, and the track with its current."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from gliderhpc.archive.profile import ProfileData
from gliderhpc.archive.taken_current import taken_current
from gliderhpc.findings.drawing import ESTIMATE, FILTER, GLIDE_ANGLE, TRUTH, label, legend, panels, shade
from gliderhpc.observations.stretches import stretches
from gliderhpc.report.page.content import Row
from gliderhpc.report.page.map_figure import round_speed, scale_arrow
from gliderhpc.store_schema.schema import CONTROLS
from gliderhpc.studies.archived import platform_of
from gliderhpc.studies.library.anchored_track import AnchoredTracks, anchored_tracks
from gliderhpc.studies.library.profile_reconstruction import motions_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_CONTROLS_SIZE, _TRACK_SIZE = (9.0, 7.4), (8.0, 6.4)
_ARROW = 0.25
"""Length of the current's arrow, of the track's extent."""


def controls_figure(data: ProfileData) -> Figure:
    """Draw the recorded controls over the vibration set, in which actuators moved or had just moved."""
    figure, drawn = panels(len(CONTROLS), 1, _CONTROLS_SIZE, f"Controls of profile {data.number}", share_x=True)
    minutes = data.record_time / 60.0
    for axes, values, (name, (unit, _)) in zip(drawn, data.controls.T, CONTROLS.items(), strict=True):
        shade(axes, data.time / 60.0, data.flagged("vibration"), "vibration set")
        axes.plot(minutes, values, color=ESTIMATE, linewidth=0.9)
        label(axes, name.replace("_", " "), y=unit)
    drawn[-1].set_xlabel("minutes since the profile's first sample")
    legend(drawn[0])
    return figure


def vibration_rows(data: ProfileData) -> list[Row]:
    """One row an interval of the vibration set."""
    return [
        {"interval": index, "start, s": float(data.time[first]), "stop, s": float(data.time[stop - 1]) + data.step,
         "length, s": float(data.time[stop - 1] - data.time[first]) + data.step,
         "depth at its start, m": _depth_at(data, float(data.time[first]))}
        for index, (first, stop) in enumerate(stretches(data.flagged("vibration")))
    ]  # fmt: skip


def track_figure(archive: xr.DataTree, data: ProfileData) -> Figure:
    """Draw the track through the water and, where fixes anchor it, over the ground, with the depth-averaged current."""
    motions = motions_of(data, platform_of(archive))
    tracks = anchored_tracks(archive, data, motions.estimate, motions.glide_angle)
    figure, (axes,) = panels(1, 1, _TRACK_SIZE, f"Track of profile {data.number}")
    north, east = data.motion[:, 0], data.motion[:, 1]
    axes.plot(east - east[0], north - north[0], "--", color=ESTIMATE, linewidth=1.0, label="through the water")
    if tracks is not None:
        _draw_tracks(axes, tracks)
    _draw_current(axes, data)
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.12)
    label(axes, "", "east of the start, m", "north of the start, m")
    legend(axes)
    return figure


def _draw_tracks(axes: Axes, tracks: AnchoredTracks) -> None:
    axes.plot(*tracks.estimate.T[::-1], color=ESTIMATE, linewidth=1.6, label="over the ground, closed on the fixes")
    axes.plot(*tracks.glide_angle.T[::-1], color=GLIDE_ANGLE, linewidth=0.9, label="the same by the glide angle")
    axes.plot(*tracks.fixes.T[::-1], "^", color=TRUTH, markersize=7, linestyle="none", label="GPS fix")


def _draw_current(axes: Axes, data: ProfileData) -> None:
    current = taken_current(data.table)
    north, east = float(current.north), float(current.east)
    speed = float(np.hypot(north, east))
    if not np.isfinite(speed) or speed == 0.0:
        return
    extent = max(float(np.ptp(data.motion[:, 0])), float(np.ptp(data.motion[:, 1])))
    metres = _ARROW * extent / speed
    arrow = axes.quiver(0.0, 0.0, metres * east, metres * north, color=FILTER, angles="xy", scale_units="xy", scale=1.0,
                        width=0.006, zorder=4.0)  # fmt: skip
    arrow.set_label(f"depth-averaged current, {current.label}")
    shown = round_speed(speed)
    scale_arrow(axes, arrow, metres * shown, f"{shown:g} m/s")


def _depth_at(data: ProfileData, time: float) -> float:
    return float(np.interp(time, data.record_time, data.reconstructed[:, 3]))
