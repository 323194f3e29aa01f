"""Prediction and update of the 18-state filter (eqs. 19-27): twelve states and six Gauss-Markov disturbances.

The covariance is kept symmetric by construction: the prediction computes one triangle, the update is the Joseph form of
one scalar measurement at a time.
"""

from gliderhpc.kernels.jit import formula, kernel
from gliderhpc.kernels.tangent import step_tangent


@kernel
def predict_covariance(transition, decay, noise, P, work):
    """``P <- Phi P Phi' + Q`` with ``Phi = [[A, B], [0, diag(decay)]]`` and ``Q`` on the disturbances' diagonal (eq. 24)."""
    half = work[0]
    for i in range(12):
        for j in range(18):
            half[i, j] = 0.0
        for k in range(18):
            entry = transition[i, k]
            if entry != 0.0:
                for j in range(18):
                    half[i, j] += entry * P[k, j]
    for i in range(12):
        for j in range(i + 1):
            total = 0.0
            for k in range(18):
                total += half[i, k] * transition[j, k]
            P[i, j] = total
            P[j, i] = total
        for j in range(6):
            value = half[i, 12 + j] * decay[j]
            P[i, 12 + j] = value
            P[12 + j, i] = value
    for i in range(6):
        for j in range(6):
            P[12 + i, 12 + j] *= decay[i] * decay[j]
        P[12 + i, 12 + i] += noise[i]


@kernel
def predict(hull, body, x, h, decay, noise, P, transition, work):
    """Advance the estimate ``x (18)`` and its covariance by one step (eqs. 23, 24)."""
    y = (x[0], x[1], x[2], x[3], x[4], x[5], x[6], x[7], x[8], x[9], x[10], x[11])
    b = (x[12], x[13], x[14], x[15], x[16], x[17])
    new = step_tangent(hull, body, y, b, h, transition, work)
    for i in range(12):
        x[i] = new[i]
    for i in range(6):
        x[12 + i] *= decay[i]
    predict_covariance(transition, decay, noise, P, work)


@formula
def update(x, P, index, innovation, variance, gain):
    """Correct ``x`` and ``P`` by one measurement of state ``index`` (eqs. 25-27, Joseph form)."""
    total = P[index, index] + variance
    for i in range(18):
        gain[i, 0] = P[i, index]
        gain[i, 1] = P[i, index] / total
    for i in range(18):
        x[i] += gain[i, 1] * innovation
        for j in range(i + 1):
            value = (
                P[i, j] - gain[i, 1] * gain[j, 0] - gain[i, 0] * gain[j, 1] + total * gain[i, 1] * gain[j, 1]
            )
            P[i, j] = value
            P[j, i] = value
