"""One pass of the smoother compared with a dense one in NumPy and dynamax's on JAX, over the same linearised dive."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.linear_dive import dense_pass, linear_dive
from benchmarks.machine import machine_row
from benchmarks.peers.base import UnavailableError
from benchmarks.peers.dynamax_smoother import dynamax_pass, dynamax_versions
from benchmarks.timing import in_turns, spread_of
from benchmarks.windows import PLATFORM, twin_series
from gliderhpc import Glider, load_platform
from gliderhpc.estimation.preparation import prepare_profile
from gliderhpc.estimation.profile import estimate_profile
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.estimation.smoother.iterate import run_smoother
from gliderhpc.estimation.smoother.problem import Sweeps, Trajectory
from gliderhpc.kernels.parameters import Hull
from gliderhpc.kernels.smoother_memory import Backward, SmootherProblem

Array = NDArray[np.float64]
Row = dict[str, Any]


def smoother_rows(settings: EstimationSettings, depth: float, repetitions: int) -> Row:
    """Microseconds a step of one pass (filter forwards, costates backwards), of the peers' passes, and of a whole dive.

    A peer that is missing on this machine has a line under ``skipped``.
    """
    hull, dive, path, whole = _smoothed_dive(settings, depth)
    sweeps = Sweeps(hull, dive)
    sweeps.forward(path)
    found, linear = sweeps.backward(path), linear_dive(hull, dive, path, sweeps.rows)
    peers: dict[str, Callable[[], tuple[Array, Array]]] = {"dense": lambda: dense_pass(linear)}
    skipped, versions = {}, {}
    try:
        peers["dynamax"] = dynamax_pass(linear, np.sqrt(np.median(_variances(found), axis=0)))
        versions = dynamax_versions()
    except UnavailableError as lack:
        skipped["dynamax"] = str(lack)
    differences = {name: _largest_difference(found, call()) for name, call in peers.items()}
    # The mean, which is the default, also takes a mean shift; the peers have the mode, as the comparison.
    usual = Sweeps(hull, dive, mean=True)
    calls = {
        "forward": lambda: usual.forward(path),
        "backward": lambda: usual.backward(path),
        **peers,
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
        "ratios": {name: times[name].median / one_pass for name in peers},
        "largest_differences": differences,
        "versions": versions,
        "skipped": skipped,
    }


def _smoothed_dive(
    settings: EstimationSettings, depth: float
) -> tuple[Hull, SmootherProblem, Trajectory, Callable[[], object]]:
    """Hull, problem and path of a synthetic dive after its last pass, and the call that smooths it from the filter's."""
    glider = Glider(load_platform(PLATFORM))
    profile = prepare_profile(glider, twin_series(settings, depth))
    filtered = estimate_profile(profile, settings).filtered
    smoothed = run_smoother(profile, filtered, settings)
    last = np.vstack([smoothed.disturbances, smoothed.disturbances[-1]])
    path = Trajectory(smoothed.states.copy(), last)
    assert smoothed.last_pass is not None
    return glider.hull, smoothed.last_pass.problem, path, lambda: run_smoother(profile, filtered, settings)


def _largest_difference(found: Backward, peer: tuple[Array, Array]) -> float:
    """Largest difference of the means in deviations, and of the variances relative to themselves."""
    means, variances = peer
    own = _variances(found)
    apart = np.abs(found.correction - means) / np.sqrt(own)
    return float(max(apart.max(), np.abs(variances / own - 1.0).max()))


def _variances(found: Backward) -> Array:
    return np.hstack([found.state_variance, found.disturbance_variance])
