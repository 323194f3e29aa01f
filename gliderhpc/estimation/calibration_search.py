"""The fit of a hull's numbers, and the search for those that the glides do not determine."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from gliderhpc.estimation.identifiability import directions, jackknife_covariance
from gliderhpc.estimation.segment_errors import DIFFERENCE, SegmentErrors

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

FARTHEST = 4.0
"""Bound of every parameter, in its plausible deviations."""

FIRST_SCALES = (0.02, math.radians(2.0), math.radians(2.0), math.radians(0.2))
"""Errors that count as one before their own size is known: m/s, rad, rad, rad/s."""

LEAST_SCALES = (0.001, math.radians(0.03), math.radians(0.03), math.radians(0.003))
"""What sensors resolve over a segment; smaller scales are not believed."""

FLATNESS = math.radians(0.02)
"""Of the hull's flattest pitch (`SegmentErrors.flatness`), what counts as one error, rad."""

RESCALINGS = 4
"""Fits in turn with the scales of the errors that the one before left."""

_MAD = 1.4826
_LARGE = 3.0
_INVOLVED = 0.3
_UNMOVED = 1e-6
_AT_BOUND = 0.999 * FARTHEST


class Reason(Enum):
    """Why a parameter was held."""

    UNDETERMINED = "the glides do not determine it"
    IMPLAUSIBLE = "the fit ran to the bound of what is plausible"


@dataclass(frozen=True)
class Held:
    """A parameter that was held on the way.

    Attributes
    ----------
    index : int
        Which.
    reason : Reason
        Why.
    alike : tuple of int
        What else moves by more than `_INVOLVED` along the direction that is not determined.
    """

    index: int
    reason: Reason
    alike: tuple[int, ...] = ()


class CalibrationSearch:
    """Robust least squares over the free parameters, and which are free.

    Attributes
    ----------
    steps : (p,)
        The parameters, in plausible deviations from the platform's values.
    free : (p,) of bool
        Which are looked for.
    held : list of Held
        What was held on the way, in that order.
    scales : (4,)
        Size of an error that counts as one, SI.
    """

    def __init__(
        self, errors: SegmentErrors, free: Mask, weakest_allowed: float, report: Callable[[str], None]
    ) -> None:
        self._errors, self._weakest_allowed, self._report = errors, weakest_allowed, report
        self.free = free.copy()
        self.steps = np.zeros(len(free))
        self.scales = np.array(FIRST_SCALES)
        self.held: list[Held] = []

    def run(self) -> None:
        """Fit everything with its plausible deviation as a prior, hold what is not determined, fit the rest alone.

        Then hold, one by one, what ran to its bound, and what the profiles do not agree on to its plausible deviation.
        The scales are those of the errors that everything free leaves: what holding a parameter adds to the errors must
        not make them tell less of the others.
        """
        for _ in range(RESCALINGS):
            self._fit(prior=1.0)
            self._rescale()
        self._hold_the_undetermined()
        self._settle()
        while (doubtful := self._at_bound() or self._scattered()) is not None:
            self._hold(doubtful)
            self._settle()

    def scatter(self) -> Array:
        """Standard errors (p,) of what is free, in plausible deviations; NaN of what is held."""
        errors = np.full(len(self.free), np.nan)
        errors[self.free] = np.sqrt(np.diag(self.scatter_covariance()))
        return errors

    def scatter_covariance(self) -> Array:
        """Covariance (f, f) of what is free, by its scatter between profiles, in plausible deviations.

        That of the jackknife over profiles, which few profiles may make too small by chance, raised where the scales of
        the errors say more.
        """
        jacobian, residuals = self.weighted()
        jacobian = jacobian[:, self.free]
        between = jackknife_covariance(jacobian, residuals, self._errors.profile)
        within = np.linalg.pinv(jacobian.T @ jacobian, hermitian=True)
        known = np.maximum(np.diag(between), np.finfo(float).tiny)
        raised = np.sqrt(np.maximum(np.diag(within) / known, 1.0))
        return np.asarray(between * np.outer(raised, raised))

    def weighted(self) -> tuple[Array, Array]:
        """Jacobian (m, p) by all parameters, and errors (m,), over their scales and with the loss's weights."""
        weights = self._weights()
        jacobian = self._errors.jacobian(self.steps, range(len(self.steps)))
        return weights[:, None] * jacobian, weights * self._errors(self.steps)

    def weighted_offsets(self) -> Array:
        """`SegmentErrors.offsets` (m, 4) over the scales and with the loss's weights."""
        return np.asarray(self._weights()[:, None] * self._errors.offsets())

    def _weights(self) -> Array:
        scale = self._scale_of_each()
        return np.asarray((1.0 + (self._errors(self.steps) / scale) ** 2) ** -0.25 / scale)

    def _settle(self) -> None:
        self._fit(prior=0.0)
        while self._hold_the_undetermined():
            self._fit(prior=0.0)

    def _hold_the_undetermined(self) -> bool:
        """Hold until every direction is determined; whether anything was held."""
        before = len(self.held)
        while self.free.any():
            chosen = np.flatnonzero(self.free)
            weakest = directions(self.weighted()[0][:, chosen])[-1]
            if weakest.singular_value >= 1.0 / self._weakest_allowed:
                break
            parts = np.abs(weakest.vector)
            index = int(chosen[np.argmax(parts)])
            alike = tuple(int(i) for i in chosen[parts > _INVOLVED] if i != index)
            self._hold(Held(index, Reason.UNDETERMINED, alike))
        return len(self.held) > before

    def _at_bound(self) -> Held | None:
        beyond = np.flatnonzero(self.free & (np.abs(self.steps) > _AT_BOUND))
        return Held(int(beyond[0]), Reason.IMPLAUSIBLE) if len(beyond) else None

    def _scattered(self) -> Held | None:
        if not self.free.any():
            return None
        scatter = np.nan_to_num(self.scatter())
        worst = int(np.argmax(scatter))
        return Held(worst, Reason.UNDETERMINED) if scatter[worst] > 1.0 else None

    def _hold(self, held: Held) -> None:
        self.held.append(held)
        self._report(f"{self._errors.parameters[held.index].key} is held: {held.reason.value}")
        moved = abs(self.steps[held.index]) > _UNMOVED
        self.free[held.index], self.steps[held.index] = False, 0.0
        if moved:
            self._fit(prior=1.0)

    def _fit(self, prior: float) -> None:
        chosen = np.flatnonzero(self.free)
        if not len(chosen):
            return
        scale, unit = self._scale_of_each(), np.eye(len(chosen))

        def at(values: Array) -> Array:
            steps = self.steps.copy()
            steps[chosen] = values
            return steps

        def residuals(values: Array) -> Array:
            return np.concatenate([self._errors(at(values)) / scale, prior * values, barrier(values)])

        def barrier(values: Array) -> Array:
            return np.array([self._errors.flatness(at(values)) / FLATNESS])

        def barrier_slope(values: Array) -> Array:
            return np.array([(barrier(values + DIFFERENCE * row) - barrier(values)) / DIFFERENCE for row in unit]).T

        def jacobian(values: Array) -> Array:
            errors = self._errors.jacobian(at(values), chosen.tolist()) / scale[:, None]
            return np.vstack([errors, prior * unit, barrier_slope(values)])

        found = least_squares(
            residuals, self.steps[chosen], jac=jacobian, bounds=(-FARTHEST, FARTHEST), loss="soft_l1",
            xtol=1e-6, ftol=1e-8, gtol=1e-8, max_nfev=60,
        )  # fmt: skip
        self.steps = at(found.x)
        self._report(f"cost {found.cost:.1f} with {len(chosen)} free, {found.nfev} evaluations")

    def _scale_of_each(self) -> Array:
        return self.scales[self._errors.kind]

    def _rescale(self) -> None:
        errors = self._errors(self.steps)
        for kind in range(len(self.scales)):
            own = self._errors.kind == kind
            if own.any():
                self.scales[kind] = correlated_scale(errors[own], self._errors.leg[own], LEAST_SCALES[kind])


def correlated_scale(errors: Array, leg: NDArray[np.int64], least: float) -> float:
    """Scale by which errors (n,) count as independent ones of size one: their own, raised for what a leg has in common.

    Notes
    -----
    The robust deviation times ``sqrt(sum_legs (sum e)^2 / sum e^2)``, the factor by which the sum over a leg scatters
    more than that of independent errors would.
    """
    deviation = max(_MAD * float(np.median(np.abs(errors))), least)
    clipped = np.clip(errors, -_LARGE * deviation, _LARGE * deviation)
    _, place = np.unique(leg, return_inverse=True)
    inflation = float(np.sum(np.bincount(place, clipped) ** 2) / max(np.sum(clipped**2), least**2))
    return deviation * math.sqrt(max(inflation, 1.0))
