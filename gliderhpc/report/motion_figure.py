"""Figure of one profile: measured and reconstructed motion, and the disturbances from every estimator."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import xarray as xr
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from gliderhpc.archive.profile import SMOOTHED, TRACKED, Array, Mask, ProfileData, read_profile_data, truth_on_samples
from gliderhpc.archive.reader import Archive
from gliderhpc.findings.drawing import ADJOINT, FILTER, MEASURED, SMOOTHER, TRUTH
from gliderhpc.findings.formatting import instant, signed
from gliderhpc.observations.profiles import stretches
from gliderhpc.report.accuracy import NAMES, ProfileAccuracy, profile_accuracy, tracking_rmse
from gliderhpc.report.facts import facts_of, message_lines, title_of
from gliderhpc.vocabulary import CHANNELS

A4 = (8.27, 11.69)
"""Width and height in inches."""

DPI = 150
"""Resolution of a figure that is written as PNG, dots per inch."""


@dataclass(frozen=True)
class Shade:
    """Display of a quality bit: colour, opacity, fraction of the panel's height, and label of the legend."""

    colour: str
    opacity: float
    height: float
    label: str


SHADES = {
    "vibration": Shade("#999999", 0.35, 1.0, "actuators moving"),
    "gap_in_the_record": Shade("#CC79A7", 0.35, 1.0, "gap in the record"),
    "prior_used_because_the_window_failed": Shade("#F0E442", 0.5, 1.0, "window failed, filter used"),
    "window_not_converged": Shade("#56B4E9", 1.0, 0.07, "window not converged"),
}
"""Quality bits that are displayed."""

_UNITS = {"degree": "°", "m": "m", "N": "N", "N m": "N m"}
_SMALL, _MEDIUM, _TEXT, _LARGE = 6.5, 7.5, 8.0, 11.0
_LEFT, _RIGHT, _BOTTOM = 0.095, 0.985, 0.042
_TITLE_TOP, _TEXT_TOP, _LINE, _LEGEND = 0.984, 0.962, 0.0149, 0.032
"""Fractions of the page's height: top of title and of text, height of a line, and of a legend of one line."""

_LEGEND_COLUMNS = 5
"""Maximum number of the legend's columns."""

_DASHES = (0, (4, 2))
_BAND, _ADJOINT_BAND = 0.3, 0.15
"""Opacity of the bands of one standard deviation on either side (68 %), the smoother's and the adjoint's."""


def motion_figure(archive: Archive, number: int, truth: xr.Dataset | None) -> Figure:
    """Draw one profile on an A4 page: attitude and depth, measured and reconstructed, and the six disturbances.

    Parameters
    ----------
    archive : Archive
        Archive, as :func:`gliderhpc.archive.mission.open_mission` returns it.
    number : int
        Number of an estimated profile.
    truth : xarray.Dataset or None
        Truth, as returned by :func:`gliderhpc.observations.truth.read_profile_truth`, if it is known.

    Returns
    -------
    matplotlib.figure.Figure
        Ten axes over time in minutes since the profile's first sample, labelled ``roll`` ... ``B_cr`` (`get_label`);
        their lines are ``measured`` and ``reconstructed``, or ``adjoint``, ``filter``, ``smoother`` and ``truth``.

    Raises
    ------
    InputError
        There is no such profile or it is not done, or the truth belongs to another mission.
    """
    data = read_profile_data(archive, number)
    accuracy = None if truth is None else profile_accuracy(data, truth)
    true = None if truth is None else truth_on_samples(data, truth)
    smoothed = _read_smoothed(archive, number)
    figure = Figure(figsize=A4, dpi=DPI)
    handles = _legend_handles(data, smoothed is not None, truth is not None)
    top = _head(figure, data, truth) - _LEGEND - _LINE * (_legend_rows(handles) - 1)
    panels = _panels(figure, data, top)
    for column, axes in enumerate(panels[: len(TRACKED)]):
        _draw_tracked(axes, data, column)
    for channel, axes in enumerate(panels[len(TRACKED) :]):
        _draw_disturbance(axes, data, smoothed, channel, true)
        if accuracy is not None:
            _note(axes, _describe_errors(accuracy, channel), "left")
    _draw_legend(figure, handles, top)
    return figure


def _read_smoothed(archive: Archive, number: int) -> ProfileData | None:
    """Read the smoother's estimate; return None if the archive has none for the profile."""
    if SMOOTHED not in archive.children:
        return None
    data = read_profile_data(archive, number, SMOOTHED)
    return data if np.isfinite(data.disturbances_std).any() else None


def _panels(figure: Figure, data: ProfileData, top: float) -> list[Axes]:
    """Create ten empty panels with a common time axis, up to `top`, a fraction of the page's height."""
    names = [*TRACKED, *CHANNELS]
    panels: list[Axes] = figure.subplots(
        len(names),
        1,
        sharex=True,
        gridspec_kw={"left": _LEFT, "right": _RIGHT, "bottom": _BOTTOM, "top": top, "hspace": 0.26},
    ).tolist()
    for name, axes in zip(names, panels, strict=True):
        axes.set_label(name)
        _style(axes)
        _shade(axes, data)
    panels[-1].set_xlim(0.0, data.time[-1] / 60.0)
    panels[-1].set_xlabel(f"minutes since {instant(data.epoch)}", fontsize=_MEDIUM)
    return panels


def _style(axes: Axes) -> None:
    axes.tick_params(labelsize=_SMALL, length=2.0, width=0.6, pad=2.0)
    axes.grid(True, linewidth=0.3, color="#CCCCCC")
    axes.set_axisbelow(True)
    axes.locator_params(axis="y", nbins=4)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    for side in ("left", "bottom"):
        axes.spines[side].set_linewidth(0.6)


def _shade(axes: Axes, data: ProfileData) -> None:
    """Shade the intervals with a quality bit in the background of a panel."""
    for meaning, shade in SHADES.items():
        stretches = _bars(data.flagged(meaning), data.time, data.step)
        if stretches:
            bars = axes.broken_barh(
                stretches,
                (0.0, shade.height),
                transform=axes.get_xaxis_transform(),
                facecolor=shade.colour,
                alpha=shade.opacity,
                linewidth=0.0,
                zorder=0.5,
            )
            bars.set_label(meaning)


def _bars(mask: Mask, time: Array, step: float) -> list[tuple[float, float]]:
    """Return start and width (minutes) of every contiguous interval of a mask."""
    return [
        (float(time[first]) / 60.0, float(time[stop - 1] - time[first] + step) / 60.0)
        for first, stop in stretches(mask)
    ]


def _draw_tracked(axes: Axes, data: ProfileData, column: int) -> None:
    """Draw roll, pitch, heading or depth, with the reconstruction on top of the measurements."""
    name = list(TRACKED)[column]
    unit = _UNITS[TRACKED[name]]
    minutes = data.record_time / 60.0
    axes.plot(
        minutes,
        data.measured[:, column],
        linestyle="none",
        marker=".",
        markersize=3.2,
        markeredgewidth=0.0,
        color=MEASURED,
        label="measured",
    )
    axes.plot(minutes, data.reconstructed[:, column], color=ADJOINT, linewidth=0.7, label="reconstructed")
    axes.set_ylabel(f"{name} ({unit})", fontsize=_MEDIUM)
    axes.yaxis.set_label_coords(-0.068, 0.5)
    if name == "depth":
        axes.invert_yaxis()
    rmse = tracking_rmse(data)[column]
    space = "" if unit == "°" else " "
    known = np.isfinite(rmse)
    _note(axes, f"residual in steady glide {rmse:.3f}{space}{unit} RMS" if known else "no steady glide", "right")


def _draw_disturbance(
    axes: Axes, data: ProfileData, smoothed: ProfileData | None, channel: int, true: Array | None
) -> None:
    """Draw one disturbance: estimates of adjoint, filter and smoother, with the truth on top."""
    name, (unit, _) = list(CHANNELS.items())[channel]
    minutes = data.time / 60.0
    curves = {"adjoint": data.disturbances[:, channel], "filter": data.prior[:, channel]}
    axes.axhline(0.0, color="#888888", linewidth=0.5, zorder=1.0)
    _draw_band(axes, data, channel, ADJOINT, _ADJOINT_BAND)
    axes.plot(minutes, curves["adjoint"], color=ADJOINT, linewidth=0.9, label="adjoint")
    axes.plot(minutes, curves["filter"], color=FILTER, linewidth=0.6, label="filter")
    if smoothed is not None:
        curves["smoother"] = smoothed.disturbances[:, channel]
        _draw_band(axes, smoothed, channel, SMOOTHER, _BAND)
        axes.plot(minutes, curves["smoother"], color=SMOOTHER, linewidth=0.6, label="smoother")
    if true is not None:
        curves["truth"] = true[:, channel]
        axes.plot(minutes, true[:, channel], color=TRUTH, linewidth=0.7, linestyle=_DASHES, label="truth")
    bands = [edge for each in (data, smoothed) if each is not None for edge in _band(each, channel)]
    limits = axis_limits([*curves.values(), *bands], data.steady)
    axes.set_ylim(*limits)
    axes.set_ylabel(f"$B_{{{name.removeprefix('B_')}}}$ ({_UNITS[unit]})\n{NAMES[name].split()[0]}", fontsize=_MEDIUM)
    axes.yaxis.set_label_coords(-0.068, 0.5)
    outside = outside_axis(curves, limits, _UNITS[unit])
    if outside:
        # With a truth, the errors are above the panel.
        _note(axes, outside, "right", inside=true is not None)


def _band(data: ProfileData, channel: int) -> tuple[Array, Array]:
    """Return the lower and upper edge of the band of one standard deviation on either side of a disturbance."""
    middle, deviation = data.disturbances[:, channel], data.disturbances_std[:, channel]
    return middle - deviation, middle + deviation


def _draw_band(axes: Axes, data: ProfileData, channel: int, colour: str, opacity: float) -> None:
    """Draw one standard deviation of a disturbance on either side, if the estimate has one."""
    lower, upper = _band(data, channel)
    if not np.isfinite(upper).any():
        return
    axes.fill_between(
        data.time / 60.0,
        lower,
        upper,
        color=colour,
        alpha=opacity,
        linewidth=0.0,
        zorder=1.5,
        rasterized=True,
    )


def _describe_errors(accuracy: ProfileAccuracy, channel: int) -> str:
    texts = []
    for label, score in (("adjoint", accuracy.adjoint[channel]), ("filter", accuracy.prior[channel])):
        correlation = f", r = {score.correlation:.2f}" if np.isfinite(score.correlation) else ""
        texts.append(f"{label} {score.rmse:.3f}{correlation}")
    return f"RMSE in steady glide: {'; '.join(texts)}"


def _note(axes: Axes, text: str, side: Literal["left", "right"], *, inside: bool = False) -> None:
    """Write a text above a panel, or at its upper end inside."""
    x, y = 0.0 if side == "left" else 1.0, 0.97 if inside else 1.02
    up: Literal["top", "bottom"] = "top" if inside else "bottom"
    written = axes.text(x, y, text, transform=axes.transAxes, ha=side, va=up, fontsize=_SMALL, color="#333333")
    if inside:
        written.set_bbox({"facecolor": "white", "alpha": 0.8, "edgecolor": "none", "pad": 0.8})


def _head(figure: Figure, data: ProfileData, truth: xr.Dataset | None) -> float:
    """Write title and facts of the profile at the top of the page, and return the height of their lower end."""
    lines = [*facts_of(data, truth), *message_lines(data)]
    # A dollar sign in a mission's name must not start a formula.
    style: dict[str, Any] = {"va": "top", "parse_math": False}
    figure.text(_LEFT, _TITLE_TOP, title_of(data), fontsize=_LARGE, fontweight="bold", **style)
    figure.text(_LEFT, _TEXT_TOP, "\n".join(lines), fontsize=_TEXT, linespacing=1.45, **style)
    return _TEXT_TOP - _LINE * len(lines)


def _legend_handles(data: ProfileData, smoothed: bool, truth: bool) -> list[Artist]:
    handles: list[Artist] = [
        Line2D([], [], linestyle="none", marker=".", markersize=5, color=MEASURED, label="measured"),
        Line2D([], [], color=ADJOINT, linewidth=1.2, label="reconstructed; adjoint estimate"),
        Line2D([], [], color=FILTER, linewidth=0.9, label="filter (EKF)"),
    ]
    if np.isfinite(data.disturbances_std).any():
        handles.append(Patch(facecolor=ADJOINT, alpha=_ADJOINT_BAND, label="adjoint, 68 %"))
    if smoothed:
        band = Patch(facecolor=SMOOTHER, edgecolor=SMOOTHER, linewidth=0.6, alpha=_BAND, label="smoother, 68 %")
        handles.append(band)
    if truth:
        handles.append(Line2D([], [], color=TRUTH, linewidth=0.9, linestyle=_DASHES, label="truth"))
    handles += [
        Patch(facecolor=shade.colour, alpha=shade.opacity, label=shade.label)
        for meaning, shade in SHADES.items()
        if data.flagged(meaning).any()
    ]
    return handles


def _legend_rows(handles: list[Artist]) -> int:
    return -(-len(handles) // _LEGEND_COLUMNS)


def _draw_legend(figure: Figure, handles: list[Artist], top: float) -> None:
    """Draw one legend for all panels, directly above them, in rows of nearly equal length."""
    figure.legend(
        handles=handles,
        loc="lower left",
        bbox_to_anchor=(_LEFT - 0.008, top + 0.011),
        ncols=-(-len(handles) // _legend_rows(handles)),
        fontsize=_MEDIUM - 0.5,
        frameon=False,
        handlelength=1.8,
        columnspacing=1.4,
        borderaxespad=0.0,
    )


# The axis of a disturbance spans these percentiles of steady glide, or the full range if that is not much larger. A
# rare excursion then does not compress everything else, and an impulse of ordinary size is not cut off.
PERCENTILES = (0.1, 99.9)
MAX_EXTREMES_RATIO = 2.5
MIN_SPAN = 0.02
"""Minimum span of an axis, N or N m; it keeps rounding and noise from looking like a signal."""


def axis_limits(curves: Sequence[Array], steady: Mask) -> tuple[float, float]:
    """Return the limits of a disturbance's axis.

    Parameters
    ----------
    curves : sequence of (n,) array
        Curves on the axis, N or N m; NaN where missing.
    steady : (n,) array of bool
        Samples that determine the limits.

    Returns
    -------
    tuple of float
        Lower and upper limit, around percentiles 0.1 to 99.9 of the steady samples, or around all of these samples if
        they span at most 2.5 times as much.
    """
    inside = np.concatenate([curve[steady & np.isfinite(curve)] for curve in curves])
    if not inside.size:
        everything = np.concatenate([curve[np.isfinite(curve)] for curve in curves])
        inside = everything if everything.size else np.zeros(1)
    low, high = (float(value) for value in np.percentile(inside, PERCENTILES))
    if np.ptp(inside) <= MAX_EXTREMES_RATIO * (high - low):
        low, high = float(inside.min()), float(inside.max())
    padding = 0.08 * max(high - low, MIN_SPAN) + max(0.0, MIN_SPAN - (high - low)) / 2.0
    return low - padding, high + padding


def outside_axis(curves: Mapping[str, Array], limits: tuple[float, float], unit: str) -> str:
    """List the curves that exceed the axis and their extreme values; empty if none does."""
    parts = []
    for name, curve in curves.items():
        below, above = curve[curve < limits[0]], curve[curve > limits[1]]
        ends = ([below.min()] if below.size else []) + ([above.max()] if above.size else [])
        if ends:
            parts.append(f"{name} to {' and '.join(signed(end, '.2g') for end in ends)} {unit}")
    return f"outside the axis: {', '.join(parts)}" if parts else ""
