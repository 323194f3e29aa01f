"""The current's uncertainty budget for one platform: fitted to twins, written to and read from ``budget.yaml``.

The budget is the covariance of `gliderhpc.estimation.current_errors.current_uncertainty`: an axial error along the
track, an error of the course across it, and one relative to the current's magnitude. Fitting that very form to the
errors of many twins by maximum likelihood, rather than naming three figures one by one, makes the ellipses cover what
they should.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import scipy
import yaml
from numpy.typing import NDArray
from pydantic import Field, ValidationError

from gliderhpc.errors import InputError
from gliderhpc.estimation.current_errors import CurrentErrors, Drift, current_uncertainty
from gliderhpc.estimation.settings import Settings
from gliderhpc.yaml_text import parse_yaml, read_yaml_text

Array = NDArray[np.float64]

PUBLISHED_TERMS = ("axial_error", "relative_error", "heading_error")
"""Those of section 5.5."""

TERMS = (*PUBLISHED_TERMS, "cross_track_error")
"""Those that can be fitted."""

_BEGIN = {"axial_error": 0.01, "relative_error": 0.05, "heading_error": 3.0, "cross_track_error": 0.01}

_LIMITS = (-12.0, 5.0)
"""Standard deviation of the terms' logarithms."""

_MIN_VARIANCE = 1e-12
"""Keeps covariances from becoming singular, m2/s2."""

MIN_TWINS = 3
"""That a budget can be fitted to."""

CHI_SQUARE_MEDIAN = 1.386
"""Median of the squared Mahalanobis distance in two dimensions, were the budget exact and the errors normal."""


class Budget(Settings):
    """Error budget of a hull by ``twin recoverability`` and ``twin currents``, for ``analyze currents --budget``."""

    platform: str = Field(min_length=1, description="the hull it belongs to")
    axial_error: float = Field(ge=0, description="velocity error of the weakly observed axial motion, m/s")
    relative_error: float = Field(ge=0, description="relative error of the current's magnitude")
    heading_error: float = Field(ge=0, description="error of the course through the water, degree")
    cross_track_error: float = Field(0.0, ge=0, description="velocity error across the track, m/s")
    identification_noise: float = Field(gt=0, description="high-passed yaw moment that noise alone leaves, RMS, N m")
    detection_floor: float = Field(gt=0, description="amplitude of a yaw impulse found nine times in ten, N m")
    axial_offset_dive: float = Field(description="mean error of B_cu on the dive, N")
    axial_offset_climb: float = Field(description="mean error of B_cu on the climb, N")
    axial_offset_rms: float = Field(ge=0, description="root mean square of the mean error of B_cu, N")
    exact_axial_error: float = Field(ge=0, description="axial_error, were the coefficients exact, m/s")
    how: dict[str, str] = Field(default_factory=dict, description="how each figure was got")

    @property
    def current(self) -> CurrentErrors:
        """The terms of the current's covariance."""
        return CurrentErrors(**{name: getattr(self, name) for name in TERMS})


@dataclass(frozen=True)
class CurrentError:
    """One twin's depth-averaged current: truth and error (m/s, north and east), the way it flew (m), and the time (s).

    `known` is the variance, either way, of errors that the terms are not to explain (m2/s2), as of the fixes.
    """

    truth: tuple[float, float]
    error: tuple[float, float]
    track: tuple[float, float]
    duration: float
    known: float = 0.0


@dataclass(frozen=True)
class FittedBudget:
    """Terms of largest likelihood, and the median squared distance of the errors under them (`CHI_SQUARE_MEDIAN`)."""

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
        raise InputError(f"a budget needs at least {MIN_TWINS} twins, not {len(errors)}; give more --seeds")

    shapes, wrong = _shapes(errors, names), np.array([error.error for error in errors])
    known = np.array([error.known for error in errors])

    def minus_log_likelihood(x: Array) -> float:
        covariance = _covariances(shapes, known, x)
        return 0.5 * float((np.linalg.slogdet(covariance)[1] + _distances(covariance, wrong)).sum())

    begin: Array = np.log(np.array([_BEGIN[name] for name in names]))
    found: Any = scipy.optimize.minimize(
        minus_log_likelihood, begin, method="Nelder-Mead", options={"fatol": 1e-4, "xatol": 1e-3}
    )
    median = float(np.median(_distances(_covariances(shapes, known, found.x), wrong)))
    return FittedBudget(_settings(np.exp(np.clip(found.x, *_LIMITS)).tolist(), names), median)


def budget_text(budget: Budget, study: str = "recoverability") -> str:
    """Give a budget as YAML, figures to four digits, with the twin study that made it."""
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
        No such file, not YAML, or a key missing, unknown or out of range.
    """
    content = parse_yaml(read_yaml_text(Path(path), "budget"), str(path))
    try:
        return Budget.model_validate(content)
    except ValidationError as error:
        fault = error.errors(include_url=False)[0]
        key = ".".join(str(part) for part in fault["loc"]) or "the whole"
        raise InputError(f"{path}: {key}: {fault['msg'].lower()}") from None


def _settings(values: Sequence[float], names: Sequence[str]) -> CurrentErrors:
    return CurrentErrors(**{**dict.fromkeys(TERMS, 0.0), **dict(zip(names, values, strict=True))})


def _shapes(errors: Sequence[CurrentError], names: Sequence[str]) -> Array:
    """Covariances ``(n, terms, 2, 2)`` of terms of one: the covariance is their sum, times the terms' squares."""
    return np.array(
        [
            [current_uncertainty(_drift(error), _settings([1.0], [name])).covariance for name in names]
            for error in errors
        ]
    )


def _drift(error: CurrentError) -> Drift:
    """Drift of a twin of which nothing but the terms is uncertain."""
    return Drift(np.array(error.truth), np.array(error.track), error.duration, 0.0, 0.0, np.zeros((2, 2)))


def _covariances(shapes: Array, known: Array, x: Array) -> Array:
    """Covariances ``(n, 2, 2)`` under terms of logarithm x."""
    terms = np.exp(2.0 * np.clip(x, *_LIMITS))
    return np.asarray(np.einsum("k,nkij->nij", terms, shapes) + (known + _MIN_VARIANCE)[:, None, None] * np.eye(2))


def _distances(covariance: Array, wrong: Array) -> Array:
    """Squared Mahalanobis distances ``(n,)``."""
    return np.asarray(np.einsum("ni,ni->n", wrong, np.linalg.solve(covariance, wrong[..., None])[..., 0]))
