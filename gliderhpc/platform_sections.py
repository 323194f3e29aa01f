"""Base class of the platform file's sections, types of their numbers, and the uncertainty of these numbers."""

from __future__ import annotations

from typing import Annotated, Any, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, StringConstraints, model_validator


def _refuse_bool(value: object) -> object:
    """Refuse a boolean: YAML reads ``yes`` and ``off`` as booleans, which would be accepted as 1 and 0."""
    if isinstance(value, bool):
        raise ValueError("must be a number, not yes or no")  # noqa: TRY004 - pydantic reports ValueError alone
    return value


LARGEST_NUMBER = 1e9
"""Upper bound of the magnitude of any property of a glider, in any of the file's units."""


def _refuse_huge(value: float) -> float:
    if abs(value) > LARGEST_NUMBER:
        raise ValueError(f"must not be larger than {LARGEST_NUMBER:g}")
    return value


Number: TypeAlias = Annotated[
    float, BeforeValidator(_refuse_bool), Field(allow_inf_nan=False), AfterValidator(_refuse_huge)
]
Positive: TypeAlias = Annotated[Number, Field(gt=0)]
NonNegative: TypeAlias = Annotated[Number, Field(ge=0)]
Negative: TypeAlias = Annotated[Number, Field(lt=0)]
NonPositive: TypeAlias = Annotated[Number, Field(le=0)]
Correlation: TypeAlias = Annotated[Number, Field(ge=-1, le=1)]
Vector: TypeAlias = tuple[Number, Number, Number]
PositiveVector: TypeAlias = tuple[Positive, Positive, Positive]
NonNegativeVector: TypeAlias = tuple[NonNegative, NonNegative, NonNegative]
SixPositive: TypeAlias = tuple[Positive, Positive, Positive, Positive, Positive, Positive]
Text: TypeAlias = Annotated[str, StringConstraints(strip_whitespace=True, min_length=1)]


class Section(BaseModel):
    """Section of the platform file; it is immutable and refuses unknown keys."""

    model_config = ConfigDict(frozen=True, extra="forbid")


_ROUNDED_CORRELATIONS = 1e-3
"""Magnitude of a negative eigenvalue that rounding of the correlations in a file can cause."""


class CalibrationErrors(Section):
    """Remaining errors of a calibration's numbers, including those held fixed, and their correlations."""

    parameters: tuple[Text, ...] = Field(
        description="keys of the platform file, `position.hull.2` for the third of a list"
    )
    deviation: tuple[NonNegative, ...] = Field(description="standard deviation of each, in the file's unit")
    correlation: tuple[tuple[Correlation, ...], ...] = Field(
        description="correlations of each with those before it, one row each: none in the first, one in the second"
    )

    @model_validator(mode="after")
    def _belong_together(self) -> Self:
        count = len(self.parameters)
        if len(self.deviation) != count or [len(row) for row in self.correlation] != list(range(count)):
            raise ValueError(f"needs a deviation and a row of correlations for each of its {count} parameters")
        if count and float(np.linalg.eigvalsh(self.correlation_matrix)[0]) < -_ROUNDED_CORRELATIONS:
            raise ValueError("must be a covariance, but these correlations contradict one another")
        return self

    @property
    def correlation_matrix(self) -> NDArray[np.float64]:
        """Correlations (p, p)."""
        matrix = np.eye(len(self.parameters))
        for i, row in enumerate(self.correlation):
            matrix[i, :i] = matrix[:i, i] = row
        return matrix

    @property
    def covariance(self) -> NDArray[np.float64]:
        """Covariance (p, p) in the file's units; negative eigenvalues that come from rounding are left out."""
        return np.asarray(np.outer(self.deviation, self.deviation) * _semidefinite(self.correlation_matrix))


def _semidefinite(correlation: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return correlations (p, p) with negative eigenvalues set to zero; unchanged if there are none."""
    values, vectors = np.linalg.eigh(correlation)
    if not len(values) or values[0] >= 0.0:
        return correlation
    matrix = (vectors * np.maximum(values, 0.0)) @ vectors.T
    scale = np.sqrt(np.diag(matrix))
    return np.asarray(matrix / np.outer(scale, scale))


class Uncertainty(Section):
    """Uncertainty of the platform file's numbers: plausible deviations, and the errors that a calibration leaves."""

    deviation: dict[Text, Positive] = Field(
        default_factory=dict,
        description="plausible deviation by key, in the file's unit, relative where a number varies by factors",
    )
    covariance: CalibrationErrors | None = Field(
        default=None,
        description="errors of a calibration, as `gliderhpc calibrate` writes them, or a file that contains them",
    )
    walk: dict[Text, NonNegative] = Field(
        default_factory=dict,
        description="change with time by key, in the same units as the deviation, per square root of a day",
    )

    def __hash__(self) -> int:
        """Return a hash of the contents, since dictionaries have none and studies cache their results by hull."""
        return hash((frozenset(self.deviation.items()), self.covariance, frozenset(self.walk.items())))

    @property
    def keys(self) -> dict[str, tuple[str, ...]]:
        """Keys of the platform file that each entry names."""
        stated = () if self.covariance is None else self.covariance.parameters
        return {"deviation": tuple(self.deviation), "covariance": stated, "walk": tuple(self.walk)}


def number_at(platform: Section, key: str) -> Any:
    """Return the value at a dotted key of the platform file; ``position.hull.2`` is the third number of a list.

    Raises
    ------
    KeyError
        There is no such key.
    """
    node: Any = platform
    try:
        for part in key.split("."):
            node = node[_position(part)] if isinstance(node, tuple) else getattr(node, part)
    except (AttributeError, ValueError, IndexError):
        raise KeyError(key) from None
    return node


def _position(part: str) -> int:
    """Return the position in a list that a part of a key names; `ValueError` if it is not written in digits."""
    if not part.isdecimal():
        raise ValueError(part)
    return int(part)


def has_number(platform: Section, key: str) -> bool:
    """Return whether a key is that of a single number, which may be left out of the file."""
    try:
        value = number_at(platform, key)
    except KeyError:
        return False
    return value is None or isinstance(value, float | int)
