"""Linearisation of a profile's segments by the states and by constant errors of the hull, one segment in each lane."""

from gliderhpc.kernels.constants_gradient import CONSTANTS, HULL_CONSTANTS, by_constants
from gliderhpc.kernels.dynamics import geometry_of
from gliderhpc.kernels.elementwise import LANES, clear, load, store
from gliderhpc.kernels.jit import formula, inner_kernel, kernel
from gliderhpc.kernels.mass import load_body
from gliderhpc.kernels.smoother_segments import (
    add_defects,
    begin_products,
    gather,
    pull_back,
    run_model,
    save_products,
    scatter_run,
    scatter_transition,
)
from gliderhpc.kernels.tangent import load_ten


@inner_kernel
def _gather_slopes(forcing, segments, number, gradient):
    """Copy the slopes of the mass properties of segments ``number`` to ``number + LANES`` into the lanes.

    Most of the time the actuators are at rest, and the slopes of the segments before are still those of these.
    """
    rows = segments.rows
    last = rows.shape[0] - 2
    for lane in range(LANES):
        segment = min(number + lane, last)
        first, stop = rows[segment], rows[segment + 1]
        for s in range(gradient.slopes.shape[0]):
            row = forcing.row[min(first + s, stop - 1)]
            if gradient.row[s, lane] != row:
                gradient.row[s, lane] = row
                for m in range(forcing.moving.shape[0]):
                    for i in range(CONSTANTS - HULL_CONSTANTS):
                        gradient.slopes[s, m, i, lane] = forcing.bodies[row, m, i]


@inner_kernel
def _slopes_differ(gradient, s):
    """Return whether the slopes of steps ``s`` and ``s - 1`` differ in any lane."""
    differ = False
    for lane in range(LANES):
        differ |= gradient.row[s, lane] != gradient.row[s - 1, lane]
    return differ


@formula
def _add(array, i, j, factor, value):
    store(array, (i, j), load(array, (i, j)) + factor * value)


@formula
def _add_eight(array, i, first, factor, values):
    """Add ``factor`` times eight values to row ``i``; a loop over a tuple of many would be compiled to jumps."""
    _add(array, i, first, factor, values[0])
    _add(array, i, first + 1, factor, values[1])
    _add(array, i, first + 2, factor, values[2])
    _add(array, i, first + 3, factor, values[3])
    _add(array, i, first + 4, factor, values[4])
    _add(array, i, first + 5, factor, values[5])
    _add(array, i, first + 6, factor, values[6])
    _add(array, i, first + 7, factor, values[7])


@inner_kernel
def _add_gradient(hull, lanes, gradient, s):
    """Add the derivatives of the segment's end by the constants that act at step ``s``."""
    h, body = load(lanes.durations, s), load_body(lanes.bodies, s)
    sixth = h / 6.0
    b = (
        load(lanes.disturbances, (s, 0)), load(lanes.disturbances, (s, 1)), load(lanes.disturbances, (s, 2)),
        load(lanes.disturbances, (s, 3)), load(lanes.disturbances, (s, 4)), load(lanes.disturbances, (s, 5)),
    )  # fmt: skip
    for number in range(4):
        y, costates = load_ten(lanes.stages[s], number), lanes.stage_costates[number]
        geometry = geometry_of(y)
        for i in range(12):
            found = by_constants(hull, body, y, geometry, b, load_ten(costates, i))
            _add_eight(gradient.hull, i, 0, sixth, found[0:8])
            _add_eight(gradient.hull, i, 8, sixth, found[8:16])
            _add_eight(gradient.hull, i, 16, sixth, found[16:24])
            _add_eight(gradient.body, i, 0, sixth, found[24:32])
            _add(gradient.body, i, 8, sixth, found[32])
            _add(gradient.body, i, 9, sixth, found[33])
            _add(gradient.body, i, 10, sixth, found[34])
    if s == 0 or _slopes_differ(gradient, s):
        for m in range(gradient.moving.shape[0]):
            for i in range(12):
                total = load(gradient.forced, (gradient.moving[m], i))
                for c in range(CONSTANTS - HULL_CONSTANTS):
                    total += load(gradient.slopes, (s, m, c)) * load(gradient.body, (i, c))
                store(gradient.forced, (gradient.moving[m], i), total)
        clear(gradient.body)


@inner_kernel
def _scatter_gradient(forcing, gradient, sensitivity, at):
    """Write the derivatives of the segments' ends by the parameters to the rows of the block from ``at`` on."""
    for e in range(forcing.constant.shape[0]):
        for i in range(12):
            total = load(gradient.forced, (gradient.place[e], i))
            total += forcing.slope[e] * load(gradient.hull, (i, forcing.constant[e]))
            store(gradient.forced, (gradient.place[e], i), total)
    for lane in range(LANES):
        forced = sensitivity.forced[at + lane]
        for q in range(gradient.acting.shape[0]):
            for i in range(12):
                forced[i, gradient.acting[q]] = gradient.forced[q, i, lane]


@kernel
def linearise_with_constants(
    hull, problem, forcing, states, disturbances, segments, number, block, at, tally, gradient, sensitivity
):
    """Linearise segments ``number`` to ``number + LANES`` by states and parameters, and save the products of each step.

    `gliderhpc.kernels.smoother_segments.linearise_segments` is the same without the derivatives by parameters, and with
    the noise.

    Parameters
    ----------
    at : int
        First row in the block, a multiple of `LANES`: the products are saved in group ``at // LANES``.
    tally, gradient : (14,), Gradient
        Scratch.
    sensitivity : SensitivityBlock
        Memory, in the field `forced` of which the derivatives are stored.
    """
    lanes = segments.lanes
    gather(problem, states, disturbances, segments, number)
    _gather_slopes(forcing, segments, number, gradient)
    run_model(hull, lanes)
    begin_products(lanes)
    clear(gradient.hull)
    clear(gradient.body)
    clear(gradient.forced)
    for s in range(lanes.durations.shape[0] - 1, -1, -1):
        add_defects(lanes, s)
        save_products(lanes, at // LANES, s)
        pull_back(hull, problem.decay, lanes, s, True)
        _add_gradient(hull, lanes, gradient, s)
    scatter_run(states, segments, number, tally)
    scatter_transition(segments, number, block, at)
    _scatter_gradient(forcing, gradient, sensitivity, at)
