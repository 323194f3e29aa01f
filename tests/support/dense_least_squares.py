"""The smoother's linearised problem in one dense matrix, solved by least squares."""

import numpy as np

from gliderhpc.flight.glider import SENSED
from support import reference
from support.smoothing import PETREL, SAMPLED, H

ORDER = np.concatenate([SENSED, np.arange(12, 18), [3, 4]])
"""Places of the smoother's sixteen states, X and Y among eq. 16's twelve and the disturbances."""


def dense_transition(control, state, disturbance, decay, platform=PETREL.platform):
    """Phi ``(18, 18)`` of one step by the complex step of the second implementation, and the new state."""

    def advance(z):
        new = reference.rk4_step(platform, z[:12], control, z[12:], H)
        return np.concatenate([new, decay * z[12:]])

    z = np.concatenate([state, disturbance])
    return reference.jacobian(advance, z), advance(z)


class DenseLeastSquares:
    """The linearised problem in one matrix: unknown are the initial deviation and every step's noise, whitened.

    Attributes
    ----------
    maps, offsets : (n+1, 18, m), (n+1, 18)
        Deviation of each row from the path as a function of the unknowns.
    solution, root : (m,), (m, m)
        Least-squares solution, and a root of its covariance.
    """

    def __init__(self, dive, path, control):
        n = len(dive.bodies)
        size = 16 + 6 * n
        self.maps, self.offsets = np.zeros((n + 1, 18, size)), np.zeros((n + 1, 18))
        at_start = np.concatenate([path.states[0], path.disturbances[0]])[ORDER]
        self.maps[0, ORDER[:16], np.arange(16)] = dive.deviation
        self.offsets[0, ORDER[:16]] = dive.mean - at_start[:16]
        for k in range(n):
            Phi, new = dense_transition(control, path.states[k], path.disturbances[k], dive.decay)
            self.maps[k + 1] = Phi @ self.maps[k]
            self.maps[k + 1, 12 + np.arange(6), 16 + 6 * k + np.arange(6)] += np.sqrt(dive.noise[k])
            self.offsets[k + 1] = Phi @ self.offsets[k] + new
            self.offsets[k + 1] -= np.concatenate([path.states[k + 1], path.disturbances[k + 1]])
        rows, values = [np.eye(size)], [np.zeros(size)]
        for k, channel in np.argwhere(np.isfinite(dive.measured)):
            index, deviation = SAMPLED[channel], np.sqrt(dive.variance[k, channel])
            residual = dive.measured[k, channel] - path.states[k, index]
            if channel == 2:
                residual = np.arctan2(np.sin(residual), np.cos(residual))
            rows.append(self.maps[k, index][None] / deviation)
            values.append(np.array([(residual - self.offsets[k, index]) / deviation]))
        orthogonal, triangle = np.linalg.qr(np.vstack(rows))
        self.solution = np.linalg.solve(triangle, orthogonal.T @ np.concatenate(values))
        self.root = np.linalg.inv(triangle)

    def mean(self, k):
        return (self.maps[k] @ self.solution + self.offsets[k])[ORDER]

    def covariance(self, k):
        half = self.maps[k] @ self.root
        return (half @ half.T)[np.ix_(ORDER, ORDER)]

    def noise_square(self, dive):
        unit = self.solution[16:] ** 2 + (self.root[16:] ** 2).sum(axis=1)
        return unit.reshape(-1, 6) * dive.noise
