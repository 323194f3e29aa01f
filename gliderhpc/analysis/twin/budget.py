"""The current's uncertainty budget for one platform: fitted to twins, written to and read from ``budget.yaml``.

The budget is the covariance of section 5.5, `gliderhpc.estimation.currents.current_covariance`: an axial error along
the track, a relative and a heading error along and across the current. Fitting that very form to the errors of many
twins by maximum likelihood, rather than naming three figures one by one, makes the ellipses cover what they should.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from pydantic import Field, ValidationError
from scipy.optimize import minimize

from gliderhpc.errors import InputError
from gliderhpc.estimation.currents import CurrentSettings, current_covariance
from gliderhpc.estimation.self_motion import SelfMotion
from gliderhpc.estimation.settings import Settings

Array = NDArray[np.float64]

LEAST_TWINS = 3
"""That a budget can be fitted to."""

CHI_SQUARE_MEDIAN = 1.386
"""Median of the squared Mahalanobis distance in two dimensions, were the budget exact and the errors normal."""


class Budget(Settings):
    """What ``twin recoverability`` finds for a platform and ``analyze currents --budget`` takes."""

    platform: str = Field(min_length=1, description="the hull it belongs to")
    axial_error: float = Field(ge=0, description="velocity error of the weakly observed axial motion, m/s")
    relative_error: float = Field(ge=0, description="relative error of the current's magnitude")
    heading_error: float = Field(ge=0, description="heading error, degree")
    identification_noise: float = Field(gt=0, description="high-passed yaw moment that noise alone leaves, RMS, N m")
    detection_floor: float = Field(gt=0, description="amplitude of a yaw impulse found nine times in ten, N m")
    axial_offset_dive: float = Field(description="mean error of B_cu on the dive, N")
    axial_offset_climb: float = Field(description="mean error of B_cu on the climb, N")
    axial_offset_rms: float = Field(ge=0, description="root mean square of the mean error of B_cu, N")
    exact_axial_error: float = Field(ge=0, description="axial_error, were the coefficients exact, m/s")
    how: dict[str, str] = Field(default_factory=dict, description="how each figure was got")

    @property
    def current(self) -> CurrentSettings:
        """The terms of the current's covariance."""
        return CurrentSettings(
            axial_error=self.axial_error, relative_error=self.relative_error, heading_error=self.heading_error
        )


@dataclass(frozen=True)
class CurrentError:
    """One twin's depth-averaged current: truth and error (m/s, north and east), and the way it flew (m)."""

    truth: tuple[float, float]
    error: tuple[float, float]
    track: tuple[float, float]


@dataclass(frozen=True)
class FittedBudget:
    """Terms of largest likelihood, and the median squared distance of the errors under them (`CHI_SQUARE_MEDIAN`)."""

    settings: CurrentSettings
    median_distance: float


def fit_budget(errors: Sequence[CurrentError]) -> FittedBudget:
    """Fit axial, relative and heading error to the errors of twins by maximum likelihood.

    Raises
    ------
    InputError
        Fewer than three twins.
    """
    if len(errors) < LEAST_TWINS:
        raise InputError(f"a budget needs at least {LEAST_TWINS} twins, not {len(errors)}; give more --seeds")

    def objective(x: Array) -> float:
        return _minus_log_likelihood(errors, _terms(x))

    begin: Array = np.log(np.array([0.01, 0.05, 3.0]))
    found: Any = minimize(objective, begin, method="Nelder-Mead", options={"fatol": 1e-4, "xatol": 1e-3})
    terms = _terms(found.x)
    return FittedBudget(terms, float(np.median([_distance(error, terms) for error in errors])))


def budget_text(budget: Budget) -> str:
    """Give a budget as YAML, figures to four digits."""
    content = {
        name: float(f"{value:.4g}") if isinstance(value, float) else value
        for name, value in budget.model_dump().items()
    }
    head = "# Made by `gliderhpc twin recoverability`; `gliderhpc analyze ARCHIVE currents --budget` takes it.\n"
    return head + yaml.safe_dump(content, sort_keys=False, width=110, allow_unicode=True)


def read_budget(path: str | Path) -> Budget:
    """Read and validate a budget.

    Raises
    ------
    InputError
        No such file, not YAML, or a key missing, unknown or out of range.
    """
    try:
        content = yaml.safe_load(Path(path).read_text("utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot read this budget ({error})") from None
    except yaml.YAMLError:
        raise InputError(f"{path}: not YAML, so not a budget; `gliderhpc twin recoverability` writes one") from None
    try:
        return Budget.model_validate(content)
    except ValidationError as error:
        fault = error.errors(include_url=False)[0]
        key = ".".join(str(part) for part in fault["loc"]) or "the whole"
        raise InputError(f"{path}: {key}: {fault['msg'].lower()}") from None


def _terms(x: Array) -> CurrentSettings:
    axial, relative, heading = np.exp(np.clip(x, -12.0, 5.0))
    return CurrentSettings(axial_error=float(axial), relative_error=float(relative), heading_error=float(heading))


def _covariance(error: CurrentError, terms: CurrentSettings) -> Array:
    return current_covariance(np.array(error.truth), SelfMotion(np.array([error.track]), 0.0), terms)


def _distance(error: CurrentError, terms: CurrentSettings) -> float:
    wrong = np.array(error.error)
    return float(wrong @ np.linalg.solve(_covariance(error, terms) + 1e-12 * np.eye(2), wrong))


def _minus_log_likelihood(errors: Sequence[CurrentError], terms: CurrentSettings) -> float:
    total = 0.0
    for error in errors:
        covariance = _covariance(error, terms) + 1e-12 * np.eye(2)
        total += 0.5 * (float(np.linalg.slogdet(covariance)[1]) + _distance(error, terms))
    return total
