"""Page of ``twin estimators`` in Markdown, from the content of its JSON, and its figure."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined

from gliderhpc.findings.drawing import SMALL, TRUTH
from gliderhpc.findings.findings import markdown, number
from gliderhpc.twins.estimators.methods import ESTIMATORS, HEAVY_TAILED, LABELS, SMOOTHER
from gliderhpc.twins.estimators.runs import CALM, COEFFICIENTS, HARSH, IMPULSIVE, PRIOR, interval_name
from gliderhpc.twins.figures import COLOURS, GREY, label_axes, new_sheet
from gliderhpc.twins.scoring import INTERVALS, LONGITUDINAL_AND_YAW, Row
from gliderhpc.twins.study import first, select
from gliderhpc.vocabulary import CHANNELS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Content = Mapping[str, Any]

LINE_WIDTH = 119
_KINDS = {
    CALM: "calm",
    IMPULSIVE: "impulsive",
    HARSH: "harsh",
    COEFFICIENTS: "wrong coefficients",
    PRIOR: "prior's own",
}
_COLOURS = {estimator.name: colour for estimator, colour in zip(ESTIMATORS, COLOURS, strict=False)}


def page_text(content: Content, figure: str) -> str:
    """Render the page; `figure` is the path of the figure relative to it."""
    summary = content["summary"]
    kinds = dict.fromkeys(line["kind"] for line in summary)
    return _render(
        "page.md",
        content,
        figure=figure,
        twins=min(content["size"]["case_seeds"], len(content["seeds"])),
        units=", ".join(f"{name} {unit}" for name, (unit, _) in CHANNELS.items()),
        kinds=[(kind, select(summary, kind=kind)) for kind in kinds],
        wrong_coefficients=select(summary, kind=COEFFICIENTS),
    )


def claim(content: Content) -> str:
    """Render the accuracy on the impulsive twins, which is also quoted in the README."""
    return _render("claim.md", content).rstrip()


def _render(template: str, content: Content, **values: Any) -> str:
    environment = Environment(
        loader=PackageLoader("gliderhpc.twins.estimators"),
        # The output is Markdown rather than HTML, and inserted values come from the study's own JSON.
        autoescape=False,
        trim_blocks=True,
        undefined=StrictUndefined,
    )
    tables = (accuracy_table, error_table, interval_table, impulse_table, offset_table, cost_table)
    environment.filters |= {"fill": _fill, **{table.__name__: table for table in tables}}
    impulsive = select(content["summary"], kind=IMPULSIVE)
    text = environment.get_template(template).render(
        {**content, "impulsive": impulsive, "command": _command(content), **values}
    )
    return text.rstrip() + "\n"


def _fill(text: str) -> str:
    return fill(" ".join(text.split()), LINE_WIDTH, break_long_words=False, break_on_hyphens=False) + "\n"


def _command(content: Content) -> str:
    """Command that reproduces the study, with its size if that is not the full one."""
    size, seeds = content["size"], len(content["seeds"])
    quick = " --quick" if content["quick"] else ""
    return f"`gliderhpc twin estimators{quick}" + ("`" if seeds == size["seeds"] else f" --seeds {seeds}`")


def accuracy_table(lines: Sequence[Row]) -> str:
    """RMSE, yaw correlation and coverage, and computing time, one line per estimator."""
    headings = (
        "estimator",
        "surge, N",
        "heave, N",
        "pitch, N m",
        "yaw, N m",
        "yaw correlation",
        "yaw intervals 68 / 95 %",
        "s per dive",
    )
    rows = [
        [
            LABELS[line["arm"]],
            *(number(line[f"rmse_{name}"]) for name in LONGITUDINAL_AND_YAW),
            number(line["correlation_B_cr"]),
            _shares(line, "B_cr"),
            number(line["seconds"]),
        ]
        for line in lines
    ]
    return markdown(headings, rows, headings[1:])


def error_table(lines: Sequence[Row]) -> str:
    """RMSE and correlation for one kind of twin, one line per estimator, after the truth's root mean square."""
    correlations = [f"corr. {name}" for name in LONGITUDINAL_AND_YAW]
    truth = [
        "*truth, RMS*",
        "",
        *(number(lines[0][f"truth_{name}"]) for name in CHANNELS),
        "",
        *("" for _ in correlations),
    ]
    rows = [
        [
            LABELS[line["arm"]],
            _twins(line),
            *(number(line[f"rmse_{name}"]) for name in CHANNELS),
            number(line["overall"]),
            *(number(line[f"correlation_{name}"]) for name in LONGITUDINAL_AND_YAW),
        ]
        for line in lines
    ]
    return markdown(("estimator", "twins", *CHANNELS, "overall", *correlations), [truth, *rows])


def interval_table(summary: Iterable[Row]) -> str:
    """Coverage and width of every channel, one line per kind of twin and estimator with intervals."""
    rows = [
        [
            line["kind"],
            LABELS[line["arm"]],
            *(f"{_shares(line, name)} ({number(line[f'width_{name}'])})" for name in CHANNELS),
        ]
        for line in summary
        if line.get("width_B_cr") is not None
    ]
    return markdown(("twins", "estimator", *CHANNELS), rows)


def impulse_table(lines: Iterable[Row]) -> str:
    """Height and time of impulses, and error and coverage inside and outside the events."""
    rows = [
        [
            LABELS[line["arm"]],
            number(line["impulse_gain"]),
            number(line["impulse_gain_error"]),
            number(line["impulse_delay"]),
            number(line["impulse_delay_size"]),
            number(line["rmse_inside"]),
            _shares(line, "inside"),
            number(line["rmse_outside"]),
            _shares(line, "outside"),
        ]
        for line in lines
    ]
    headings = (
        "estimator", "height", "its error", "delay, s", "its size, s", "RMSE inside, N m", "68 / 95 % inside",
        "RMSE outside, N m", "68 / 95 % outside",
    )  # fmt: skip
    return markdown(headings, rows, headings[1:])


def offset_table(lines: Iterable[Row]) -> str:
    """Offset and interval width of every channel."""
    rows = [
        [
            LABELS[line["arm"]],
            *(f"{number(line[f'offset_{name}'])} ({number(line[f'width_{name}'])})" for name in CHANNELS),
        ]
        for line in lines
    ]
    return markdown(("estimator", *(f"{name} (std)" for name in CHANNELS)), rows)


def cost_table(lines: Iterable[Row], kind: str) -> str:
    """Seams, displacement and cost for one kind of twin."""
    headings = (
        kind,
        "seam ratio",
        "displacement, m",
        "in deviations",
        "seconds",
        "rounds",
        "converged",
        "worst outcome, dives",
    )
    rows = [
        [
            LABELS[line["arm"]],
            number(line["seam_ratio"]),
            number(line["displacement_error"]),
            number(line["displacement_deviations"]),
            number(line["seconds"]),
            number(line["rounds"]),
            number(line["converged"]),
            ", ".join(f"{n} {name.lower()}" for name, n in line["outcomes"].items()),
        ]
        for line in lines
    ]
    return markdown(headings, rows, headings[1:7])


def _twins(line: Row) -> str:
    return f"{line['twins']}" + (f" ({line['refused']} refused)" if line["refused"] else "")


def _shares(line: Row, name: str) -> str:
    return " / ".join(number(line[f"coverage_{label}_{name}"]) for label in INTERVALS)


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
        axes.axhline(0.01 * float(label), color=GREY, lw=0.7, zorder=0)
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
