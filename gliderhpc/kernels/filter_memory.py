"""Memory of the filter for the profiles that it filters side by side, one in each lane."""

from typing import Any, NamedTuple

import numpy as np

from gliderhpc.kernels.elementwise import LANES, lane_array
from gliderhpc.kernels.jacobian import ENTRIES
from gliderhpc.kernels.jit import inner_kernel, kernel

Array = Any

BLOCK = 16
"""Most steps of one block. Their Jacobians (283 kB with eight lanes) stay in the second-level cache."""

IDLE, STARTING, RUNNING, ENDED = range(4)
"""States of a lane: idle; about to treat row 0; under way; done."""


class Sweep(NamedTuple):
    """Scratch of the covariance's prediction; an axis of lanes behind these shapes.

    Attributes
    ----------
    transition, remaining : (10, 16), (6,)
        From behind some step to the end of the block: of the sensed states, and the disturbances' decay.
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
    """The filter's numbers; every array has an axis of lanes behind these shapes.

    Attributes
    ----------
    hull, decay, noise, variance : (24,), (6,), (6,), (4,)
        Constants, decay of the disturbances over a step and variance it adds, variance of a measurement.
    start, start_variance : (18,), (16,)
        Initial estimate and the diagonal of its covariance; restarts take the disturbances and the variances from it.
    bodies, durations, factors : (m, 11), (m,), (m,)
        Of the block's steps: mass properties, lengths (zero behind a lane's own last step), factors on the noise.
    path : (m+1, 18)
        Sensed states, disturbances, X and Y.
    partials : (m, 4, 67)
        Jacobians of the stages.
    covariance : (16, 16)
        Of the sensed states and the disturbances, at the start of the block.
    measured, vibrating : (4,), (1,)
        Sample at the end of the block, NaN where there is none; 1 inside the vibration set.
    innovation : (2, 4)
        Of the sample: measured less predicted, NaN where nothing was taken, and its variance.
    gain : (16, 2)
        Scratch of the update.
    verdict : (3,)
        1 where the estimate is plausible; channels rejected; channels inflated.
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


class Progress(NamedTuple):
    """Each lane's account, integers ``(LANES,)``.

    Attributes
    ----------
    status : int
        What the lane is doing (`IDLE` ...).
    row, last, steps : int
        Row reached, last row of the record, steps of the block.
    assimilated : int
        Fed samples so far.
    patience, rejected_in_a_row : int
        Samples in a row with a rejected channel after which the filter restarts, and how many there are.
    trouble, allowed : int
        Samples gated, inflated and reset, and how many there may be before the run is given up.
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
    """The profiles in the lanes, a tuple of `LANES` arrays each.

    Attributes
    ----------
    bodies : (n, 11)
        Mass properties a step.
    measured : (n+1, 4)
        Measurements ``[phi, theta, psi, Z]``; NaN is missing.
    fed, vibrating : (n+1,) bool
        Where a sample is fed, and the vibration set.
    guesses : (g, 6)
        Velocities and rates to restart with, at every so many rows.
    states, disturbances : (n+1, 12), (n+1, 6)
        Filled with the estimates.
    events : (n+1,) uint8
        Bits are added that say what happened to a sample.
    innovations : (m, 2, 4)
        Filled with the innovations of the fed samples and their variances, rad and m.
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


def allocate() -> tuple[Memory, Progress]:
    """Memory for `LANES` profiles; all lanes idle."""
    m = BLOCK
    memory = Memory(
        hull=lane_array(24), decay=lane_array(6), noise=lane_array(6), variance=lane_array(4), start=lane_array(18),
        start_variance=lane_array(16), bodies=lane_array(m, 11), durations=lane_array(m), factors=lane_array(m),
        path=lane_array(m + 1, 18), partials=lane_array(m, 4, ENTRIES), covariance=lane_array(16, 16),
        measured=lane_array(4), vibrating=lane_array(1), innovation=lane_array(2, 4), gain=lane_array(16, 2),
        verdict=lane_array(3), sweep=Sweep(lane_array(10, 16), lane_array(6), lane_array(16, 16), lane_array(10, 16)),
    )  # fmt: skip
    # A lane that was never used computes too, if only of a hull of unit masses straight ahead.
    memory.hull[...] = 1.0
    memory.variance[...] = 1.0
    memory.path[:, 4] = 1.0
    return memory, Progress(*(np.zeros(LANES, dtype=np.int64) for _ in Progress._fields))


@inner_kernel
def reset_covariance(memory, lane):
    """Give a lane its initial covariance."""
    for i in range(16):
        for j in range(16):
            memory.covariance[i, j, lane] = memory.start_variance[i, lane] if i == j else 0.0


@kernel
def load_profile(memory, progress, lane, hull, decay, noise, variance, x0, deviation, last, patience, allowed):
    """Put a profile of ``last`` steps into a lane.

    Its arrays are given to the run; here ``x0 (18)`` and ``deviation (16)``, in the order of a row of the path.
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
