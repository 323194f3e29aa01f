"""Errors of the steady balance before and after a calibration, and whether they are better."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gliderhpc.errors import CalibrationError
from gliderhpc.platform import Platform
from gliderhpc.tuning.calibration_search import FIRST_SCALES
from gliderhpc.tuning.segment_errors import SegmentErrors
from gliderhpc.tuning.steady_balance import QUANTITIES
from gliderhpc.tuning.steady_segments import SteadySegments

Array = NDArray[np.float64]

ROSE = 0.5 * np.array(FIRST_SCALES)
"""Errors (m/s, rad, rad, rad/s) that a calibration may add to the root mean square at most, in the square sum."""

REMEDY = (
    "look for a sensor or an actuator that is off with `gliderhpc inspect`, choose other --profiles, or hold what is "
    "known, such as --set calibration.hold=[K_L]"
)
"""Remedy where no fit is better than its start."""


@dataclass(frozen=True, eq=False)
class Score:
    """Root mean square errors of the four quantities over some segments, before and after (`QUANTITIES`, SI)."""

    profiles: tuple[int, ...]
    segments: int
    before: Array
    after: Array


def score(errors: SegmentErrors, steps: Array) -> Score:
    """Errors that count of the platform as it was and of the hull of some steps (p,)."""
    values = [np.where(errors.counted, errors.everywhere(x), np.nan) for x in (np.zeros(len(steps)), steps)]
    before, after = (
        np.array([math.sqrt(np.nanmean(column**2)) if errors.counted[:, kind].any() else math.nan
                  for kind, column in enumerate(value.T)])
        for value in values
    )  # fmt: skip
    numbers = tuple(np.unique(errors.segments.profile).tolist())
    return Score(numbers, len(errors.segments), before, after)


def score_of(hull: Platform, segments: SteadySegments) -> Array:
    """Root mean square errors (4,) of a hull's balance over segments (`QUANTITIES`, SI); NaN where nothing counts."""
    return score(SegmentErrors(hull, (), segments), np.zeros(0)).after


def check_errors(fitted: Score, held_out: Score, quantities: int = len(QUANTITIES)) -> None:
    """Refuse a hull whose steady glides are clearly worse than those of the platform that it was made from.

    Parameters
    ----------
    fitted, held_out : Score
        Errors on the profiles fitted and on those held out.
    quantities : int
        How many of `QUANTITIES`, from the first on, are judged.

    Raises
    ------
    CalibrationError
        An error has grown, on the profiles fitted or on those held out.
    """
    for name, each in (("fitted", fitted), ("held out", held_out)):
        rose = np.sqrt(np.maximum(each.after**2 - each.before**2, 0.0))[:quantities] > ROSE[:quantities]
        if rose.any():
            raise CalibrationError(
                f"calibration: the hull that fits best has a larger error of {QUANTITIES[int(np.argmax(rose))]} than "
                f"the platform does, on the profiles {name}: nothing is written; {REMEDY}"
            )
