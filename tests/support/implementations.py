"""Each implementation of the kernels, under one set of names, for the oracle and the dot-product tests.

Every function takes and gives plain arrays: hull (24,), mass properties (n, 11), states of ten or twelve.
"""

from typing import Protocol

import numpy as np
import pytest
from numba import njit
from numpy.typing import NDArray

from gliderhpc.flight.glider import SENSED
from gliderhpc.kernels import dynamics, rk4, tangent, window
from gliderhpc.kernels import points as point
from gliderhpc.kernels.elementary import arctan2, sincos, wrap
from gliderhpc.kernels.elementwise import LANES, load, store
from gliderhpc.kernels.fortran.library import LibraryError
from gliderhpc.kernels.fortran.library import load as load_library
from gliderhpc.kernels.jacobian import ENTRIES, rhs_jacobian
from gliderhpc.kernels.lane_memory import Problem, allocate, load_window
from gliderhpc.kernels.mass import load_body
from gliderhpc.kernels.parameters import Hull

Array = NDArray[np.float64]


class Implementation(Protocol):
    """Results of an implementation of the kernels."""

    name: str

    def sincos(self, x: Array) -> tuple[Array, Array]: ...
    def arctan2(self, y: Array, x: Array) -> Array: ...
    def wrap(self, x: Array) -> Array: ...
    def rhs(self, hull: Array, bodies: Array, state: Array, b: Array) -> Array: ...
    def jacobian(self, hull: Array, bodies: Array, state: Array) -> Array: ...
    def rates_vjp(self, hull: Array, bodies: Array, y: Array, a: Array) -> tuple[Array, Array]: ...
    def step(self, hull: Array, bodies: Array, y: Array, b: Array, h: float) -> Array: ...
    def step_vjp(self, hull: Array, bodies: Array, y: Array, b: Array, a: Array, h: float) -> tuple[Array, Array]: ...
    def simulate(self, hull: Array, bodies: Array, state0: Array, b: Array, h: float) -> Array: ...
    def window(
        self, hull: Array, bodies: Array, state0: Array, b: Array, measured: Array, weights: Array, h: float
    ) -> tuple[float, Array, Array]: ...
    def evaluate(self, problem: Problem) -> None: ...
    def tangent(self, hull: Array, bodies: Array, row: Array, decay: Array, h: float) -> tuple[Array, Array]: ...


@njit(error_model="numpy")
def _sincos(x, sine, cosine):
    for i in range(x.shape[0]):
        s, c = sincos(load(x, i))
        store(sine, i, s)
        store(cosine, i, c)


@njit(error_model="numpy")
def _arctan2(y, x, angle):
    for i in range(x.shape[0]):
        store(angle, i, arctan2(load(y, i), load(x, i)))


@njit(error_model="numpy")
def _wrap(x, wrapped):
    for i in range(x.shape[0]):
        store(wrapped, i, wrap(load(x, i)))


def evaluated_by_numba(p: Problem) -> None:
    """Cost and gradient of every lane's trial."""
    window.cost_and_gradient(
        p.hull, p.bodies, p.state0, p.trial, p.measurements, p.weights, p.durations, p.states, p.tape, p.gradient,
        p.gradient_state0, p.cost,
    )  # fmt: skip


class Numba:
    """The kernels, a number at a time."""

    name = "numba"

    def sincos(self, x):
        sine, cosine = np.empty_like(x), np.empty_like(x)
        _sincos(x, sine, cosine)
        return sine, cosine

    def arctan2(self, y, x):
        angle = np.empty_like(x)
        _arctan2(y, x, angle)
        return angle

    def wrap(self, x):
        wrapped = np.empty_like(x)
        _wrap(x, wrapped)
        return wrapped

    def rhs(self, hull, bodies, state, b):
        out = np.empty(12)
        point.rhs(Hull(*hull), bodies, state, b, out)
        return out

    def jacobian(self, hull, bodies, state):
        out = np.empty((12, 12))
        rhs_jacobian(Hull(*hull), bodies, state, out)
        return out

    def rates_vjp(self, hull, bodies, y, a):
        y = tuple(y)
        found = dynamics.rates_vjp(Hull(*hull), load_body(bodies, 0), y, dynamics.geometry_of(y), tuple(a))
        return tuple(map(np.array, found))

    def step(self, hull, bodies, y, b, h):
        return np.array(rk4.step(Hull(*hull), load_body(bodies, 0), tuple(y), tuple(b), h)[0])

    def step_vjp(self, hull, bodies, y, b, a, h):
        hull, body = Hull(*hull), load_body(bodies, 0)
        _, stages, geometry = rk4.step(hull, body, tuple(y), tuple(b), h)
        return tuple(map(np.array, rk4.step_vjp(hull, body, stages, geometry, tuple(a), h)))

    def simulate(self, hull, bodies, state0, b, h):
        trajectory = np.empty((len(b) + 1, 12))
        window.simulate(Hull(*hull), bodies, state0, b, h, trajectory)
        return trajectory

    def window(self, hull, bodies, state0, b, measured, weights, h):
        n = len(b)
        gradient, gradient0, cost = np.empty((n, 6)), np.empty(10), np.empty(1)
        window.cost_and_gradient(
            Hull(*hull), bodies, state0[SENSED][None], b, measured, weights, h, np.empty((n + 1, 10)),
            np.empty((n, window.TAPE)), gradient, gradient0, cost,
        )  # fmt: skip
        return cost[0], gradient, gradient0

    def evaluate(self, problem):
        evaluated_by_numba(problem)

    def tangent(self, hull, bodies, row, decay, h):
        path, partials, transition = np.zeros((2, 18)), np.empty((1, 4, ENTRIES)), np.eye(10, 16)
        path[0] = row
        tangent.advance(hull, bodies, np.array([h]), decay, path, partials, 0)
        tangent.pull_back(hull, np.array([h]), decay, partials, transition, 0)
        return path[1], transition


class Fortran:
    """The library's. Functions for lanes only are run in all lanes, and each must give the same bits."""

    name = "fortran"

    def __init__(self):
        self._library = load_library()
        self._kernels = self._library.kernels

    def sincos(self, x):
        sine, cosine = np.empty_like(x), np.empty_like(x)
        self._kernels["sincos"](x.size, x, sine, cosine)
        return sine, cosine

    def arctan2(self, y, x):
        angle = np.empty_like(x)
        self._kernels["arctan2"](x.size, y, x, angle)
        return angle

    def wrap(self, x):
        wrapped = np.empty_like(x)
        self._kernels["wrap"](x.size, x, wrapped)
        return wrapped

    def rhs(self, hull, bodies, state, b):
        return self._filled("rhs", hull, bodies, state, b, np.empty(12))

    def jacobian(self, hull, bodies, state):
        return self._filled("rhs_jacobian", hull, bodies, state, np.empty((12, 12)))

    def rates_vjp(self, hull, bodies, y, a):
        by_state, by_disturbance = np.empty(10), np.empty(6)
        self._kernels["rates_vjp"](hull, bodies, y, a, by_state, by_disturbance)
        return by_state, by_disturbance

    def step(self, hull, bodies, y, b, h):
        return self._filled("step", hull, bodies, y, b, h, np.empty(10))

    def step_vjp(self, hull, bodies, y, b, a, h):
        by_state, by_disturbance = np.empty(10), np.empty(6)
        self._kernels["step_vjp"](hull, bodies, y, b, a, h, by_state, by_disturbance)
        return by_state, by_disturbance

    def simulate(self, hull, bodies, state0, b, h):
        return self._filled("simulate", len(b), hull, bodies, state0, b, h, np.empty((len(b) + 1, 12)))

    def window(self, hull, bodies, state0, b, measured, weights, h):
        problem, descent, progress = allocate(len(b), 1)
        for lane in range(LANES):
            load_window(
                problem, descent, progress, lane, Hull(*hull), bodies, state0[SENSED], measured, weights, h,
                np.ones(6), b, 1.0, 1,
            )  # fmt: skip
        self.evaluate(problem)
        return float(_common(problem.cost)[0]), _common(problem.gradient), _common(problem.gradient_state0)

    def evaluate(self, problem):
        self._library.evaluation(problem)()

    def tangent(self, hull, bodies, row, decay, h):
        hull, bodies, decay, h = (_spread(value) for value in (hull, bodies, decay, np.array([h])))
        path, partials = np.zeros((2, 18, LANES)), np.empty((1, 4, ENTRIES, LANES))
        path[0], transition = row[:, None], _spread(np.eye(10, 16))
        self._kernels["advance"](1, hull, bodies, h, decay, path, partials, 0)
        self._kernels["pull_back"](1, hull, h, decay, partials, transition, 0)
        return _common(path)[1], _common(transition)

    def _filled(self, name, *arguments):
        self._kernels[name](*arguments)
        return arguments[-1]


def _spread(array: Array) -> Array:
    """The same in every lane."""
    return np.ascontiguousarray(np.repeat(np.asarray(array)[..., None], LANES, axis=-1))


def _common(array: Array) -> Array:
    """Content common to all lanes, bit for bit."""
    np.testing.assert_array_equal(array, np.broadcast_to(array[..., :1], array.shape))
    return array[..., 0].copy()


IMPLEMENTATIONS = {"numba": Numba, "fortran": Fortran}


def implementation_named(name: str) -> Implementation:
    """Give an implementation of the kernels; the test is skipped where Fortran's are not built."""
    try:
        return IMPLEMENTATIONS[name]()
    except LibraryError as error:
        pytest.skip(str(error))
