"""Forward runs, and the cost of a window with its gradient (eq. 28 and its exact discrete adjoint).

`cost_and_gradient` and the functions that it calls process one window, or one in each lane
(`gliderhpc.kernels.elementwise`). With lanes, arrays have an axis of `LANES` after those given here, ``hull`` is an
array too, and every step has its own length; a window shorter than its neighbours ends with steps of zero length.
"""

import numpy as np
from numba.core import types
from numba.core.typing.templates import signature

from gliderhpc.kernels.dynamics import Attitude
from gliderhpc.kernels.elementary import wrap
from gliderhpc.kernels.elementwise import kind_loaded, load, lower_load, operation, store, zero_like
from gliderhpc.kernels.hydrodynamics import Bearing
from gliderhpc.kernels.jit import formula, kernel
from gliderhpc.kernels.mass import load_body
from gliderhpc.kernels.parameters import Hull
from gliderhpc.kernels.rk4 import displacement, step, step_vjp

TAPE = 62
"""Numbers per step on the adjoint's tape, besides the states: three later stages of ten, and all four geometries.

Recomputing sines and cosines, the angles of the flow and reciprocal speeds would take a third of the sweep.
"""


@formula
def load_state(states, k):
    """Return row ``k`` of an array of ten-state rows, as a tuple."""
    return (
        load(states, (k, 0)), load(states, (k, 1)), load(states, (k, 2)), load(states, (k, 3)), load(states, (k, 4)),
        load(states, (k, 5)), load(states, (k, 6)), load(states, (k, 7)), load(states, (k, 8)), load(states, (k, 9)),
    )  # fmt: skip


@formula
def store_state(states, k, y):
    """Write the tuple ``y`` into row ``k``."""
    for i in range(10):
        store(states, (k, i), y[i])


@formula
def load_disturbance(b, k):
    """Return row ``k`` of the disturbance, as a tuple."""
    return load(b, (k, 0)), load(b, (k, 1)), load(b, (k, 2)), load(b, (k, 3)), load(b, (k, 4)), load(b, (k, 5))


def hull_in(hull):
    """Return the constants as a `Hull`, given as one or as an array ``(24,)`` with an axis of lanes."""
    return hull if isinstance(hull, Hull) else Hull(*hull)


def duration(h, k):
    """Return the length of step ``k`` (s): ``h`` itself, or its entry."""
    return h if np.ndim(h) == 0 else h[k]


def _kind_of_hull(hull):
    return types.NamedUniTuple(kind_loaded(hull, types.intp), len(Hull._fields), Hull) if _is_array(hull) else hull


def _lower_hull(context, builder, sig, args):
    if not _is_array(sig.args[0]):
        return args[0]
    one = signature(sig.return_type.dtype, sig.args[0], types.intp)
    indices = (context.get_constant(types.intp, i) for i in range(len(Hull._fields)))
    values = [lower_load(context, builder, one, (args[0], index)) for index in indices]
    return context.make_tuple(builder, sig.return_type, values)


def _lower_duration(context, builder, sig, args):
    if _is_array(sig.args[0]):
        return lower_load(context, builder, sig, args)
    return context.cast(builder, args[0], sig.args[0], sig.return_type)


def _is_array(kind):
    return isinstance(kind, types.Array)


operation(hull_in, _kind_of_hull, _lower_hull)
operation(duration, lambda h, k: kind_loaded(h, k) if _is_array(h) else types.float64, _lower_duration)


@formula
def sensed_of(y):
    """Return the ten sensed states of a twelve-state row."""
    return y[0], y[1], y[2], y[5], y[6], y[7], y[8], y[9], y[10], y[11]


@formula
def store_row(trajectory, k, y, X, Y):
    """Write the twelve-state row ``k``: the sensed states and the track."""
    trajectory[k, 0], trajectory[k, 1], trajectory[k, 2] = y[0], y[1], y[2]
    trajectory[k, 3], trajectory[k, 4], trajectory[k, 5] = X, Y, y[3]
    for i in range(6):
        trajectory[k, 6 + i] = y[4 + i]


@kernel
def simulate(hull, bodies, state0, b, h, trajectory):
    """Fill ``trajectory (n+1, 12)`` from ``state0 (12)`` under ``bodies (n, 11)`` and ``b (n, 6)``."""
    y = sensed_of(state0)
    X, Y = state0[3], state0[4]
    store_row(trajectory, 0, y, X, Y)
    for k in range(b.shape[0]):
        new, stages, _ = step(hull, load_body(bodies, k), y, load_disturbance(b, k), h)
        north, east = displacement(stages, h)
        X += north
        Y += east
        y = new
        store_row(trajectory, k + 1, y, X, Y)


@kernel
def moves(hull, bodies, states, b, h, track):
    """Fill ``track (n, 2)``: displacement north and east, m, over each step from its row of ``states (n+1, 10)``."""
    for k in range(b.shape[0]):
        _, stages, _ = step(hull, load_body(bodies, k), load_state(states, k), load_disturbance(b, k), h)
        track[k, 0], track[k, 1] = displacement(stages, h)


@formula
def load_stage(tape, k, number):
    """Return the later stage ``number`` (0 to 2) of step ``k``, as a tuple."""
    at = 10 * number
    return (
        load(tape, (k, at)), load(tape, (k, at + 1)), load(tape, (k, at + 2)), load(tape, (k, at + 3)),
        load(tape, (k, at + 4)), load(tape, (k, at + 5)), load(tape, (k, at + 6)), load(tape, (k, at + 7)),
        load(tape, (k, at + 8)), load(tape, (k, at + 9)),
    )  # fmt: skip


@formula
def load_geometry(tape, k, number):
    """Return the geometry of stage ``number`` (0 to 3) of step ``k``."""
    at = 30 + 8 * number
    return (
        Attitude(load(tape, (k, at)), load(tape, (k, at + 1)), load(tape, (k, at + 2)), load(tape, (k, at + 3))),
        Bearing(load(tape, (k, at + 4)), load(tape, (k, at + 5)), load(tape, (k, at + 6)), load(tape, (k, at + 7))),
    )


@formula
def record_step(tape, k, stages, geometry):
    """Write the three later stages of step ``k`` and the geometry of all four."""
    for i in range(10):
        store(tape, (k, i), stages[1][i])
        store(tape, (k, 10 + i), stages[2][i])
        store(tape, (k, 20 + i), stages[3][i])
    for number in range(4):
        attitude, bearing = geometry[number]
        for i in range(4):
            store(tape, (k, 30 + 8 * number + i), attitude[i])
            store(tape, (k, 34 + 8 * number + i), bearing[i])


@kernel
def forward(hull, bodies, y0, b, h, states, tape):
    """Integrate the sensed states: fill ``states (n+1, 10)`` and the adjoint's ``tape (n, TAPE)``."""
    constants = hull_in(hull)
    y = load_state(y0, 0)
    store_state(states, 0, y)
    for k in range(b.shape[0]):
        y, stages, geometry = step(constants, load_body(bodies, k), y, load_disturbance(b, k), duration(h, k))
        record_step(tape, k, stages, geometry)
        store_state(states, k + 1, y)


@formula
def misfit(states, measurements, k):
    """Return model minus sample ``k``: roll, pitch, heading (the short way round) and depth."""
    return (
        load(states, (k, 0)) - load(measurements, (k, 0)),
        load(states, (k, 1)) - load(measurements, (k, 1)),
        wrap(load(states, (k, 2)) - load(measurements, (k, 2))),
        load(states, (k, 3)) - load(measurements, (k, 3)),
    )


@kernel
def adjoint(hull, bodies, states, tape, measurements, weights, h, gradient, gradient_state0, cost):
    """Sweep the exact transpose backwards (terminal costate zero): dJ/db ``(n, 6)`` and dJ/dy0 ``(10,)``.

    The sweep also sums the cost of eq. 28, over samples 1..n, into ``cost (1,)``: rad2 s and m2 s.
    """
    constants = hull_in(hull)
    total = zero_like(load(weights, 0))
    a = (total, total, total, total, total, total, total, total, total, total)
    for k in range(bodies.shape[0] - 1, -1, -1):
        d_phi, d_theta, d_psi, d_Z = misfit(states, measurements, k + 1)
        weight = duration(h, k) * load(weights, k + 1)
        total += weight * (d_phi * d_phi + d_theta * d_theta + d_psi * d_psi + d_Z * d_Z)
        scale = 2.0 * weight
        a = (
            a[0] + scale * d_phi, a[1] + scale * d_theta, a[2] + scale * d_psi, a[3] + scale * d_Z,
            a[4], a[5], a[6], a[7], a[8], a[9],
        )  # fmt: skip
        stages = load_state(states, k), load_stage(tape, k, 0), load_stage(tape, k, 1), load_stage(tape, k, 2)
        geometry = (
            load_geometry(tape, k, 0),
            load_geometry(tape, k, 1),
            load_geometry(tape, k, 2),
            load_geometry(tape, k, 3),
        )
        a, g = step_vjp(constants, load_body(bodies, k), stages, geometry, a, duration(h, k))
        for i in range(6):
            store(gradient, (k, i), g[i])
    for i in range(10):
        store(gradient_state0, i, a[i])
    store(cost, 0, total)


@kernel
def cost_and_gradient(hull, bodies, y0, b, measurements, weights, h, states, tape, gradient, gradient_state0, cost):
    """Store the cost of one window in ``cost (1,)``, and its gradient in ``gradient`` and ``gradient_state0``."""
    forward(hull, bodies, y0, b, h, states, tape)
    adjoint(hull, bodies, states, tape, measurements, weights, h, gradient, gradient_state0, cost)
