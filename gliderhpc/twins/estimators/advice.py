"""Which estimator to use for what, by what the twins show."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from operator import itemgetter

import numpy as np

from gliderhpc.findings.tables import number
from gliderhpc.twins.estimators.arms import ARMS, HEAVY_TAILED, SMOOTHER
from gliderhpc.twins.estimators.cases import CALM, COEFFICIENTS, HARSH, IMPULSIVE, interval_name
from gliderhpc.twins.estimators.summary import paired
from gliderhpc.twins.estimators.targets import line_of
from gliderhpc.twins.runs import Row
from gliderhpc.twins.smoothing import INTERVALS
from gliderhpc.vocabulary import CHANNELS

NEAR = 0.05
"""Relative excess over the best median that nobody should choose an estimator by."""

_LABELS = {arm.name: arm.label for arm in ARMS}


@dataclass(frozen=True)
class Purpose:
    """What an estimator may be wanted for: the kind of twin, and the score whose smallest value is best there."""

    name: str
    kind: str
    score: str
    unit: str


def purposes(intervals: Sequence[float]) -> tuple[Purpose, ...]:
    """Every purpose; the slowest of the sample intervals (s) stands for slow records."""
    longest = max(intervals)
    return (
        Purpose("slow forces and moments in calm water", CALM, "overall", "prior deviations"),
        Purpose("the yaw moment where there are impulses", IMPULSIVE, "rmse_B_cr", "N m"),
        Purpose("the height of an impulse", IMPULSIVE, "impulse_gain_error", "of its height"),
        Purpose("the time of an impulse", IMPULSIVE, "impulse_delay_size", "s"),
        Purpose("the yaw moment in harsh water, coefficients and sensors amiss", HARSH, "rmse_B_cr", "N m"),
        Purpose(f"a record every {longest:g} s", interval_name(longest), "overall", "prior deviations"),
        Purpose("coefficients wrong by up to 15 %", COEFFICIENTS, "overall", "prior deviations"),
        Purpose("the way through the water, so the current", IMPULSIVE, "displacement_error", "m"),
        Purpose("the same in harsh water", HARSH, "displacement_error", "m"),
        Purpose("little computing time", IMPULSIVE, "seconds", "s a dive"),
    )


def recommend(rows: Sequence[Row], purpose: Purpose) -> Row:
    """Find the estimator of the least median for a purpose, and those that the twins do not tell from it.

    An estimator is not told apart where its median lies within `NEAR` of the best one's, or where in a quarter of the
    twins it is at least as good.

    Returns
    -------
    dict
        ``name``, ``kind``, ``score``, ``unit``, ``best``, ``as_good`` (names), ``medians`` (by name) and ``twins``;
        ``best`` is None where no twin was answered by all.
    """
    table = paired(rows, purpose.kind, purpose.score)
    found: Row = {**vars(purpose), "twins": len(table), "best": None, "as_good": [], "medians": {}}
    if not len(table):
        return found
    medians = table.median()
    best = str(medians.idxmin())
    excess = table.sub(table[best], axis=0).drop(columns=best)
    as_good = [
        str(name)
        for name in excess.columns
        if medians[name] <= (1.0 + NEAR) * medians[best] or np.percentile(excess[name], 25.0) <= 0.0
    ]
    return found | {
        "best": best,
        "as_good": as_good,
        "medians": {str(name): float(medians[name]) for name in medians.index},
    }


def tally_sentence(found: Sequence[Row]) -> str:
    """Count for how many purposes each estimator is the best or not told apart from it."""
    decided = [line for line in found if line["best"] is not None]
    counts = {arm.name: sum(arm.name in (line["best"], *line["as_good"]) for line in decided) for arm in ARMS}
    ranked = sorted(counts.items(), key=itemgetter(1), reverse=True)
    said = ", ".join(f"{_LABELS[name]} for {count}" for name, count in ranked)
    return f"Best, or not told apart from the best, for so many of these {len(decided)} purposes: {said}."


def recommendation_sentence(found: Row) -> str:
    """Say it in one sentence."""
    if found["best"] is None:
        return f"For {found['name']}: no twin was answered by every estimator."
    medians, best = found["medians"], found["best"]
    sentence = f"For {found['name']}: {_LABELS[best]} ({number(medians[best])} {found['unit']}"
    if found["as_good"]:
        rivals = ", ".join(f"{_LABELS[name]} {number(medians[name])}" for name in found["as_good"])
        sentence += f"; not told apart from it: {rivals}"
    others = {name: value for name, value in medians.items() if name != best and name not in found["as_good"]}
    if others:
        said = ", ".join(
            f"{_LABELS[name]} {number(value)}" for name, value in sorted(others.items(), key=itemgetter(1))
        )
        sentence += f"; then {said}"
    return f"{sentence})."


def interval_sentences(summary: Sequence[Row]) -> Iterator[str]:
    """Say how far intervals can be trusted: on impulsive twins inside and outside the events, and with wrong hulls."""
    for arm in (SMOOTHER, HEAVY_TAILED):
        line = line_of(summary, IMPULSIVE, arm.name)
        if "coverage_68_inside" not in line:
            continue
        inside, outside = (
            " and ".join(f"{line[f'coverage_{label}_{place}']:.0%}" for label in INTERVALS)
            for place in ("inside", "outside")
        )
        yield (
            f"Intervals of the {arm.label} in yaw, impulsive twins: those of 68 and 95 % hold {inside} of the steps "
            f"inside the impulses and {outside} of those outside."
        )
        yield _offset_sentence(line_of(summary, COEFFICIENTS, arm.name), arm.label)


def _offset_sentence(line: Row, label: str) -> str:
    wider = [name for name in CHANNELS if line.get(f"offset_{name}", np.nan) > line.get(f"width_{name}", np.nan)]
    if not wider:
        return f"With wrong coefficients no channel's offset exceeds the {label}'s mean standard deviation."
    said = ", ".join(
        f"{name} {number(line[f'offset_{name}'])} beside {number(line[f'width_{name}'])} {CHANNELS[name][0]}"
        for name in wider
    )
    return (
        f"With wrong coefficients the intervals of the {label} do not hold the offset, which exceeds the mean standard "
        f"deviation in {said}."
    )
