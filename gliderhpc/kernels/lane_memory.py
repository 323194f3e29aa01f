"""Memory of a batch of windows, one in each lane: the problem, the trial, and the quasi-Newton history."""

from typing import Any, NamedTuple

import numpy as np

from gliderhpc.kernels.elementwise import LANES, entry, lane_array, set_entry
from gliderhpc.kernels.jit import kernel
from gliderhpc.kernels.line_search import Search
from gliderhpc.kernels.window import TAPE

Array = Any

IDLE, STARTING, SEARCHING, RETURNING, ENDED, UNFLYABLE = range(6)
"""States of a lane: idle; evaluating its start; searching; evaluating its last point again after a failed search; done;
done because its start cannot be flown."""

SLOPE, NORM, FINITE, PITCH, SPEED2, RATE2, CHANGE2 = range(7)
"""Rows of `Descent.measured`."""

RUN = 96
"""Number of unknowns of which a direction is summed up at once; with all lanes, they stay in the first-level cache."""


class Problem(NamedTuple):
    """Windows of ``n`` steps, and buffers for their cost and gradient; the arrays have an axis of lanes after these.

    Attributes
    ----------
    hull : (24,)
        Constants, as in `Hull`.
    bodies : (n, 11)
        Mass properties of each step.
    state0 : (1, 10)
        Sensed states at the start.
    measurements, weights : (n+1, 4), (n+1,)
        Samples ``[phi, theta, psi, Z]`` and their weights.
    durations : (n,)
        Length of each step, s; zero after a window's own end.
    scale : (6,)
        Scale s of the control-variable transform.
    trial : (n, 6)
        Disturbance to be evaluated, N and N m.
    states, tape, gradient, gradient_state0, cost : (n+1, 10), (n, TAPE), (n, 6), (10,), (1,)
        Sensed states, tape, gradients and cost of the trial.
    """

    hull: Array
    bodies: Array
    state0: Array
    measurements: Array
    weights: Array
    durations: Array
    scale: Array
    trial: Array
    states: Array
    tape: Array
    gradient: Array
    gradient_state0: Array
    cost: Array


class Descent(NamedTuple):
    """Progress of each lane's descent in the scaled unknown ``x = b / s``; arrays have an axis of lanes after these.

    The six unknowns of a step follow those of the step before. In one axis, a loop over those of a window alone is a
    loop over consecutive numbers.

    Attributes
    ----------
    point, slope, direction : (6 n,)
        Last accepted point, gradient there, direction of the search.
    taken, change : (6 n,)
        Step and change of the gradient between the last two accepted points.
    run : (RUN,)
        Scratch for a part of a direction.
    steps, changes : (m, 6 n)
        Stored pairs of steps and changes; the slot of the newest pair differs from lane to lane.
    measured : (7,)
        Properties of the trial: slope along the direction, largest entry of the scaled gradient, a sum that is finite
        if the gradient and the trajectory are, largest pitch, squared speed and squared rate of turning, and (where
        accepted) ``change . change``.
    products : (5, m)
        Products of the pairs with the gradient and with the newest pair.
    weights : (2 m + 1,)
        Weights of the pairs and of the gradient in the direction.
    aimed : (2,)
        Gradient along the direction, and the squared length of the direction.
    accepted, aiming, reach : (1,)
        1 where the trial becomes the point (2: with a new pair); 1 where a direction is needed; step along the
        direction.
    """

    point: Array
    slope: Array
    direction: Array
    taken: Array
    change: Array
    run: Array
    steps: Array
    changes: Array
    measured: Array
    products: Array
    weights: Array
    aimed: Array
    accepted: Array
    aiming: Array
    reach: Array


class LaneProgress(NamedTuple):
    """Progress of each lane, as numbers: arrays ``(LANES,)``, ``(1,)`` for a window alone, except for the last three.

    Attributes
    ----------
    status, iterations, evaluations, tries, pairs, newest, limit : int
        State of the lane (`IDLE` ...); numbers of iterations, of evaluations, of evaluations in this search, and of
        stored pairs; slot of the newest pair; number of iterations at which the descent stops.
    value, norm, least_norm, curvature : float
        Cost at the point; largest entry of the scaled gradient of the trial, and its value at which the descent stops;
        scale of the initial inverse Hessian.
    search : (LANES, 15)
        State of the line search (`Search`).
    step_change, change_change : (LANES, m, m)
        Products ``s_i . y_j`` and ``y_i . y_j``.
    """

    status: Array
    iterations: Array
    evaluations: Array
    tries: Array
    pairs: Array
    newest: Array
    limit: Array
    value: Array
    norm: Array
    least_norm: Array
    curvature: Array
    search: Array
    step_change: Array
    change_change: Array


def allocate(steps: int, history: int, *, alone: bool = False) -> tuple[Problem, Descent, LaneProgress]:
    """Allocate the memory for windows of up to ``steps`` steps and ``history`` pairs, with all lanes idle.

    There are `LANES` windows, or one if it is ``alone``: its arrays have no axis of lanes, and take a fraction of the
    memory and of the time.
    """
    n, m, count = steps, history, 1 if alone else LANES
    array = _numbers if alone else lane_array
    problem = Problem(
        hull=array(24), bodies=array(n, 11), state0=array(1, 10), measurements=array(n + 1, 4),
        weights=array(n + 1), durations=array(n), scale=array(6), trial=array(n, 6),
        states=array(n + 1, 10), tape=array(n, TAPE), gradient=array(n, 6),
        gradient_state0=array(10), cost=array(1),
    )  # fmt: skip
    # A lane that is never used computes, too: it flies straight ahead.
    problem.hull[...] = 1.0
    problem.scale[...] = 1.0
    problem.state0[0, 4] = 1.0
    descent = Descent(
        point=array(6 * n), slope=array(6 * n), direction=array(6 * n), taken=array(6 * n), change=array(6 * n),
        run=array(RUN), steps=array(m, 6 * n), changes=array(m, 6 * n), measured=array(7),
        products=array(5, m), weights=array(2 * m + 1), aimed=array(2), accepted=array(1),
        aiming=array(1), reach=array(1),
    )  # fmt: skip
    status, iterations, evaluations, tries, pairs, newest, limit = np.zeros((7, count), dtype=np.int64)
    value, norm, least_norm, curvature = np.zeros((4, count))
    progress = LaneProgress(
        status, iterations, evaluations, tries, pairs, newest, limit, value, norm, least_norm, curvature,
        search=np.zeros((count, len(Search._fields))), step_change=np.zeros((count, m, m)),
        change_change=np.zeros((count, m, m)),
    )  # fmt: skip
    return problem, descent, progress


def _numbers(*shape: int) -> Array:
    return np.zeros(shape)


@kernel
def load_window(
    problem, descent, progress, lane, hull, bodies, state0, measurements, weights, step, scale, start, least_norm, limit
):
    """Load a window into a lane: arrays as in `WindowData`, ``start (n, 6)``; norm and iterations at which to stop."""
    own = bodies.shape[0]
    for i in range(24):
        set_entry(problem.hull, i, lane, hull[i])
    for i in range(10):
        set_entry(problem.state0, (0, i), lane, state0[i])
    for i in range(6):
        set_entry(problem.scale, i, lane, scale[i])
    for k in range(problem.bodies.shape[0]):
        inside = k < own
        row = k if inside else own - 1
        set_entry(problem.durations, k, lane, step if inside else 0.0)
        set_entry(problem.weights, k + 1, lane, weights[k + 1] if inside else 0.0)
        for i in range(11):
            set_entry(problem.bodies, (k, i), lane, bodies[row, i])
        for i in range(4):
            set_entry(problem.measurements, (k + 1, i), lane, measurements[row + 1, i])
        for i in range(6):
            x = start[k, i] / scale[i] if inside else 0.0
            set_entry(descent.point, 6 * k + i, lane, x)
            set_entry(descent.slope, 6 * k + i, lane, 0.0)
            set_entry(descent.direction, 6 * k + i, lane, 0.0)
            set_entry(problem.trial, (k, i), lane, scale[i] * x)
    set_entry(descent.reach, 0, lane, 0.0)
    progress.status[lane] = STARTING
    progress.iterations[lane] = 0
    progress.evaluations[lane] = 0
    progress.tries[lane] = 0
    progress.pairs[lane] = 0
    progress.newest[lane] = -1
    progress.curvature[lane] = 1.0
    progress.least_norm[lane] = least_norm
    progress.limit[lane] = limit


@kernel
def read_window(problem, lane, disturbances, states):
    """Copy a lane's trial ``(n, 6)`` and its states ``(n+1, 10)``."""
    for k in range(states.shape[0]):
        for i in range(10):
            states[k, i] = entry(problem.states, (k, i), lane)
    for k in range(disturbances.shape[0]):
        for i in range(6):
            disturbances[k, i] = entry(problem.trial, (k, i), lane)
