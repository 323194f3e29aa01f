"""Effect of errors of the hull in steady glide: on medians of the disturbances, and on the speed through the water."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gliderhpc.estimation.preparation import PreparedProfile
from gliderhpc.estimation.smoother.estimate import SmoothedEstimate
from gliderhpc.estimation.smoother.information import HullInformation

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_BAND, _SHALLOW_BAND = (150.0, 500.0), (0.3, 0.95)
"""Range of depths (m) of the steady glide used; for a shallower profile, as fractions of its depth."""
_SETTLING = 60.0
"""Time (s) from the start that is excluded."""
_MIN_RECORDS = 30
_MIDDLE = 0.1
"""Fraction of the records on either side of a median over which its sensitivity is averaged."""
_VELOCITY = slice(6, 9)


class GlideSensitivity(NamedTuple):
    """Derivatives in steady glide with respect to ``p`` errors in plausible deviations; NaN where it is too short.

    Attributes
    ----------
    medians : (2, 6, p)
        Derivatives of the medians of the disturbances over dive and climb, N and N m.
    speeds : (2, p)
        Derivatives of the mean speed through the water over dive and climb, m/s.
    """

    medians: Array
    speeds: Array


def glide_sensitivity(
    profile: PreparedProfile, smoothed: SmoothedEstimate, information: HullInformation, every: int
) -> GlideSensitivity:
    """Compute the derivatives in steady glide from those at the records.

    Parameters
    ----------
    profile : PreparedProfile
        The profile on its ``n`` steps.
    smoothed, information : SmoothedEstimate, HullInformation
        Smoothed estimate, and the profile's sensitivities, both at the records.
    every : int
        Number of steps from record to record.
    """
    phases = steady_phases(profile, every)
    return GlideSensitivity(
        np.array([median_sensitivities(smoothed.disturbances, information.disturbances, phase) for phase in phases]),
        np.array([speed_sensitivity(smoothed.states, information.states, phase) for phase in phases]),
    )


def steady_phases(profile: PreparedProfile, every: int) -> tuple[Mask, Mask]:
    """Return masks of the records in steady mid-depth glide, one for the dive and one for the climb."""
    series = profile.series
    depth, time = series.measurements[::every, 3], series.time[::every]
    steady = ~profile.vibrating[::every] & (series.weights[::every] > 0.0) & (time >= _SETTLING)
    deepest = int(np.argmax(depth))
    low, high = _band(float(depth[deepest]))
    steady &= (depth >= low) & (depth <= high)
    diving = np.arange(len(depth)) < deepest
    return steady & diving, steady & ~diving


def _band(deepest: float) -> tuple[float, float]:
    """Range of depths (m) of the steady glide used, for a profile's largest depth (m)."""
    if deepest >= _BAND[1]:
        return _BAND
    return min(_BAND[0], _SHALLOW_BAND[0] * deepest), _SHALLOW_BAND[1] * deepest


def median_sensitivities(values: Array, sensitivity: Array, counted: Mask) -> Array:
    """Derivatives ``(6, p)`` of the medians of the disturbances ``(k, 6)`` over the records `counted`.

    Each is the mean of the derivatives ``(k, 6, p)`` at the records next to the median in rank.
    """
    chosen = np.flatnonzero(counted[: len(values)])
    if len(chosen) < _MIN_RECORDS:
        return np.full(sensitivity.shape[1:], np.nan)
    reach = max(1, round(_MIDDLE * len(chosen)))
    middle = slice(len(chosen) // 2 - reach, len(chosen) // 2 + reach + 1)
    order = chosen[np.argsort(values[chosen], axis=0, kind="stable")[middle]]
    return np.array([sensitivity[order[:, i], i].mean(axis=0) for i in range(values.shape[1])])


def speed_sensitivity(states: Array, sensitivity: Array, counted: Mask) -> Array:
    """Derivatives ``(p,)`` of the mean speed through the water over the records `counted`, m/s."""
    if counted.sum() < _MIN_RECORDS:
        return np.full(sensitivity.shape[2], np.nan)
    velocity = states[counted, _VELOCITY]
    direction = velocity / np.maximum(np.linalg.norm(velocity, axis=1, keepdims=True), 1e-9)
    return np.asarray(np.einsum("mi,mip->p", direction, sensitivity[counted, _VELOCITY]) / counted.sum())
