"""Figure of ``twin estimators``: errors, coverage and offsets by kind of twin."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from gliderhpc.findings.drawing import SHADE, SMALL, TRUTH
from gliderhpc.twins.drawing import COLOURS, label_axes, new_sheet
from gliderhpc.twins.estimators.methods import ESTIMATORS, HEAVY_TAILED, SMOOTHER
from gliderhpc.twins.estimators.runs import CALM, COEFFICIENTS, HARSH, IMPULSIVE, PRIOR, interval_name
from gliderhpc.twins.scoring import INTERVALS, LONGITUDINAL_AND_YAW, Row
from gliderhpc.twins.study import first
from gliderhpc.vocabulary import CHANNELS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_KINDS = {
    CALM: "calm",
    IMPULSIVE: "impulsive",
    HARSH: "harsh",
    COEFFICIENTS: "wrong coefficients",
    PRIOR: "prior's own",
}
_COLOURS = {estimator.name: colour for estimator, colour in zip(ESTIMATORS, COLOURS, strict=False)}


def draw_estimators(summary: Sequence[Row], interval: float, intervals: Sequence[float]) -> Figure:
    """Draw errors, coverage and offsets.

    Parameters
    ----------
    summary : sequence of dict
        One line per kind of twin and estimator.
    interval, intervals : float, sequence of float
        Sample interval of the calm twin, and of its slow records, s.
    """
    figure = new_sheet(12.5, 11.0)
    grid = figure.add_gridspec(3, 4)
    kinds = {interval: CALM, **{value: interval_name(value) for value in intervals}}
    for column, channel in enumerate(LONGITUDINAL_AND_YAW):
        _draw_errors(figure.add_subplot(grid[0, column]), summary, channel)
        _draw_intervals(figure.add_subplot(grid[1, column]), summary, channel, kinds)
    entries = figure.axes[0].get_legend_handles_labels()
    figure.legend(*entries, fontsize=SMALL, frameon=False, handlelength=3.5, ncols=7, loc="outside upper center")
    _draw_coverage(figure.add_subplot(grid[2, :2]), summary)
    _draw_offsets(figure.add_subplot(grid[2, 2:]), summary)
    return figure


def _draw_errors(axes: Axes, summary: Sequence[Row], channel: str) -> None:
    """RMSE with quartiles by kind of twin, and the truth's root mean square as a dash."""
    width = 0.8 / len(ESTIMATORS)
    for index, estimator in enumerate(ESTIMATORS):
        lines = [first(summary, kind=kind, arm=estimator.name) for kind in _KINDS]
        at = np.arange(len(_KINDS)) + (index - 0.5 * (len(ESTIMATORS) - 1)) * width
        value, low, high = (_scores(lines, f"rmse_{channel}{end}") for end in ("", "_low", "_high"))
        axes.errorbar(
            at,
            value,
            np.maximum([value - low, high - value], 0.0),
            fmt="o",
            ms=3,
            lw=0.9,
            color=_COLOURS[estimator.name],
            label=estimator.label,
        )
    truth = _scores([first(summary, kind=kind, arm=SMOOTHER.name) for kind in _KINDS], f"truth_{channel}")
    truth[truth == 0.0] = np.nan
    axes.plot(np.arange(len(_KINDS)), truth, "_", ms=26, color=TRUTH, lw=0.8, label="truth, RMS")
    axes.set_yscale("log")
    axes.set_xticks(np.arange(len(_KINDS)), list(_KINDS.values()), rotation=20)
    label_axes(axes, "", f"{channel} RMSE, {CHANNELS[channel][0]}")


def _draw_intervals(axes: Axes, summary: Sequence[Row], channel: str, kinds: dict[float, str]) -> None:
    for estimator in ESTIMATORS:
        value = _scores([first(summary, kind=kind, arm=estimator.name) for kind in kinds.values()], f"rmse_{channel}")
        axes.plot(list(kinds), value, "o-", ms=3, lw=1.1, color=_COLOURS[estimator.name])
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xticks(list(kinds), [f"{interval:g}" for interval in kinds], minor=False)
    axes.set_xticks([], minor=True)
    label_axes(axes, "sample interval, s (calm)", f"{channel} RMSE, {CHANNELS[channel][0]}")


def _draw_coverage(axes: Axes, summary: Sequence[Row]) -> None:
    """Coverage on twins drawn from the prior, with the nominal shares."""
    for estimator, shift in ((SMOOTHER, -0.1), (HEAVY_TAILED, 0.1)):
        line = first(summary, kind=PRIOR, arm=estimator.name)
        for label, marker in zip(INTERVALS, ("o", "s"), strict=True):
            value = _scores([line], *(f"coverage_{label}_{channel}" for channel in CHANNELS))
            axes.plot(
                np.arange(len(CHANNELS)) + shift,
                value,
                marker,
                ms=4,
                color=_COLOURS[estimator.name],
                label=f"{estimator.label}, {label} %",
            )
    for label in INTERVALS:
        axes.axhline(0.01 * float(label), color=SHADE, lw=0.7, zorder=0)
    axes.set_ylim(0.0, 1.02)
    axes.set_xticks(np.arange(len(CHANNELS)), list(CHANNELS))
    axes.legend(fontsize=SMALL - 1, frameon=False, loc="lower right")
    label_axes(axes, "", "share of steps inside (drawn from the prior)")


def _draw_offsets(axes: Axes, summary: Sequence[Row]) -> None:
    """Offset due to wrong coefficients, with the mean standard deviation."""
    width = 0.8 / len(ESTIMATORS)
    for index, estimator in enumerate(ESTIMATORS):
        line = first(summary, kind=COEFFICIENTS, arm=estimator.name)
        at = np.arange(len(CHANNELS)) + (index - 0.5 * (len(ESTIMATORS) - 1)) * width
        axes.bar(
            at, _scores([line], *(f"offset_{channel}" for channel in CHANNELS)), width, color=_COLOURS[estimator.name]
        )
    line = first(summary, kind=COEFFICIENTS, arm=SMOOTHER.name)
    axes.plot(
        np.arange(len(CHANNELS)),
        _scores([line], *(f"width_{channel}" for channel in CHANNELS)),
        "_",
        ms=40,
        color=TRUTH,
        label="standard deviation from the smoother",
    )
    axes.set_yscale("log")
    axes.set_xticks(np.arange(len(CHANNELS)), list(CHANNELS))
    axes.legend(fontsize=SMALL - 1, frameon=False, handlelength=5.5)
    label_axes(axes, "", "offset by coefficients within 15 %, N or N m")


def _scores(lines: Sequence[Row], *names: str) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    return np.array([line.get(name, np.nan) for line in lines for name in names], dtype=np.float64)
