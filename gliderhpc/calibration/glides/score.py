"""Errors of the steady balance before and after a calibration, and a check that they have not grown."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gliderhpc.calibration.glides.search import FIRST_SCALES
from gliderhpc.calibration.glides.segment_errors import SegmentErrors
from gliderhpc.errors import CalibrationError
from gliderhpc.estimation.steady_balance import QUANTITIES
from gliderhpc.estimation.steady_segments import SteadySegments
from gliderhpc.platform import Platform

Array = NDArray[np.float64]

MAX_INCREASE = 0.5 * np.array(FIRST_SCALES)
"""Largest errors (m/s, rad, rad, rad/s) that a calibration may add in quadrature to the root mean square."""

REMEDY = (
    "look for an error of a sensor or actuator with `gliderhpc inspect`, choose other `profiles`, or hold parameters "
    "that are known, such as `calibration.hold=[K_L]`"
)
"""Remedy where no fit is better than its start."""


CHANCE_FACTOR = 1.2
"""Factor by which chance may raise an error: a few tens of independent segments determine it to about a tenth."""

TRIMMED_FRACTION = 0.95
"""Fraction of the errors, the smallest ones, in the trimmed root mean square by which a calibration is judged. In a
segment where a hull's yaw hardly balances, a small change of its coefficients can predict any rate of turn, and one
such segment must not decide."""


@dataclass(frozen=True, eq=False)
class Errors:
    """Root mean square errors of the four quantities (`QUANTITIES`, SI) over some segments; NaN without segments.

    Attributes
    ----------
    all, trimmed : (4,)
        Root mean square of all errors, and of the smallest ones, a fraction `TRIMMED_FRACTION` of them.
    """

    all: Array
    trimmed: Array


@dataclass(frozen=True, eq=False)
class Score:
    """Errors over some segments before and after a calibration."""

    profiles: tuple[int, ...]
    segments: int
    errors_before: Errors
    errors_after: Errors

    @property
    def before(self) -> Array:
        """Root mean square errors (4,) before."""
        return self.errors_before.all

    @property
    def after(self) -> Array:
        """Root mean square errors (4,) after."""
        return self.errors_after.all


NO_ERRORS = Errors(np.full(4, math.nan), np.full(4, math.nan))
"""Errors in the absence of segments."""


def score(errors: SegmentErrors, steps: Array) -> Score:
    """Compute the errors of the original platform and of the hull at some steps (p,)."""
    numbers = tuple(np.unique(errors.segments.profile).tolist())
    return Score(numbers, len(errors.segments), _errors(errors, np.zeros(len(steps))), _errors(errors, steps))


def score_of(hull: Platform, segments: SteadySegments) -> Errors:
    """Errors of a hull's balance over segments."""
    return _errors(SegmentErrors(hull, (), segments), np.zeros(0))


def _errors(errors: SegmentErrors, steps: Array) -> Errors:
    sizes = [
        np.sort(np.abs(values[counted & ~np.isnan(values)]))
        for values, counted in zip(errors.all_errors(steps).T, errors.counted.T, strict=True)
    ]
    return Errors(
        np.array([_root_mean_square(values) for values in sizes]),
        np.array([_root_mean_square(values[: math.ceil(TRIMMED_FRACTION * len(values))]) for values in sizes]),
    )


def _root_mean_square(values: Array) -> float:
    return math.sqrt(np.mean(values**2)) if len(values) else math.nan


def check_errors(
    fitted: Score, held_out: Score, quantities: int = len(QUANTITIES), *, before: str = "the platform"
) -> None:
    """Refuse a hull whose errors in steady glides are clearly larger than those of the hull before.

    Parameters
    ----------
    fitted, held_out : Score
        Errors on the profiles fitted and on those held out.
    quantities : int
        Number of `QUANTITIES` to judge, starting with the first.
    before : str
        Name of the hull before, for the message.

    Raises
    ------
    CalibrationError
        An error (`Errors.trimmed`) has grown by more than chance, on the profiles fitted or on those held out.
    """
    for name, score_there in (("fitted", fitted), ("held out", held_out)):
        first, after = score_there.errors_before.trimmed, score_there.errors_after.trimmed
        grown = (np.sqrt(np.maximum(after**2 - first**2, 0.0)) > MAX_INCREASE) & (after > CHANCE_FACTOR * first)
        grown = grown[:quantities]
        if grown.any():
            raise CalibrationError(
                f"calibration: the hull that fits best has a larger error of {QUANTITIES[int(np.argmax(grown))]} than "
                f"{before} on the profiles {name}; {REMEDY}"
            )
