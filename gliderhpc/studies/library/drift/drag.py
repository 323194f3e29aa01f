"""Change of drag equivalent to a drift: the part common to dive and climb, and their difference.

Drag acts against the motion on both dive and climb. Weight acts downwards: it drives the dive and opposes the climb. A
change of weight therefore changes the equivalent K_D0 with opposite signs on the two phases. A weighted mean of dive
and climb in which the weight cancels gives their common change of drag. Their difference may be an uneven change of
drag, a change of weight, or a change of the pitch sensor's offset; dives and climbs alone cannot distinguish these.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from gliderhpc.estimation.priors import default_prior
from gliderhpc.platform import Platform
from gliderhpc.store_schema.columns import median_column, phase_column
from gliderhpc.studies.library.drift.coefficients import CoefficientSlopes
from gliderhpc.studies.library.drift.medians import DRAG, DriftSettings
from gliderhpc.studies.library.drift.series import SeriesTrend, days_of, epochs_of, series_trend, values_of
from gliderhpc.studies.library.trends import MIN_VALUES, epoch_draws, interval
from gliderhpc.vocabulary import PHASES

Interval = tuple[float, float]

Array = NDArray[np.float64]
Index = NDArray[np.int64]

MIN_VALUES_OF_SLOPE = 3
"""Minimum number of values for the slope after an onset."""

_CANDIDATES, _RESAMPLES = 101, 400

NORMAL_95 = 1.96
"""Half width of a 95 % interval, in standard deviations."""

HEAVE = 2
"""Position of B_cw among the disturbances."""

EXTRA = " and more"
"""Ending of a cause if dive and climb also drift apart."""

CAUSES = {
    "none": "no drift of the drag was detected",
    "drag": "the drag grows on dive and climb alike: compatible with fouling (growth, or a rougher hull)",
    "less drag": "the drag falls on dive and climb alike: compatible with growth that comes off, or another trim",
    "drag and more": (
        "the drag common to dive and climb grows, compatible with fouling; dive and climb also drift apart: uneven "
        "growth of the drag, a slow change of buoyancy and one of the pitch sensor's offset cannot be distinguished"
    ),
    "less drag and more": (
        "the drag common to dive and climb falls; dive and climb also drift apart: an uneven drag, a slow change of "
        "buoyancy and one of the pitch sensor's offset cannot be distinguished"
    ),
    "weight": (
        "no change of drag common to dive and climb: they drift apart, compatible with a slow change of buoyancy or "
        "of the pitch sensor's offset"
    ),
}
"""Interpretations of the trends of drag; none is a proof, because the data are observational."""

OTHER_CAUSES = (
    "these records do not prove a cause: apart from fouling, a changed payload or trim, water in a fairing, air in "
    "the oil circuit, a drifting pressure or attitude sensor and a change of the water encountered are possible"
)


@dataclass(frozen=True)
class Onset:
    """Day on which a change begins.

    Attributes
    ----------
    day, low, high : float
        Estimate and its 95 % interval.
    first : float
        First day of the series.
    """

    day: float
    low: float
    high: float
    first: float

    @property
    def from_the_start(self) -> bool:
        """Return whether the series may have changed from its first day on."""
        return bool(self.low <= self.first)


def find_onset(days: Array, values: Array, epoch: Index, resamples: int, seed: int) -> Onset:
    """Fit a level that turns into a straight slope, by least squares.

    Parameters
    ----------
    days, values, epoch : (n,)
        Days, values (missing ones are left out) and epochs of the series.
    resamples, seed : int
        Number of series of the bootstrap by epochs, and seed.

    Notes
    -----
    Candidates are evenly spaced over the series except for its last values, which determine the slope.
    """
    known = np.isfinite(values) & np.isfinite(days)
    t, y, own = days[known], values[known], epoch[known]
    if len(y) < MIN_VALUES:
        return Onset(*[float("nan")] * 4)
    candidates = np.linspace(t[0], np.sort(t)[-MIN_VALUES_OF_SLOPE], _CANDIDATES)
    rng = np.random.default_rng(seed)
    draws = epoch_draws(own, min(resamples, _RESAMPLES), rng)
    onsets = np.array([_best_onset(t[drawn], y[drawn], candidates) for drawn in draws])
    return Onset(_best_onset(t, y, candidates), *interval(onsets), float(t[0]))


def _best_onset(t: Array, y: Array, candidates: Array) -> float:
    """Candidate with the least sum of squares, which is the one whose hinge correlates most with the series."""
    hinges = np.maximum(0.0, t[None] - candidates[:, None])
    hinges = hinges - hinges.mean(axis=1, keepdims=True)
    power = (hinges**2).sum(axis=1)
    explained = np.where(power > 0.0, (hinges @ (y - y.mean())) ** 2 / np.where(power > 0.0, power, 1.0), 0.0)
    return float(candidates[int(np.argmax(explained))])


@dataclass(frozen=True, eq=False)
class DragDrift:
    """Change of drag over the mission according to one estimate.

    Attributes
    ----------
    estimate : str
        Name of the estimate.
    phases : dict of str to SeriesTrend
        Equivalent K_D0 on dive and climb, kg/m.
    shared : SeriesTrend
        Change common to both, without the effect of weight, kg/m.
    phase_difference : SeriesTrend
        Climb minus dive, expressed as the change of weight in water that would explain it, N.
    onset : Onset
        Day from which the shared drag changes.
    reference : float
        K_D0 of the hull, kg/m.
    by_coefficients : (low, high)
        Interval of the difference of the shared slope for drawn coefficients of the hull, kg/m per day; (0, 0) if none
        were drawn.
    unresolved : (float, float)
        Standard deviations of shared change (kg/m) and weight (N) due to other changes that the records cannot
        distinguish from them (`unresolved_changes`).
    """

    estimate: str
    phases: dict[str, SeriesTrend]
    shared: SeriesTrend
    phase_difference: SeriesTrend
    onset: Onset
    reference: float
    by_coefficients: Interval
    unresolved: tuple[float, float]

    @property
    def slope_interval(self) -> Interval:
        """Return the 95 % interval of the shared slope, including errors of coefficients and heave, kg/m per day."""
        trend = self.shared.trend
        return combine_errors(
            trend.slope,
            (trend.low, trend.high),
            self.by_coefficients,
            NORMAL_95 * self.unresolved[0] / self.shared.span,
        )

    @property
    def change(self) -> float:
        """Shared change over the mission, kg/m."""
        return self.shared.drift

    @property
    def change_interval(self) -> Interval:
        """Return the 95 % interval of the shared change, kg/m."""
        low, high = self.slope_interval
        return low * self.shared.span, high * self.shared.span

    @property
    def weight_interval(self) -> Interval:
        """Return the 95 % interval of the weight (N) equivalent to `phase_difference`, including the error of heave."""
        trend, span = self.phase_difference.trend, self.phase_difference.span
        low, high = combine_errors(
            trend.slope, (trend.low, trend.high), (1.0, 1.0), NORMAL_95 * self.unresolved[1] / span
        )
        return low * span, high * span

    @property
    def cause(self) -> str:
        """Key of `CAUSES`; a change is significant if the robust test and its full interval both show it."""
        together = self.shared.is_significant and _excludes_zero(self.change_interval)
        apart = self.phase_difference.is_significant and _excludes_zero(self.weight_interval)
        if not together:
            return "weight" if apart else "none"
        name = "drag" if self.shared.trend.slope > 0.0 else "less drag"
        return name + EXTRA if apart else name

    def days_until(self, increase: float) -> tuple[float, Interval]:
        """Days from the first observation until a given relative increase of K_D0, with the interval; inf for never.

        The growth over the mission is extrapolated from the state of the hull at the start of the mission.
        """
        low, high = self.slope_interval
        growth = increase * self.reference
        return _days(growth, self.shared.trend.slope), (_days(growth, high), _days(growth, low))


def drag_drift(
    table: pd.DataFrame,
    estimate: str,
    hull: Platform,
    by_coefficients: Interval,
    settings: DriftSettings,
    outside: NDArray[np.bool_] | None = None,
) -> DragDrift:
    """Find the drift of drag by one estimate.

    Parameters
    ----------
    table : pandas.DataFrame
        Table of medians, one row for each profile.
    estimate : str
        Name of an estimate with medians.
    hull : Platform
        Hull of the mission.
    by_coefficients : (low, high)
        Interval of the shared slope's error due to the coefficients, kg/m per day.
    settings : DriftSettings
        Settings of the study: number of bootstrap series, and seed.
    outside : (n,) mask, optional
        Profiles that are used, which are those outside episodes; all by default.
    """
    days, epoch = days_of(table), epochs_of(table)
    counted = np.ones(len(table), dtype=np.bool_) if outside is None else outside
    dive, climb = (
        np.where(counted, values_of(table, median_column(DRAG, phase, estimate)), np.nan) for phase in PHASES
    )
    weight = weight_effects(table)
    shared = shared_drag(dive, climb, weight)

    def trend(values: Array) -> SeriesTrend:
        return series_trend(days, values, epoch, settings.resamples, settings.seed)

    return DragDrift(
        estimate,
        phases={"dive": trend(dive), "climb": trend(climb)},
        shared=trend(shared),
        phase_difference=trend((climb - dive) / (weight[1] - weight[0])),
        onset=find_onset(days, shared, epoch, settings.resamples, settings.seed),
        reference=hull.viscous.K_D0,
        by_coefficients=by_coefficients,
        unresolved=unresolved_changes(table, hull),
    )


def unresolved_changes(table: pd.DataFrame, hull: Platform) -> tuple[float, float]:
    """Standard deviations of shared drag (kg/m) and weight (N) due to a heave force that changes as its prior allows.

    Depth and pitch cannot distinguish a change of lift, or of another force across the path, from a change of drag. The
    estimates attribute all of it to drag; the size of the force across the path is given by the disturbance prior.
    """
    effects = [float(np.nanmedian(values_of(table, phase_column("heave_effect", phase)))) for phase in PHASES]
    weight, deviation = weight_effects(table), default_prior(hull).deviation[HEAVE]
    shared = shared_drag(np.array(effects[:1]), np.array(effects[1:]), weight)
    # A change of lift shifts both phases alike, a force in a fixed direction shifts them apart.
    apart = sum(abs(effect) for effect in effects) / (weight[1] - weight[0])
    return float(abs(shared[0]) * deviation), apart * deviation


def weight_effects(table: pd.DataFrame) -> Interval:
    """Change of the equivalent K_D0 per newton of weight on dive and climb (kg/m/N), medians over the mission."""
    dive, climb = (values_of(table, phase_column("weight_effect", phase)) for phase in PHASES)
    return float(np.nanmedian(dive)), float(np.nanmedian(climb))


def shared_drag(dive: Array, climb: Array, weight: Interval) -> Array:
    """Weighted mean of the drag on dive and climb that does not depend on a change of weight.

    Parameters
    ----------
    dive, climb : array
        Equivalent changes of K_D0, kg/m.
    weight : (float, float)
        Changes of both per newton of weight, with opposite signs.
    """
    return np.asarray((weight[1] * dive - weight[0] * climb) / (weight[1] - weight[0]))


def error_by_coefficients(slopes: Sequence[CoefficientSlopes], weight: Interval) -> Interval:
    """Return the 95 % interval of the shared slope for drawn hulls less the nominal one; (0, 0) without draws."""
    dive, climb = (
        next(slope for slope in slopes if slope.quantity == DRAG and slope.phase == phase) for phase in PHASES
    )
    nominal = float(shared_drag(np.array([dive.nominal]), np.array([climb.nominal]), weight)[0])
    low, high = interval(shared_drag(dive.draws, climb.draws, weight) - nominal)
    return (low, high) if np.isfinite(low + high) else (0.0, 0.0)


def combine_errors(slope: float, sampling: Interval, coefficients: Interval, unresolved: float) -> Interval:
    """Combine the independent errors of a slope due to sampling, coefficients and unresolved changes into an interval.

    Parameters
    ----------
    slope : float
        The slope.
    sampling : (float, float)
        Interval due to sampling.
    coefficients : (float, float)
        Interval of the error due to the coefficients, about zero.
    unresolved : float
        Half width of the interval due to unresolved changes.
    """
    below = np.linalg.norm([slope - sampling[0], max(-coefficients[0], 0.0), unresolved])
    above = np.linalg.norm([sampling[1] - slope, max(coefficients[1], 0.0), unresolved])
    return float(slope - below), float(slope + above)


def _excludes_zero(ends: Interval) -> bool:
    return ends[0] > 0.0 or ends[1] < 0.0


def _days(growth: float, slope: float) -> float:
    return growth / slope if slope > 0.0 else float("inf")
