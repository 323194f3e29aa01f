"""dynamax: Kalman filter and smoother of a linear problem, sequential scans compiled by XLA for one core."""

import importlib.metadata
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.linear_dive import LinearDive
from benchmarks.peers.base import require
from benchmarks.peers.jax_scan import jax_on_one_core

Array = NDArray[np.float64]


def dynamax_versions() -> dict[str, str]:
    """Versions of the packages that the pass uses."""
    return {name: importlib.metadata.version(name) for name in ("dynamax", "jax", "jaxlib")}


def dynamax_pass(linear: LinearDive, unit: Array) -> Callable[[], tuple[Array, Array]]:
    """Give the call that smooths a linearised dive: means and variances ``(s+1, 16)``, as `dense_pass`.

    States are in units ``unit (16,)`` and samples in units of their deviations, because dynamax adds 1e-9 to the
    diagonal of each matrix that it inverts. A channel without a sample is a sample of nothing. A first call, which
    compiles, is made here.

    Raises
    ------
    UnavailableError
        dynamax is not installed.
    """
    require("dynamax")
    jax = jax_on_one_core()
    from dynamax.linear_gaussian_ssm import (
        ParamsLGSSM,
        ParamsLGSSMDynamics,
        ParamsLGSSMEmissions,
        ParamsLGSSMInitial,
        lgssm_smoother,
    )

    there = linear.fed[:, None] & np.isfinite(linear.residual)
    samples, emissions = _in_units(linear, unit, there)
    rows, channels = there.shape
    parameters = jax.device_put(
        ParamsLGSSM(
            initial=ParamsLGSSMInitial(mean=linear.start / unit, cov=np.diag((linear.deviation / unit) ** 2)),
            dynamics=ParamsLGSSMDynamics(
                weights=_to_every_row(linear.transition * unit / unit[:, None]),
                bias=_to_every_row(linear.offset / unit),
                input_weights=np.zeros((16, 0)),
                cov=_to_every_row(linear.noise / (unit * unit[:, None])),
            ),
            emissions=ParamsLGSSMEmissions(
                weights=emissions,
                bias=np.zeros(channels),
                input_weights=np.zeros((channels, 0)),
                cov=np.eye(channels),
            ),
        )
    )
    inputs = jax.numpy.zeros((rows, 0))

    @jax.jit
    def smooth(parameters: Any, samples: Any) -> Any:
        found = lgssm_smoother(parameters, samples, inputs)
        return found.smoothed_means, jax.numpy.diagonal(found.smoothed_covariances, axis1=1, axis2=2)

    def smoothed() -> tuple[Array, Array]:
        means, variances = smooth(parameters, samples)
        return np.asarray(means) * unit, np.asarray(variances) * unit**2

    smoothed()
    return smoothed


def _to_every_row(of_segments: Array) -> Array:
    """Repeat the first segment's: dynamax asks for one a row, that of the segment before it, and ignores the first."""
    return np.concatenate([of_segments[:1], of_segments])


def _in_units(linear: LinearDive, unit: Array, there: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Samples ``(s+1, 4)`` in units of their deviations, and their derivatives ``(s+1, 4, 16)`` by states in units."""
    deviation = np.sqrt(np.where(there, linear.variance, 1.0))
    samples = np.where(there, linear.residual, 0.0) / deviation
    emissions = np.zeros((*there.shape, 16))
    for channel in range(there.shape[1]):
        # Roll, pitch, heading and depth are the first four states.
        emissions[:, channel, channel] = there[:, channel] * unit[channel] / deviation[:, channel]
    return samples, emissions
