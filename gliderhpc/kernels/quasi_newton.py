"""Limited-memory BFGS with a strong-Wolfe line search for one window in each lane, with synchronous evaluations.

Every lane has its own iterations, steps and history. All lanes are evaluated together; then each lane is updated by
itself. The two-loop recursion (Nocedal, 1980, Math. Comp. 35, 773-782) uses only the products of the pairs (a few
hundred numbers per lane); the pairs themselves are read only twice per iteration, in long streams. A lane does not
depend on the others: arithmetic is elementwise, and sums are taken over one lane in a fixed order. A window alone, in
arrays without an axis of lanes (`gliderhpc.kernels.lane_memory.allocate`), is solved by the same code on numbers, with
the same result to the bit.
"""

import math

from gliderhpc.kernels.elementwise import entry, load, select, set_entry, store, zero_like
from gliderhpc.kernels.jit import formula, inner_kernel, kernel
from gliderhpc.kernels.lane_memory import ENDED, IDLE, RETURNING, RUN, SEARCHING, STARTING, UNFLYABLE
from gliderhpc.kernels.line_search import CONTINUE, Search, advance_search, start_search
from gliderhpc.kernels.window import cost_and_gradient

MAX_TRIES = 20
"""Number of evaluations after which a line search has failed (as in L-BFGS-B)."""
MAX_PITCH = math.radians(89.0)
MAX_SPEED2 = 25.0
"""Bound of the model's domain on the squared speed, m2/s2; that on the pitch, `MAX_PITCH`, is in rad."""
_EPSILON = 2.220446049250313e-16
_SLOPE, _NORM, _FINITE, _PITCH, _SPEED2, _CHANGE2 = range(6)


@kernel
def run_until_done(problem, descent, progress):
    """Evaluate and decide until a lane is done (`ENDED` or `UNFLYABLE`) or none is active."""
    done = False
    while not done:
        done = advance(problem, descent, progress)


@kernel
def advance(problem, descent, progress):
    """Evaluate every lane's trial once and place its next; return whether a lane is done or none is active."""
    p = problem
    cost_and_gradient(
        p.hull, p.bodies, p.state0, p.trial, p.measurements, p.weights, p.durations, p.states, p.tape, p.gradient,
        p.gradient_state0, p.cost,
    )  # fmt: skip
    return proceed(problem, descent, progress)


@kernel
def proceed(problem, descent, progress):
    """Process every lane's evaluated trial and place its next; return the same as `advance`."""
    measure_trial(problem, descent)
    done, accepted, aiming = decide(problem, descent, progress)
    if accepted:
        accept_trial(problem, descent)
        keep_pairs(descent, progress)
    while aiming:
        combine_pairs(descent, progress)
        aiming = aim(descent, progress)
    place_trial(problem, descent)
    return done


@kernel
def measure_trial(problem, descent):
    """Store slope, largest gradient and extremes of the trajectory in ``measured``."""
    zero = zero_like(load(problem.scale, 0))
    slope, norm, finite = zero, zero, zero
    for k in range(problem.gradient.shape[0]):
        for i in range(6):
            g = load(problem.scale, i) * load(problem.gradient, (k, i))
            slope += g * load(descent.direction, 6 * k + i)
            finite += abs(g)
            norm = select(abs(g) > norm, abs(g), norm)
    pitch, speed2 = zero, zero
    for k in range(problem.states.shape[0]):
        theta = abs(load(problem.states, (k, 1)))
        u, v, w = load(problem.states, (k, 4)), load(problem.states, (k, 5)), load(problem.states, (k, 6))
        square = u * u + v * v + w * w
        finite += theta + square
        pitch = select(theta > pitch, theta, pitch)
        speed2 = select(square > speed2, square, speed2)
    store(descent.measured, _SLOPE, slope)
    store(descent.measured, _NORM, norm)
    store(descent.measured, _FINITE, finite)
    store(descent.measured, _PITCH, pitch)
    store(descent.measured, _SPEED2, speed2)


@kernel
def decide(problem, descent, progress):
    """Update each lane with its evaluation; return whether any is done (or none active), accepted, or to be aimed."""
    done, accepted, aiming, working = False, False, False, False
    for lane in range(progress.status.shape[0]):
        set_entry(descent.accepted, 0, lane, 0.0)
        set_entry(descent.aiming, 0, lane, 0.0)
        status = progress.status[lane]
        if status == IDLE or status >= ENDED:
            continue
        progress.evaluations[lane] += 1
        progress.norm[lane] = entry(descent.measured, _NORM, lane)
        if status == STARTING:
            begin_descent(problem, descent, progress, lane)
        elif status == RETURNING:
            progress.status[lane] = ENDED
        else:
            search_on(problem, descent, progress, lane)
        done |= progress.status[lane] >= ENDED
        working |= progress.status[lane] < ENDED
        accepted |= entry(descent.accepted, 0, lane) > 0.0
        aiming |= entry(descent.aiming, 0, lane) > 0.0
    return done or not working, accepted, aiming


@kernel
def flyable(problem, descent, lane):
    """Return whether a lane's trial is finite and stays inside the model's domain."""
    return (
        math.isfinite(entry(problem.cost, 0, lane))
        and math.isfinite(entry(descent.measured, _FINITE, lane))
        and entry(descent.measured, _PITCH, lane) < MAX_PITCH
        and entry(descent.measured, _SPEED2, lane) < MAX_SPEED2
    )


@inner_kernel
def begin_descent(problem, descent, progress, lane):
    """Accept the start as the first point, if it can be flown."""
    if not flyable(problem, descent, lane):
        progress.status[lane] = UNFLYABLE
        return
    progress.value[lane] = entry(problem.cost, 0, lane)
    if progress.norm[lane] <= progress.least_norm[lane]:
        progress.status[lane] = ENDED
        return
    set_entry(descent.accepted, 0, lane, 1.0)
    set_entry(descent.aiming, 0, lane, 1.0)
    progress.status[lane] = SEARCHING


@inner_kernel
def load_search(progress, lane):
    """Return a lane's line search."""
    row = progress.search[lane]
    return Search(
        row[0], row[1], row[2], row[3], row[4], row[5], row[6], row[7], row[8], row[9], row[10], row[11], row[12],
        row[13], row[14],
    )  # fmt: skip


@inner_kernel
def store_search(progress, lane, search):
    """Store a lane's line search."""
    for i in range(15):
        progress.search[lane, i] = search[i]


@inner_kernel
def search_on(problem, descent, progress, lane):
    """Advance the lane's line search with the evaluation: accept the trial, give up, or try the next step."""
    search = load_search(progress, lane)
    progress.tries[lane] += 1
    value, slope = entry(problem.cost, 0, lane), entry(descent.measured, _SLOPE, lane)
    verdict = CONTINUE
    if flyable(problem, descent, lane):
        search, verdict = advance_search(search, value, slope)
    else:
        # Replace the cost by a steep bowl about the last point, higher and uphill; the search then shortens its step.
        search, verdict = advance_search(
            search, search.value0 + 0.5 * (1.0 + search.value0), (1.0 + search.value0) / search.step
        )
    store_search(progress, lane, search)
    if verdict != CONTINUE and flyable(problem, descent, lane):
        accept(descent, progress, lane, search, value, slope)
    elif verdict != CONTINUE or progress.tries[lane] >= MAX_TRIES:
        give_up_search(descent, progress, lane)
    else:
        set_entry(descent.reach, 0, lane, search.step)


@kernel
def accept(descent, progress, lane, search, value, slope):
    """Accept the trial as the point; end there, or request the next direction."""
    progress.iterations[lane] += 1
    fallen = progress.value[lane] - value
    progress.value[lane] = value
    if (
        progress.norm[lane] <= progress.least_norm[lane]
        or progress.iterations[lane] >= progress.limit[lane]
        or progress.evaluations[lane] > MAX_TRIES * progress.limit[lane]
        or fallen <= 0.0
    ):
        progress.status[lane] = ENDED
        return
    set_entry(descent.accepted, 0, lane, 1.0)
    set_entry(descent.aiming, 0, lane, 1.0)
    # A pair without positive curvature is not stored.
    gained = (slope - search.slope0) * search.step
    if gained > -_EPSILON * search.slope0 * search.step:
        slots = descent.steps.shape[0]
        progress.newest[lane] = (progress.newest[lane] + 1) % slots
        progress.pairs[lane] = min(progress.pairs[lane] + 1, slots)
        progress.curvature[lane] = gained
        set_entry(descent.accepted, 0, lane, 2.0)


@inner_kernel
def give_up_search(descent, progress, lane):
    """Restart from the last point along the steepest descent; if that has been tried, return to the point and end."""
    if progress.pairs[lane] == 0:
        set_entry(descent.reach, 0, lane, 0.0)
        progress.status[lane] = RETURNING
        return
    clear_pairs(progress, lane)
    set_entry(descent.aiming, 0, lane, 1.0)


@inner_kernel
def clear_pairs(progress, lane):
    """Discard a lane's history; the next pair is stored in the first slot."""
    progress.pairs[lane] = 0
    progress.newest[lane] = -1


@kernel
def accept_trial(problem, descent):
    """Move the accepted lanes to their trial; store step and change of gradient in ``taken`` and ``change``."""
    moves = load(descent.accepted, 0) > 0.0
    reach = load(descent.reach, 0)
    square = zero_like(reach)
    for k in range(problem.gradient.shape[0]):
        for i in range(6):
            e = 6 * k + i
            old = load(descent.slope, e)
            new = load(problem.scale, i) * load(problem.gradient, (k, i))
            step, change = reach * load(descent.direction, e), new - old
            square += change * change
            store(descent.taken, e, step)
            store(descent.change, e, change)
            store(descent.slope, e, select(moves, new, old))
            point = load(descent.point, e)
            store(descent.point, e, select(moves, point + step, point))
    store(descent.measured, _CHANGE2, square)


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
            progress.curvature[lane] /= entry(descent.measured, _CHANGE2, lane)


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


@kernel
def aim(descent, progress):
    """Form the requested directions and start their searches; return whether one is uphill and must be formed again."""
    point_directions(descent, progress)
    again = False
    for lane in range(progress.status.shape[0]):
        if entry(descent.aiming, 0, lane) == 0.0:
            continue
        slope = entry(descent.aimed, 0, lane)
        # Uphill, or NaN if rounding has left a pair without curvature.
        if not slope < 0.0 and progress.pairs[lane] > 0:
            clear_pairs(progress, lane)
            again = True
            continue
        set_entry(descent.aiming, 0, lane, 0.0)
        progress.tries[lane] = 0
        # The very first step has no scale; it gets unit length.
        first = progress.iterations[lane] == 0
        step = 1.0 / math.sqrt(entry(descent.aimed, 1, lane)) if first else 1.0
        store_search(progress, lane, start_search(progress.value[lane], slope, step))
        set_entry(descent.reach, 0, lane, step)
    return again


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


@kernel
def place_trial(problem, descent):
    """Write the unscaled trial of every lane: the point plus its step along the direction."""
    reach = load(descent.reach, 0)
    for k in range(problem.trial.shape[0]):
        for i in range(6):
            x = load(descent.point, 6 * k + i) + reach * load(descent.direction, 6 * k + i)
            store(problem.trial, (k, i), load(problem.scale, i) * x)
