"""Limited-memory BFGS with a strong-Wolfe line search for one window in each lane, with synchronous evaluations.

Every lane has its own iterations, steps and history (`gliderhpc.kernels.pairs`). All lanes are evaluated together; then
each lane is updated by itself. A lane does not depend on the others: arithmetic is elementwise, and sums are taken over
one lane in a fixed order. A window alone, in arrays without an axis of lanes
(`gliderhpc.kernels.lane_memory.allocate`), is solved by the same code on numbers, with the same result bit for bit.
"""

import math

from gliderhpc.kernels.elementwise import entry, load, select, set_entry, store, zero_like
from gliderhpc.kernels.jit import inner_kernel, kernel
from gliderhpc.kernels.lane_memory import (
    CHANGE2,
    ENDED,
    FINITE,
    IDLE,
    NORM,
    PITCH,
    RATE2,
    RETURNING,
    SEARCHING,
    SLOPE,
    SPEED2,
    STARTING,
    UNFLYABLE,
)
from gliderhpc.kernels.line_search import CONTINUE, Search, advance_search, start_search
from gliderhpc.kernels.pairs import clear_pairs, combine_pairs, keep_pairs, point_directions
from gliderhpc.kernels.window import cost_and_gradient

MAX_TRIES = 20
"""Number of evaluations after which a line search has failed (as in L-BFGS-B)."""
MAX_PITCH = math.radians(89.0)
MAX_SPEED2 = 25.0
MAX_RATE2 = 36.0
"""Bounds of the model's domain: pitch (rad), squared speed (m2/s2), and squared rate of turning (rad2/s2): a turn a
second, about, is faster than any glider."""
_EPSILON = 2.220446049250313e-16


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
    pitch, speed2, rate2 = zero, zero, zero
    for k in range(problem.states.shape[0]):
        theta = abs(load(problem.states, (k, 1)))
        u, v, w = load(problem.states, (k, 4)), load(problem.states, (k, 5)), load(problem.states, (k, 6))
        p, q, r = load(problem.states, (k, 7)), load(problem.states, (k, 8)), load(problem.states, (k, 9))
        square, turning = u * u + v * v + w * w, p * p + q * q + r * r
        finite += theta + square + turning
        pitch = select(theta > pitch, theta, pitch)
        speed2 = select(square > speed2, square, speed2)
        rate2 = select(turning > rate2, turning, rate2)
    store(descent.measured, SLOPE, slope)
    store(descent.measured, NORM, norm)
    store(descent.measured, FINITE, finite)
    store(descent.measured, PITCH, pitch)
    store(descent.measured, SPEED2, speed2)
    store(descent.measured, RATE2, rate2)


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
        progress.norm[lane] = entry(descent.measured, NORM, lane)
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
        and math.isfinite(entry(descent.measured, FINITE, lane))
        and entry(descent.measured, PITCH, lane) < MAX_PITCH
        and entry(descent.measured, SPEED2, lane) < MAX_SPEED2
        and entry(descent.measured, RATE2, lane) < MAX_RATE2
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
    value, slope = entry(problem.cost, 0, lane), entry(descent.measured, SLOPE, lane)
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
    store(descent.measured, CHANGE2, square)


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


@kernel
def place_trial(problem, descent):
    """Write the unscaled trial of every lane: the point plus its step along the direction."""
    reach = load(descent.reach, 0)
    for k in range(problem.trial.shape[0]):
        for i in range(6):
            x = load(descent.point, 6 * k + i) + reach * load(descent.direction, 6 * k + i)
            store(problem.trial, (k, i), load(problem.scale, i) * x)
