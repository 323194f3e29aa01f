"""JAX: a scan over the steps, compiled by XLA for one core, about scipy's L-BFGS-B."""

import os
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.peers.base import Contender, Evaluator, Value, one_at_a_time, require
from benchmarks.peers.casadi_problem import HEADING, once_for_all
from benchmarks.peers.model import Functions, rates
from benchmarks.peers.quasi_newton import minimise, options_of
from benchmarks.windows import Window
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.kernels.parameters import Body

Array = NDArray[np.float64]

XLA_FLAGS = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"
TUNING = "float64, lax.scan over steps, every stage checkpointed, and fenced by optimization_barrier from 0.10 on"
"""Variants that were tried. With every stage checkpointed, rather than every step or none, the backward sweep is fastest.
Version 0.4.31 is about four times as fast as later ones (0.4.34, 0.4.38 and 0.10.2 were tried): XLA's newer CPU runtime pays for every
small operation, and without the fences its fusion copies a stage's work into each of ten outputs and compiles for
minutes. Vectors with ``jnp.cross`` for the scalars of `model`, two steps a turn of the loop, synchronous dispatch and the
flags for the older runtime and emitters gained nothing there."""

FENCED_SINCE = (0, 10)
"""Version from which `jax.lax.optimization_barrier` can be counted on to be differentiable (0.4.38 refuses)."""


def jax_on_one_core() -> ModuleType:
    """Return the package, set to one core and double precision, or raise `UnavailableError`."""
    require("jax")
    os.environ["JAX_PLATFORMS"] = "cpu"
    os.environ.setdefault("XLA_FLAGS", XLA_FLAGS)
    import jax

    jax.config.update("jax_enable_x64", True)
    return jax


def jax_scan(settings: EstimationSettings) -> Contender:
    """Give the peer, or raise `UnavailableError`."""
    jax = jax_on_one_core()
    compiled = once_for_all(lambda window: jax.jit(jax.value_and_grad(_cost_of(jax, window))))

    def evaluator(window: Window) -> Evaluator:
        function, data = compiled(window), window.data
        fixed = [jax.device_put(part) for part in (data.state0, data.bodies, data.measurements[1:], data.weights[1:])]

        def evaluate(x: Array) -> Value:
            cost, gradient = function(x, *fixed)
            return float(cost), np.asarray(gradient)

        return evaluate

    return one_at_a_time(
        "jax",
        "JAX + scipy L-BFGS-B",
        evaluator,
        lambda window: minimise(evaluator(window), window, options_of(settings, window.data.step)),
        {"XLA_FLAGS": os.environ["XLA_FLAGS"], "how": TUNING, **options_of(settings, settings.step)},
        {"jax": jax.__version__, "jaxlib": _jaxlib_version()},
    )


def _jaxlib_version() -> str:
    import jaxlib

    return str(jaxlib.__version__)


def _cost_of(jax: ModuleType, window: Window) -> Any:
    """Cost as a function of ``x``, initial state, mass properties, measurements and weights."""
    jnp, hull, h, scale = jax.numpy, window.data.hull, window.data.step, window.data.scale
    functions = Functions(jnp.sin, jnp.cos, jnp.arctan2, jnp.sqrt)
    fence = _fence(jax)

    @jax.checkpoint
    def slope(body: Any, y: Any, b: Any) -> Any:
        return fence(jnp.stack(rates(functions, hull, Body(*_parts(body, 11)), _parts(y, 10), _parts(b, 6))))

    def step(y: Any, inputs: Any) -> tuple[Any, Any]:
        body, b = inputs
        k1 = slope(body, y, b)
        k2 = slope(body, fence(y + 0.5 * h * k1), b)
        k3 = slope(body, fence(y + 0.5 * h * k2), b)
        k4 = slope(body, fence(y + h * k3), b)
        new = y + h / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
        return new, new[:4]

    def cost(x: Any, y0: Any, bodies: Any, measurements: Any, weights: Any) -> Any:
        _, sensed = jax.lax.scan(step, y0, (bodies, x.reshape(-1, 6) * scale))
        misfit = sensed - measurements
        turn = misfit[:, HEADING]
        misfit = misfit.at[:, HEADING].set(turn - 2.0 * jnp.pi * jnp.round(turn / (2.0 * jnp.pi)))
        return h * jnp.sum(weights[:, None] * misfit**2)

    return cost


def _fence(jax: ModuleType) -> Any:
    """Give what keeps XLA's fusion within a stage, or nothing before the versions that have and need it."""
    if jax.__version_info__ < FENCED_SINCE:
        return lambda value: value
    return jax.lax.optimization_barrier


def _parts(vector: Any, count: int) -> list[Any]:
    return [vector[i] for i in range(count)]
