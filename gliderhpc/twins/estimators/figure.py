"""Errors by the kind of twin and by the sample interval, coverage, and offsets beside the intervals' width."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from gliderhpc.findings.drawing import SMALL, TRUTH
from gliderhpc.twins.drawing import COLOURS, dress, sheet
from gliderhpc.twins.estimators.arms import ARMS, HEAVY_TAILED, SMOOTHER
from gliderhpc.twins.estimators.cases import CALM, COEFFICIENTS, HARSH, IMPULSIVE, PRIOR, interval_name
from gliderhpc.twins.estimators.targets import COVERAGE_BOUNDS, line_of
from gliderhpc.twins.runs import Row
from gliderhpc.vocabulary import CHANNELS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SHOWN = ("B_cu", "B_cw", "B_cq", "B_cr")
CASES = {CALM: "calm", IMPULSIVE: "impulsive", HARSH: "harsh", COEFFICIENTS: "wrong coefficients", PRIOR: "prior's own"}
_COLOURS = {arm.name: colour for arm, colour in zip(ARMS, COLOURS, strict=False)}


def draw_estimators(summary: Sequence[Row], interval: float, intervals: Sequence[float]) -> Figure:
    """Draw errors, coverage and offsets.

    Parameters
    ----------
    summary : sequence of dict
        One line a kind of twin and estimator.
    interval, intervals : float, sequence of float
        Sample interval of the calm twin, and of its slow records, s.
    """
    figure = sheet(12.5, 11.0)
    grid = figure.add_gridspec(3, 4)
    cases = {interval: CALM, **{value: interval_name(value) for value in intervals}}
    for column, channel in enumerate(SHOWN):
        _errors(figure.add_subplot(grid[0, column]), summary, channel)
        _over_intervals(figure.add_subplot(grid[1, column]), summary, channel, cases)
    entries = figure.axes[0].get_legend_handles_labels()
    figure.legend(*entries, fontsize=SMALL, frameon=False, handlelength=3.5, ncols=7, loc="outside upper center")
    _coverage(figure.add_subplot(grid[2, :2]), summary)
    _offsets(figure.add_subplot(grid[2, 2:]), summary)
    return figure


def _errors(axes: Axes, summary: Sequence[Row], channel: str) -> None:
    """RMSE with quartiles, kinds of twin across; the truth's own root mean square as a dash."""
    width = 0.8 / len(ARMS)
    for index, arm in enumerate(ARMS):
        lines = [line_of(summary, case, arm.name) for case in CASES]
        at = np.arange(len(CASES)) + (index - 0.5 * (len(ARMS) - 1)) * width
        value, low, high = (_scores(lines, f"rmse_{channel}{end}") for end in ("", "_low", "_high"))
        axes.errorbar(at, value, np.maximum([value - low, high - value], 0.0), fmt="o", ms=3, lw=0.9,
                      color=_COLOURS[arm.name], label=arm.label)  # fmt: skip
    truth = _scores([line_of(summary, case, SMOOTHER.name) for case in CASES], f"truth_{channel}")
    truth[truth == 0.0] = np.nan
    axes.plot(np.arange(len(CASES)), truth, "_", ms=26, color=TRUTH, lw=0.8, label="truth, RMS")
    axes.set_yscale("log")
    axes.set_xticks(np.arange(len(CASES)), list(CASES.values()), rotation=20)
    dress(axes, "", f"{channel} RMSE, {CHANNELS[channel][0]}")


def _over_intervals(axes: Axes, summary: Sequence[Row], channel: str, cases: dict[float, str]) -> None:
    for arm in ARMS:
        value = _scores([line_of(summary, case, arm.name) for case in cases.values()], f"rmse_{channel}")
        axes.plot(list(cases), value, "o-", ms=3, lw=1.1, color=_COLOURS[arm.name])
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xticks(list(cases), [f"{interval:g}" for interval in cases], minor=False)
    axes.set_xticks([], minor=True)
    dress(axes, "sample interval, s (calm)", f"{channel} RMSE, {CHANNELS[channel][0]}")


def _coverage(axes: Axes, summary: Sequence[Row]) -> None:
    """Coverage on twins drawn from the prior, within what is asked."""
    for arm, shift in ((SMOOTHER, -0.1), (HEAVY_TAILED, 0.1)):
        line = line_of(summary, PRIOR, arm.name)
        for label, marker in zip(COVERAGE_BOUNDS, ("o", "s"), strict=True):
            value = _scores([line], *(f"coverage_{label}_{channel}" for channel in CHANNELS))
            axes.plot(np.arange(len(CHANNELS)) + shift, value, marker, ms=4, color=_COLOURS[arm.name],
                      label=f"{arm.label}, {label} %")  # fmt: skip
    for low, high in COVERAGE_BOUNDS.values():
        axes.axhspan(low, high, color="#999999", alpha=0.25, lw=0)
    axes.set_ylim(0.0, 1.02)
    axes.set_xticks(np.arange(len(CHANNELS)), list(CHANNELS))
    axes.legend(fontsize=SMALL - 1, frameon=False, loc="lower right")
    dress(axes, "", "share of steps inside (drawn from the prior)")


def _offsets(axes: Axes, summary: Sequence[Row]) -> None:
    """Offset that wrong coefficients cause, beside the mean standard deviation."""
    width = 0.8 / len(ARMS)
    for index, arm in enumerate(ARMS):
        line = line_of(summary, COEFFICIENTS, arm.name)
        at = np.arange(len(CHANNELS)) + (index - 0.5 * (len(ARMS) - 1)) * width
        axes.bar(at, _scores([line], *(f"offset_{channel}" for channel in CHANNELS)), width, color=_COLOURS[arm.name])
    line = line_of(summary, COEFFICIENTS, SMOOTHER.name)
    axes.plot(np.arange(len(CHANNELS)), _scores([line], *(f"width_{channel}" for channel in CHANNELS)), "_", ms=40,
              color=TRUTH, label="standard deviation by the smoother")  # fmt: skip
    axes.set_yscale("log")
    axes.set_xticks(np.arange(len(CHANNELS)), list(CHANNELS))
    axes.legend(fontsize=SMALL - 1, frameon=False, handlelength=5.5)
    dress(axes, "", "offset by coefficients within 15 %, N or N m")


def _scores(lines: Sequence[Row], *names: str) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    return np.array([line.get(name, np.nan) for line in lines for name in names], dtype=np.float64)
