"""Move of a path by the correction of a smoother's pass, and sums over the noise of its steps."""

from gliderhpc.kernels.jit import kernel


@kernel
def move_path(decay, rows, correction, noise_mean, fraction, states, disturbances):
    """Move a path by a fraction of the correction of a pass.

    Parameters
    ----------
    decay : (6,)
        Decay of the disturbances over a step.
    rows : (s+1,) int
        First row of each segment, and the last row of the profile.
    correction, noise_mean : (s+1, 16), (n, 6)
        Smoothed deviation of the sensed states and disturbances in these rows, and smoothed noise of each step, by
        which the disturbances move inside the segments.
    fraction : float
        Fraction of the move.
    states, disturbances : (n+1, 12), (n+1, 6)
        Path, to be moved; its states inside the segments are left as they are.
    """
    count = rows.shape[0]
    for number in range(count):
        first = rows[number]
        stop = rows[number + 1] if number + 1 < count else first + 1
        for i in range(10):
            states[first, i if i < 3 else i + 2] += fraction * correction[number, i]
        for i in range(6):
            moved = disturbances[first, i] + correction[number, 10 + i]
            disturbances[first, i] += fraction * (moved - disturbances[first, i])
            for k in range(first + 1, stop):
                moved = decay[i] * moved + noise_mean[k - 1, i]
                disturbances[k, i] += fraction * (moved - disturbances[k, i])


@kernel
def sum_noise_values(noise_mean, noise_resolved, noise, steps, sums):
    """Sum up the squares of the smoothed noise over its variances, the resolved parts, and the variances.

    Parameters
    ----------
    noise_mean, noise_resolved, noise : (n, 6), (n, 6), (n, 6)
        Smoothed noise of each step, the resolved part of its variance, and the variance.
    steps : (n,) bool
        Steps to sum over.
    sums : (3, 6)
        The sums, to be filled.
    """
    for i in range(6):
        for part in range(3):
            sums[part, i] = 0.0
    for k in range(steps.shape[0]):
        if steps[k]:
            for i in range(6):
                sums[0, i] += noise_mean[k, i] * noise_mean[k, i] / noise[k, i]
                sums[1, i] += noise_resolved[k, i]
                sums[2, i] += noise[k, i]
