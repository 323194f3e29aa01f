"""A pass of the smoother beside a dense one in NumPy, over the same linearised dive."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.machine import machine_row
from benchmarks.timing import in_turns, spread_of
from benchmarks.windows import PLATFORM, twin_series
from gliderhpc import Glider, load_platform
from gliderhpc.estimation.preparation import prepare_profile
from gliderhpc.estimation.profile import estimate_profile
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.estimation.smoother.iterate import smooth_dive
from gliderhpc.estimation.smoother.problem import Sweeps, Trajectory
from gliderhpc.kernels.elementwise import LANES
from gliderhpc.kernels.parameters import Hull
from gliderhpc.kernels.smoother_allocation import allocate_block, allocate_segments
from gliderhpc.kernels.smoother_memory import LOG_DETERMINANT, Backward, Dive
from gliderhpc.kernels.smoother_segments import linearise_segments

Array = NDArray[np.float64]
Row = dict[str, Any]

_DEPTH = 5
"""Index of the depth among the twelve states; the first three are the angles."""


@dataclass(frozen=True, eq=False)
class LinearDive:
    """A dive linearised about a path: what a smoother of linear problems needs, in deviations from the path.

    Attributes
    ----------
    start, deviation : (16,), (16,)
        Deviation of the prior's mean from the path at the start, and the prior's standard deviations.
    transition, noise, offset : (s, 16, 16), (s, 16, 16), (s, 16)
        Transition over each segment, covariance of its noise, and defect of the path.
    fed : (s+1,) bool
        Whether a row between segments has a sample.
    residual, variance : (s+1, 4), (s+1, 4)
        Sample less the path, NaN where missing, and its variance.
    """

    start: Array
    deviation: Array
    transition: Array
    noise: Array
    offset: Array
    fed: NDArray[np.bool_]
    residual: Array
    variance: Array


def smoother_rows(settings: EstimationSettings, depth: float, repetitions: int) -> Row:
    """Microseconds a step of one pass (filter forwards, costates backwards), of a dense pass, and of a whole dive."""
    hull, dive, path, whole = _smoothed_dive(settings, depth)
    sweeps = Sweeps(hull, dive)
    sweeps.forward(path)
    found, linear = sweeps.backward(path), linear_dive(hull, dive, path, sweeps.rows)
    difference = _largest_difference(found, dense_pass(linear))
    # The mean, which is the default, also takes a mean shift; the dense pass has the mode, as the comparison.
    usual = Sweeps(hull, dive, mean=True)
    calls = {
        "forward": lambda: usual.forward(path),
        "backward": lambda: usual.backward(path),
        "dense": lambda: dense_pass(linear),
        "whole": whole,
    }
    steps = len(dive.bodies)
    times = {name: spread_of([1e6 * t / steps for t in taken]) for name, taken in in_turns(calls, repetitions).items()}
    one_pass = times["forward"].median + times["backward"].median
    return {
        "day": machine_row()["day"],
        "minutes": steps * settings.step / 60.0,
        **{f"{name}_us": times[name].row() for name in calls},
        "pass_us": one_pass,
        "dense_ratio": times["dense"].median / one_pass,
        "largest_difference": difference,
    }


def _smoothed_dive(settings: EstimationSettings, depth: float) -> tuple[Hull, Dive, Trajectory, Callable[[], object]]:
    """Hull, problem and path of a synthetic dive after its last pass, and the call that smooths it from the filter's."""
    glider = Glider(load_platform(PLATFORM))
    profile = prepare_profile(glider, twin_series(settings, depth))
    filtered = estimate_profile(profile, settings).filtered
    smoothed = smooth_dive(profile, filtered, settings)
    last = np.vstack([smoothed.disturbances, smoothed.disturbances[-1]])
    path = Trajectory(smoothed.states.copy(), last)
    assert smoothed.last_pass is not None
    return glider.hull, smoothed.last_pass.dive, path, lambda: smooth_dive(profile, filtered, settings)


def linear_dive(hull: Hull, dive: Dive, path: Trajectory, rows: NDArray[np.int64]) -> LinearDive:
    """Linearise a dive about a path whose rows inside the segments are the model's run already."""
    count = len(rows) - 1
    segments, block, tally = allocate_segments(rows), allocate_block(), np.zeros(LOG_DETERMINANT + 1)
    transition, noise, offset = np.empty((count, 16, 16)), np.empty((count, 16, 16)), np.empty((count, 16))
    for number in range(0, count, LANES):
        linearise_segments(hull, dive, path.states, path.disturbances, segments, number, 0, block, 0, tally)
        part = slice(number, min(number + LANES, count))
        size = part.stop - part.start
        transition[part] = block.tangent[:size].swapaxes(1, 2)
        noise[part], offset[part] = segments.noise[:size], segments.offset[:size]
    states = path.states[rows]
    residual = dive.measured[rows] - states[:, [0, 1, 2, _DEPTH]]
    residual[:, 2] = np.mod(residual[:, 2] + np.pi, 2.0 * np.pi) - np.pi
    sensed = np.concatenate([np.delete(states[0], [3, 4]), path.disturbances[0]])
    return LinearDive(
        dive.mean - sensed, dive.deviation, transition, noise, offset, dive.fed[rows], residual, dive.variance[rows]
    )


def dense_pass(linear: LinearDive) -> tuple[Array, Array]:
    """Smoothed means and variances ``(s+1, 16)`` by a Kalman filter and the smoother of Rauch, Tung and Striebel.

    Whole matrices in NumPy, whose products and solutions are LAPACK's; the linearisation is given.
    """
    count = len(linear.transition)
    mean, covariance = linear.start.copy(), np.diag(linear.deviation**2)
    means, covariances = np.empty((count + 1, 16)), np.empty((count + 1, 16, 16))
    predicted, spread = np.empty((count + 1, 16)), np.empty((count + 1, 16, 16))
    for k in range(count + 1):
        if linear.fed[k]:
            there = np.flatnonzero(np.isfinite(linear.residual[k]))
            across = covariance[:, there]
            gain = np.linalg.solve(across[there] + np.diag(linear.variance[k, there]), across.T).T
            mean = mean + gain @ (linear.residual[k, there] - mean[there])
            covariance = covariance - gain @ across.T
        means[k], covariances[k] = mean, covariance
        if k < count:
            transition = linear.transition[k]
            mean = transition @ mean + linear.offset[k]
            covariance = transition @ covariance @ transition.T + linear.noise[k]
            # Over thousands of segments, rounding would make it asymmetric and then indefinite.
            covariance = 0.5 * (covariance + covariance.T)
            predicted[k + 1], spread[k + 1] = mean, covariance
    variances = np.empty((count + 1, 16))
    variances[count] = np.diag(covariances[count])
    for k in range(count - 1, -1, -1):
        gain = np.linalg.solve(spread[k + 1], linear.transition[k] @ covariances[k]).T
        means[k] += gain @ (means[k + 1] - predicted[k + 1])
        smoothed = covariances[k] + gain @ (covariances[k + 1] - spread[k + 1]) @ gain.T
        covariances[k] = 0.5 * (smoothed + smoothed.T)
        variances[k] = np.diag(covariances[k])
    return means, variances


def _largest_difference(found: Backward, dense: tuple[Array, Array]) -> float:
    """Largest difference of the means in deviations, and of the variances relative to themselves."""
    means, variances = dense
    own = np.hstack([found.state_variance, found.disturbance_variance])
    apart = np.abs(found.correction - means) / np.sqrt(own)
    return float(max(apart.max(), np.abs(variances / own - 1.0).max()))
