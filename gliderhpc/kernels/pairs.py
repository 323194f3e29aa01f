"""The history of limited-memory BFGS for one window in each lane: pairs of steps and changes of the gradient.

The two-loop recursion (Nocedal, 1980, Math. Comp. 35, 773-782) uses only the products of the pairs (a few hundred
numbers per lane); the pairs themselves are read only twice per iteration, in long streams.
"""

from gliderhpc.kernels.elementwise import entry, load, select, set_entry, store, zero_like
from gliderhpc.kernels.jit import formula, inner_kernel, kernel
from gliderhpc.kernels.lane_memory import CHANGE2, RUN


@inner_kernel
def clear_pairs(progress, lane):
    """Discard a lane's history; the next pair is stored in the first slot."""
    progress.pairs[lane] = 0
    progress.newest[lane] = -1


@inner_kernel
def keep_pairs(descent, progress):
    """Write the new pairs into their lanes' slots, and update the products of the pairs."""
    most = 0
    for lane in range(progress.status.shape[0]):
        if entry(descent.accepted, 0, lane) == 2.0:
            slot = progress.newest[lane]
            for e in range(descent.taken.shape[0]):
                set_entry(descent.steps, (slot, e), lane, entry(descent.taken, e, lane))
                set_entry(descent.changes, (slot, e), lane, entry(descent.change, e, lane))
        most = max(most, progress.pairs[lane])
    for slot in range(0, most, 2):
        multiply_pairs(descent, slot, min(slot + 1, most - 1))
    for lane in range(progress.status.shape[0]):
        if entry(descent.accepted, 0, lane) == 2.0:
            newest = progress.newest[lane]
            for slot in range(progress.pairs[lane]):
                progress.step_change[lane, slot, newest] = entry(descent.products, (2, slot), lane)
                progress.step_change[lane, newest, slot] = entry(descent.products, (3, slot), lane)
                progress.change_change[lane, slot, newest] = entry(descent.products, (4, slot), lane)
                progress.change_change[lane, newest, slot] = entry(descent.products, (4, slot), lane)
            progress.curvature[lane] /= entry(descent.measured, CHANGE2, lane)


@kernel
def multiply_pairs(descent, first, second):
    """Store products of two slots' pairs with the gradient and with the newest pair: s.g, y.g, s.y', y.s', y.y'.

    A sum has to wait for its last addition; those of two slots wait at the same time, and read gradient and newest pair
    once.
    """
    zero = zero_like(load(descent.reach, 0))
    sg, yg, sy, ys, yy = zero, zero, zero, zero, zero
    sg2, yg2, sy2, ys2, yy2 = zero, zero, zero, zero, zero
    for e in range(descent.slope.shape[0]):
        g, step, change = load(descent.slope, e), load(descent.taken, e), load(descent.change, e)
        s, y = load(descent.steps, (first, e)), load(descent.changes, (first, e))
        sg += s * g
        yg += y * g
        sy += s * change
        ys += y * step
        yy += y * change
        s, y = load(descent.steps, (second, e)), load(descent.changes, (second, e))
        sg2 += s * g
        yg2 += y * g
        sy2 += s * change
        ys2 += y * step
        yy2 += y * change
    store_products(descent, first, sg, yg, sy, ys, yy)
    store_products(descent, second, sg2, yg2, sy2, ys2, yy2)


@formula
def store_products(descent, slot, sg, yg, sy, ys, yy):
    """Write the products of one slot's pair."""
    store(descent.products, (0, slot), sg)
    store(descent.products, (1, slot), yg)
    store(descent.products, (2, slot), sy)
    store(descent.products, (3, slot), ys)
    store(descent.products, (4, slot), yy)


@kernel
def combine_pairs(descent, progress):
    """Run the two-loop recursion on the products: weights of pairs and gradient in each requested direction."""
    slots = descent.steps.shape[0]
    for lane in range(progress.status.shape[0]):
        if entry(descent.aiming, 0, lane) == 0.0:
            continue
        for j in range(2 * slots):
            set_entry(descent.weights, j, lane, 0.0)
        count, newest = progress.pairs[lane], progress.newest[lane]
        gamma = progress.curvature[lane] if count > 0 else 1.0
        sy, yy = progress.step_change[lane], progress.change_change[lane]
        for back in range(count):  # from the newest to the oldest
            i = (newest - back) % slots
            total = entry(descent.products, (0, i), lane)
            for newer in range(back):
                j = (newest - newer) % slots
                total -= entry(descent.weights, slots + j, lane) * sy[i, j]
            set_entry(descent.weights, slots + i, lane, total / sy[i, i])
        for forth in range(count):  # from the oldest to the newest
            i = (newest - count + 1 + forth) % slots
            total = entry(descent.products, (1, i), lane)
            for any_pair in range(count):
                j = (newest - any_pair) % slots
                total -= entry(descent.weights, slots + j, lane) * yy[i, j]
            total *= gamma
            for older in range(forth):
                j = (newest - count + 1 + older) % slots
                total -= entry(descent.weights, j, lane) * sy[j, i]
            set_entry(descent.weights, i, lane, total / sy[i, i] - entry(descent.weights, slots + i, lane))
        for i in range(slots):
            set_entry(descent.weights, slots + i, lane, gamma * entry(descent.weights, slots + i, lane))
        set_entry(descent.weights, 2 * slots, lane, -gamma)


@inner_kernel
def _sum_run(descent, first, count, pairs):
    """Sum up ``count`` unknowns of the directions, from ``first`` on: weighted gradient, steps and changes.

    Pair by pair: the loops over the unknowns of a window alone are then over consecutive numbers.
    """
    slots = descent.steps.shape[0]
    weight = load(descent.weights, 2 * slots)
    for e in range(count):
        store(descent.run, e, weight * load(descent.slope, first + e))
    for j in range(pairs):
        of_step, of_change = load(descent.weights, j), load(descent.weights, slots + j)
        for e in range(count):
            d = load(descent.run, e) + of_step * load(descent.steps, (j, first + e))
            store(descent.run, e, d + of_change * load(descent.changes, (j, first + e)))


@kernel
def point_directions(descent, progress):
    """Write the direction of the lanes that need one, from their weights."""
    wanted = load(descent.aiming, 0) > 0.0
    most = 0
    for lane in range(progress.status.shape[0]):
        if entry(descent.aiming, 0, lane) > 0.0:
            most = max(most, progress.pairs[lane])
    zero = zero_like(load(descent.reach, 0))
    along, square = zero, zero
    for first in range(0, descent.slope.shape[0], RUN):
        count = min(RUN, descent.slope.shape[0] - first)
        _sum_run(descent, first, count, most)
        for e in range(count):
            d = select(wanted, load(descent.run, e), load(descent.direction, first + e))
            along += load(descent.slope, first + e) * d
            square += d * d
            store(descent.direction, first + e, d)
    store(descent.aimed, 0, along)
    store(descent.aimed, 1, square)
