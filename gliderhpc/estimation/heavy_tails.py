"""Heavy-tailed noise of the disturbances by iterative reweighting, so that impulses are not smeared (off by default).

Student's t is a Gaussian whose variance is itself drawn, here anew for every sample interval: ``f q`` in place of ``q``
at each of its ``m`` steps. A record resolves one number an interval, what the noise sums up to; let ``R`` be the
expectation of that number's square over its variance ``m q``. Expectation-maximisation then gives
``f = (nu + R) / (nu + 1)``: near 1 in quiet stretches, larger where the record demands a jump. The sweeps give the
expected squares of the steps' noise, ``S q`` in sum; all but one of its ``m`` degrees of freedom are at their prior's
variance, so ``R = S - (m - 1) f`` with the ``f`` that the sweeps took.

References
----------
A. Y. Aravkin, J. V. Burke, G. Pillonetto (2014), Robust and trend-following Student's t Kalman smoothers, SIAM Journal
on Control and Optimization 52, 2891-2916.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gliderhpc.kernels.smoother_memory import Backward

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class HeavyTails:
    """Which channels' noise is Student-t, and how.

    Attributes
    ----------
    nominal : (n, 6)
        Variances that the steps add, q.
    degrees_of_freedom : float
        nu.
    channels : tuple of int
        The channels.
    steps : int
        m, steps of a sample interval.
    """

    nominal: Array
    degrees_of_freedom: float
    channels: tuple[int, ...]
    steps: int

    def renewed(self, noise: Array, linear: Backward) -> Array:
        """Variances ``(n, 6)`` that follow from a pass with variances ``noise (n, 6)``."""
        renewed = noise.copy()
        starts = np.arange(0, len(noise), self.steps)
        counts = np.diff(np.append(starts, len(noise)))
        square = linear.noise_mean**2 + noise * (1.0 - linear.noise_resolved)
        for channel in self.channels:
            q = self.nominal[:, channel]
            total, factor = (np.add.reduceat(x[:, channel] / q, starts) for x in (square, noise))
            resolved = np.maximum(total - factor * (counts - 1) / counts, 0.0)
            weight = (self.degrees_of_freedom + resolved) / (self.degrees_of_freedom + 1.0)
            renewed[:, channel] = q * np.repeat(weight, counts)
        return renewed
