"""Memory of the filter for the profiles that it filters together, one in each lane."""

from typing import Any, NamedTuple

import numpy as np

from gliderhpc.kernels.elementwise import LANES, lane_array
from gliderhpc.kernels.jacobian import ENTRIES
from gliderhpc.kernels.jit import inner_kernel, kernel

Array = Any

BLOCK = 16
"""Largest number of steps of a block. Their Jacobians (283 kB with eight lanes) fit into the second-level cache."""

IDLE, STARTING, RUNNING, ENDED = range(4)
"""States of a lane: idle; about to process row 0; under way; done."""


class Sweep(NamedTuple):
    """Scratch of the covariance's prediction; the arrays have an axis of lanes after these shapes.

    Attributes
    ----------
    transition, remaining : (10, 16), (6,)
        Transition of the sensed states and decay of the disturbances, from the end of a step to the end of the block.
    added : (16, 16)
        Noise at the end of the block, lower triangle.
    half : (10, 16)
        Transition times covariance.
    """

    transition: Array
    remaining: Array
    added: Array
    half: Array


class Memory(NamedTuple):
    """Numbers of the filter; every array has an axis of lanes after these shapes.

    Attributes
    ----------
    hull, decay, noise, variance : (24,), (6,), (6,), (4,)
        Constants; decay of the disturbances over a step, and the variance that a step adds; variance of a measurement.
    start, start_variance : (18,), (16,)
        Initial estimate and the diagonal of its covariance; restarts use its disturbances and the variances.
    bodies, durations, factors : (m, 11), (m,), (m,)
        Mass properties, lengths (zero after a lane's own last step) and noise factors of the block's steps.
    path : (m+1, 18)
        Sensed states, disturbances, X and Y.
    partials : (m, 4, 67)
        Jacobians of the stages.
    covariance : (16, 16)
        Covariance of the sensed states and the disturbances, at the start of the block.
    measured, vibrating : (4,), (1,)
        Sample at the end of the block, NaN where there is none; 1 inside the vibration set.
    innovation : (2, 4)
        Innovation of the sample (measured minus predicted, NaN where there is none), and its variance.
    gain : (16, 2)
        Scratch of the update.
    verdict : (3,)
        1 where the estimate is plausible; number of channels rejected; number of channels inflated.
    sweep : Sweep
        Scratch of the prediction.
    """

    hull: Array
    decay: Array
    noise: Array
    variance: Array
    start: Array
    start_variance: Array
    bodies: Array
    durations: Array
    factors: Array
    path: Array
    partials: Array
    covariance: Array
    measured: Array
    vibrating: Array
    innovation: Array
    gain: Array
    verdict: Array
    sweep: Sweep


class FilterProgress(NamedTuple):
    """Progress of each lane, integers ``(LANES,)``.

    Attributes
    ----------
    status : int
        State of the lane (`IDLE` ...).
    row, last, steps : int
        Row reached, last row of the record, number of steps of the block.
    assimilated : int
        Number of fed samples so far.
    patience, rejected_in_a_row : int
        Largest number of successive samples with a rejected channel without a restart, and their present number.
    trouble, allowed : int
        Number of gatings, inflations and resets, and the largest number before the run is abandoned.
    """

    status: Array
    row: Array
    last: Array
    steps: Array
    assimilated: Array
    patience: Array
    rejected_in_a_row: Array
    trouble: Array
    allowed: Array


class Records(NamedTuple):
    """Profiles in the lanes; each entry is a tuple of `LANES` arrays.

    Attributes
    ----------
    bodies : (n, 11)
        Mass properties of each step.
    measured : (n+1, 4)
        Measurements ``[phi, theta, psi, Z]``; NaN is missing.
    fed, vibrating : (n+1,) bool
        True where a sample is fed, and inside the vibration set.
    guesses : (g, 6)
        Velocities and rates for a restart, at regular intervals of rows.
    states, disturbances : (n+1, 12), (n+1, 6)
        Estimates, to be filled.
    events : (n+1,) uint8
        Events of each sample, to which bits are added.
    innovations : (m, 2, 4)
        Innovations of the fed samples and their variances, rad and m, to be filled.
    """

    bodies: Array
    measured: Array
    fed: Array
    vibrating: Array
    guesses: Array
    states: Array
    disturbances: Array
    events: Array
    innovations: Array


def allocate() -> tuple[Memory, FilterProgress]:
    """Allocate the memory for `LANES` profiles, with all lanes idle."""
    m = BLOCK
    memory = Memory(
        hull=lane_array(24), decay=lane_array(6), noise=lane_array(6), variance=lane_array(4), start=lane_array(18),
        start_variance=lane_array(16), bodies=lane_array(m, 11), durations=lane_array(m), factors=lane_array(m),
        path=lane_array(m + 1, 18), partials=lane_array(m, 4, ENTRIES), covariance=lane_array(16, 16),
        measured=lane_array(4), vibrating=lane_array(1), innovation=lane_array(2, 4), gain=lane_array(16, 2),
        verdict=lane_array(3), sweep=Sweep(lane_array(10, 16), lane_array(6), lane_array(16, 16), lane_array(10, 16)),
    )  # fmt: skip
    # A lane that is never used computes, too: a hull of unit masses that flies straight ahead.
    memory.hull[...] = 1.0
    memory.variance[...] = 1.0
    memory.path[:, 4] = 1.0
    return memory, FilterProgress(*(np.zeros(LANES, dtype=np.int64) for _ in FilterProgress._fields))


@inner_kernel
def reset_covariance(memory, lane):
    """Reset the covariance of a lane to the initial one."""
    for i in range(16):
        for j in range(16):
            memory.covariance[i, j, lane] = memory.start_variance[i, lane] if i == j else 0.0


@kernel
def load_profile(memory, progress, lane, hull, decay, noise, variance, x0, deviation, last, patience, allowed):
    """Load a profile of ``last`` steps into a lane.

    The initial estimate ``x0 (18)`` and its ``deviation (16)`` are in the order of a row of the path. The profile's
    arrays are passed to the run (`Records`).
    """
    for i in range(24):
        memory.hull[i, lane] = hull[i]
    for i in range(6):
        memory.decay[i, lane] = decay[i]
        memory.noise[i, lane] = noise[i]
    for i in range(4):
        memory.variance[i, lane] = variance[i]
    for i in range(18):
        memory.start[i, lane] = x0[i]
        memory.path[0, i, lane] = x0[i]
    for i in range(16):
        memory.start_variance[i, lane] = deviation[i] * deviation[i]
    reset_covariance(memory, lane)
    progress.status[lane] = STARTING
    progress.row[lane] = 0
    progress.last[lane] = last
    progress.assimilated[lane] = 0
    progress.patience[lane] = patience
    progress.rejected_in_a_row[lane] = 0
    progress.trouble[lane] = 0
    progress.allowed[lane] = allowed
