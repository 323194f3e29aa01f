"""The fit of a hull's parameters, and the search for those that the glides do not determine."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np
import scipy
from numpy.typing import NDArray

from gliderhpc.calibration.glides.segment_errors import DIFFERENCE, SegmentErrors
from gliderhpc.distributions import MAD_TO_STD
from gliderhpc.estimation.least_squares import directions, jackknife_covariance

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

PARAMETER_BOUND = 4.0
"""Bound of every parameter, in its plausible deviations."""

FIRST_SCALES = (0.02, math.radians(2.0), math.radians(2.0), math.radians(0.2))
"""Initial scales of the errors: m/s, rad, rad, rad/s."""

MIN_SCALES = (0.001, math.radians(0.03), math.radians(0.03), math.radians(0.003))
"""Resolution of the sensors over a segment; smaller scales are implausible."""

FLATNESS = math.radians(0.02)
"""Scale of the penalty on the hull's flattest pitch (`SegmentErrors.flatness`), rad."""

RESCALINGS, START_RESCALINGS = 4, 2
"""Numbers of fits in a search and from each starting point; each uses the scales of the previous fit's residuals."""

START_COUNT = 3
"""Starting points: the platform's own hull, and hulls drawn around it within `START_SPREAD` plausible deviations."""

START_SPREAD = 2.0

REFUTING_RISE = 0.25
"""Rise of the cost, relative to it, beyond which the platform's value is refuted. The errors of segments are too
dependent for a ratio of likelihoods, and for standard errors: on a simulated mission a lift five standard errors away
from the platform's lowered the cost by 0.006 of itself and made the currents wrong by 0.08 m/s. On two others, lift and
drag at the platform's values together raised it by 1.3 and 8.0, and a hull with one of them at that value was worse."""

REFUTING_RISE_OF_KIND = 4.0
"""The same for one kind of errors. On a simulated mission in yaw impulses, rates of turn were nine tenths of the cost:
a hull that misses the depth rate by 25 cm/s raised the sum by less than a quarter, but the cost of depth rate or pitch
by 8 to 14 times. In disturbed water these costs double or triple with values that are right."""

MIN_REFUTING_RISE = 4.5
"""Rise of the cost below which no value is refuted: that of a residual of three deviations."""

COARSE_TOLERANCE, DEFAULT_TOLERANCE, FINE_TOLERANCE = 1e-4, 1e-6, 1e-8
"""Relative change of the cost at which a fit ends: from a starting point, during the search, and in the final fit."""

_LARGE_RESIDUAL = 3.0
_MIN_COMPONENT = 0.3
_STAGE = 0.5
_NEAR = 0.2
_AT_BOUND = 0.999 * PARAMETER_BOUND
_SEED = 0


class CalibrationVerdict(Enum):
    """Outcome of a parameter's fit: estimated, or the reason why it was held and the value at which it was held."""

    ESTIMATED = "estimated"
    ASKED = "held as requested"
    UNDETERMINED = "held: the glides do not determine it"
    REFUTED = "held at the most probable value: the glides refute the platform's value but do not determine another"
    IMPLAUSIBLE = "held at the bound: the fit reached the limit of plausible values"
    UNSTABLE = "held: if it is free, the hull has no stable glide"
    TOO_STEEP = "held: if the lateral terms are free, the hull found cannot glide as flat as the glider did"
    GLIDE_MISSED = "held: if the lateral terms are free, the fit misses the depth rate or the pitch"
    IMPLAUSIBLE_TURNS = "held: if the lateral terms are free, one of them is far from the platform's value"
    CONFOUNDED = "held: if it is free, other parameters are known less well than the platform file states"


@dataclass(frozen=True)
class HeldParameter:
    """A parameter that was held during the search.

    Attributes
    ----------
    index : int
        Index of the parameter.
    verdict : CalibrationVerdict
        Reason, and value at which it was held.
    confounded_with : tuple of int
        Other parameters that move by more than `_MIN_COMPONENT` along the undetermined direction.
    """

    index: int
    verdict: CalibrationVerdict
    confounded_with: tuple[int, ...] = ()


class CalibrationSearch:
    """Robust least squares over the free parameters, and the choice of the free ones.

    Attributes
    ----------
    steps : (p,)
        Parameters, in plausible deviations from the platform's values.
    free : (p,) of bool
        Mask of the free parameters.
    held : list of HeldParameter
        Parameters held during the search, in that order.
    scales : (4,)
        Scales of the errors, SI.
    """

    def __init__(
        self, errors: SegmentErrors, free: Mask, weakest_allowed: float, report: Callable[[str], None]
    ) -> None:
        self._errors, self._weakest_allowed, self._report = errors, weakest_allowed, report
        self.free = free.copy()
        self.steps = np.zeros(len(free))
        self.scales = np.array(FIRST_SCALES)
        self.held: list[HeldParameter] = []

    def run(self, steps: Array) -> None:
        """Fit all parameters with a prior, hold the undetermined ones, and fit the rest without the prior.

        The prior is the plausible deviation of each parameter. Then parameters are held one by one if they ran to their
        bound, or if they scatter between profiles by more than their plausible deviation. The scales are recomputed
        from the residuals of each fit.

        Parameters
        ----------
        steps : (p,)
            Starting point, from `best_start`.
        """
        self.steps = np.where(self.free, steps, 0.0)
        self.fit_everything(RESCALINGS, DEFAULT_TOLERANCE)
        self._hold_undetermined()
        self._fit_determined()
        while (doubtful := self._at_bound() or self._find_scattered()) is not None:
            self._hold(doubtful)
            self._fit_determined()
        self._fit(prior=0.0, tolerance=FINE_TOLERANCE)

    def fit_everything(self, times: int, tolerance: float) -> None:
        """Repeat the fit of the free parameters, with plausible deviations as a prior, and the update of the scales."""
        for _ in range(times):
            self._fit(prior=1.0, tolerance=tolerance)
            self._rescale()

    def misfit(self) -> float:
        """Negative log-likelihood of errors of unknown scales (Laplace's, robust), plus that of the prior."""
        errors = np.abs(self._errors(self.steps))
        sizes = [(rows.sum(), max(float(errors[rows].mean()), least)) for rows, least in self._kinds() if rows.any()]
        return float(sum(count * math.log(size) for count, size in sizes) + _robust_costs(self.steps).sum())

    def cost_of(self, steps: Array) -> float:
        """Robust cost of some steps (p,), without a prior, with the present scales."""
        return float(_robust_costs(self._errors(steps) / self._scale_of_each()).sum())

    def scatter(self) -> Array:
        """Standard errors (p,) of the free parameters, in plausible deviations; NaN for held ones."""
        errors = np.full(len(self.free), np.nan)
        errors[self.free] = np.sqrt(np.diag(self.scatter_covariance()))
        return errors

    def scatter_covariance(self) -> Array:
        """Covariance (f, f) of the free parameters from their scatter between profiles, in plausible deviations.

        This is the jackknife covariance over profiles. With few profiles it may be too small by chance, and so it is
        raised where the scales of the errors imply a larger variance.
        """
        jacobian, residuals = self.weighted()
        jacobian = jacobian[:, self.free]
        between = jackknife_covariance(jacobian, residuals, self._errors.profile)
        within = np.linalg.pinv(jacobian.T @ jacobian, hermitian=True)
        variance = np.maximum(np.diag(between), np.finfo(float).tiny)
        factor = np.sqrt(np.maximum(np.diag(within) / variance, 1.0))
        return np.asarray(between * np.outer(factor, factor))

    def weighted(self) -> tuple[Array, Array]:
        """Jacobian (m, p) in all parameters, and errors (m,), divided by the scales and weighted by the robust loss."""
        weights = self._weights()
        jacobian = self._errors.jacobian(self.steps, range(len(self.steps)))
        return weights[:, None] * jacobian, weights * self._errors(self.steps)

    def weighted_offsets(self) -> Array:
        """`SegmentErrors.offsets` (m, 4), divided by the scales and weighted by the robust loss."""
        return np.asarray(self._weights()[:, None] * self._errors.offsets())

    def weighted_unfitted(self) -> Array:
        """`SegmentErrors.by_unfitted` (m, r), divided by the scales and weighted by the robust loss."""
        return np.asarray(self._weights()[:, None] * self._errors.by_unfitted(self.steps))

    def _weights(self) -> Array:
        scale = self._scale_of_each()
        return np.asarray((1.0 + (self._errors(self.steps) / scale) ** 2) ** -0.25 / scale)

    def _fit_determined(self) -> None:
        self._fit(prior=0.0)
        self._rescale()
        while self._hold_undetermined():
            self._fit(prior=0.0)
            self._rescale()

    def _hold_undetermined(self) -> bool:
        """Hold parameters until every direction is determined, and return whether any was held."""
        before = len(self.held)
        while self.free.any():
            chosen = np.flatnonzero(self.free)
            weakest = directions(self.weighted()[0][:, chosen])[-1]
            if weakest.singular_value >= 1.0 / self._weakest_allowed:
                break
            parts = np.abs(weakest.vector)
            index = int(chosen[np.argmax(parts)])
            confounded_with = tuple(int(i) for i in chosen[parts > _MIN_COMPONENT] if i != index)
            self._hold(HeldParameter(index, CalibrationVerdict.UNDETERMINED, confounded_with))
        return len(self.held) > before

    def _at_bound(self) -> HeldParameter | None:
        beyond = np.flatnonzero(self.free & (np.abs(self.steps) > _AT_BOUND))
        return HeldParameter(int(beyond[0]), CalibrationVerdict.UNDETERMINED) if len(beyond) else None

    def _find_scattered(self) -> HeldParameter | None:
        if not self.free.any():
            return None
        scatter = np.nan_to_num(self.scatter())
        worst = int(np.argmax(scatter))
        return HeldParameter(worst, CalibrationVerdict.UNDETERMINED) if scatter[worst] > 1.0 else None

    def _hold(self, held: HeldParameter) -> None:
        """Hold a parameter at the platform's value unless the glides refute that value (`_is_refuted`).

        If they do, the parameter is held at its most probable value, or at the bound if that is beyond it. The
        platform's value would enlarge the errors, and the glides would then determine less of all other parameters.
        """
        if self._is_refuted(held.index, [index for index in held.confounded_with if self.free[index]]):
            held, value = replace(held, verdict=CalibrationVerdict.REFUTED), float(self.steps[held.index])
            if abs(value) > _AT_BOUND:
                held = replace(held, verdict=CalibrationVerdict.IMPLAUSIBLE)
                self.steps[held.index] = math.copysign(PARAMETER_BOUND, value)
        self.free[held.index] = False
        self._fit(prior=1.0)
        self.held.append(held)
        self._report(f"{self._errors.parameters[held.index].key} is {held.verdict.value}")

    def _is_refuted(self, index: int, confounded_with: Sequence[int]) -> bool:
        """Fit with the prior, and return whether the glides refute the platform's value of a free parameter.

        They refute it if that value increases the cost of the fit, prior included, by `REFUTING_RISE`, or the cost of
        one kind of errors by `REFUTING_RISE_OF_KIND`. The value is tried with the other parameters free, and with those
        that the glides do not separate from it at the platform's values: left free, these could compensate for it by
        implausible values. Standard errors are no criterion, because the most probable value can be many of them away
        although the cost hardly depends on it. A most probable value near the platform's does not refute it. The steps
        afterwards are the most probable ones, or those with the platform's value.
        """
        self._fit(prior=1.0)
        if abs(self.steps[index]) < _NEAR:
            self.steps[index] = 0.0
            return False
        probable = self.steps.copy()
        held_as_well: list[Sequence[int]] = [confounded_with, []] if confounded_with else [[]]
        refuted = any(self._cost_rises(probable, index, others) for others in held_as_well)
        if refuted:
            self.steps = probable
        return refuted

    def _cost_rises(self, probable: Array, index: int, others: Sequence[int]) -> bool:
        """Return whether the cost rises by too much with the platform's value, and `others` held there as well."""
        free, self.steps = self.free.copy(), probable.copy()
        before = self._costs_at_platform(others)
        rise = self._costs_at_platform([*others, index]) - before
        self.free = free
        in_total = rise[-1] > max(REFUTING_RISE * before[-1], MIN_REFUTING_RISE)
        in_kind = rise[:-1] > REFUTING_RISE_OF_KIND * (before[:-1] + MIN_REFUTING_RISE)
        return bool(in_total or in_kind.any())

    def _costs_at_platform(self, indices: Sequence[int]) -> Array:
        """Hold some parameters at the platform's values, fit the others with the prior, and return the costs.

        They approach these values in several fits, because in a single one the others can end in a false minimum. The
        costs are those of each kind of errors, followed by the one that the fit minimises.
        """
        start = self.steps[indices]
        self.free[indices] = False
        for remaining in np.linspace(1.0, 0.0, math.ceil(np.abs(start).max(initial=0.0) / _STAGE) + 1)[1:]:
            self.steps[indices] = remaining * start
            self._fit(prior=1.0)
        costs = _robust_costs(self._errors(self.steps) / self._scale_of_each())
        flatness = self._errors.flatness(self.steps) / FLATNESS
        penalties = _robust_costs(np.append(self.steps, flatness))
        return np.array([*(costs[rows].sum() for rows, _ in self._kinds()), costs.sum() + penalties.sum()])

    def _fit(self, prior: float, tolerance: float = DEFAULT_TOLERANCE) -> None:
        """Fit the free parameters, separately for each part of the errors (`SegmentErrors.parts`)."""
        for rows, columns in self._errors.parts():
            chosen = np.flatnonzero(self.free & columns)
            if len(chosen):
                self._fit_part(rows, chosen, prior, tolerance)

    def _fit_part(self, rows: Mask, chosen: NDArray[np.intp], prior: float, tolerance: float) -> None:
        scale, unit = self._scale_of_each()[rows], np.eye(len(chosen))

        def at(values: Array) -> Array:
            steps = self.steps.copy()
            steps[chosen] = values
            return steps

        def residuals(values: Array) -> Array:
            return np.concatenate([self._errors(at(values))[rows] / scale, prior * values, barrier(values)])

        def barrier(values: Array) -> Array:
            return np.array([self._errors.flatness(at(values)) / FLATNESS])

        def barrier_slope(values: Array) -> Array:
            value = barrier(values)
            return np.array([(barrier(values + DIFFERENCE * row) - value) / DIFFERENCE for row in unit]).T

        def jacobian(values: Array) -> Array:
            errors = self._errors.jacobian(at(values), chosen.tolist())[rows] / scale[:, None]
            return np.vstack([errors, prior * unit, barrier_slope(values)])

        result = scipy.optimize.least_squares(
            residuals,
            self.steps[chosen],
            jac=jacobian,
            bounds=(-PARAMETER_BOUND, PARAMETER_BOUND),
            loss="soft_l1",
            xtol=100.0 * tolerance,
            ftol=tolerance,
            gtol=tolerance,
            max_nfev=60,
        )
        self.steps = at(result.x)
        self._report(f"cost {result.cost:.1f} with {len(chosen)} free parameters, {result.nfev} evaluations")

    def _scale_of_each(self) -> Array:
        return self.scales[self._errors.kind]

    def _rescale(self) -> None:
        errors = self._errors(self.steps)
        for kind, (rows, least) in enumerate(self._kinds()):
            if rows.any():
                self.scales[kind] = correlated_scale(errors[rows], self._errors.leg[rows], least)

    def _kinds(self) -> list[tuple[Mask, float]]:
        """Mask (m,) of the errors of each kind, with their smallest plausible scale."""
        return [(self._errors.kind == kind, least) for kind, least in enumerate(MIN_SCALES)]


def _robust_costs(normalised: Array) -> Array:
    """Costs of errors over their scales, under the robust loss of the fit."""
    return np.asarray(np.sqrt(1.0 + normalised**2) - 1.0)


def best_start(errors: SegmentErrors, free: Mask, report: Callable[[str], None]) -> Array:
    """Steps (p,) of the best fit, with the plausible deviations as a prior, from several starting points.

    The first one is the platform's hull. If the platform is far from the hull flown, a ridge of the cost may separate
    the two.

    Parameters
    ----------
    errors : SegmentErrors
        Errors over some segments; a few hundred suffice to find a starting point.
    free : (p,) of bool
        Mask of the free parameters.
    report : callable
        Called with a line of text for every start.
    """
    rng = np.random.default_rng(_SEED)
    results = []
    for number in range(START_COUNT):
        search = CalibrationSearch(errors, free, 1.0, lambda _: None)
        drawn = np.clip(rng.standard_normal(len(free)), -START_SPREAD, START_SPREAD)
        search.steps = np.where(free, drawn, 0.0) if number else np.zeros(len(free))
        search.fit_everything(START_RESCALINGS, COARSE_TOLERANCE)
        results.append((search.misfit(), search.steps))
        report(f"start {number + 1} of {START_COUNT}: misfit {results[-1][0]:.1f}")
    return min(results, key=lambda result: result[0])[1]


def correlated_scale(errors: Array, leg: NDArray[np.int64], least: float) -> float:
    """Scale of errors (n,): their own robust deviation, raised for the correlation within a leg; at least `least`.

    Notes
    -----
    The scale is the robust deviation times ``sqrt(sum_legs (sum e)^2 / sum e^2)``. This factor is the scatter of sums
    over a leg relative to that of independent errors.
    """
    deviation = max(MAD_TO_STD * float(np.median(np.abs(errors))), least)
    clipped = np.clip(errors, -_LARGE_RESIDUAL * deviation, _LARGE_RESIDUAL * deviation)
    _, group = np.unique(leg, return_inverse=True)
    inflation = float(np.sum(np.bincount(group, clipped) ** 2) / max(np.sum(clipped**2), least**2))
    return deviation * math.sqrt(max(inflation, 1.0))
