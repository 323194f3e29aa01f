"""The uncertainty of a depth-averaged current: one error budget for the archive's table, both estimates and the study.

The current is the drift between fixes less the displacement through the water, divided by the time. Its errors are
those of the displacement (speed along the track, course across it, parts bridged while actuators moved) and those of
the positions between which the water carried the glider. They depend on the speed through the water rather than on the
current.

A platform's own budget, in the same form, is fitted to the errors of many twins by maximum likelihood, which gives the
ellipses their nominal coverage. It is written to and read from ``budget.yaml``.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
import scipy
import yaml
from numpy.typing import NDArray
from pydantic import Field, ValidationError

from gliderhpc.errors import InputError
from gliderhpc.estimation.settings import Settings
from gliderhpc.platform import Platform
from gliderhpc.yaml_text import parse_yaml, read_yaml_text

Array = NDArray[np.float64]


class _CommonErrors(Settings):
    """Terms that do not depend on the hull."""

    cross_track_error: float = Field(
        0.0,
        ge=0,
        description="velocity error across the track in addition to that of the course, m/s; none in the paper",
    )
    actuation_error: float = Field(
        0.2, ge=0, description="relative error of the displacement bridged while actuators move"
    )
    fix_error: float = Field(5.0, ge=0, description="error of a GPS fix, north and east each, m")
    surface_shear: float = Field(
        0.2, ge=0, description="difference between the drift at the surface and the current below, m/s"
    )


class CurrentErrors(_CommonErrors):
    """Terms of a depth-averaged current's uncertainty. The defaults are the paper's (section 5.5)."""

    axial_error: float = Field(0.055, ge=0, description="velocity error of the weakly observed axial motion, m/s")
    relative_error: float = Field(0.26, ge=0, description="relative error of the current's magnitude")
    heading_error: float = Field(8.0, ge=0, description="error of the course through the water, degree")


CALIBRATED = {"axial_error": 0.017, "relative_error": 0.0, "heading_error": 2.5}
"""Terms for a calibrated hull, measured on twins (docs/current-ellipses.md)."""


PUBLISHED_TERMS = ("axial_error", "relative_error", "heading_error")
"""Names of the terms of section 5.5."""


class CurrentSettings(_CommonErrors):
    """Terms of the current's uncertainty, and of the drift at the surface. Unset terms depend on the hull."""

    budget: Literal["hull", "published"] | None = Field(
        None, description="errors of the displacement: from the smoother and the hull's errors, or from the "
        "paper's terms; default hull, or published if one of these terms is given",
    )  # fmt: skip
    axial_error: float | None = Field(
        None,
        ge=0,
        description="velocity error of the weakly observed axial motion, m/s; default 0.017 with a "
        "calibrated hull, else 0.055",
    )
    relative_error: float | None = Field(
        None, ge=0, description="relative error of the current's magnitude; default 0 with a calibrated hull, else 0.26"
    )
    heading_error: float | None = Field(
        None,
        ge=0,
        description="error of the course through the water, degree; default 2.5 with a calibrated hull, else 8",
    )

    @property
    def by_hull(self) -> bool:
        """Return whether the errors of a displacement come from the smoother and the hull's errors."""
        if self.budget is None:
            return all(getattr(self, name) is None for name in PUBLISHED_TERMS)
        return self.budget == "hull"

    def errors(self, platform: Platform) -> CurrentErrors:
        """Terms for a hull: those given, else those for calibrated hulls if it is one, else the paper's."""
        defaults = {} if platform.calibration is None else CALIBRATED
        chosen = {name: value for name, value in self.model_dump(exclude={"budget"}).items() if value is not None}
        return CurrentErrors(**(defaults | chosen))


@dataclass(frozen=True, eq=False)
class CurrentUncertainty:
    """Terms of a depth-averaged current's uncertainty, m/s, and their sum.

    Attributes
    ----------
    axial, cross_track, magnitude, heading, fixes, actuation : float
        Standard deviations: along and across the track, along the current, across the track from the course, and (in
        each direction) from the fixes with the drift at the surface and from the displacement bridged while the
        actuators moved. The difference of the estimates and the smoother's own uncertainty are in the covariance only.
    covariance : (2, 2)
        Covariance of the north and east components, m2/s2.
    """

    axial: float
    cross_track: float
    magnitude: float
    heading: float
    fixes: float
    actuation: float
    covariance: Array

    @property
    def axes(self) -> tuple[float, float]:
        """Semi-axes of the 1-sigma ellipse, m/s, the longer first."""
        smaller, larger = np.sqrt(np.maximum(np.linalg.eigvalsh(self.covariance), 0.0))
        return float(larger), float(smaller)

    @property
    def orientation(self) -> float:
        """Direction of the longer axis, degrees clockwise from north, in [0, 180)."""
        north, east = np.linalg.eigh(self.covariance)[1][:, 1]
        return float(np.degrees(np.arctan2(east, north)) % 180.0)

    @property
    def area(self) -> float:
        """Area of the 1-sigma ellipse, m2/s2."""
        return float(np.pi * np.sqrt(max(np.linalg.det(self.covariance), 0.0)))


@dataclass(frozen=True, eq=False)
class Drift:
    """Quantities from which a current and its uncertainty follow.

    Attributes
    ----------
    velocity : (2,)
        Current, north and east, m/s.
    track : (2,)
        Displacement through the water, north and east, m.
    elapsed : float
        Time over which the current acted, s.
    position_variance : float
        Sum of the variances of the positions where the current begins and ceases to act, north and east each, m2.
    bridged : float
        Length of the displacement that was interpolated over the actuation intervals, m; zero for the smoother, whose
        covariance contains the noise there.
    track_covariance : (2, 2)
        Covariance of the displacement from the smoother, m2; zero for an adjoint without one.
    with_hull : bool
        Whether the track's covariance contains the hull's errors, which makes the terms for them zero.
    disagreement : (2,)
        Difference between the currents of two estimates, m/s; zero if there is only one. If the windows start from the
        smoothed path, the current of the filter replaces that of the adjoint.
    departure : (2,)
        Difference from the smoother's current, m/s, of an adjoint whose track has the smoother's covariance.
    """

    velocity: Array
    track: Array
    elapsed: float
    position_variance: float
    bridged: float
    track_covariance: Array
    disagreement: Array = field(default_factory=lambda: np.zeros(2))
    with_hull: bool = False
    departure: Array = field(default_factory=lambda: np.zeros(2))


def current_uncertainty(drift: Drift, errors: CurrentErrors) -> CurrentUncertainty:
    """Combine the terms of a current's uncertainty.

    Notes
    -----
    With the unit vectors t along the track and v along the current, c across the track, U the mean speed through the
    water and T the time::

        C = axial^2 t t' + ((heading U)^2 + cross_track^2) c c' + (relative |V|)^2 v v'
            + (position_variance / T^2 + (actuation bridged / T)^2) I + track_covariance / T^2 + d d' / 2 + a a'

    The terms axial, heading, cross_track and relative represent errors of the hull and the compass. They are zero if
    the track's covariance contains these errors (`Drift.with_hull`). Adjoint and smoother have the same hull, sensors
    and fixes. If they differ by d, at least one of them has an error that no other term contains, and the variance of
    the difference is divided between them. If the windows start from the smoothed path, the filter's current replaces
    the adjoint's in d. With the hull's errors the adjoint has the smoother's covariance, and the whole of its own
    difference a from the smoother is added to its error.
    """
    if drift.with_hull:
        errors = errors.model_copy(update=dict.fromkeys(TERMS, 0.0))
    speed_through_water = float(np.linalg.norm(drift.track)) / drift.elapsed
    along, towards = _unit(drift.track), _unit(drift.velocity)
    across = np.array([-along[1], along[0]])
    magnitude = errors.relative_error * float(np.linalg.norm(drift.velocity))
    heading = float(np.radians(errors.heading_error)) * speed_through_water
    fixes = float(np.sqrt(drift.position_variance)) / drift.elapsed
    actuation = errors.actuation_error * drift.bridged / drift.elapsed
    covariance = (
        errors.axial_error**2 * np.outer(along, along)
        + (heading**2 + errors.cross_track_error**2) * np.outer(across, across)
        + magnitude**2 * np.outer(towards, towards)
        + (fixes**2 + actuation**2) * np.eye(2)
        + drift.track_covariance / drift.elapsed**2
        + 0.5 * np.outer(drift.disagreement, drift.disagreement)
        + np.outer(drift.departure, drift.departure)
    )
    return CurrentUncertainty(
        errors.axial_error, errors.cross_track_error, magnitude, heading, fixes, actuation, np.asarray(covariance)
    )


def _unit(vector: Array) -> Array:
    length = float(np.linalg.norm(vector))
    return vector / length if length > 0.0 else np.zeros(2)


TERMS = (*PUBLISHED_TERMS, "cross_track_error")
"""Names of the terms that can be fitted."""

_START = {"axial_error": 0.01, "relative_error": 0.05, "heading_error": 3.0, "cross_track_error": 0.01}

_LIMITS = (-12.0, 5.0)
"""Bounds of the terms' logarithms."""

_MIN_VARIANCE = 1e-12
"""Variance added to covariances to prevent singular ones, m2/s2."""

MIN_TWINS = 3
"""Smallest number of twins to which a budget can be fitted."""


class Budget(Settings):
    """Error budget of a hull by ``twin recoverability`` and ``twin currents``, for ``analyze currents --budget``."""

    platform: str = Field(min_length=1, description="hull to which the budget belongs")
    axial_error: float = Field(ge=0, description="velocity error of the weakly observed axial motion, m/s")
    relative_error: float = Field(ge=0, description="relative error of the current's magnitude")
    heading_error: float = Field(ge=0, description="error of the course through the water, degree")
    cross_track_error: float = Field(0.0, ge=0, description="velocity error across the track, m/s")
    identification_noise: float = Field(gt=0, description="high-passed yaw moment due to noise alone, RMS, N m")
    detection_floor: float | None = Field(
        gt=0, description="amplitude of a yaw impulse found nine times in ten, N m; null if none of the grid is"
    )
    axial_offset_dive: float = Field(description="mean error of B_cu on the dive, N")
    axial_offset_climb: float = Field(description="mean error of B_cu on the climb, N")
    axial_offset_rms: float = Field(ge=0, description="root mean square of the mean error of B_cu, N")
    exact_axial_error: float = Field(ge=0, description="axial_error if the coefficients were exact, m/s")
    how: dict[str, str] = Field(default_factory=dict, description="origin of each figure")

    @property
    def current(self) -> CurrentErrors:
        """Terms of the current's covariance."""
        return CurrentErrors(**{name: getattr(self, name) for name in TERMS})


@dataclass(frozen=True)
class CurrentError:
    """Depth-averaged current of one twin: truth and error (m/s, north and east), displacement (m) and duration (s).

    `known` is the variance in each direction of errors from other sources than the terms (m2/s2), such as the fixes.
    """

    truth: tuple[float, float]
    error: tuple[float, float]
    track: tuple[float, float]
    duration: float
    known: float = 0.0


@dataclass(frozen=True)
class FittedBudget:
    """Maximum-likelihood terms, and the median squared Mahalanobis distance of the errors under them.

    For an exact budget and normal errors, the median in two dimensions is 1.386.
    """

    settings: CurrentErrors
    median_distance: float


def fit_budget(errors: Sequence[CurrentError], names: Sequence[str] = PUBLISHED_TERMS) -> FittedBudget:
    """Fit terms (of `TERMS`, those left out are zero) to the errors of twins by maximum likelihood.

    Raises
    ------
    InputError
        Fewer than three twins.
    """
    if len(errors) < MIN_TWINS:
        raise InputError(f"a budget needs at least {MIN_TWINS} twins, not {len(errors)}; give more `seeds`")

    shapes, deviations = _shapes(errors, names), np.array([error.error for error in errors])
    known = np.array([error.known for error in errors])

    def minus_log_likelihood(x: Array) -> float:
        covariance = _covariances(shapes, known, x)
        return 0.5 * float((np.linalg.slogdet(covariance)[1] + _distances(covariance, deviations)).sum())

    start: Array = np.log(np.array([_START[name] for name in names]))
    result: Any = scipy.optimize.minimize(
        minus_log_likelihood, start, method="Nelder-Mead", options={"fatol": 1e-4, "xatol": 1e-3}
    )
    median = float(np.median(_distances(_covariances(shapes, known, result.x), deviations)))
    return FittedBudget(_settings(np.exp(np.clip(result.x, *_LIMITS)).tolist(), names), median)


def budget_text(budget: Budget, study: str = "recoverability") -> str:
    """Format a budget as YAML, figures to four digits, with the name of the twin study that made it."""
    content = {
        name: float(f"{value:.4g}") if isinstance(value, float) else value
        for name, value in budget.model_dump().items()
    }
    head = f"# Made by `gliderhpc twin {study}`; `gliderhpc analyze ARCHIVE currents --budget` takes it.\n"
    return head + yaml.safe_dump(content, sort_keys=False, width=110, allow_unicode=True)


def read_budget(path: str | Path) -> Budget:
    """Read and validate a budget.

    Raises
    ------
    InputError
        The file does not exist or is not YAML, or a key is missing, unknown or out of range.
    """
    content = parse_yaml(read_yaml_text(Path(path), "budget"), str(path))
    try:
        return Budget.model_validate(content)
    except ValidationError as error:
        fault = error.errors(include_url=False)[0]
        key = ".".join(str(part) for part in fault["loc"]) or "the budget"
        raise InputError(f"{path}: {key}: {fault['msg'].lower()}") from None


def _settings(values: Sequence[float], names: Sequence[str]) -> CurrentErrors:
    return CurrentErrors(**{**dict.fromkeys(TERMS, 0.0), **dict(zip(names, values, strict=True))})


def _shapes(errors: Sequence[CurrentError], names: Sequence[str]) -> Array:
    """Covariances ``(n, terms, 2, 2)`` of unit terms; the total covariance is their sum times the squared terms."""
    return np.array(
        [
            [current_uncertainty(_drift(error), _settings([1.0], [name])).covariance for name in names]
            for error in errors
        ]
    )


def _drift(error: CurrentError) -> Drift:
    """Drift of a twin in which only the terms are uncertain."""
    return Drift(np.array(error.truth), np.array(error.track), error.duration, 0.0, 0.0, np.zeros((2, 2)))


def _covariances(shapes: Array, known: Array, x: Array) -> Array:
    """Covariances ``(n, 2, 2)`` for terms with logarithms x."""
    terms = np.exp(2.0 * np.clip(x, *_LIMITS))
    return np.asarray(np.einsum("k,nkij->nij", terms, shapes) + (known + _MIN_VARIANCE)[:, None, None] * np.eye(2))


def _distances(covariance: Array, deviations: Array) -> Array:
    """Squared Mahalanobis distances ``(n,)``."""
    return np.asarray(np.einsum("ni,ni->n", deviations, np.linalg.solve(covariance, deviations[..., None])[..., 0]))
