"""Linearisation of a profile's segments: each lane takes one segment, and all have the same path of linearisation.

Covariances are needed where there are samples, which is once in several steps. A segment is a few steps without a
sample in between. The model runs from the path's state in its first row with the path's disturbances. Products of the
steps' transitions, computed by the transpose of the step, carry the states and the noise of its steps to its end; this
is exact for the linearised problem (docs/smoother.md).
"""

from gliderhpc.kernels.dynamics import horizontal_velocity, rates
from gliderhpc.kernels.elementwise import LANES, clear, load, store, zero_like
from gliderhpc.kernels.jacobian import store_partials, track_partials
from gliderhpc.kernels.jit import formula, inner_kernel, kernel
from gliderhpc.kernels.kalman import dot6
from gliderhpc.kernels.mass import load_body
from gliderhpc.kernels.rk4 import scaled, shifted
from gliderhpc.kernels.smoother_memory import DEFECTS, NOISE_COLUMN
from gliderhpc.kernels.tangent import NOTHING, decay_over, load_ten, pulled_over_step


@formula
def _load_six(array, k, first):
    """Return six entries of row ``k``, the first of them in column ``first``."""
    return (
        load(array, (k, first)), load(array, (k, first + 1)), load(array, (k, first + 2)),
        load(array, (k, first + 3)), load(array, (k, first + 4)), load(array, (k, first + 5)),
    )  # fmt: skip


@inner_kernel
def gather(problem, states, disturbances, segments, number):
    """Copy segments ``number`` to ``number + LANES`` into the lanes; a lane too many repeats the last segment."""
    lanes, rows = segments.lanes, segments.rows
    last = rows.shape[0] - 2
    for lane in range(LANES):
        segment = min(number + lane, last)
        first, stop = rows[segment], rows[segment + 1]
        for i in range(10):
            lanes.states[0, i, lane] = states[first, i if i < 3 else i + 2]
        lanes.states[0, 10, lane] = 0.0
        lanes.states[0, 11, lane] = 0.0
        for s in range(lanes.durations.shape[0]):
            k = min(first + s, stop - 1)
            within = first + s < stop
            lanes.durations[s, lane] = problem.step if within else 0.0
            for i in range(11):
                lanes.bodies[s, i, lane] = problem.bodies[k, i]
            for i in range(6):
                lanes.disturbances[s, i, lane] = disturbances[k, i]
                defect = problem.decay[i] * disturbances[k, i] - disturbances[k + 1, i]
                lanes.defects[s, i, lane] = defect if within else 0.0


@inner_kernel
def _gather_noise(noise, segments, number):
    """Copy the noise ``(n, 6)`` of segments ``number`` to ``number + LANES`` into the lanes; clear its sums."""
    lanes, rows = segments.lanes, segments.rows
    last = rows.shape[0] - 2
    for lane in range(LANES):
        segment = min(number + lane, last)
        first, stop = rows[segment], rows[segment + 1]
        for s in range(lanes.durations.shape[0]):
            for i in range(6):
                lanes.noise[s, i, lane] = noise[first + s, i] if first + s < stop else 0.0
    clear(lanes.gathered)
    clear(lanes.gathered_cross)
    clear(lanes.gathered_own)


@inner_kernel
def run_model(hull, lanes):
    """Run the model over the segments, and store the stages of each step.

    The Jacobians of the stages' rates, and those of the horizontal velocity, are multiplied by the step. They are
    stored even for a run without linearisation: its rounding is then that of the sweeps, bit for bit.
    """
    for s in range(lanes.durations.shape[0]):
        h, body, y = load(lanes.durations, s), load_body(lanes.bodies, s), load_ten(lanes.states, s)
        disturbance = _load_six(lanes.disturbances, s, 0)
        stage, total = y, scaled(0.0, y)
        north = east = zero_like(h)
        for number in range(4):
            inner = number == 1 or number == 2
            weight = 2.0 if inner else 1.0
            rate = rates(hull, body, stage, disturbance)
            to_north, to_east = horizontal_velocity(stage)
            store_partials(hull, body, stage, 0.5 * h if inner else h, lanes.partials, (s, number))
            track = track_partials(stage)
            for row in range(2):
                for i in range(6):
                    store(lanes.track_partials, (s, number, 1 + row, i), h * track[row][i])
            for i in range(10):
                store(lanes.stages, (s, number, i), stage[i])
            north, east = north + weight * to_north, east + weight * to_east
            total = shifted(total, weight, rate)
            stage = shifted(y, h if number == 2 else 0.5 * h, rate)
        # Summed first, as in `step`: a depth of hundreds of metres is then rounded only once per step.
        new = shifted(y, h / 6.0, total)
        for i in range(10):
            store(lanes.states, (s + 1, i), new[i])
        store(lanes.states, (s + 1, 10), load(lanes.states, (s, 10)) + h / 6.0 * north)
        store(lanes.states, (s + 1, 11), load(lanes.states, (s, 11)) + h / 6.0 * east)


@inner_kernel
def begin_products(lanes):
    """Begin the products at the segments' ends: identity, no decay, no defect."""
    clear(lanes.transition)
    clear(lanes.offset)
    one = zero_like(load(lanes.durations, 0)) + 1.0
    for i in range(10):
        store(lanes.transition, (i, i), one)
    for i in range(6):
        store(lanes.remaining, i, one)


@inner_kernel
def _add_noise(lanes, group, s):
    """Add the noise of step ``s``, carried from its end to the end of the segment by the products saved there."""
    noise, left = _load_six(lanes.noise, s, 0), lanes.by_own[group]
    if s < lanes.by_noise.shape[1]:
        products, moved = lanes.by_noise[group, s], lanes.track_by_noise[group % lanes.track_by_noise.shape[0], s]
        for i in range(12):
            t = _load_six(products, i, 0) if i < 10 else _load_six(moved, i - 10, 0)
            weighted = (
                noise[0] * t[0], noise[1] * t[1], noise[2] * t[2], noise[3] * t[3], noise[4] * t[4], noise[5] * t[5],
            )  # fmt: skip
            for j in range(min(i + 1, 10)):
                total = load(lanes.gathered, (i, j)) + dot6(weighted, _load_six(products, j, 0))
                store(lanes.gathered, (i, j), total)
            for j in range(10, i + 1):
                total = load(lanes.gathered, (i, j)) + dot6(weighted, _load_six(moved, j - 10, 0))
                store(lanes.gathered, (i, j), total)
            for j in range(6):
                total = load(lanes.gathered_cross, (j, i)) + weighted[j] * load(left, (s, j))
                store(lanes.gathered_cross, (j, i), total)
    for j in range(6):
        own = load(left, (s, j))
        store(lanes.gathered_own, j, load(lanes.gathered_own, j) + noise[j] * own * own)


@inner_kernel
def add_defects(lanes, s):
    """Add the disturbances' defects of step ``s``, carried from its end to the end of the segment."""
    defects = _load_six(lanes.defects, s, 0)
    for i in range(10):
        store(lanes.offset, i, load(lanes.offset, i) + dot6(defects, _load_six(lanes.transition, i, 10)))
    for j in range(6):
        store(lanes.offset, 10 + j, load(lanes.offset, 10 + j) + defects[j] * load(lanes.remaining, j))


@inner_kernel
def save_products(lanes, group, s):
    """Save the products at the end of step ``s``, for the noise and for the backward sweep.

    The noise of the last step acts on nothing but its disturbance.
    """
    if s < lanes.by_noise.shape[1]:
        place = group % lanes.track_by_noise.shape[0]
        for j in range(6):
            for i in range(10):
                store(lanes.by_noise, (group, s, i, j), load(lanes.transition, (i, 10 + j)))
            for i in range(2):
                store(lanes.track_by_noise, (place, s, i, j), load(lanes.transition, (10 + i, 10 + j)))
    for j in range(6):
        store(lanes.by_own, (group, s, j), load(lanes.remaining, j))
    if s == 0:
        for i in range(10):
            for j in range(16):
                store(lanes.after, (i, j), load(lanes.transition, (i, j)))


@formula
def _load_track(partials, s, number, row, zero):
    """Return the derivative of X (``row`` 1) or Y (2) by the ten sensed states at a stage of step ``s``; zeros (0)."""
    at = (s, number, row)
    return (
        load(partials, (*at, 0)), load(partials, (*at, 1)), load(partials, (*at, 2)), zero,
        load(partials, (*at, 3)), load(partials, (*at, 4)), load(partials, (*at, 5)),
        zero, zero, zero,
    )  # fmt: skip


@formula
def _track_at(lanes, s, row, zero):
    """Return the derivatives of X (``row`` 1) or Y (2) by the sensed states at the four stages of step ``s``."""
    return (
        _load_track(lanes.track_partials, s, 0, row, zero), _load_track(lanes.track_partials, s, 1, row, zero),
        _load_track(lanes.track_partials, s, 2, row, zero), _load_track(lanes.track_partials, s, 3, row, zero),
    )  # fmt: skip


@formula
def _pull_row(decay, lanes, s, i, by_stages, h, zero, pushes, with_costates):
    """Multiply row ``i`` of the transition from the right by the transition of step ``s``."""
    transition = lanes.transition
    new, costates = pulled_over_step(lanes.partials, s, load_ten(transition, i), by_stages, zero)
    n1, n2, n3, n4 = costates
    for j in range(10):
        store(transition, (i, j), new[j])
    if with_costates:
        for j in range(10):
            store(lanes.stage_costates, (0, i, j), n1[j])
            store(lanes.stage_costates, (1, i, j), n2[j])
            store(lanes.stage_costates, (2, i, j), n3[j])
            store(lanes.stage_costates, (3, i, j), n4[j])
    for j in range(6):
        decayed = load(transition, (i, 10 + j)) * decay_over(decay, h, j)
        store(transition, (i, 10 + j), decayed + pushes[j] * (n4[4 + j] + n3[4 + j] + n2[4 + j] + n1[4 + j]))


@inner_kernel
def pull_back(hull, decay, lanes, s, with_costates):
    """Multiply the transition from the right by that of step ``s``; the stages' costates are stored if requested."""
    h = load(lanes.durations, s)
    sixth, zero = h / 6.0, zero_like(h)
    pushes = (
        sixth / hull.mass_u, sixth / hull.mass_v, sixth / hull.mass_w,
        sixth / hull.inertia_p, sixth / hull.inertia_q, sixth / hull.inertia_r,
    )  # fmt: skip
    for i in range(10):
        _pull_row(decay, lanes, s, i, (NOTHING, NOTHING, NOTHING, NOTHING), h, zero, pushes, with_costates)
    for i in range(10, 12):
        _pull_row(decay, lanes, s, i, _track_at(lanes, s, i - 9, zero), h, zero, pushes, with_costates)
    for j in range(6):
        store(lanes.remaining, j, load(lanes.remaining, j) * decay_over(decay, h, j))


@inner_kernel
def scatter_run(states, segments, number, tally):
    """Write the run of each segment into the path, up to the row before its end; X and Y up to its end.

    The defects of the sensed states are added to the offsets.
    """
    lanes, rows = segments.lanes, segments.rows
    for lane in range(min(LANES, rows.shape[0] - 1 - number)):
        first, stop = rows[number + lane], rows[number + lane + 1]
        for k in range(first, stop):
            s = k - first
            states[k + 1, 3] = states[first, 3] + lanes.states[s + 1, 10, lane]
            states[k + 1, 4] = states[first, 4] + lanes.states[s + 1, 11, lane]
            if k + 1 < stop:
                for i in range(10):
                    states[k + 1, i if i < 3 else i + 2] = lanes.states[s + 1, i, lane]
        for i in range(10):
            defect = lanes.states[stop - first, i, lane] - states[stop, i if i < 3 else i + 2]
            lanes.offset[i, lane] += defect
            tally[DEFECTS + i] += abs(defect)


@inner_kernel
def _add_cost_of_noise(problem, segments, number, tally):
    """Add the disturbances' defects in the segments to the cost."""
    lanes, rows = segments.lanes, segments.rows
    for lane in range(min(LANES, rows.shape[0] - 1 - number)):
        first = rows[number + lane]
        for k in range(first, rows[number + lane + 1]):
            for i in range(6):
                defect = lanes.defects[k - first, i, lane]
                tally[2] += 0.5 * defect * defect / problem.noise[k, i]


@inner_kernel
def scatter_transition(segments, number, block, at):
    """Write transitions and offsets to the rows of the block from ``at`` on."""
    lanes = segments.lanes
    for lane in range(min(LANES, segments.rows.shape[0] - 1 - number)):
        row = at + lane
        tangent, moved = block.tangent[row], block.track_tangent[row]
        for i in range(16):
            segments.offset[row, i] = lanes.offset[i, lane]
            for j in range(10):
                tangent[i, j] = lanes.transition[j, i, lane]
            moved[0, i] = lanes.transition[10, i, lane]
            moved[1, i] = lanes.transition[11, i, lane]
        for i in range(6):
            tangent[10 + i, 10 + i] = lanes.remaining[i, lane]


@inner_kernel
def write_transition(tangent, transition):
    """Write the transition of which ``tangent (16, 16)`` is the transpose: ten rows, and the decay in the last one."""
    for i in range(10):
        for j in range(16):
            transition[i, j] = tangent[j, i]
    for i in range(10, 16):
        transition[10, i] = tangent[i, i]


@inner_kernel
def _scatter_noise(segments, number, at):
    """Write the covariances of the noise to the rows of the block from ``at`` on."""
    lanes = segments.lanes
    for lane in range(min(LANES, segments.rows.shape[0] - 1 - number)):
        row = at + lane
        noise, cross, track = segments.noise[row], segments.noise_cross[row], segments.noise_track[row]
        for i in range(10):
            for j in range(i + 1):
                noise[i, j] = lanes.gathered[i, j, lane]
                noise[j, i] = noise[i, j]
            for j in range(6):
                noise[10 + j, i] = lanes.gathered_cross[j, i, lane]
                noise[i, 10 + j] = noise[10 + j, i]
            cross[0, i] = lanes.gathered[10, i, lane]
            cross[1, i] = lanes.gathered[11, i, lane]
        for i in range(6):
            noise[10 + i, 10 + i] = lanes.gathered_own[i, lane]
            cross[0, 10 + i] = lanes.gathered_cross[i, 10, lane]
            cross[1, 10 + i] = lanes.gathered_cross[i, 11, lane]
        track[0, 0], track[1, 1] = lanes.gathered[10, 10, lane], lanes.gathered[11, 11, lane]
        track[0, 1] = lanes.gathered[11, 10, lane]
        track[1, 0] = track[0, 1]


@inner_kernel
def sum_noise(noise, segments, number, group, at):
    """Sum up the noise ``(n, 6)`` of the steps of segments ``number`` to ``number + LANES``, in rows from ``at`` on.

    The products of these segments are those of group ``group``.
    """
    lanes = segments.lanes
    _gather_noise(noise, segments, number)
    for s in range(lanes.durations.shape[0] - 1, -1, -1):
        _add_noise(lanes, group, s)
    _scatter_noise(segments, number, at)


@inner_kernel
def scatter_after(segments, number, tape):
    """Write the transition after the first step of the segments whose mean shift is computed."""
    lanes = segments.lanes
    for lane in range(min(LANES, segments.rows.shape[0] - 1 - number)):
        if segments.represented_steps[number + lane] > 0:
            after = tape.after[tape.shift[number + lane]]
            for i in range(16):
                for j in range(10):
                    after[j, i] = lanes.after[j, i, lane]
            for j in range(6):
                after[10 + j, 10 + j] = lanes.by_own[number // LANES, 0, j, lane]


@inner_kernel
def scatter_products(segments, group):
    """Write the derivatives by the noise of a group of segments, one in each lane, to the rows of `by_noise`."""
    lanes, first = segments.lanes, group * LANES
    for lane in range(min(LANES, segments.rows.shape[0] - 1 - first)):
        for s in range(segments.rows[first + lane + 1] - segments.rows[first + lane]):
            by_noise = segments.by_noise[lane, s]
            for j in range(6):
                by_noise[10, NOISE_COLUMN + j] = lanes.by_own[group, s, j, lane]
            if s < lanes.by_noise.shape[1]:
                for i in range(10):
                    for j in range(6):
                        by_noise[i, NOISE_COLUMN + j] = lanes.by_noise[group, s, i, j, lane]


@kernel
def linearise_segments(hull, problem, states, disturbances, segments, number, group, block, at, tally):
    """Linearise segments ``number`` to ``number + LANES`` of the profile; results go to rows from ``at`` of the block.

    Parameters
    ----------
    hull, problem : Hull, SmootherProblem
        The problem.
    states, disturbances : (n+1, 12), (n+1, 6)
        Path of linearisation. The rows inside the segments are replaced by the model's run, and X and Y by the
        displacement along it.
    segments, block : Segments, Block
        Memory, in which the results are stored.
    number, group, at : int
        First segment, the group in which its products are saved, and its row in the block.
    tally : (14,)
        Sums as in `gliderhpc.kernels.smoother.forward`; those of defects and noise are added.
    """
    lanes = segments.lanes
    gather(problem, states, disturbances, segments, number)
    run_model(hull, lanes)
    begin_products(lanes)
    for s in range(lanes.durations.shape[0] - 1, -1, -1):
        add_defects(lanes, s)
        save_products(lanes, group, s)
        pull_back(hull, problem.decay, lanes, s, False)
    scatter_run(states, segments, number, tally)
    scatter_transition(segments, number, block, at)
    sum_noise(problem.noise, segments, number, group, at)
    _add_cost_of_noise(problem, segments, number, tally)


@inner_kernel
def run_segments(hull, problem, states, disturbances, segments, tally):
    """Replace the rows inside the segments by the model's run, and X and Y by the displacement along it.

    The arguments are those of `linearise_segments`.
    """
    for number in range(0, segments.rows.shape[0] - 1, LANES):
        gather(problem, states, disturbances, segments, number)
        run_model(hull, segments.lanes)
        scatter_run(states, segments, number, tally)
        _add_cost_of_noise(problem, segments, number, tally)
