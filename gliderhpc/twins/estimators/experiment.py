"""``twin estimators``: filter, smoother, heavy-tailed smoother and adjoint on the same records, and their best uses.

Every twin is simulated once for all estimators. Each estimate is compared with the truth channel by channel, including
the coverage of intervals if the estimator gives any.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from operator import itemgetter

import numpy as np

from gliderhpc.findings.comparison import Comparison
from gliderhpc.findings.formatting import number
from gliderhpc.findings.results import Findings, as_plain
from gliderhpc.twins.estimators.figure import draw_estimators
from gliderhpc.twins.estimators.methods import (
    DEGREES_OF_FREEDOM,
    ESTIMATORS,
    HEAVY_TAILED,
    LABELS,
    PAPER,
    SMOOTHER,
)
from gliderhpc.twins.estimators.page import page_text
from gliderhpc.twins.estimators.runs import (
    CALM,
    COEFFICIENTS,
    HARSH,
    IMPULSIVE,
    PRIOR,
    EstimatorsSize,
    estimator_runs,
    interval_name,
    paired,
    run_rows,
    summarise,
)
from gliderhpc.twins.scoring import INTERVALS, Row
from gliderhpc.twins.study import TwinPlan, TwinStudy, first, twin_findings
from gliderhpc.vocabulary import CHANNELS

NAME = "estimators"
PAGE = "estimators.md"
FULL = EstimatorsSize(depth=200.0, intervals=(2.0, 4.0, 10.0, 20.0), seeds=40, case_seeds=10)
QUICK = EstimatorsSize(depth=50.0, intervals=(4.0, 20.0), seeds=4, case_seeds=2)

NEGLIGIBLE_EXCESS = 0.05
"""Relative excess over the best median that is negligible for the choice of an estimator."""

PAPER_YAW_ERROR = 0.15
"""Yaw error of the paper with windows of 30 s, N m (section 5.1.2)."""


def conclude(plan: TwinPlan[EstimatorsSize], rows: list[Row]) -> Findings:
    """Make findings, with a table of comparisons for three kinds of twin, and the page."""
    (platform,) = plan.platforms
    summary = summarise(rows)
    advice = [recommend(rows, purpose) for purpose in purposes(plan.size.intervals)]
    sentences = (*map(describe_recommendation, advice), describe_tally(advice), *describe_intervals(summary))
    findings = twin_findings(
        NAME,
        plan,
        {f"{platform.name}, {kind}": compare_estimators(summary, kind) for kind in (CALM, IMPULSIVE, PRIOR)},
        rows=rows,
        figure=draw_estimators(summary, platform.sensors.sample_interval, plan.size.intervals),
        facts={"degrees_of_freedom": DEGREES_OF_FREEDOM, "summary": summary, "advice": advice, "sentences": sentences},
        remarks=sentences,
    )
    return replace(findings, documents={PAGE: page_text(as_plain(findings.content), f"{NAME}.png")})


STUDY = TwinStudy(NAME, FULL, QUICK, estimator_runs, conclude, job=run_rows)
"""The study that the program runs."""


# Comparisons with the paper, and the best estimator for each purpose


def compare_estimators(summary: Sequence[Row], kind: str) -> list[Comparison]:
    """List every estimator's RMSE on one kind of twin; the paper gives a value only for its own yaw moment."""
    rows = []
    for channel in ("B_cr", "B_cu", "B_cw", "B_cq"):
        for estimator in ESTIMATORS:
            line = first(summary, kind=kind, arm=estimator.name)
            if not line:
                continue
            has_figure = channel == "B_cr" and estimator is PAPER and kind == IMPULSIVE
            error, low, high = (line[f"rmse_{channel}{end}"] for end in ("", "_low", "_high"))
            rows.append(
                Comparison(
                    f"{channel} RMSE, {estimator.label}",
                    CHANNELS[channel][0],
                    error,
                    PAPER_YAW_ERROR if has_figure else None,
                    (low, high),
                )
            )
    return rows


@dataclass(frozen=True)
class Purpose:
    """Purpose of an estimate: the kind of twin, and the score whose smallest value is best there."""

    name: str
    kind: str
    score: str
    unit: str


def purposes(intervals: Sequence[float]) -> tuple[Purpose, ...]:
    """Return every purpose; the longest of the sample intervals (s) represents slow records."""
    longest = max(intervals)
    return (
        Purpose("slow forces and moments in calm water", CALM, "overall", "prior deviations"),
        Purpose("the yaw moment where there are impulses", IMPULSIVE, "rmse_B_cr", "N m"),
        Purpose("the height of an impulse", IMPULSIVE, "impulse_gain_error", "of its height"),
        Purpose("the time of an impulse", IMPULSIVE, "impulse_delay_size", "s"),
        Purpose("the yaw moment in harsh water, with errors in coefficients and sensors", HARSH, "rmse_B_cr", "N m"),
        Purpose(f"a record every {longest:g} s", interval_name(longest), "overall", "prior deviations"),
        Purpose("coefficients wrong by up to 15 %", COEFFICIENTS, "overall", "prior deviations"),
        Purpose("the displacement through the water, and so the current", IMPULSIVE, "displacement_error", "m"),
        Purpose("the same in harsh water", HARSH, "displacement_error", "m"),
        Purpose("little computing time", IMPULSIVE, "seconds", "s per dive"),
    )


def recommend(rows: Sequence[Row], purpose: Purpose) -> Row:
    """Find the estimator with the smallest median for a purpose, and those not distinguishable from it.

    An estimator is not distinguishable if its median lies within `NEGLIGIBLE_EXCESS` of the best one's, or if it is at
    least as good in a quarter of the twins.

    Returns
    -------
    dict
        ``name``, ``kind``, ``score``, ``unit``, ``best``, ``as_good`` (names), ``medians`` (by name) and ``twins``;
        ``best`` is None if no twin has a score for every estimator.
    """
    table = paired(rows, purpose.kind, purpose.score)
    recommendation: Row = {**vars(purpose), "twins": len(table), "best": None, "as_good": [], "medians": {}}
    if not len(table):
        return recommendation
    medians = table.median()
    best = str(medians.idxmin())
    excess = table.sub(table[best], axis=0).drop(columns=best)
    as_good = [
        str(name)
        for name in excess.columns
        if medians[name] <= (1.0 + NEGLIGIBLE_EXCESS) * medians[best] or np.percentile(excess[name], 25.0) <= 0.0
    ]
    return recommendation | {
        "best": best,
        "as_good": as_good,
        "medians": {str(name): float(medians[name]) for name in medians.index},
    }


def describe_tally(recommendations: Sequence[Row]) -> str:
    """Describe the number of purposes for which each estimator is the best or not distinguishable from it."""
    decided = [line for line in recommendations if line["best"] is not None]
    counts = {name: sum(name in (line["best"], *line["as_good"]) for line in decided) for name in LABELS}
    ranked = sorted(counts.items(), key=itemgetter(1), reverse=True)
    tally = ", ".join(f"{LABELS[name]} for {count}" for name, count in ranked)
    return f"Best, or not distinguishable from the best, for these {len(decided)} purposes: {tally}."


def describe_recommendation(recommendation: Row) -> str:
    """Describe a recommendation in one sentence."""
    if recommendation["best"] is None:
        return f"For {recommendation['name']}: no twin has an estimate by every estimator."
    medians, best = recommendation["medians"], recommendation["best"]
    sentence = f"For {recommendation['name']}: {LABELS[best]} ({number(medians[best])} {recommendation['unit']}"
    if recommendation["as_good"]:
        rivals = ", ".join(f"{LABELS[name]} {number(medians[name])}" for name in recommendation["as_good"])
        sentence += f"; not distinguishable: {rivals}"
    others = {name: value for name, value in medians.items() if name != best and name not in recommendation["as_good"]}
    if others:
        values = ", ".join(
            f"{LABELS[name]} {number(value)}" for name, value in sorted(others.items(), key=itemgetter(1))
        )
        sentence += f"; then {values}"
    return f"{sentence})."


def describe_intervals(summary: Sequence[Row]) -> Iterator[str]:
    """Describe the coverage of the intervals on impulsive twins, inside and outside the events, and for wrong hulls."""
    for estimator in (SMOOTHER, HEAVY_TAILED):
        line = first(summary, kind=IMPULSIVE, arm=estimator.name)
        if "coverage_68_inside" not in line:
            continue
        inside, outside = (
            " and ".join(f"{line[f'coverage_{label}_{where}']:.0%}" for label in INTERVALS)
            for where in ("inside", "outside")
        )
        yield (
            f"Intervals of the {estimator.label} in yaw, impulsive twins: those of 68 and 95 % cover {inside} of the "
            f"steps inside the impulses and {outside} of those outside."
        )
        yield _describe_offsets(first(summary, kind=COEFFICIENTS, arm=estimator.name), estimator.label)


def _describe_offsets(line: Row, label: str) -> str:
    wider = [name for name in CHANNELS if line.get(f"offset_{name}", np.nan) > line.get(f"width_{name}", np.nan)]
    if not wider:
        return f"With wrong coefficients no channel's offset exceeds the {label}'s mean standard deviation."
    offsets = ", ".join(
        f"{name} {number(line[f'offset_{name}'])} against {number(line[f'width_{name}'])} {CHANNELS[name][0]}"
        for name in wider
    )
    return (
        f"With wrong coefficients the intervals of the {label} do not cover the offset, which exceeds the mean "
        f"standard deviation in {offsets}."
    )
