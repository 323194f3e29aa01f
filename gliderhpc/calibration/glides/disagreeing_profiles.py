"""Profiles whose steady glides disagree with the hull that fits those of the other profiles.

A storm, a vehicle held by a line or a faulty record affects every segment of a profile. The robust loss reduces the
weight of single segments only, so that such a profile would distort the hull that is fitted to all of them.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gliderhpc.calibration.glides.search import MIN_SCALES
from gliderhpc.calibration.glides.segment_errors import MIN_PROFILES, SegmentErrors
from gliderhpc.estimation.steady_balance import QUANTITIES

Array = NDArray[np.float64]

MAX_ERROR_RATIO = 8.0
"""Ratio of a profile's median error to that of the profiles beyond which it does not fit the others' hull. On simulated
missions in steady conditions it is at most 2.5, and 5 at the end of a fouling by half of the drag; strong shear with
yaw impulses gives 18 to 64, the loss of a wing 47 to 57."""

MIN_SECOND_RATIO = 4.0
"""The same for a second one of its errors. Impulses of the yaw moment alone, or a shift of the pitch sensor, make one
error large (up to 19 and 10) and hardly change the others; in a storm a second one is 4.9 to 8.5 times as large."""

MAX_SHARE = 1.0 / 3.0
"""Largest fraction of the profiles that may be left out; if more disagree, the others are no clear majority."""


@dataclass(frozen=True)
class DisagreeingProfile:
    """A profile that does not fit the hull of the others.

    Attributes
    ----------
    number : int
        Number of the profile.
    quantity : str
        One of `QUANTITIES`, the one with the largest ratio.
    ratio : float
        Its median error, relative to the median over the profiles.
    """

    number: int
    quantity: str
    ratio: float

    @property
    def reason(self) -> str:
        """Reason for leaving it out."""
        return f"its {self.quantity} is in error by {self.ratio:.0f} times as much as in most profiles"


def disagreeing_profiles(errors: SegmentErrors, steps: Array) -> tuple[DisagreeingProfile, ...]:
    """Return the profiles that do not fit a hull fitted to all; none if they are more than `MAX_SHARE` of them.

    Parameters
    ----------
    errors : SegmentErrors
        Errors of all profiles.
    steps : (p,)
        Hull, in plausible deviations: a fit of all profiles with plausible deviations as a prior.

    Notes
    -----
    An error that is smaller than the resolution of the sensors counts as that resolution.
    """
    numbers = np.unique(errors.segments.profile)
    sizes = np.where(errors.counted, np.abs(errors.all_errors(steps)), np.nan)
    medians = np.array([_column_medians(sizes[errors.segments.profile == number]) for number in numbers])
    medians = np.fmax(medians, MIN_SCALES)
    ratios = medians / np.median(medians, axis=0)
    second, largest = np.sort(np.nan_to_num(ratios), axis=1)[:, -2:].T
    disagrees = (largest > MAX_ERROR_RATIO) & (second > MIN_SECOND_RATIO)
    found = [
        DisagreeingProfile(int(number), QUANTITIES[int(np.argmax(row))], float(row.max()))
        for number, row in zip(numbers[disagrees], ratios[disagrees], strict=True)
    ]
    most = min(int(MAX_SHARE * len(numbers)), len(numbers) - MIN_PROFILES)
    return tuple(found) if len(found) <= most else ()


def _column_medians(sizes: Array) -> Array:
    """Median of each column, NaN where it has no number."""
    return np.array([np.median(known) if len(known := column[~np.isnan(column)]) else np.nan for column in sizes.T])
