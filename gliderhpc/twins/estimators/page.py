"""Page of ``twin estimators`` in Markdown, from the content of its JSON."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from textwrap import fill
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from gliderhpc.findings.formatting import markdown, number
from gliderhpc.twins.estimators.methods import LABELS
from gliderhpc.twins.estimators.runs import COEFFICIENTS, IMPULSIVE
from gliderhpc.twins.scoring import INTERVALS, LONGITUDINAL_AND_YAW, Row
from gliderhpc.twins.study import select
from gliderhpc.vocabulary import CHANNELS

Content = Mapping[str, Any]

LINE_WIDTH = 119


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
