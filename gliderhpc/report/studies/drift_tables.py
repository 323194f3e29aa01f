"""Study ``drift``: comparisons with the paper, and Tables 5 and 6, as rows and as Markdown."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from gliderhpc.findings.comparison import Comparison, range_text
from gliderhpc.findings.formatting import markdown, number
from gliderhpc.studies.library.drift.change_text import MOMENT_NAMES
from gliderhpc.studies.library.drift.coefficients import CoefficientSlopes, are_drawn
from gliderhpc.studies.library.drift.medians import (
    DRAG,
    UNITS,
    CoefficientSettings,
)
from gliderhpc.studies.library.drift.series import (
    EstimateTrends,
)
from gliderhpc.studies.library.drift.verdict import (
    DriftVerdict,
    ForwardModelCheck,
)
from gliderhpc.vocabulary import PHASES

PAPER_DRIFTS = {("B_cu", "dive"): -0.56, ("B_cu", "climb"): -1.39, ("B_cw", "climb"): -4.41, ("B_cq", "climb"): -1.69}
"""Drifts over the mission from the paper's Table 5, N and N m."""


PAPER_SAME_SIGN, PAPER_RISE, PAPER_WITH_DAY, PAPER_WITH_AXIAL = 1.0, 0.66, 0.69, 0.75
"""Values from the paper's Table 6: fraction of draws that keep the slope's sign, relative rise of the forward model's
error, and Spearman correlations of this error with the day and with |B_cu| on the climb."""


_SHARED = "of K_D0 on dive and climb"
"""Name of a change of the drag that dive and climb share."""


def comparisons(
    trends: Sequence[EstimateTrends],
    verdict: DriftVerdict,
    slopes: Sequence[CoefficientSlopes],
    check: ForwardModelCheck | None,
    increase: float,
) -> tuple[Comparison, ...]:
    """Return the rows of the study's table of comparisons."""
    return (
        *(_drift(own, key, paper) for key, paper in PAPER_DRIFTS.items() for own in trends),
        *_drag(verdict, increase, "coefficients included" if are_drawn(slopes) else "without coefficients"),
        *_changes(verdict),
        *_coefficients(slopes),
        *_forward_model(check),
    )


def _drift(own: EstimateTrends, key: tuple[str, str], paper: float) -> Comparison:
    trend = own.trends[key]
    return Comparison(
        f"drift of {key[0]}, {key[1]}, {own.estimate}",
        UNITS[key[0]],
        trend.drift,
        paper,
        spread=(trend.trend.low * trend.span, trend.trend.high * trend.span),
        remark=f"p {number(trend.trend.p)}, robust {number(trend.corrected)} after Holm; spread: 95 % interval",
    )


def _drag(verdict: DriftVerdict, increase: float, included: str) -> Iterator[Comparison]:
    for drag in verdict.drags:
        yield Comparison(
            f"change of K_D0 common to dive and climb, {drag.estimate}",
            UNITS[DRAG],
            drag.change,
            spread=drag.change_interval,
            remark=f"{100.0 * drag.change / drag.reference:+.1f} %; spread: 95 % interval, {included}",
        )
        if verdict.has_onset:
            yield Comparison(
                f"day from which it grows, {drag.estimate}",
                "day",
                drag.onset.day,
                spread=(drag.onset.low, drag.onset.high),
                remark="spread: 95 % interval",
            )
    if not verdict.extrapolates:
        return
    day, span = verdict.days_until(increase)
    yield Comparison(
        f"day on which K_D0 has risen by {100.0 * increase:.0f} %",
        "day",
        day,
        spread=span,
        remark="if it continues to grow at the same rate",
    )


def _changes(verdict: DriftVerdict) -> Iterator[Comparison]:
    reference = verdict.drags[0].reference
    for change in verdict.changes.found:
        name = f"{change.kind} from profile {change.first} to {change.last}: largest change"
        sizes = {f"of equivalent K_D0, {phase}": change.size(DRAG, phase) for phase in change.phases}
        errors = {}
        if change.is_drag:
            sizes = {_SHARED: change.drag, **sizes}
            errors = {_SHARED: ", the hull's other errors included"}
        for of, size in sizes.items():
            yield Comparison(
                f"{name} {of}",
                UNITS[DRAG],
                size.value,
                spread=(size.low, size.high),
                remark=f"{100.0 * size.value / reference:+.0f} %; p {number(change.p)}; spread: 95 % interval"
                f"{errors.get(of, '')}",
            )
    for change in verdict.moments.found:
        for channel in change.moments:
            for phase in PHASES:
                size = change.size(channel, phase)
                yield Comparison(
                    f"{change.kind} from profile {change.first} to {change.last}: largest change of the "
                    f"{MOMENT_NAMES[channel]}, {phase}",
                    UNITS[channel],
                    size.value,
                    spread=(size.low, size.high),
                    remark=f"p {number(change.p)}; spread: 95 % interval",
                )


def _coefficients(slopes: Sequence[CoefficientSlopes]) -> Iterator[Comparison]:
    for slope in slopes:
        yield Comparison(
            f"draws of the coefficients that keep the slope's sign, {slope.quantity}, {slope.phase}",
            "1",
            slope.same_sign,
            PAPER_SAME_SIGN if (slope.quantity, slope.phase) in PAPER_DRIFTS else None,
            remark=f"slope {number(slope.nominal)} per day, draws {range_text(slope.interval)}",
        )
        if slope.quantity == "B_cu":
            yield Comparison(
                f"shift of B_cu by a constant pitch offset, {slope.phase}",
                UNITS[slope.quantity],
                float(slope.shift[0]),
                remark=f"slope {number(float(slope.pitched[0]))} per day with it; opposite on dive and climb, so no "
                "drift",
            )


def _forward_model(check: ForwardModelCheck | None) -> Iterator[Comparison]:
    if check is None:
        return
    yield Comparison(
        "rise of the forward model's error",
        "1",
        check.trend.trend.change,
        PAPER_RISE,
        remark=f"p {number(check.trend.trend.p)}, robust {number(check.trend.robust.p)}",
    )
    yield Comparison("its Spearman correlation with the day", "1", check.with_day.rho, PAPER_WITH_DAY)
    yield Comparison("with |B_cu| on the climb, adjoint", "1", check.with_axial.rho, PAPER_WITH_AXIAL)


_TIERS = {"primary": "Primary", "supporting": "Supp.", "negligible": "(neg.)", "none": "–"}


_COLUMNS_5 = (
    "estimate", "component", "phase", "n", "tau", "p", "slope per day", "95 % interval", "drift", "drift, %", "floor",
    "drift/floor", "tier", "robust p", "block", "Holm p", "verdict",
)  # fmt: skip


_TEXT_5 = ("estimate", "component", "phase", "95 % interval", "tier", "verdict")


def table_5(trends: Sequence[EstimateTrends]) -> list[dict[str, Any]]:
    """Return the rows of Table 5: forces in N, moments in N m, slopes per day, drift in % of the line's first value."""
    return [
        {
            "estimate": own.estimate, "component": channel, "unit": UNITS[channel], "phase": phase,
            "count": trend.trend.count, "tau": trend.trend.tau, "p": trend.trend.p, "slope": trend.trend.slope,
            "slope_low": trend.trend.low, "slope_high": trend.trend.high, "drift": trend.drift,
            "drift_percent": 100.0 * trend.drift / abs(trend.trend.first) if trend.trend.first else float("nan"),
            "floor": trend.floor, "ratio": trend.ratio, "tier": own.tier((channel, phase)), "robust_p": trend.robust.p,
            "block": trend.robust.block, "holm_p": trend.corrected, "shown": trend.is_significant,
        }
        for own in trends
        for (channel, phase), trend in own.trends.items()
    ]  # fmt: skip


def table_5_text(rows: Sequence[dict[str, Any]]) -> str:
    """Format the table as Markdown."""
    heading = (
        "Trends. tau, p: plain Mann-Kendall test; slope: Theil-Sen, its interval by drawing epochs; "
        "floor: standard deviation within epochs; tier: as the paper grades it (p < 0.05 and an interval without zero: "
        "primary). robust p: Mann-Kendall by the moving-block bootstrap; Holm p: the same, corrected for the series of "
        "the estimate; verdict: Holm p < 0.05 and an interval without zero.\n\n"
    )
    cells = (
        (
            str(row["estimate"]), f"{row['component']} ({row['unit']})", str(row["phase"]), str(row["count"]),
            f"{row['tau']:+.2f}" if np.isfinite(row["tau"]) else "–", number(row["p"]), number(row["slope"]),
            range_text((row["slope_low"], row["slope_high"])), number(row["drift"]),
            number(row["drift_percent"]), number(row["floor"]), number(row["ratio"]), _TIERS[row["tier"]],
            number(row["robust_p"]), str(row["block"]), number(row["holm_p"]), "drift" if row["shown"] else "not shown",
        )
        for row in rows
    )  # fmt: skip
    return heading + markdown(_COLUMNS_5, cells, [name for name in _COLUMNS_5 if name not in _TEXT_5]) + "\n"


_COLUMNS_6 = (
    "component", "phase", "all samples", "segments", "95 % of draws", "same sign", "pitch up", "pitch down",
    "shift, pitch up", "shift, pitch down",
)  # fmt: skip


def table_6(slopes: Sequence[CoefficientSlopes], all_samples: dict[tuple[str, str], float]) -> list[dict[str, Any]]:
    """Return the rows of Table 6, with slopes per day.

    Parameters
    ----------
    slopes : sequence of CoefficientSlopes
        Slopes from the segments.
    all_samples : dict
        The adjoint's slopes over all samples used, by quantity and phase.
    """
    return [
        {
            "component": slope.quantity, "unit": UNITS[slope.quantity], "phase": slope.phase,
            "slope_all_samples": all_samples.get((slope.quantity, slope.phase), float("nan")),
            "slope_segments": slope.nominal, "slope_low": slope.interval[0], "slope_high": slope.interval[1],
            "draws": int(np.isfinite(slope.draws).sum()), "same_sign": slope.same_sign,
            "slope_pitch_up": float(slope.pitched[0]),
            "slope_pitch_down": float(slope.pitched[1]), "shift_pitch_up": float(slope.shift[0]),
            "shift_pitch_down": float(slope.shift[1]),
        }
        for slope in slopes
    ]  # fmt: skip


def table_6_text(rows: Sequence[dict[str, Any]], settings: CoefficientSettings, check: ForwardModelCheck | None) -> str:
    """Format the table as Markdown, followed by the check by the forward model."""
    return _coefficient_rows(rows, settings) + "\n" + _check_rows(check)


def _coefficient_rows(rows: Sequence[dict[str, Any]], settings: CoefficientSettings) -> str:
    if not rows:
        return "The coefficients were not drawn (drift.coefficients.draws = 0).\n"
    heading = (
        f"Slopes per day for {settings.draws} hulls whose viscous and added-mass coefficients are in error by up to "
        f"{settings.error:.0%}, from the adjoint. Inverted again, through filter and windows: {settings.segments} "
        f"steady segment(s) of {settings.length:g} s per profile and phase, the first {settings.settling:g} s not "
        f"counted.\nPitch up and down: slope with a constant pitch error of {settings.pitch_offset:g} degree; shift: "
        "its effect on the level.\n\n"
    )
    cells = (
        (
            f"{row['component']} ({row['unit']})",
            str(row["phase"]),
            number(row["slope_all_samples"]),
            number(row["slope_segments"]),
            range_text((row["slope_low"], row["slope_high"])),
            f"{row['same_sign']:.0%} of {row['draws']}" if row["draws"] else "–",
            number(row["slope_pitch_up"]),
            number(row["slope_pitch_down"]),
            number(row["shift_pitch_up"]),
            number(row["shift_pitch_down"]),
        )
        for row in rows
    )
    return heading + markdown(_COLUMNS_6, cells, _COLUMNS_6[2:]) + "\n"


def _check_rows(check: ForwardModelCheck | None) -> str:
    if check is None:
        return "No independent check: `gliderhpc validate` has not written the forward model's error to the archive.\n"
    error = check.trend
    return (
        f"Error of the forward model, an independent check without the adjoint: {number(error.trend.first)} to "
        f"{number(error.trend.last)} ({error.trend.change_text}), Mann-Kendall p {number(error.trend.p)}, robust p "
        f"{number(error.robust.p)}; Spearman with the day {check.with_day.rho:+.2f} (p {number(check.with_day.p)}), "
        f"with |B_cu| on the climb {check.with_axial.rho:+.2f} (p {number(check.with_axial.p)}).\n"
    )
