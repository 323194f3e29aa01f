"""The page of ``twin estimators`` in Markdown, out of what its JSON holds, so that none of its figures is typed."""

from collections.abc import Iterable, Mapping, Sequence
from textwrap import wrap
from typing import Any

from gliderhpc.findings.tables import markdown, number
from gliderhpc.twins.estimators.arms import ARMS
from gliderhpc.twins.estimators.cases import COEFFICIENTS, IMPULSIVE
from gliderhpc.twins.runs import Row
from gliderhpc.twins.smoothing import INTERVALS
from gliderhpc.vocabulary import CHANNELS

Content = Mapping[str, Any]

_LABELS = {arm.name: arm.label for arm in ARMS}
_LONGITUDINAL = ("B_cu", "B_cw", "B_cq", "B_cr")
_UNITS = ", ".join(f"{name} {unit}" for name, (unit, _) in CHANNELS.items())


def page_text(content: Content, figure: str) -> str:
    """The page; `figure` is the path of the figure from it."""
    lines = [
        "# Which estimator for what",
        "",
        made_by(content),
        "",
        *_filled(
            "Every twin is simulated once and all estimators get the same record: the filter, the smoother, the "
            f"smoother with Student-t yaw noise (`smoother.degrees_of_freedom` {content['degrees_of_freedom']:g}), and "
            "the windowed adjoint. *Calm*: slow forces and pitch moments of the simulator's usual twin; *impulsive*: "
            "with its yaw impulses of 0.6 to 3 N m too; *harsh*: the scenario `harsh` (gusts, shear, true coefficients "
            "within 15 %, offsets, gaps, false samples); *calm, N s*: one sample in N s; *coefficients within 15 %*: "
            "the impulsive twin, every coefficient that the estimators believe in drawn within 15 % of the true one; "
            "*drawn from the prior*: what filter and smoother assume, white attitude errors included. Medians over the "
            "twins, over steady glide; coverage is the mean share of the steps. *Overall* is the root mean square of "
            "the six errors, each over the prior's deviation. *Refused* counts records that the filter cannot follow, "
            "and draws of the prior under which the glider does not surface: those that are left are a little milder "
            "than the prior."
        ),
        "",
        claim(content),
        "",
        "## Which to use",
        "",
        *(f"- {sentence}" for sentence in content["sentences"]),
        "",
        f"![Estimators]({figure})",
        "",
        "## What is asked of the smoother",
        "",
        target_table(content["targets"]),
        "",
        *_error_section(content),
        *_interval_section(content),
        *_cost_section(content),
    ]
    return "\n".join(lines).rstrip() + "\n"


def _error_section(content: Content) -> list[str]:
    lines = [
        "## Errors",
        "",
        f"RMSE ({_UNITS}), and correlation with the truth in surge, heave, pitch and yaw.",
        "",
    ]
    for kind in kinds_of(content):
        lines += [f"### {kind[0].upper()}{kind[1:]}", "", error_table(lines_of(content, kind)), ""]
    return lines


def _interval_section(content: Content) -> list[str]:
    return [
        "## Intervals",
        "",
        "Coverage of the 68 and 95 % intervals, and their mean standard deviation (units as above).",
        "",
        interval_table(content["summary"]),
        "",
        "## Impulses",
        "",
        *_filled(
            "Impulsive twins, high-passed yaw moment: identified over true height, delay and its size; then, within "
            "three widths of an impulse's peak and outside, RMSE and coverage of the yaw moment."
        ),
        "",
        impulse_table(lines_of(content, IMPULSIVE)),
        "",
        "## Offsets by wrong coefficients",
        "",
        *_filled(
            "Root mean square of the mean error of every dive and climb; beside it the mean standard deviation that "
            "the estimator states. What exceeds it is not in the interval."
        ),
        "",
        offset_table(lines_of(content, COEFFICIENTS)),
        "",
    ]


def _cost_section(content: Content) -> list[str]:
    return [
        "## Seams, way through the water, cost",
        "",
        *_filled(
            "The seam ratio is that of docs/twins.md; of filter and smoother, which have no windows, at the boundaries "
            "of the adjoint's. Displacement: error at the end of the dive, and in standard deviations (two components: "
            "1.2 is usual). Seconds a dive on one core, one dive at a time, from the record on the steps to the "
            "answer. Rounds: passes of a smoother, iterations a window of the adjoint. Converged: share of dives or "
            "windows."
        ),
        "",
        *cost_tables(content),
    ]


def claim(content: Content) -> str:
    """What the README says of accuracy too: the impulsive twins' table, and how much of what is asked is met."""
    lines = lines_of(content, IMPULSIVE)
    rows = [
        [
            _LABELS[line["arm"]], *(number(line[f"rmse_{name}"]) for name in _LONGITUDINAL),
            number(line["correlation_B_cr"]), _shares(line, "B_cr"), number(line["seconds"]),
        ]
        for line in lines
    ]  # fmt: skip
    headings = (
        "estimator", "surge, N", "heave, N", "pitch, N m", "yaw, N m", "yaw correlation", "yaw intervals 68 / 95 %",
        "s a dive",
    )  # fmt: skip
    minutes = lines[0]["duration"] / 60.0
    head = (
        f"RMSE against the truth of {lines[0]['twins']} synthetic dives of {minutes:.0f} minutes with slow forces and "
        f"yaw impulses, {', '.join(content['platforms'])}, exact coefficients "
        f"({_command(content)}), medians:"
    )
    table = markdown(headings, rows, headings[1:])
    return "\n".join([*_filled(head), "", table, "", *_filled(verdict_line(content["targets"]))])


def made_by(content: Content) -> str:
    """Say how the study was made."""
    size, hulls = content["size"], ", ".join(content["platforms"])
    twins = min(size["case_seeds"], len(content["seeds"]))
    said = (
        f"{_command(content)}: {twins} twins of {hulls} of every kind and "
        f"{len(content['seeds'])} drawn from the prior, dives to {size['depth']:g} m, records at the platform's sample "
        "interval unless said otherwise."
    )
    return "\n".join(_filled(said))


def verdict_line(targets: Sequence[Row]) -> str:
    """Count the targets that are met, by the kind of twin."""
    counts = []
    for kind in dict.fromkeys(target["kind"] for target in targets):
        met = [target["met"] for target in targets if target["kind"] == kind]
        counts.append(f"{sum(met)} of {len(met)} on the twins *{kind}*")
    return f"Of the figures that are asked of the smoother it meets {', '.join(counts)}."


def target_table(targets: Sequence[Row]) -> str:
    """Every target with its bounds."""
    rows = [
        [
            target["kind"], target["quantity"], _bound(target), number(target["value"]),
            "met" if target["met"] else "**not met**", target["remark"],
        ]
        for target in targets
    ]  # fmt: skip
    return markdown(("twins", "quantity", "asked", "found", "", "how"), rows, ("found",))


def error_table(lines: Sequence[Row]) -> str:
    """RMSE and correlation of one kind of twin, a line an estimator, the truth's root mean square first."""
    correlations = [f"corr. {name}" for name in _LONGITUDINAL]
    truth = [
        "*truth, RMS*",
        "",
        *(number(lines[0][f"truth_{name}"]) for name in CHANNELS),
        "",
        *("" for _ in correlations),
    ]
    rows = [
        [
            _LABELS[line["arm"]], _twins(line), *(number(line[f"rmse_{name}"]) for name in CHANNELS),
            number(line["overall"]), *(number(line[f"correlation_{name}"]) for name in _LONGITUDINAL),
        ]
        for line in lines
    ]  # fmt: skip
    return markdown(("estimator", "twins", *CHANNELS, "overall", *correlations), [truth, *rows])


def interval_table(summary: Iterable[Row]) -> str:
    """Coverage and width of every channel, a line a kind of twin and estimator that has intervals."""
    rows = [
        [
            line["kind"],
            _LABELS[line["arm"]],
            *(f"{_shares(line, name)} ({number(line[f'width_{name}'])})" for name in CHANNELS),
        ]
        for line in summary
        if line.get("width_B_cr") is not None
    ]
    return markdown(("twins", "estimator", *CHANNELS), rows)


def impulse_table(lines: Iterable[Row]) -> str:
    """Height, time, and error and coverage inside and outside the events."""
    rows = [
        [
            _LABELS[line["arm"]], number(line["impulse_gain"]), number(line["impulse_gain_error"]),
            number(line["impulse_delay"]), number(line["impulse_delay_size"]),
            number(line["rmse_inside"]), _shares(line, "inside"),
            number(line["rmse_outside"]), _shares(line, "outside"),
        ]
        for line in lines
    ]  # fmt: skip
    headings = (
        "estimator", "height", "its error", "delay, s", "its size, s", "RMSE inside, N m", "68 / 95 % inside",
        "RMSE outside, N m", "68 / 95 % outside",
    )  # fmt: skip
    return markdown(headings, rows, headings[1:])


def offset_table(lines: Iterable[Row]) -> str:
    """Offset and width of every channel."""
    rows = [
        [
            _LABELS[line["arm"]],
            *(f"{number(line[f'offset_{name}'])} ({number(line[f'width_{name}'])})" for name in CHANNELS),
        ]
        for line in lines
    ]
    return markdown(("estimator", *(f"{name} (std)" for name in CHANNELS)), rows)


def cost_tables(content: Content) -> list[str]:
    """Seams, displacement and cost, a table a kind of twin."""
    lines = []
    for kind in kinds_of(content):
        rows = [
            [
                _LABELS[line["arm"]], number(line["seam_ratio"]), number(line["displacement_error"]),
                number(line["displacement_deviations"]), number(line["seconds"]), number(line["rounds"]),
                number(line["converged"]), ", ".join(f"{n} {name.lower()}" for name, n in line["outcomes"].items()),
            ]
            for line in lines_of(content, kind)
        ]  # fmt: skip
        headings = (
            kind, "seam ratio", "displacement, m", "in deviations", "seconds", "rounds", "converged",
            "worst outcome, dives",
        )  # fmt: skip
        lines += [markdown(headings, rows, headings[1:7]), ""]
    return lines


def kinds_of(content: Content) -> list[str]:
    """Kinds of twin, in the study's order."""
    return list(dict.fromkeys(line["kind"] for line in content["summary"]))


def lines_of(content: Content, kind: str) -> list[Row]:
    """Lines of one kind of twin."""
    return [line for line in content["summary"] if line["kind"] == kind]


def _filled(text: str) -> list[str]:
    return wrap(text, 119, break_long_words=False, break_on_hyphens=False)


def _command(content: Content) -> str:
    """The command that makes the same, its size with it where that is not the full one."""
    size, seeds = content["size"], len(content["seeds"])
    quick = " --quick" if content["quick"] else ""
    return f"`gliderhpc twin estimators{quick}" + ("`" if seeds == size["seeds"] else f" --seeds {seeds}`")


def _twins(line: Row) -> str:
    return f"{line['twins']}" + (f" ({line['refused']} refused)" if line["refused"] else "")


def _shares(line: Row, what: str) -> str:
    return " / ".join(number(line[f"coverage_{label}_{what}"]) for label in INTERVALS)


def _bound(target: Row) -> str:
    return f"{target['least']:g} to {target['most']:g}" if target["least"] > 0.0 else f"at most {target['most']:g}"
