"""How strong a dive's disturbances are, told by the dive: one factor a channel on the noise of its prior.

A prior serves many dives, and the water is calmer on one than on another. Where a prior is too wide, intervals are, and
the mean path is drawn to where the record resolves the noise less (docs/smoother.md); where it is too narrow, the
reverse. The evidence says by how much: were the prior right, the squares of the smoothed noise would sum up, over their
variances, to the number of values that the record resolves,

    sum of mean^2 / q = sum of q L,

for the noise is ``-q l`` with a costate of covariance ``L``. The factor is the ratio of the two sums (MacKay 1992), the
prior itself counting as `WEIGHT` resolved values more.

References
----------
D. J. C. MacKay (1992), Bayesian interpolation, Neural Computation 4, 415-447.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gliderhpc.kernels.smoother_memory import Backward

Array = NDArray[np.float64]

WEIGHT = 20.0
"""Resolved values that the prior's own intensity is worth."""


@dataclass(frozen=True, eq=False)
class NoiseScale:
    """Which part of the noise the factors apply to.

    Attributes
    ----------
    prior, actuators : (n, 6)
        Variances that the steps add by the prior, and for the actuators' sake.
    usual : (n,) mask
        Steps that tell: outside the vibration set, the actuators at rest.
    channels : tuple of int
        Channels that have a factor.
    """

    prior: Array
    actuators: Array
    usual: NDArray[np.bool_]
    channels: tuple[int, ...]

    def factors(self, noise: Array) -> Array:
        """Factors ``(6,)`` that variances ``noise (n, 6)`` stand for; of no usual step at all, one."""
        if not self.usual.any():
            return np.ones(6)
        return np.asarray(noise[self.usual].sum(axis=0) / self.prior[self.usual].sum(axis=0))

    def renewed(self, noise: Array, linear: Backward) -> Array:
        """Variances ``(n, 6)`` that follow from a pass with variances ``noise (n, 6)``."""
        steps, renewed = self.usual, noise.copy()
        before = self.factors(noise)
        spent = np.sum(linear.noise_mean[steps] ** 2 / noise[steps], axis=0)
        resolved = np.sum(linear.noise_resolved[steps], axis=0)
        after = (before * spent + WEIGHT) / (resolved + WEIGHT)
        channels = list(self.channels)
        renewed[:, channels] = self.scaled(after)[:, channels]
        return renewed

    def scaled(self, factors: Array) -> Array:
        """Variances ``(n, 6)`` of these factors ``(6,)``; channels without one keep the prior's."""
        own = np.ones(6)
        own[list(self.channels)] = factors[list(self.channels)]
        return own * self.prior + self.actuators

    def of_piece(self, steps: slice) -> "NoiseScale":
        """That of a piece of the dive."""
        return replace(self, prior=self.prior[steps], actuators=self.actuators[steps], usual=self.usual[steps])
