"""Hulls and flight states for the kernel tests, and hypothesis strategies of states."""

import math
from typing import Any

import numpy as np
from hypothesis import strategies as st
from numpy.typing import NDArray

from gliderhpc.kernels.mass import load_body
from gliderhpc.kernels.parameters import Body
from gliderhpc.platform import Platform, read_platform, with_overrides

Array = NDArray[np.float64]

BELOW_A_RIGHT_ANGLE = math.nextafter(math.pi / 2.0, 0.0)

VISCOUS = ("K_D0", "K_D", "K_beta", "K_L0", "K_L", "K_MR", "K_p", "K_M0", "K_M", "K_q", "K_MY", "K_r", "K_delta")
"""Hull constants without which the water exerts no viscous force."""


def lopsided_platform(**viscous: float) -> Platform:
    """Seawing with every mass off centre and every optional coefficient at work: no term of the model vanishes."""
    coefficients = {"K_L0": -0.36, "K_delta": 12.0, "rate_damping_floor": 0.15} | viscous
    return with_overrides(
        read_platform("seawing"),
        {
            "position.hull": "[-0.0814, 0.001, 0.0032]",
            "position.bladder": "[0.6, 0.002, -0.003]",
            "position.reservoir": "[-0.3, 0.001, 0.004]",
            "buoyancy.depth_slope": "0.005",
        }
        | {f"viscous.{name}": repr(value) for name, value in coefficients.items()},
    )


def random_state(rng: np.random.Generator) -> Array:
    """Draw a state: headings of several turns, sternway and steep angles of attack included."""
    return np.concatenate(
        [
            rng.uniform([-0.6, -1.1, -10.0], [0.6, 1.1, 10.0]),
            rng.uniform([-500.0, -500.0, 0.0], [500.0, 500.0, 700.0]),
            rng.uniform([-0.2, -0.1, -0.2], [0.8, 0.1, 0.2]),
            rng.uniform(-0.2, 0.2, 3),
        ]
    )


def random_controls(rng: np.random.Generator, n: int) -> Array:
    """``(n, 5)`` controls [r_px, gamma, m_b, m_m, rudder]: oil pumped to and fro and a rudder that moves."""
    return rng.uniform([-0.05, -0.8, -0.3, -0.4, -0.3], [0.05, 0.8, 0.3, 0.8, 0.3], (n, 5))


def random_disturbances(rng: np.random.Generator, n: int) -> Array:
    """``(n, 6)`` disturbances of the size that missions show, N and N m."""
    return rng.normal(size=(n, 6)) * np.array([0.3, 0.3, 0.3, 0.05, 0.1, 0.5])


def body_of(bodies: Array) -> Body:
    """First row of an array of mass properties, as the kernels take it."""
    return load_body(bodies, 0)


def relative_error(actual: Any, expected: Any) -> float:
    """Largest difference, relative to the largest entry expected."""
    return float(np.max(np.abs(np.asarray(actual) - expected)) / np.max(np.abs(expected)))


def _magnitudes(largest: float) -> st.SearchStrategy[float]:
    """Zero, everyday sizes, and numbers whose squares underflow."""
    return st.one_of(
        st.just(0.0),
        st.floats(-largest, largest),
        st.builds(lambda sign, exponent: sign * 10.0**exponent, st.sampled_from([-1.0, 1.0]), st.floats(-320.0, 0.0)),
    )


def extreme_states() -> st.SearchStrategy[Array]:
    """Draw states with |theta| below 90 degrees, whole hulls at rest or nearly so among them."""
    angle = st.floats(-1e4, 1e4)
    pitch = st.floats(-BELOW_A_RIGHT_ANGLE, BELOW_A_RIGHT_ANGLE)
    position = st.floats(-1e4, 1e4)
    parts = [angle, pitch, angle] + [position] * 3 + [_magnitudes(10.0)] * 3 + [_magnitudes(5.0)] * 3
    return st.tuples(*parts).map(np.array)
