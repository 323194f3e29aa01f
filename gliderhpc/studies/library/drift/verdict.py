"""Verdict of study ``drift``: trends, drag, change points and an independent check, in words and as JSON."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import scipy
from numpy.typing import NDArray

from gliderhpc.archive.profile import ADJOINT
from gliderhpc.archive.reader import Archive
from gliderhpc.findings.formatting import number
from gliderhpc.platform import Platform
from gliderhpc.store_schema.columns import FORWARD_ERROR_COLUMN, median_column
from gliderhpc.studies.library.drift.change_points import moment_per_degree
from gliderhpc.studies.library.drift.change_rows import changes_as_json, moments_as_json
from gliderhpc.studies.library.drift.change_search import MIN_VALUES_SEARCHED
from gliderhpc.studies.library.drift.change_text import change_lines, drag_name, kinds_text, moment_lines, moment_name
from gliderhpc.studies.library.drift.changes import Changes
from gliderhpc.studies.library.drift.coefficients import CoefficientSlopes
from gliderhpc.studies.library.drift.departures import amplitude
from gliderhpc.studies.library.drift.drag import (
    CAUSES,
    EXTRA,
    OTHER_CAUSES,
    DragDrift,
    Interval,
    drag_drift,
    error_by_coefficients,
    shared_drag,
    weight_effects,
)
from gliderhpc.studies.library.drift.medians import DRAG, PRIMARY, PRIOR, DriftSettings
from gliderhpc.studies.library.drift.series import (
    LATERAL,
    LONGITUDINAL,
    EstimateTrends,
    SeriesTrend,
    days_of,
    estimate_trends,
    of_epochs,
    trend_of,
    values_of,
)
from gliderhpc.studies.library.trends import MIN_VALUES, known_pairs
from gliderhpc.vocabulary import PHASES

VALIDATION_GROUP, FORWARD_ERROR = "validation", "longitudinal_rmse"

CURVED = 3.0
"""Standard deviations above which a curvature is significant."""


@dataclass(frozen=True)
class Correlation:
    """Spearman's rank correlation and its two-sided probability of chance."""

    rho: float
    p: float


@dataclass(frozen=True, eq=False)
class ForwardModelCheck:
    """Trend of the forward model's error, and its correlations with the days and with the axial force on the climb."""

    trend: SeriesTrend
    with_day: Correlation
    with_axial: Correlation


def forward_errors(archive: Archive, numbers: list[int]) -> dict[int, float] | None:
    """Longitudinal error of the forward model by profile number; None if the archive was not validated."""
    if VALIDATION_GROUP not in archive.children or FORWARD_ERROR not in archive[VALIDATION_GROUP].to_dataset():
        return None
    errors = archive[VALIDATION_GROUP].to_dataset()[FORWARD_ERROR].sel(profile=numbers).values
    return dict(zip(numbers, errors.tolist(), strict=True)) if np.isfinite(errors).any() else None


def forward_model_check(table: pd.DataFrame, resamples: int, seed: int) -> ForwardModelCheck | None:
    """Check the drift with the forward model, which is independent of the estimates; None without its errors."""
    if FORWARD_ERROR_COLUMN not in table:
        return None
    error = values_of(table, FORWARD_ERROR_COLUMN)
    axial = np.abs(values_of(table, median_column("B_cu", "climb", ADJOINT)))
    return ForwardModelCheck(
        trend_of(table, FORWARD_ERROR_COLUMN, resamples, seed),
        _correlation_with(error, days_of(table)),
        _correlation_with(error, axial),
    )


def _correlation_with(first: object, second: object) -> Correlation:
    a, b = known_pairs(np.asarray(first), np.asarray(second))
    if len(a) < MIN_VALUES or np.ptp(a) == 0.0 or np.ptp(b) == 0.0:
        return Correlation(float("nan"), float("nan"))
    spearman = scipy.stats.spearmanr(a, b)
    return Correlation(float(spearman.statistic), float(spearman.pvalue))


@dataclass(frozen=True, eq=False)
class DriftVerdict:
    """Joint verdict of the estimates used.

    Attributes
    ----------
    drags : tuple of DragDrift
        Changes of drag outside the episodes, by each available estimate used for the verdict.
    changes : Changes
        Steps, ramps and episodes of drag and axial force.
    straight : bool
        True if a line describes the drag outside the episodes.
    moments : Changes
        Steps, ramps and episodes of the moments.
    per_degree : float
        Moment that tilts the hull by one degree, N m.
    """

    drags: tuple[DragDrift, ...]
    changes: Changes
    straight: bool
    moments: Changes
    per_degree: float

    @property
    def cause(self) -> str:
        """Key of `CAUSES` if the estimates agree, else ``ambiguous``; if they differ only by `EXTRA`, with `EXTRA`."""
        causes = sorted({drag.cause for drag in self.drags}, key=len)
        agree = all(cause.removesuffix(EXTRA) == causes[0] for cause in causes)
        return causes[-1] if agree or len(causes) == 1 else "ambiguous"

    @property
    def change(self) -> float:
        """Change of K_D0 common to dive and climb, kg/m, mean of the estimates."""
        return sum(drag.change for drag in self.drags) / len(self.drags)

    @property
    def interval(self) -> Interval:
        """Return the 95 % interval of the change, from the lowest to the highest end of the estimates' intervals."""
        ends = [drag.change_interval for drag in self.drags]
        return min(low for low, _ in ends), max(high for _, high in ends)

    @property
    def grows(self) -> bool:
        """Return whether the drag common to dive and climb grows."""
        return self.cause.startswith("drag")

    @property
    def has_onset(self) -> bool:
        """Return whether the drag grows like a level that turns into a line."""
        return self.grows and self.changes.allow_onset

    @property
    def extrapolates(self) -> bool:
        """Return whether the drag grows along a straight line and can therefore be extrapolated."""
        return self.grows and self.straight

    def days_until(self, increase: float) -> tuple[float, Interval]:
        """Days from the first observation until a given relative increase of K_D0.

        The growth is the mean of the estimates; the interval is from the earliest to the latest end of their intervals.
        """
        grown = self.change / self.drags[0].reference
        day = increase / grown * self.drags[0].shared.span if grown > 0.0 else float("inf")
        spans = [drag.days_until(increase)[1] for drag in self.drags]
        return day, (min(early for early, _ in spans), max(late for _, late in spans))

    def as_json(self, increase: float) -> dict[str, Any]:
        """Return the verdict as plain values."""
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
            "moment_changes": moments_as_json(self.moments),
            "estimates": {drag.estimate: _drag_as_json(drag, self.has_onset) for drag in self.drags},
        }

    @property
    def meaning(self) -> str:
        """Cause in words."""
        if self.cause == "ambiguous":
            causes = "; ".join(f"{drag.estimate}: {CAUSES[drag.cause]}" for drag in self.drags)
            return f"ambiguous, since the estimates do not agree ({causes})"
        return CAUSES[self.cause]


def verdict_lines(verdict: DriftVerdict, trends: Sequence[EstimateTrends], increase: float) -> tuple[str, ...]:
    """Describe the findings, one per line."""
    reference = verdict.drags[0].reference
    where = " outside the episodes" if verdict.changes.episodes else ""
    lines = [
        f"verdict: {_summarise_changes(verdict)}{verdict.meaning}{where}",
        *change_lines(verdict.changes, reference),
        *moment_lines(verdict.moments, verdict.per_degree),
        _describe_common_drag(verdict),
    ]
    lines += [_describe_series(own) for own in trends] + [
        _describe_phase_difference(drag) for drag in verdict.drags if np.isfinite(drag.phase_difference.drift)
    ]
    if verdict.has_onset:
        lines += [_describe_onset(drag) for drag in verdict.drags]
    if verdict.extrapolates:
        lines.append(_describe_extrapolation(verdict, increase))
    elif verdict.grows:
        lines.append("the drag does not grow linearly, so no day is given for its further growth")
    if verdict.cause != "none" or verdict.changes.found or verdict.moments.found:
        lines.append(OTHER_CAUSES)
    return tuple(lines)


def _describe_common_drag(verdict: DriftVerdict) -> str:
    """State the change of the drag that dives and climbs share."""
    if not np.isfinite(verdict.change):
        return f"drag common to dive and climb: not known, since fewer than {MIN_VALUES} profiles have a value"
    change, low, high = (100.0 * value / verdict.drags[0].reference for value in (verdict.change, *verdict.interval))
    return (
        f"drag common to dive and climb: K_D0 changes by {change:+.1f} % over the mission "
        f"(95 % interval {low:+.1f} to {high:+.1f} %)"
    )


def _summarise_changes(verdict: DriftVerdict) -> str:
    """Name all change points, for the beginning of the verdict; empty if there are none."""
    named = [kinds_text(verdict.changes, drag_name), kinds_text(verdict.moments, moment_name)]
    text = "; ".join(filter(None, named))
    return f"{text}; in addition, " if text else ""


def _describe_series(own: EstimateTrends) -> str:
    shown = own.drifting
    names = ", ".join(f"{channel} {phase}" for channel, phase in shown) or "none"
    lateral = [key for key in shown if key[0] in LATERAL and own.tier(key) != "negligible"]
    where = "also in the lateral plane" if lateral else "in the longitudinal plane alone" if shown else ""
    listed = "; ".join(filter(None, (names, where)))
    return f"{own.estimate}: series that drift after Holm's correction for {len(own.trends)}: {listed}"


def _describe_phase_difference(drag: DragDrift) -> str:
    trend = drag.phase_difference
    low, high = drag.weight_interval
    return (
        f"{drag.estimate}: dive and climb diverge, equivalent to {number(trend.drift)} N of in-water weight (95 % "
        f"interval {number(low)} to {number(high)} N)"
    )


def _describe_onset(drag: DragDrift) -> str:
    onset = drag.onset
    when = "from the first day of the record or earlier" if onset.from_the_start else f"since day {onset.day:.1f}"
    return f"{drag.estimate}: grows {when} (95 % interval: day {onset.low:.1f} to {onset.high:.1f})"


def _describe_extrapolation(verdict: DriftVerdict, increase: float) -> str:
    day, (early, late) = verdict.days_until(increase)
    latest = f"day {late:.0f}" if late < float("inf") else "no upper limit"
    return (
        f"K_D0 will be {100.0 * increase:.0f} % above its value at the start on day {day:.0f} if it continues to grow "
        f"at the same rate (95 % interval: day {early:.0f} to {latest})"
    )


def _drag_as_json(drag: DragDrift, has_onset: bool) -> dict[str, Any]:
    onset = drag.onset
    days = {"day": onset.day, "low": onset.low, "high": onset.high, "from_the_start": onset.from_the_start}
    return {
        "cause": drag.cause,
        "K_D0_change": drag.change,
        "K_D0_change_interval": drag.change_interval,
        "slope_error_by_coefficients": drag.by_coefficients,
        "shared": drag.shared.as_json(),
        "weight": drag.phase_difference.as_json(),
        "phases": {phase: trend.as_json() for phase, trend in drag.phases.items()},
        "onset": days if has_onset else None,
    }


def is_straight(table: pd.DataFrame, estimate: str, outside: NDArray[np.bool_]) -> bool:
    """Return whether the drag common to dive and climb follows a straight line over the days, without curvature.

    Parameters
    ----------
    table : pandas.DataFrame
        Table of medians, one row for each profile.
    estimate : str
        Name of an estimate with medians.
    outside : (n,) mask
        Profiles that are used.

    Notes
    -----
    A parabola is fitted together with the line by generalised least squares, with the noise model that fits best. With
    too few values no curvature is significant, and the result is true.
    """
    dive, climb = (values_of(table, median_column(DRAG, phase, estimate)) for phase in PHASES)
    values, days = shared_drag(dive, climb, weight_effects(table)), days_of(table)
    known = np.isfinite(values) & outside
    if known.sum() < MIN_VALUES_SEARCHED:
        return True
    time = 2.0 * (days[known] - days[known].min()) / np.ptp(days[known]) - 1.0
    line = np.column_stack([np.ones(len(time)), time])
    size, deviation = amplitude(np.flatnonzero(known), line, time**2, values[known])
    return bool(abs(size) <= CURVED * deviation)


@dataclass(frozen=True, eq=False)
class DriftFindings:
    """Trends, drag, slopes, check and change points found in a table of medians."""

    trends: list[EstimateTrends]
    drags: list[DragDrift]
    slopes: list[CoefficientSlopes]
    check: ForwardModelCheck | None
    changes: Changes
    straight: bool
    counted: tuple[str, ...]
    moments: Changes
    per_degree: float

    @property
    def primary(self) -> list[EstimateTrends]:
        """Trends of the estimates used for the verdict."""
        return [own for own in self.trends if own.estimate in self.counted]

    @property
    def verdict(self) -> DriftVerdict:
        """Joint verdict of the estimates used."""
        drags = tuple(drag for drag in self.drags if drag.estimate in self.counted)
        return DriftVerdict(drags, self.changes, self.straight, self.moments, self.per_degree)


def find_drift(
    table: pd.DataFrame,
    hull: Platform,
    settings: DriftSettings,
    slopes: Sequence[CoefficientSlopes] = (),
    *,
    changes: Changes | None = None,
    counted: tuple[str, ...] = PRIMARY,
    moments: Changes | None = None,
) -> DriftFindings:
    """Find trends and drag in a table of medians, and interpret them.

    Parameters
    ----------
    table : pandas.DataFrame
        Table with one row for each profile: ``profile``, ``elapsed_days``, ``epoch`` and the values of `profile_row`.
    hull : Platform
        Hull of the mission.
    settings : DriftSettings
        Settings of the study.
    slopes : sequence of CoefficientSlopes
        Slopes over segments of the same profiles, if coefficients were drawn.
    changes : Changes, optional
        Change points of drag and axial force; none by default. Trends of drag are those outside the episodes.
    counted : tuple of str
        Estimates used for the verdict (`counted_estimates`).
    moments : Changes, optional
        Change points of the moments; none by default.
    """
    changes = Changes() if changes is None else changes
    table = of_epochs(table)
    outside = changes.outside(values_of(table, "profile"))
    estimates = [name for name in (PRIOR, *PRIMARY) if median_column(DRAG, "dive", name) in table]
    error = error_by_coefficients(slopes, weight_effects(table)) if slopes else (0.0, 0.0)
    return DriftFindings(
        [estimate_trends(table, name, settings.resamples, settings.seed) for name in estimates],
        [drag_drift(table, name, hull, error, settings, outside) for name in estimates],
        list(slopes),
        forward_model_check(table, settings.resamples, settings.seed),
        changes,
        changes.allow_line and all(is_straight(table, name, outside) for name in estimates if name in counted),
        counted,
        Changes() if moments is None else moments,
        moment_per_degree(hull),
    )


def slopes_of_all_samples(findings: DriftFindings) -> dict[tuple[str, str], float]:
    """Slopes of the adjoint over all samples used, by quantity and phase; those over segments approximate them."""
    trends = next(own for own in findings.trends if own.estimate == ADJOINT).trends
    drag = next(own for own in findings.drags if own.estimate == ADJOINT).phases
    slopes = {key: series.trend.slope for key, series in trends.items() if key[0] in LONGITUDINAL}
    return slopes | {(DRAG, phase): series.trend.slope for phase, series in drag.items()}
