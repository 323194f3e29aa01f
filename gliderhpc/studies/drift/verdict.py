"""What the study says to a pilot: is the hull fouling, since when, how much, how sure."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from gliderhpc.findings.tables import number
from gliderhpc.studies.drift.change_points import Changes
from gliderhpc.studies.drift.change_text import change_lines, changes_as_json, kinds_text
from gliderhpc.studies.drift.drag import CAUSES, MORE, OTHER_CAUSES, DragDrift, Interval
from gliderhpc.studies.drift.series import LATERAL, EstimateTrends


@dataclass(frozen=True, eq=False)
class Verdict:
    """What both primary estimates say together.

    Attributes
    ----------
    drags : tuple of DragDrift
        Of the primary estimates that are there, outside the episodes.
    changes : Changes
        Steps, ramps and episodes.
    straight : bool
        Whether a line describes the drag outside the episodes.
    """

    drags: tuple[DragDrift, ...]
    changes: Changes
    straight: bool

    @property
    def cause(self) -> str:
        """Which of `CAUSES` where the estimates agree, else ``ambiguous``; the more careful of two that nearly do."""
        causes = sorted({drag.cause for drag in self.drags}, key=len)
        agree = all(cause.removesuffix(MORE) == causes[0] for cause in causes)
        return causes[-1] if agree or len(causes) == 1 else "ambiguous"

    @property
    def change(self) -> float:
        """Change of K_D0 that dive and climb share, kg/m, mean of the estimates."""
        return sum(drag.change for drag in self.drags) / len(self.drags)

    @property
    def interval(self) -> Interval:
        """Return its 95 % interval: from the lowest to the highest end of the estimates' own."""
        ends = [drag.change_interval for drag in self.drags]
        return min(low for low, _ in ends), max(high for _, high in ends)

    @property
    def grows(self) -> bool:
        """Whether the drag grows by what dive and climb share."""
        return self.cause.startswith("drag")

    @property
    def has_onset(self) -> bool:
        """Whether the drag grows as a level that turns into a line does."""
        return self.grows and self.changes.leave_an_onset

    @property
    def extrapolates(self) -> bool:
        """Whether the drag grows along a straight line, so that it can be taken to go on."""
        return self.grows and self.straight

    def days_until(self, increase: float) -> tuple[float, Interval]:
        """Days from the first observation until K_D0 has grown by a part of itself.

        By the mean growth of the estimates; the interval is from the earliest to the latest end of their own.
        """
        grown = self.change / self.drags[0].reference
        day = increase / grown * self.drags[0].shared.span if grown > 0.0 else float("inf")
        spans = [drag.days_until(increase)[1] for drag in self.drags]
        return day, (min(early for early, _ in spans), max(late for _, late in spans))

    def as_json(self, increase: float) -> dict[str, Any]:
        """Plain values."""
        days, span = self.days_until(increase) if self.extrapolates else (None, None)
        return {
            "cause": self.cause,
            "meaning": self.meaning,
            "K_D0_change": self.change,
            "K_D0_change_interval": self.interval,
            "K_D0_change_relative": self.change / self.drags[0].reference,
            "drag_increase": increase,
            "days_until": days,
            "days_until_interval": span,
            "straight": self.straight,
            "changes": changes_as_json(self.changes, self.drags[0].reference),
            "estimates": {drag.estimate: _drag_as_json(drag, self.has_onset) for drag in self.drags},
        }

    @property
    def meaning(self) -> str:
        """The cause in words."""
        if self.cause == "ambiguous":
            each = "; ".join(f"{drag.estimate}: {CAUSES[drag.cause]}" for drag in self.drags)
            return f"ambiguous, since the estimates do not agree ({each})"
        return CAUSES[self.cause]


def verdict_lines(verdict: Verdict, found: Sequence[EstimateTrends], increase: float) -> tuple[str, ...]:
    """Say what was found, a line each."""
    reference = verdict.drags[0].reference
    low, high = (100.0 * end / reference for end in verdict.interval)
    where = " outside the episodes" if verdict.changes.episodes else ""
    lines = [
        f"verdict: {kinds_text(verdict.changes)}{verdict.meaning}{where}",
        *change_lines(verdict.changes, reference),
        f"drag that dive and climb share: K_D0 by {100.0 * verdict.change / reference:+.1f} % over the mission (95 % "
        f"interval {low:+.1f} to {high:+.1f} %)",
    ]
    lines += [_plane(own) for own in found] + [_apart(drag) for drag in verdict.drags]
    if verdict.has_onset:
        lines += [_since(drag) for drag in verdict.drags]
    if verdict.extrapolates:
        lines.append(_until(verdict, increase))
    elif verdict.grows:
        lines.append("the drag does not grow along a straight line, so no day is given for its further growth")
    if verdict.cause != "none" or verdict.changes.found:
        lines.append(OTHER_CAUSES)
    return tuple(lines)


def _plane(own: EstimateTrends) -> str:
    shown = own.shown
    names = ", ".join(f"{channel} {phase}" for channel, phase in shown) or "none"
    lateral = [key for key in shown if key[0] in LATERAL and own.tier(key) != "negligible"]
    where = "also in the lateral plane" if lateral else "in the longitudinal plane alone" if shown else "nowhere"
    return f"{own.estimate}: series that drift after Holm's correction for {len(own.trends)}: {names}; {where}"


def _apart(drag: DragDrift) -> str:
    one = drag.apart
    low, high = drag.weight_interval
    return (
        f"{drag.estimate}: dive and climb drift apart by what {number(one.drift)} N of weight in water would do (95 % "
        f"interval {number(low)} to {number(high)} N)"
    )


def _since(drag: DragDrift) -> str:
    onset = drag.onset
    when = "from the first day on, as far as the record tells" if onset.from_the_start else f"since day {onset.day:.1f}"
    return f"{drag.estimate}: grows {when} (95 % interval: day {onset.low:.1f} to {onset.high:.1f})"


def _until(verdict: Verdict, increase: float) -> str:
    day, (early, late) = verdict.days_until(increase)
    latest = f"day {late:.0f}" if late < float("inf") else "no day that can be given"
    return (
        f"K_D0 is {100.0 * increase:.0f} % above that at the start on day {day:.0f}, were it to go on as so far (95 % "
        f"interval: day {early:.0f} to {latest})"
    )


def _drag_as_json(drag: DragDrift, has_onset: bool) -> dict[str, Any]:
    onset = drag.onset
    days = {"day": onset.day, "low": onset.low, "high": onset.high, "from_the_start": onset.from_the_start}
    return {
        "cause": drag.cause,
        "K_D0_change": drag.change,
        "K_D0_change_interval": drag.change_interval,
        "coefficient_scale": drag.scale,
        "shared": drag.shared.as_json(),
        "weight": drag.apart.as_json(),
        "phases": {phase: one.as_json() for phase, one in drag.phases.items()},
        "onset": days if has_onset else None,
    }
