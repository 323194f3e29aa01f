"""Cost of a window (eq. 28) and its gradient: the exact transpose of the Runge-Kutta step."""

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.typing import NDArray
from support import reference
from support.sizes import scaled
from support.specimens import (
    lopsided_platform,
    random_controls,
    random_disturbances,
    random_state,
    relative_error,
)

from gliderhpc.errors import InputError
from gliderhpc.flight.glider import SENSED, Glider
from gliderhpc.kernels import window
from gliderhpc.platform import read_platform

Array = NDArray[np.float64]

LOPSIDED = Glider(lopsided_platform())
HULL = np.array(LOPSIDED.hull)
H = 0.1
SENSED_AND_DISTURBED = np.append(SENSED, np.arange(12, 18))
"""Indices of the ten sensed states and the disturbances among the transition matrix's eighteen columns."""


@dataclass(frozen=True)
class Window:
    """Arguments of `Glider.tracking_cost`."""

    state0: Array
    controls: Array
    disturbances: Array
    measurements: Array
    weights: Array

    def cost(self, **changed):
        """Return cost and gradient, with some of the window replaced."""
        w = replace(self, **changed)
        return LOPSIDED.tracking_cost(w.state0, w.controls, w.disturbances, w.measurements, H, weights=w.weights)

    def cost_by(self, implementation):
        """Return cost and gradients by disturbance and initial state, from one implementation of the kernels."""
        return implementation.window(
            HULL, LOPSIDED.bodies(self.controls), self.state0, self.disturbances, self.measurements, self.weights, H
        )

    def reference_cost(self, state0, disturbances):
        """Return the cost of the second implementation, which accepts complex arguments."""
        return reference.tracking_cost(
            LOPSIDED.platform, state0, self.controls, disturbances, self.measurements, H, self.weights
        )


def make_window(n, seed=0):
    """Fly a window whose record is noisy, whose heading was measured within one turn, and whose controls all move."""
    rng = np.random.default_rng(seed)
    state0 = random_state(rng)
    state0[2], state0[6] = math.pi - 0.02, 0.4
    controls, disturbances = random_controls(rng, n), random_disturbances(rng, n)
    flown = LOPSIDED.simulate(state0, controls, random_disturbances(rng, n), H)
    measurements = flown[:, reference.MEASURED] + rng.normal(size=(n + 1, 4)) * [0.01, 0.01, 0.01, 0.1]
    measurements[:, 2] = np.angle(np.exp(1j * measurements[:, 2]))
    return Window(state0, controls, disturbances, measurements, np.ones(n + 1))


@pytest.fixture(scope="module")
def short():
    return make_window(40)


@pytest.fixture(scope="module")
def gappy():
    """Make a window with a gap in its record, one sample of half weight, and the last sample missing."""
    made = make_window(40, seed=1)
    made.weights[10:20] = 0.0
    made.weights[25] = 0.5
    made.weights[-1] = 0.0
    return made


# Against the oracle


@pytest.mark.parametrize("number", [0, 1, 2])
def test_windows_agree_with_the_oracle(oracle, implementation, number):
    """Tolerances: cost 1e-12, gradients 1e-10 of the largest entry, trajectory 1e-12 m in 500."""
    glider, values = Glider(read_platform(oracle / "platform.yaml")), np.load(oracle / "oracle.npz")
    state0, controls, b = (values[f"window_{name}"][number] for name in ("state0", "controls", "disturbances"))
    measured, step = np.nan_to_num(values["window_measurements"][number]), float(values["step"])
    hull, bodies = np.array(glider.hull), glider.bodies(controls)
    cost, gradient, gradient0 = implementation.window(hull, bodies, state0, b, measured, np.ones(len(measured)), step)
    assert cost == pytest.approx(float(values["window_cost"][number]), rel=1e-12)
    assert relative_error(gradient, values["window_gradient"][number]) < 1e-10
    assert relative_error(gradient0, values["window_gradient_state0"][number][SENSED]) < 1e-10
    np.testing.assert_allclose(
        implementation.simulate(hull, bodies, state0, b, step), values["window_trajectory"][number],
        rtol=1e-14, atol=1e-12,
    )  # fmt: skip


def test_glider_returns_the_same_numbers_as_the_kernels(short, numba_kernels):
    """`Glider` coerces and allocates; cost and gradient are those of the kernels."""
    cost, gradient, _ = short.cost_by(numba_kernels)
    assert short.cost()[0] == cost
    np.testing.assert_array_equal(short.cost()[1], gradient)


# Against the complex step


@pytest.mark.parametrize("name", ["short", "gappy"])
def test_cost_is_that_of_the_equation(name, implementation, request):
    """Eq. 28 is the sum over samples 1..n without masked samples."""
    made = request.getfixturevalue(name)
    cost, *_ = made.cost_by(implementation)
    assert cost == pytest.approx(made.reference_cost(made.state0, made.disturbances), rel=1e-12)


@pytest.mark.parametrize("name", ["short", "gappy"])
def test_gradient_is_that_of_the_discrete_cost(name, implementation, request):
    """dJ/db (eqs. 29-32, 36, 37) and directional derivatives agree to 1e-10 with complex steps of the second code."""
    made = request.getfixturevalue(name)
    _, gradient, _ = made.cost_by(implementation)
    directions = list(np.random.default_rng(2).normal(size=(4, *gradient.shape)))
    for step_number in (0, 17, 38):
        for channel in range(6):
            directions.append(np.zeros(gradient.shape))
            directions[-1][step_number, channel] = 1.0
    expected = [
        reference.along(lambda b: made.reference_cost(made.state0, b), made.disturbances, direction)
        for direction in directions
    ]
    actual = np.tensordot(directions, gradient, axes=2)
    assert relative_error(actual[:4], expected[:4]) < 1e-10
    assert relative_error(actual[4:], expected[4:]) < 1e-10


def test_gradient_by_the_initial_state(short, implementation):
    """The costate at the window's start equals the complex step; the cost does not depend on X and Y."""
    *_, actual = short.cost_by(implementation)
    expected = [
        reference.along(lambda y: short.reference_cost(y, short.disturbances), short.state0, axis)
        for axis in np.eye(12)
    ]
    assert relative_error(actual, np.array(expected)[SENSED]) < 1e-10
    np.testing.assert_array_equal(expected[3:5], 0.0)


def test_the_last_disturbance_affects_only_the_last_sample(short):
    """The terminal costate is zero (eq. 34): without the last sample, the last disturbance does not affect the cost."""
    weights = short.weights.copy()
    weights[-1] = 0.0
    _, gradient = short.cost(weights=weights)
    np.testing.assert_array_equal(gradient[-1], 0.0)
    assert np.all(gradient[-2] != 0.0)


# Properties


def test_taylor_remainder_is_of_second_order(short):
    """``J(b + e d) - J(b) - e <g, d>`` falls by four with every halving of e; without the gradient term by two."""
    cost, gradient = short.cost()
    direction = np.random.default_rng(3).normal(size=gradient.shape)
    sizes = 0.05 * 0.5 ** np.arange(6)
    changes = np.array([short.cost(disturbances=short.disturbances + e * direction)[0] - cost for e in sizes])
    remainders = np.abs(changes - sizes * np.sum(gradient * direction))
    orders = np.log2(remainders[:-1] / remainders[1:])
    np.testing.assert_allclose(orders[-3:], 2.0, atol=0.05)
    first_order = np.log2(np.abs(changes[:-1] / changes[1:]))
    assert first_order[-1] < 1.5


def test_a_window_that_tracks_exactly_costs_nothing(short):
    flown = LOPSIDED.simulate(short.state0, short.controls, short.disturbances, H)
    cost, gradient = short.cost(measurements=flown[:, reference.MEASURED])
    # Older compilers contract the operations of the two flights differently, in their last bit.
    assert cost < 1e-30
    np.testing.assert_allclose(gradient, 0.0, atol=1e-15)


def test_masked_samples_do_not_count(gappy):
    """Samples in a gap have zero weight: their content does not change a bit of cost and gradient."""
    cost, gradient = gappy.cost()
    measurements = gappy.measurements.copy()
    measurements[gappy.weights == 0.0] = 1e3
    other_cost, other_gradient = gappy.cost(measurements=measurements)
    assert other_cost == cost
    np.testing.assert_array_equal(other_gradient, gradient)
    assert gappy.cost(weights=np.ones(41))[0] > cost


def test_the_first_sample_is_not_used(short):
    """Eq. 28's sum starts at sample 1; sample 0 may even be missing."""
    measurements = short.measurements.copy()
    measurements[0] = np.nan
    cost, gradient = short.cost(measurements=measurements)
    assert cost == short.cost()[0]
    np.testing.assert_array_equal(gradient, short.cost()[1])


@pytest.mark.parametrize("turns", [-3, 1, 7])
def test_full_turns_of_the_heading_do_not_change_the_cost(short, turns):
    measurements = short.measurements.copy()
    measurements[5:, 2] += 2.0 * math.pi * turns
    cost, gradient = short.cost(measurements=measurements)
    assert cost == pytest.approx(short.cost()[0], rel=1e-12)
    assert relative_error(gradient, short.cost()[1]) < 1e-12
    assert cost < 10.0 * 2.0**2  # a turn would cost 39 rad2 in each of four seconds


# One step


def random_step(seed):
    """Draw mass properties (1, 11), control (5), state (12), disturbance (6)."""
    rng = np.random.default_rng(seed)
    control = random_controls(rng, 1)[0]
    return LOPSIDED.bodies(control[None]), control, random_state(rng), random_disturbances(rng, 1)[0]


def transposed_step(implementation, bodies, state, disturbance, costate):
    """Return ``J'w`` of one step: sixteen entries, for the sensed states and the disturbance."""
    return np.concatenate(implementation.step_vjp(HULL, bodies, state[SENSED], disturbance, costate, H))


def step_matrix(implementation, bodies, state, disturbance):
    """Return J of one step from the filter's tangent, (10, 16)."""
    row = np.concatenate([state[SENSED], disturbance, np.zeros(2)])
    return implementation.tangent(HULL, bodies, row, np.ones(6), H)[1]


@pytest.mark.parametrize("seed", range(5))
def test_step_transpose_against_the_tangent(seed, implementation):
    """``<Jv, w> = <v, J'w>`` to 1e-13, for random w and for ``w = Jv``, where nothing cancels."""
    bodies, _, state, disturbance = random_step(seed)
    rng = np.random.default_rng(100 + seed)
    v = rng.normal(size=16)
    Jv = step_matrix(implementation, bodies, state, disturbance) @ v
    for w in (rng.normal(size=10), Jv):
        backward = v @ transposed_step(implementation, bodies, state, disturbance, w)
        assert abs(Jv @ w - backward) < 1e-13 * np.linalg.norm(Jv) * np.linalg.norm(w)


@pytest.mark.parametrize("seed", range(5))
def test_step_transpose_against_the_complex_step(seed, implementation):
    """``<Jv, w> = <v, J'w>`` to 1e-13, with Jv from the complex step of the second implementation."""
    bodies, control, state, disturbance = random_step(seed)
    rng = np.random.default_rng(200 + seed)
    v = rng.normal(size=16)
    direction = np.zeros(18)
    direction[SENSED_AND_DISTURBED] = v

    def advanced(x):
        return reference.rk4_step(LOPSIDED.platform, x[:12], control, x[12:], H)

    Jv = reference.along(advanced, np.concatenate([state, disturbance]), direction)[SENSED]
    for w in (rng.normal(size=10), Jv):
        backward = v @ transposed_step(implementation, bodies, state, disturbance, w)
        assert abs(Jv @ w - backward) < 1e-13 * np.linalg.norm(Jv) * np.linalg.norm(w)


@pytest.mark.parametrize("seed", range(5))
def test_rates_transpose_against_the_jacobian(seed, implementation):
    """The adjoint equation's integrand (eqs. 33, 35) equals the transposed Jacobian, which has a separate code."""
    bodies, _, state, _ = random_step(seed)
    a = np.random.default_rng(300 + seed).normal(size=10)
    by_state, by_disturbance = implementation.rates_vjp(HULL, bodies, state[SENSED], a)
    jacobian = implementation.jacobian(HULL, bodies, state)[np.ix_(SENSED, SENSED)]
    assert relative_error(by_state, jacobian.T @ a) < 1e-13
    np.testing.assert_allclose(by_disturbance, LOPSIDED.input_diagonal() * a[4:], rtol=1e-15)


# The forward run


def test_trajectory_is_that_of_the_second_implementation(short, implementation):
    bodies = LOPSIDED.bodies(short.controls)
    flown = implementation.simulate(HULL, bodies, short.state0, short.disturbances, H)
    expected = reference.trajectory(LOPSIDED.platform, short.state0, short.controls, short.disturbances, H)
    np.testing.assert_allclose(flown, expected, rtol=1e-13, atol=1e-13)


def test_window_and_simulation_integrate_alike(short):
    """The ten sensed states of `forward` are those of the simulation, bit for bit."""
    n = len(short.controls)
    states, tape = np.empty((n + 1, 10)), np.empty((n, window.TAPE))
    bodies = LOPSIDED.bodies(short.controls)
    window.forward(LOPSIDED.hull, bodies, short.state0[SENSED][None], short.disturbances, H, states, tape)
    flown = LOPSIDED.simulate(short.state0, short.controls, short.disturbances, H)
    np.testing.assert_array_equal(states, flown[:, SENSED])


def test_runge_kutta_is_of_fourth_order():
    """Halving the step divides the error by sixteen, in all twelve states, including X and Y."""
    rng = np.random.default_rng(4)
    state, control = random_state(rng), random_controls(rng, 1)[0]
    disturbance, duration = random_disturbances(rng, 1)[0], 3.2

    def arrival(n):
        held = np.tile(control, (n, 1)), np.tile(disturbance, (n, 1))
        return LOPSIDED.simulate(state, *held, duration / n)[-1]

    exact = arrival(scaled(4096, 2048))
    errors = np.array([np.abs(arrival(n) - exact) for n in (128, 256)])
    assert np.median(np.log2(errors[0] / errors[1])) == pytest.approx(4.0, abs=0.1)
    for part in (slice(0, 3), slice(3, 5), slice(5, 6), slice(6, 12)):
        gain = np.log2(np.linalg.norm(errors[0, part]) / np.linalg.norm(errors[1, part]))
        assert gain == pytest.approx(4.0, abs=0.25)


# The border


def test_mismatched_windows_are_refused(short):
    with pytest.raises(InputError, match=r"disturbances has shape \(39, 6\); it must be \(40, 6\)"):
        short.cost(disturbances=short.disturbances[1:])
    with pytest.raises(InputError, match=r"measurements has shape \(40, 4\); it must be \(41, 4\)"):
        short.cost(measurements=short.measurements[1:])
    with pytest.raises(InputError, match=r"weights has shape \(40,\); it must be \(41\)"):
        short.cost(weights=short.weights[1:])


def test_a_missing_measurement_is_named(short):
    measurements = short.measurements.copy()
    measurements[3, 1] = np.nan
    with pytest.raises(InputError, match=r"measurements\[3, 1\] is nan"):
        short.cost(measurements=measurements)
