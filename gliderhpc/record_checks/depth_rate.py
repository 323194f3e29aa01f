"""Depth rates of steady glides with errors of the pitch sensor, hull and water, and the fit of these errors."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gliderhpc.estimation.least_squares import biweights, cluster_inflation, left_out_covariance, solve_normal_equations
from gliderhpc.estimation.self_motion import angle_of_attack
from gliderhpc.estimation.steady_segments import SteadySegments
from gliderhpc.flight.buoyancy import excess_weight
from gliderhpc.flight.hull_parameters import PARAMETERS, PARAMETERS_BY_DENSITY, with_values
from gliderhpc.flight.steady_glide import drag_and_lift
from gliderhpc.platform import CUBIC_CENTIMETRE, GRAVITY, Platform
from gliderhpc.record_checks.finding import UndeterminedError

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

OFFSET, SCALE, NEUTRAL_VOLUME = "offset of the pitch", "scale of the pitch", "buoyancy.neutral_volume"
SIDES, EXPONENT, LAYER = "difference of the drag between dives and climbs", "exponent of the drag", "surface layer"

_COEFFICIENTS = ("viscous.K_D0", "viscous.K_D", "viscous.K_L")
_WATER = ("buoyancy.depth_slope", "buoyancy.compressibility", "buoyancy.thermal_expansion")
_PARAMETERS = {p.key: p for p in (*PARAMETERS, *PARAMETERS_BY_DENSITY)}
_OF_GLIDE = frozenset({OFFSET, SCALE, SIDES, *_COEFFICIENTS})
_EXPONENT_ERROR = 0.3
"""Standard deviation of the exponent of the speed in drag over the squared speed; it is -0.5 for laminar flow."""
_LAYER_ERROR, _LAYER_DEPTH = 1.0, 75.0
"""Density (kg/m3) of a surface layer apart from a straight line over depth, and the depth (m) over which it decays."""
_STEP = 1e-3
"""Step of the finite differences, in the unknowns' sizes."""
_PASSES, _CONVERGED, _LONGEST, _HALVINGS = 30, 0.02, 3.0, 8
"""Number of Gauss-Newton steps, the step (in the unknowns' sizes) or its gain in the sum of squares that ends them, the
longest step, and how often a step that makes the fit worse is halved."""
_BLOCKS = 12
"""Parts of a mission, of consecutive profiles each, that are left out one by one, since errors may last for days."""
_NO_GLIDE = (
    "the hull cannot glide as most of these records show: calibrate the hull or, if it was calibrated on them, check "
    "the records of ballast, battery and pitch"
)
_NO_CONVERGENCE = (
    "the errors of pitch, hull and water that would explain these glides cannot be separated; more glides that differ "
    "more in steepness are needed"
)
_MIN_RESIDUAL = 1e-4
"""Minimum scale of the residuals of the depth rate (m/s), for the detection of outliers."""


@dataclass(frozen=True)
class Unknown:
    """One error that may have changed the depth rates.

    Attributes
    ----------
    name : str
        Name of the error, or key of a number in the platform file.
    size : float
        Unit of the fit, in the error's own unit or relative (coefficients); the prior standard deviation if `limited`.
    limited : bool
        Whether the error has a prior.
    """

    name: str
    size: float
    limited: bool = True


@dataclass(frozen=True, eq=False)
class DepthRateFit:
    """Errors that explain the depth rates best.

    Attributes
    ----------
    unknowns : tuple of Unknown
        Errors that were fitted.
    steps : (p,)
        Estimates in the unknowns' sizes.
    covariance : (p, p)
        Covariance of the estimates, in these sizes.
    blocks : int
        Number of parts of the mission from which the covariance was estimated.
    """

    unknowns: tuple[Unknown, ...]
    steps: Array
    covariance: Array
    blocks: int

    def value(self, name: str) -> float:
        """Estimate of an unknown in its own unit."""
        index = self._index(name)
        return float(self.steps[index] * self.unknowns[index].size)

    def error(self, name: str) -> float:
        """Standard error of an unknown in its own unit."""
        index = self._index(name)
        return math.sqrt(self.covariance[index, index]) * self.unknowns[index].size

    def size(self, name: str) -> float:
        """Unit of the fit of an unknown."""
        return self.unknowns[self._index(name)].size

    def implausible(self, limit: float) -> tuple[str, ...]:
        """Names of the unknowns whose estimates exceed `limit` prior standard deviations."""
        pairs = zip(self.unknowns, self.steps, strict=True)
        return tuple(unknown.name for unknown, step in pairs if unknown.limited and abs(step) > limit)

    def _index(self, name: str) -> int:
        return [unknown.name for unknown in self.unknowns].index(name)


def hull_unknowns(platform: Platform, coefficients: float, sides: float, *, by_density: bool) -> list[Unknown]:
    """List the errors of hull and water.

    Parameters
    ----------
    platform : Platform
        The hull.
    coefficients : float
        Relative error of drag, induced drag and lift.
    sides : float
        Relative error of the drag, of opposite sign in dives and in climbs.
    by_density : bool
        Whether the buoyancy follows measured density.
    """
    spreads = {p.key: p.spread(platform) for p in (PARAMETERS_BY_DENSITY if by_density else PARAMETERS)}
    unknowns = [
        Unknown(NEUTRAL_VOLUME, spreads[NEUTRAL_VOLUME], limited=False),
        *(Unknown(key, coefficients) for key in _COEFFICIENTS),
    ]
    unknowns += [Unknown(key, spreads[key]) for key in _WATER if key in spreads]
    unknowns += [Unknown(SIDES, sides), Unknown(EXPONENT, _EXPONENT_ERROR)]
    return unknowns if by_density else [*unknowns, Unknown(LAYER, _LAYER_ERROR)]


def fit_depth_rates(
    platform: Platform, segments: SteadySegments, unknowns: Sequence[Unknown], *, by_density: bool
) -> DepthRateFit:
    """Fit errors of sensor, hull and water to the depth rates of steady segments.

    The method is Gauss-Newton with Tukey's biweight and priors for the limited unknowns; if it does not converge, it is
    repeated with steps that are halved where they make the fit worse. The weights are reduced for the errors that all
    segments of a dive or climb have in common. The covariance comes from leaving out parts of the mission, and from the
    priors.

    Raises
    ------
    UndeterminedError
        The fit does not converge, or more than half of the segments have no steady glide near their pitch.
    """
    model = _Model(platform, segments, tuple(unknowns), by_density)
    # Far from the solution whole steps arrive sooner; where the errors are hardly separated they may go in circles.
    fit = _iterated(model, damped=False) or _iterated(model, damped=True)
    if fit is None:
        raise UndeterminedError(_NO_CONVERGENCE)
    return fit


@dataclass(frozen=True, eq=False)
class _Glide:
    """Path (rad) and drag over the squared speed (kg/m), neither of which depends on the weight."""

    path: Array
    drag: Array


@dataclass(frozen=True, eq=False)
class _Model:
    """Depth rates (n,) of segments as a function of steps (p,) in the unknowns' sizes."""

    platform: Platform
    segments: SteadySegments
    unknowns: tuple[Unknown, ...]
    by_density: bool

    def with_jacobian(self, steps: Array) -> tuple[Array, Array]:
        """Depth rates and their derivatives (n, p)."""
        glide = _glide_of(self.platform, self.segments, self._errors(steps))
        rates = self._rate(steps, glide)
        displaced = [
            self._rate(steps + move, None if unknown.name in _OF_GLIDE else glide)
            for unknown, move in zip(self.unknowns, _STEP * np.eye(len(steps)), strict=True)
        ]
        return rates, (np.column_stack(displaced) - rates[:, None]) / _STEP

    def shortened(self, steps: Array, change: Array, known: Mask, weights: Array, prior: Array) -> Array:
        """Return a change of the steps (p,), shortened until the segments known fit no worse than before."""
        change = change * min(1.0, _LONGEST / max(float(np.abs(change).max()), _LONGEST))

        def cost(at: Array) -> float:
            residuals = (self.segments.depth_rate - self._rate(at, None))[known]
            return float(np.sum(weights * residuals**2) + np.sum(prior * at**2))

        before = cost(steps)
        for _ in range(_HALVINGS):
            if cost(steps + change) <= before:
                break
            change = 0.5 * change
        return change

    def _rate(self, steps: Array, glide: _Glide | None) -> Array:
        errors = self._errors(steps)
        return steady_depth_rate(self.platform, self.segments, errors, glide, by_density=self.by_density)

    def _errors(self, steps: Array) -> dict[str, float]:
        return {unknown.name: float(step) * unknown.size for unknown, step in zip(self.unknowns, steps, strict=True)}


def _iterated(model: _Model, *, damped: bool) -> DepthRateFit | None:
    """Return the fit by Gauss-Newton steps, `damped` if those that make it worse are halved; None if it does not end.

    Raises
    ------
    UndeterminedError
        More than half of the segments have no steady glide near their pitch, also with damped steps.
    """
    segments, unknowns = model.segments, model.unknowns
    prior = np.array([float(unknown.limited) for unknown in unknowns])
    leg = 2 * segments.profile + (segments.depth_rate > 0.0)
    block = _blocks(segments.profile)
    steps = np.zeros(len(unknowns))
    for _ in range(_PASSES):
        predicted, jacobian = model.with_jacobian(steps)
        residuals = segments.depth_rate - predicted
        known = np.isfinite(residuals) & np.isfinite(jacobian).all(axis=1)
        if np.count_nonzero(known) < 0.5 * len(known):
            if damped:
                raise UndeterminedError(_NO_GLIDE)
            return None
        design, residual = jacobian[known], residuals[known]
        weights = biweights(residual, _MIN_RESIDUAL)
        weights /= cluster_inflation(np.sqrt(weights) * residual, leg[known])
        normal = design.T @ (weights[:, None] * design) + np.diag(prior)
        change = solve_normal_equations(normal, design.T @ (weights * residual) - prior * steps)
        limited = np.clip(change, -_LONGEST, _LONGEST)
        steps = steps + (model.shortened(steps, change, known, weights, prior) if damped else limited)
        if np.abs(change).max() < _CONVERGED or (damped and change @ normal @ change < _CONVERGED):
            covariance = left_out_covariance(design, weights, residual, block[known], prior)
            return DepthRateFit(tuple(unknowns), steps, covariance, len(np.unique(block[known])))
    return None


def steady_depth_rate(
    platform: Platform,
    segments: SteadySegments,
    errors: Mapping[str, float],
    glide: _Glide | None = None,
    *,
    by_density: bool,
) -> Array:
    """Steady depth rate (n,) (m/s) of a hull with errors, at the pitch corrected for the sensor's; NaN without a glide.

    Parameters
    ----------
    platform, segments : Platform, SteadySegments
        Hull without the errors, and measurements.
    errors : mapping of str to float
        Nonzero errors: offset (rad) and scale less one of the pitch, neutral volume (cm3) and other numbers of the
        platform file (logarithmic for coefficients), difference of the drag, its exponent, surface layer (kg/m3).
    glide : _Glide, optional
        Path and drag of glides with these errors, if they are known.
    by_density : bool
        Whether the buoyancy follows the segments' measured seawater.

    Notes
    -----
    The true pitch is ``(1 + scale) (read - offset)``. With the path ``xi = theta - alpha`` by eq. 15 and the net weight
    W, ``V0^2 = -W sin(xi) / (K_D0 + K_D alpha^2)``, and the depth rate is ``-V sin(xi)``. ``V = V0`` unless the drag
    over the squared speed is proportional to a power n of the speed: then ``V^(2 + n) = V0^2 V_r^n``, with the median
    speed V_r.
    """
    errors = _NO_ERRORS | dict(errors)
    glide = _glide_of(platform, segments, errors) if glide is None else glide
    hull = with_values(platform, _with_errors(platform, errors, (NEUTRAL_VOLUME, *_WATER)))
    weight = _net_weight(hull, segments, errors[LAYER], by_density=by_density)
    squared = -weight * np.sin(glide.path) / glide.drag
    speed = np.sqrt(np.where(squared > 0.0, squared, np.nan))
    if errors[EXPONENT] != 0.0 and np.isfinite(speed).any():
        usual = np.nanmedian(speed)
        speed = usual * (speed / usual) ** (2.0 / (2.0 + errors[EXPONENT]))
    return np.asarray(-speed * np.sin(glide.path))


_NO_ERRORS = dict.fromkeys((OFFSET, SCALE, SIDES, EXPONENT, LAYER), 0.0)


def _glide_of(platform: Platform, segments: SteadySegments, errors: Mapping[str, float]) -> _Glide:
    errors = _NO_ERRORS | dict(errors)
    hull = with_values(platform, _with_errors(platform, errors, _COEFFICIENTS))
    pitch = (1.0 + errors[SCALE]) * (segments.pitch - errors[OFFSET])
    diving = segments.depth_rate > 0.0
    path, drag = np.empty_like(pitch), np.empty_like(pitch)
    for phase, sign in ((diving, 1.0), (~diving, -1.0)):
        phase_hull = with_values(hull, {"viscous.K_D0": hull.viscous.K_D0 * math.exp(sign * errors[SIDES])})
        alpha = angle_of_attack(phase_hull, pitch[phase])
        path[phase], drag[phase] = pitch[phase] - alpha, drag_and_lift(phase_hull, alpha)[0]
    return _Glide(path, drag)


def _with_errors(platform: Platform, errors: Mapping[str, float], keys: Sequence[str]) -> dict[str, float | None]:
    """Numbers of the platform file with their errors added, by key."""
    numbers: dict[str, float | None] = {}
    for key in keys:
        error = errors.get(key, 0.0)
        if error != 0.0:
            parameter = _PARAMETERS[key]
            value = parameter.value(platform)
            numbers[key] = value * math.exp(error) if parameter.factor else value + error
    return numbers


def _net_weight(hull: Platform, segments: SteadySegments, layer: float, *, by_density: bool) -> Array:
    """Net weight (n,), N, positive heavy; `layer` is the excess density (kg/m3) at the surface over a straight line."""
    buoyancy, volume = hull.buoyancy, segments.actuators[:, 2]
    weight = -GRAVITY * buoyancy.water_density * (volume - buoyancy.neutral_volume * CUBIC_CENTIMETRE)
    weight = weight - buoyancy.depth_slope * segments.depth
    if by_density:
        return np.asarray(weight + excess_weight(hull, volume, segments.seawater))
    displaced = hull.mass.total / buoyancy.water_density
    return np.asarray(weight - GRAVITY * displaced * layer * np.exp(-segments.depth / _LAYER_DEPTH))


def _blocks(profile: NDArray[np.int64]) -> NDArray[np.int64]:
    """Number of the part of the mission that contains each segment."""
    numbers, index = np.unique(profile, return_inverse=True)
    return np.asarray(index * min(_BLOCKS, len(numbers)) // len(numbers))
