"""Figures of one profile: controls with the vibration set, track with its current, and windows."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from gliderhpc.archive.current import adopted_current
from gliderhpc.archive.profile import ProfileData
from gliderhpc.archive.reader import Archive
from gliderhpc.findings.drawing import (
    ESTIMATE,
    FILTER,
    GLIDE_ANGLE,
    MEASURED,
    SHADE,
    SMOOTHER,
    TRUTH,
    label,
    legend,
    panels,
    shade,
)
from gliderhpc.observations.profiles import stretches
from gliderhpc.outcomes import Outcome
from gliderhpc.report.maps import draw_arrows, round_speed, scale_arrow
from gliderhpc.report.page.content import Row
from gliderhpc.store_schema.schema import CONTROLS
from gliderhpc.studies.archived import platform_of
from gliderhpc.studies.library.tracks import anchored_tracks, motions_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_CONTROLS_SIZE, _TRACK_SIZE = (9.0, 7.4), (8.0, 6.4)
_ARROW = 0.25
"""Length of the current's arrow relative to the track's extent."""


def controls_figure(data: ProfileData) -> Figure:
    """Draw the recorded controls, with the vibration set (actuators moving or just stopped) shaded."""
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
    """Return one row for every interval of the vibration set."""
    return [
        {
            "interval": index,
            "start, s": float(data.time[first]),
            "stop, s": float(data.time[stop - 1]) + data.step,
            "length, s": float(data.time[stop - 1] - data.time[first]) + data.step,
            "depth at its start, m": float(np.interp(data.time[first], data.record_time, data.reconstructed[:, 3])),
        }
        for index, (first, stop) in enumerate(stretches(data.flagged("vibration")))
    ]


def track_figure(archive: Archive, data: ProfileData) -> Figure:
    """Draw the track through the water, that over the ground if fixes anchor it, and the depth-averaged current."""
    motions = motions_of(data, platform_of(archive))
    tracks = anchored_tracks(archive, data, motions.estimate, motions.glide_angle)
    figure, (axes,) = panels(1, 1, _TRACK_SIZE, f"Track of profile {data.number}")
    north, east = data.motion[:, 0], data.motion[:, 1]
    axes.plot(east - east[0], north - north[0], "--", color=ESTIMATE, linewidth=1.0, label="through the water")
    if tracks is not None:
        axes.plot(*tracks.estimate.T[::-1], color=ESTIMATE, linewidth=1.6, label="over the ground, ending on the fixes")
        axes.plot(*tracks.glide_angle.T[::-1], color=GLIDE_ANGLE, linewidth=0.9, label="the same from the glide angle")
        axes.plot(*tracks.fixes.T[::-1], "^", color=TRUTH, markersize=7, linestyle="none", label="GPS fix")
    axes.margins(0.12)
    _draw_current(axes, data)
    axes.set_aspect("equal", adjustable="datalim")
    label(axes, "", "east of the start, m", "north of the start, m")
    legend(axes)
    return figure


def _draw_current(axes: Axes, data: ProfileData) -> None:
    current = adopted_current(data.table)
    north, east = float(current.north), float(current.east)
    speed = float(np.hypot(north, east))
    if not np.isfinite(speed) or speed == 0.0:
        return
    extent = max(float(np.ptp(data.motion[:, 0])), float(np.ptp(data.motion[:, 1])))
    metres = _ARROW * extent / speed
    arrow = draw_arrows(axes, (0.0, 0.0), (metres * east, metres * north), width=0.006, name=current.label)
    # Without this, an arrow against the track would end outside the panel.
    axes.update_datalim([(metres * east, metres * north)])
    axes.autoscale_view()
    shown = round_speed(speed)
    scale_arrow(axes, arrow, metres * shown, f"{shown:g} m/s")


_SIZE = (9.0, 6.6)
_MARKS = {
    Outcome.CONVERGED: (ESTIMATE, "o"),
    Outcome.ITERATION_LIMIT: (MEASURED, "s"),
    Outcome.STALLED: (SMOOTHER, "^"),
    Outcome.DIVERGED: (FILTER, "X"),
    Outcome.NO_DATA: (SHADE, "P"),
}
"""Distinct colour and marker of every outcome."""

_COLUMNS = ("cost", "iterations", "evaluations", "gradient_norm")


def windows_of(archive: Archive, data: ProfileData) -> pd.DataFrame:
    """Read the windows of a profile, one per row: start and stop (s since its first sample), outcome, scores."""
    table = archive["windows"].to_dataset().sel(profile=data.number).load()
    known = np.isfinite(table["outcome"].values)
    columns = {name: table[name].values[known].astype(np.float64) for name in ("start", "stop", *_COLUMNS)}
    windows = pd.DataFrame(columns | {"outcome": table["outcome"].values[known].astype(np.int64)})
    return windows.assign(start=data.step * windows["start"], stop=data.step * windows["stop"])


def window_rows(windows: pd.DataFrame) -> list[Row]:
    """Return one row for every window."""
    return [
        {
            "window": index,
            "start, s": row["start"],
            "stop, s": row["stop"],
            "outcome": Outcome(int(row["outcome"])).label,
            **{name.replace("_", " "): row[name] for name in _COLUMNS},
        }
        for index, row in enumerate(windows.to_dict("records"))
    ]


def windows_figure(data: ProfileData, windows: pd.DataFrame) -> Figure:
    """Draw iterations, cost and optimality of the windows over the time of the profile, by outcome."""
    names = {"iterations": "iterations", "cost": "cost reached, eq. 28", "gradient_norm": "optimality measure"}
    figure, drawn = panels(3, 1, _SIZE, f"Windows of profile {data.number}", share_x=True)
    for axes, (name, title) in zip(drawn, names.items(), strict=True):
        _draw(axes, windows, name)
        label(axes, title, y="1")
    for axes, name in zip(drawn[1:], ("cost", "gradient_norm"), strict=True):
        axes.set_yscale("log" if _is_positive(windows[name]) else "symlog")
    drawn[-1].set_xlabel("minutes since the profile's first sample")
    legend(drawn[0])
    return figure


def _is_positive(values: pd.Series[float]) -> bool:
    known = values[np.isfinite(values)]
    return bool(known.size and (known > 0.0).all())


def _draw(axes: Axes, windows: pd.DataFrame, name: str) -> None:
    middle = (windows["start"] + windows["stop"]) / 120.0
    for outcome, (colour, mark) in _MARKS.items():
        chosen = windows["outcome"] == outcome
        if chosen.any():
            title = outcome.label
            axes.plot(middle[chosen], windows.loc[chosen, name], mark, color=colour, markersize=3.5, label=title)
