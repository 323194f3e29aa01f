"""The extended Kalman filter along one profile (eqs. 19-27), with gating, inflation and recovery from divergence."""

import math

import numpy as np

from gliderhpc.kernels.elementary import wrap
from gliderhpc.kernels.jit import kernel
from gliderhpc.kernels.kalman import predict, update
from gliderhpc.kernels.mass import load_body

GATED, INFLATED, RESET = 1, 2, 4
"""What happened to a measured sample, as bits."""


@kernel
def _measured_index(channel):
    """Where channel ``channel`` of ``[phi, theta, psi, Z]`` lies among the states."""
    return 5 if channel == 3 else channel


@kernel
def _innovation(x, measurement, channel):
    difference = measurement - x[_measured_index(channel)]
    return wrap(difference) if channel == 2 else difference


@kernel
def _fed(measurements):
    """Whether any channel of a sample carries a number."""
    for channel in range(4):
        if math.isfinite(measurements[channel]):
            return True
    return False


@kernel
def _restart(x, P, guess, x0, deviation):
    """Return to a guess of the flight state and the initial disturbances, with the initial covariance."""
    north, east = x[3], x[4]
    for i in range(18):
        x[i] = guess[i] if i < 12 else x0[i]
        for j in range(18):
            P[i, j] = deviation[i] * deviation[i] if i == j else 0.0
    if math.isfinite(north) and math.isfinite(east):
        x[3], x[4] = north, east


@kernel
def _plausible(x, P):
    """Whether the estimate lies inside the model's domain: finite, pitch under 85 degrees, speed under 3 m/s."""
    for i in range(18):
        if not (math.isfinite(x[i]) and math.isfinite(P[i, i]) and P[i, i] >= 0.0):
            return False
    return abs(x[1]) < 1.4835 and x[6] * x[6] + x[7] * x[7] + x[8] * x[8] < 9.0


@kernel
def _assimilate(x, P, measurements, variance, gate, shaken, gain):
    """Update with the four channels of one sample in turn; returns (channels rejected, whether any was inflated)."""
    rejected = 0
    inflated = False
    for channel in range(4):
        value = measurements[channel]
        if not math.isfinite(value):
            continue
        index = _measured_index(channel)
        innovation = _innovation(x, value, channel)
        excess = innovation * innovation / (gate * gate) - P[index, index] - variance[channel]
        used = variance[channel]
        if excess > 0.0:
            if not shaken:
                rejected += 1
                continue
            # Actuators at work: the sample counts for what it can, its variance raised until it passes the gate.
            used += excess
            inflated = True
        update(x, P, index, innovation, used, gain)
    return rejected, inflated


@kernel
def run_filter(
    hull, bodies, x0, deviation, h, decay, noise, noise_factor, measured, variance, guesses, shaken, gate, patience,
    states, disturbances, events,
):  # fmt: skip
    """Filter one profile.

    Parameters
    ----------
    bodies : (n, 11)
        Mass properties a step.
    x0, deviation : (18,)
        Initial estimate and its standard deviation.
    decay, noise : (6,)
        A step's decay of the disturbances and the variance it adds (Gauss-Markov; decay 1 is the random walk).
    noise_factor : float
        Factor on the added variance inside the vibration set.
    measured : (n+1, 4)
        Measurements ``[phi, theta, psi, Z]`` where the filter is fed, NaN elsewhere.
    variance : (4,)
        Measurement variances, rad2 and m2.
    guesses : (n+1, 12)
        What to restart from.
    shaken : (n+1,) bool
        The vibration set.
    gate : float
        Innovations beyond this many standard deviations are rejected (inside the vibration set: widened to).
    patience : int
        Samples in a row with a rejected channel after which the filter restarts.
    states, disturbances : (n+1, 12), (n+1, 6)
        Filled with the estimates.
    events : (n+1,) uint8
        Filled with `GATED`, `INFLATED`, `RESET` bits.
    """
    x, P = np.empty(18), np.empty((18, 18))
    transition, gain = np.empty((12, 18)), np.empty((18, 2))
    tangent_work, added = np.empty((3, 18, 18)), np.empty(6)
    for i in range(18):
        x[i] = x0[i]
        for j in range(18):
            P[i, j] = deviation[i] * deviation[i] if i == j else 0.0
    rejected_in_a_row = 0
    for k in range(states.shape[0]):
        events[k] = 0
        if k > 0:
            factor = noise_factor if shaken[k - 1] else 1.0
            for i in range(6):
                added[i] = factor * noise[i]
            predict(hull, load_body(bodies, k - 1), x, h, decay, added, P, transition, tangent_work)
        fed = _fed(measured[k])
        if fed and _plausible(x, P):
            rejected, inflated = _assimilate(x, P, measured[k], variance, gate, shaken[k], gain)
            rejected_in_a_row = rejected_in_a_row + 1 if rejected > 0 else 0
            events[k] |= (GATED if rejected > 0 else 0) | (INFLATED if inflated else 0)
        if not _plausible(x, P) or rejected_in_a_row > patience:
            _restart(x, P, guesses[k], x0, deviation)
            rejected_in_a_row = 0
            events[k] |= RESET
        for i in range(12):
            states[k, i] = x[i]
        for i in range(6):
            disturbances[k, i] = x[12 + i]
