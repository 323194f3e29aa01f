"""Peaks of a series with stretches left out."""

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from gliderhpc.studies.library.turbulence.pieces import Pieces

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Peaks:
    """Peaks of the magnitude.

    Attributes
    ----------
    at : (k,) int array
        Their samples.
    amplitude : (k,) array
        Values there, with their sign.
    width : (k,) array
        Time over which the series is at least half as large, with the same sign, s.
    """

    at: NDArray[np.int64]
    amplitude: Array
    width: Array


def peaks_of(pieces: Pieces, threshold: float, separation: float) -> Peaks:
    """Find the peaks that reach a threshold, and are the largest within so many seconds, among what counts."""
    magnitude = np.where(pieces.counted, np.abs(pieces.values), 0.0)
    # A peak may be the first or last sample that counts.
    padded = np.concatenate([[0.0], magnitude, [0.0]])
    distance = max(1, round(separation / pieces.step))
    at = np.asarray(scipy.signal.find_peaks(padded, height=threshold, distance=distance)[0] - 1, dtype=np.int64)
    widths = [half_width(pieces.values, int(one)) * pieces.step for one in at]
    return Peaks(at, pieces.values[at], np.array(widths))


def half_width(values: Array, at: int) -> int:
    """Samples in a row about a peak that have at least half its value."""
    below = values * np.sign(values[at]) < 0.5 * abs(values[at])
    before, after = below[:at][::-1], below[at:]
    left = int(np.argmax(before)) if before.any() else at
    right = int(np.argmax(after)) if after.any() else len(after)
    return left + right


def noise_floor(pieces: Pieces) -> float:
    """Standard deviation of a Gaussian series with the same median magnitude: impulses hardly change it."""
    values = pieces.values[pieces.counted]
    return float(1.4826 * np.median(np.abs(values))) if values.size else float("nan")
