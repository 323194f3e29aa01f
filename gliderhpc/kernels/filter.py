"""Extended Kalman filter along the profiles of all lanes (eqs. 19-27), with gating, inflation and restarts.

A lane advances in blocks, from one fed sample of its own record to the next (`BLOCK` steps at most). Lanes with a
shorter block end it with steps of zero length, which leave every bit unchanged; the result of a lane does not depend
on the others.
"""

import math

from gliderhpc.kernels.elementary import wrap
from gliderhpc.kernels.elementwise import LANES, load, select, store, zero_like
from gliderhpc.kernels.filter_memory import BLOCK, ENDED, RUNNING, STARTING, reset_covariance
from gliderhpc.kernels.jacobian import ENTRIES
from gliderhpc.kernels.jit import formula, inner_kernel, kernel
from gliderhpc.kernels.kalman import predict_covariance, update
from gliderhpc.kernels.tangent import advance

GATED, INFLATED, RESET = 1, 2, 4
"""Events of a measured sample, as bits."""

_STEEPEST = 1.4835
_FASTEST2 = 9.0


@formula
def _flyable(path, k):
    """Mark lanes whose row ``k`` lies inside the model's domain: finite, pitch under 85 degrees, speed under 3 m/s."""
    total = load(path, (k, 0))
    for i in range(1, 18):
        total = total + load(path, (k, i))
    u, v, w = load(path, (k, 4)), load(path, (k, 5)), load(path, (k, 6))
    # A sum minus itself is zero exactly if every term is finite.
    return (total - total == 0.0) & (abs(load(path, (k, 1))) < _STEEPEST) & (u * u + v * v + w * w < _FASTEST2)


@formula
def _plausible(path, P):
    """Mark lanes whose estimate in row 0 is flyable, with finite and non-negative variances."""
    smallest = load(P, (0, 0))
    total = smallest
    for i in range(1, 16):
        variance = load(P, (i, i))
        smallest = select(variance < smallest, variance, smallest)
        total = total + variance
    return _flyable(path, 0) & (total - total == 0.0) & (smallest >= 0.0)


@formula
def _plan_block(records, progress):
    """Count each lane's steps to its next fed sample, the record's end or the block's; return the largest count."""
    longest = 0
    for lane in range(LANES):
        steps = 0
        if progress.status[lane] == RUNNING:
            row, fed = progress.row[lane], records.fed[lane]
            stop = min(progress.last[lane], row + BLOCK)
            steps = 1
            while row + steps < stop and not load(fed, row + steps):
                steps += 1
        progress.steps[lane] = steps
        longest = max(longest, steps)
    return longest


@formula
def _gather_block(records, memory, progress, longest, step, noise_factor):
    """Load the steps of the block and the sample at its end into the lanes."""
    for lane in range(LANES):
        row, steps = progress.row[lane], progress.steps[lane]
        bodies, vibrating = records.bodies[lane], records.vibrating[lane]
        for k in range(steps):
            for i in range(11):
                store(memory.bodies, (k, i, lane), load(bodies, (row + k, i)))
            memory.durations[k, lane] = step
            memory.factors[k, lane] = noise_factor if vibrating[row + k] else 1.0
        for k in range(steps, longest):
            # No value of an earlier block may remain: a NaN would pass through a step of zero length.
            for i in range(11):
                store(memory.bodies, (k, i, lane), 0.0)
            memory.durations[k, lane] = 0.0
            memory.factors[k, lane] = 0.0
        under_way = progress.status[lane] == RUNNING or progress.status[lane] == STARTING
        end = row + steps
        feed = under_way and records.fed[lane][end]
        measured = records.measured[lane]
        for i in range(4):
            memory.measured[i, lane] = measured[end, i] if feed else math.nan
        memory.vibrating[0, lane] = 1.0 if under_way and vibrating[end] else 0.0


@inner_kernel
def _restart(records, memory, lane, row, k, every):
    """Reset row ``k`` of a lane's path to a guess of the flight and the initial disturbances; keep a finite track."""
    path, measured = memory.path, records.measured[lane]
    guesses = records.guesses[lane]
    guess = min((row + every // 2) // every, guesses.shape[0] - 1)
    for i in range(4):
        path[k, i, lane] = measured[row, i]
    for i in range(6):
        path[k, 4 + i, lane] = guesses[guess, i]
        path[k, 10 + i, lane] = memory.start[10 + i, lane]
    if not (math.isfinite(path[k, 16, lane]) and math.isfinite(path[k, 17, lane])):
        path[k, 16, lane] = 0.0
        path[k, 17, lane] = 0.0
    reset_covariance(memory, lane)


@inner_kernel
def _zero_steps(memory, lane, steps):
    """Set the first ``steps`` steps of a lane's block to zero length for the covariance."""
    for k in range(steps):
        memory.durations[k, lane] = 0.0
        memory.factors[k, lane] = 0.0
        for stage in range(4):
            for i in range(ENTRIES):
                memory.partials[k, stage, i, lane] = 0.0


@inner_kernel
def _any_diverged(path, verdict, steps, k):
    """Return whether row ``k`` of any lane's block lies outside the model's domain; mark the lanes in the verdict."""
    store(verdict, 0, select(_flyable(path, k), 1.0, zero_like(load(path, (k, 0)))))
    diverged = False
    for lane in range(LANES):
        diverged |= verdict[0, lane] == 0.0 and k < steps[lane]
    return diverged


@inner_kernel
def _restart_diverged(records, memory, progress, k, every):
    """Restart the lanes that `_any_diverged` found."""
    for lane in range(LANES):
        if memory.verdict[0, lane] == 0.0 and k < progress.steps[lane]:
            row = progress.row[lane] + k
            _restart(records, memory, lane, row, k, every)
            _zero_steps(memory, lane, k)
            records.events[lane][row] |= RESET
            progress.trouble[lane] += 1


@inner_kernel
def _assimilate(memory, gate):
    """Update row 0 with the four channels of the sample in turn, if it is plausible; store the verdict.

    Each channel's innovation, NaN where there is none, and its variance before any inflation are stored too.
    """
    path, P, variance, verdict = memory.path, memory.covariance, memory.variance, memory.verdict
    zero = zero_like(load(memory.vibrating, 0))
    open_to_data = select(_plausible(path, P), 1.0, zero)
    vibrating = load(memory.vibrating, 0)
    rejected = inflated = zero
    for channel in range(4):
        value = load(memory.measured, channel)
        present = (value - value == 0.0) & (open_to_data > 0.0)
        innovation = select(present, value - load(path, (0, channel)), 0.0)
        if channel == 2:
            innovation = wrap(innovation)
        store(memory.innovation, (0, channel), select(present, innovation, math.nan))
        store(memory.innovation, (1, channel), load(P, (channel, channel)) + load(variance, channel))
        excess = innovation * innovation / (gate * gate) - load(P, (channel, channel)) - load(variance, channel)
        beyond = present & (excess > 0.0)
        # While actuators move, a sample beyond the gate is not rejected: its variance is inflated until it passes.
        widened = select(beyond & (vibrating > 0.0), 1.0, zero)
        dropped = select(beyond & (vibrating == 0.0), 1.0, zero)
        used = select(present & (dropped == 0.0), 1.0, zero)
        spread = load(variance, channel) + select(widened > 0.0, excess, 0.0)
        update(path[0], P, channel, innovation, spread, used, memory.gain)
        rejected = rejected + dropped
        inflated = inflated + widened
    store(verdict, 0, select(_plausible(path, P), 1.0, zero))
    store(verdict, 1, rejected)
    store(verdict, 2, inflated)


@formula
def _note_innovations(innovations, innovation, lane, sample):
    """Copy a lane's innovations and their variances to the arrays of its fed samples."""
    for part in range(2):
        for channel in range(4):
            store(innovations, (sample, part, channel), load(innovation, (part, channel, lane)))


@formula
def _settle_sample(records, memory, progress, lane, every):
    """Record the events of the sample at a lane's row, and restart the lane if necessary."""
    row, verdict = progress.row[lane], memory.verdict
    gated, inflated = verdict[1, lane] > 0.0, verdict[2, lane] > 0.0
    if records.fed[lane][row]:
        _note_innovations(records.innovations[lane], memory.innovation, lane, progress.assimilated[lane])
        progress.assimilated[lane] += 1
        progress.rejected_in_a_row[lane] = progress.rejected_in_a_row[lane] + 1 if gated else 0
    reset = verdict[0, lane] == 0.0 or progress.rejected_in_a_row[lane] > progress.patience[lane]
    if reset:
        _restart(records, memory, lane, row, 0, every)
        progress.rejected_in_a_row[lane] = 0
    records.events[lane][row] |= (GATED if gated else 0) | (INFLATED if inflated else 0) | (RESET if reset else 0)
    progress.trouble[lane] += int(gated) + int(inflated) + int(reset)


@formula
def _write_row(path, lane, k, states, disturbances, row):
    """Copy row ``k`` of a lane's path to row ``row`` of its estimates."""
    for i in range(3):
        store(states, (row, i), load(path, (k, i, lane)))
    store(states, (row, 3), load(path, (k, 16, lane)))
    store(states, (row, 4), load(path, (k, 17, lane)))
    store(states, (row, 5), load(path, (k, 3, lane)))
    for i in range(6):
        store(states, (row, 6 + i), load(path, (k, 4 + i, lane)))
        store(disturbances, (row, i), load(path, (k, 10 + i, lane)))


@formula
def _settle(records, memory, progress, every):
    """Close the block in every lane under way; return whether one has ended."""
    ended = False
    path = memory.path
    for lane in range(LANES):
        if progress.status[lane] != RUNNING and progress.status[lane] != STARTING:
            continue
        row, steps = progress.row[lane], progress.steps[lane]
        states, disturbances = records.states[lane], records.disturbances[lane]
        for k in range(1, steps):
            _write_row(path, lane, k, states, disturbances, row + k)
        progress.row[lane] = row + steps
        _settle_sample(records, memory, progress, lane, every)
        _write_row(path, lane, 0, states, disturbances, row + steps)
        progress.status[lane] = RUNNING
        if row + steps == progress.last[lane] or progress.trouble[lane] > progress.allowed[lane]:
            progress.status[lane] = ENDED
            ended = True
    return ended


@kernel
def run_until_done(records, memory, progress, step, gate, noise_factor, every):
    """Filter until a lane reaches the end of its profile, or has had more trouble than it is allowed.

    Parameters
    ----------
    records, memory, progress : Records, Memory, Progress
        The profiles in the lanes, at least one of them under way.
    step : float
        Length of a step, s.
    gate : float
        Number of standard deviations beyond which an innovation is rejected (inside the vibration set, its variance is
        inflated instead).
    noise_factor : float
        Factor on the variance added by a step that begins inside the vibration set.
    every : int
        Number of rows between two guesses.
    """
    ended = False
    while not ended:
        longest = _plan_block(records, progress)
        _gather_block(records, memory, progress, longest, step, noise_factor)
        for k in range(longest):
            advance(memory.hull, memory.bodies, memory.durations, memory.decay, memory.path, memory.partials, k)
            if _any_diverged(memory.path, memory.verdict, progress.steps, k + 1):
                _restart_diverged(records, memory, progress, k + 1, every)
        predict_covariance(
            memory.hull, memory.durations, memory.decay, memory.noise, memory.factors, memory.partials, longest,
            memory.sweep, memory.covariance,
        )  # fmt: skip
        for i in range(18):
            store(memory.path, (0, i), load(memory.path, (longest, i)))
        _assimilate(memory, gate)
        ended = _settle(records, memory, progress, every)
