"""The paper's figures of the drift beside ours."""

from collections.abc import Iterator, Sequence

from gliderhpc.findings.comparison import Comparison
from gliderhpc.findings.tables import number
from gliderhpc.studies.drift.medians import DRAG, UNITS
from gliderhpc.studies.drift.series import EstimateTrends
from gliderhpc.studies.drift.spread import CoefficientSlopes
from gliderhpc.studies.drift.verdict import Verdict
from gliderhpc.studies.drift.witness import Witness

PAPER_DRIFTS = {
    ("B_cu", "dive"): -0.56,
    ("B_cu", "climb"): -1.39,
    ("B_cw", "climb"): -4.41,
    ("B_cq", "climb"): -1.69,
}
"""Drifts over the mission of Table 5, N and N m."""

PAPER_SAME_SIGN, PAPER_RISE, PAPER_WITH_DAY, PAPER_WITH_AXIAL = 1.0, 0.66, 0.69, 0.75
"""Of Table 6."""


def comparisons(
    trends: Sequence[EstimateTrends],
    verdict: Verdict,
    slopes: Sequence[CoefficientSlopes],
    witness: Witness | None,
    increase: float,
) -> tuple[Comparison, ...]:
    """Rows of the study's table."""
    return (
        *(_drift(own, key, paper) for key, paper in PAPER_DRIFTS.items() for own in trends),
        *_drag(verdict, increase),
        *_changes(verdict),
        *_coefficients(slopes),
        *_witness(witness),
    )


def _drift(own: EstimateTrends, key: tuple[str, str], paper: float) -> Comparison:
    one = own.trends[key]
    return Comparison(
        f"drift of {key[0]}, {key[1]}, {own.estimate}", UNITS[key[0]], one.drift, paper,
        spread=(one.trend.low * one.span, one.trend.high * one.span),
        remark=f"p {number(one.trend.p)}, robust {number(one.corrected)} after Holm; spread: 95 % interval",
    )  # fmt: skip


def _drag(verdict: Verdict, increase: float) -> Iterator[Comparison]:
    for drag in verdict.drags:
        yield Comparison(
            f"change of K_D0 that dive and climb share, {drag.estimate}", UNITS[DRAG], drag.change,
            spread=drag.change_interval,
            remark=f"{100.0 * drag.change / drag.reference:+.1f} %; spread: 95 % interval, coefficients included",
        )  # fmt: skip
        if verdict.has_onset:
            yield Comparison(
                f"day since which it grows, {drag.estimate}", "day", drag.onset.day,
                spread=(drag.onset.low, drag.onset.high),
                remark="spread: 95 % interval",
            )  # fmt: skip
    if not verdict.extrapolates:
        return
    day, span = verdict.days_until(increase)
    yield Comparison(
        f"day on which K_D0 is {100.0 * increase:.0f} % up",
        "day",
        day,
        spread=span,
        remark="were it to go on as so far",
    )


def _changes(verdict: Verdict) -> Iterator[Comparison]:
    reference = verdict.drags[0].reference
    for one in verdict.changes.found:
        for phase in one.phases:
            size = one.size(DRAG, phase)
            yield Comparison(
                f"{one.kind} from profile {one.first} to {one.last}: largest change of K_D0, {phase}", UNITS[DRAG],
                size.value, spread=(size.low, size.high),
                remark=f"{100.0 * size.value / reference:+.0f} %; p {number(one.p)}; spread: 95 % interval",
            )  # fmt: skip


def _coefficients(slopes: Sequence[CoefficientSlopes]) -> Iterator[Comparison]:
    for one in slopes:
        yield Comparison(
            f"draws of the coefficients that keep the slope's sign, {one.quantity}, {one.phase}", "1", one.same_sign,
            PAPER_SAME_SIGN if (one.quantity, one.phase) in PAPER_DRIFTS else None,
            remark=f"slope {number(one.nominal)} a day, draws {number(one.interval[0])} to {number(one.interval[1])}",
        )  # fmt: skip
        if one.quantity == "B_cu":
            yield Comparison(
                f"shift of B_cu by a constant pitch offset, {one.phase}",
                UNITS[one.quantity],
                float(one.shift[0]),
                remark=f"slope {number(float(one.pitched[0]))} a day with it; opposite on dive and climb, so no drift",
            )


def _witness(witness: Witness | None) -> Iterator[Comparison]:
    if witness is None:
        return
    yield Comparison(
        "rise of the forward model's error", "1", witness.trend.trend.change, PAPER_RISE,
        remark=f"p {number(witness.trend.trend.p)}, robust {number(witness.trend.robust.p)}",
    )  # fmt: skip
    yield Comparison("its Spearman correlation with the day", "1", witness.with_day.rho, PAPER_WITH_DAY)
    yield Comparison("with |B_cu| on the climb, adjoint", "1", witness.with_axial.rho, PAPER_WITH_AXIAL)
