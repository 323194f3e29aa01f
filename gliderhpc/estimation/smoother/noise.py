"""Noise of the disturbances in the smoother: its scale in one profile, heavy tails, and lagging actuators.

References
----------
A. C. Harvey, S. J. Koopman (1992), Diagnostic checking of unobserved-components time series models, Journal of Business
and Economic Statistics 10, 377-389.

D. J. C. MacKay (1992), Bayesian interpolation, Neural Computation 4, 415-447.

A. Y. Aravkin, J. V. Burke, G. Pillonetto (2014), Robust and trend-following Student's t Kalman smoothers, SIAM Journal
on Control and Optimization 52, 2891-2916.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from gliderhpc.kernels.mass import GRAVITY
from gliderhpc.kernels.smoother_memory import Backward
from gliderhpc.kernels.smoother_path import sum_noise_values

Array = NDArray[np.float64]


def actuation_noise(bodies: Array, attitude: Array, lag: Array, step: float) -> Array:
    """Variance ``(n, 6)`` per step that lagging records of the actuators add to the disturbances, N2 and (N m)2.

    Parameters
    ----------
    bodies : (n, 11)
        Mass properties from `gliderhpc.flight.glider.Glider.bodies`.
    attitude : (n, 2)
        Roll and pitch, rad.
    lag, step : (n,), float
        Largest lag or lead of the records at each step, and the step, s.

    Notes
    -----
    The recorded positions of battery and ballast may be early or late by up to a lag. While an actuator moves, the
    force and moment of its weight are then in error by their change over that time. This error acts like a disturbance
    that appears when the move begins and vanishes when it has ended. A random walk with the same change over the lag,

        variance a step = (lag / h) (change from step to step of the lag's error)^2,

    lets the disturbance follow this error, and is no wider.
    """
    rows = np.maximum(1, np.rint(lag / step).astype(np.int64))
    earlier = bodies[np.maximum(np.arange(len(bodies)) - rows, 0)]
    down = _down(attitude)
    moment, weight = (bodies - earlier)[:, :3], (bodies - earlier)[:, 9:10]
    error = np.hstack([weight * down, GRAVITY * np.cross(moment, down)])
    return np.asarray((lag / step)[:, None] * np.diff(error, axis=0, prepend=error[:1]) ** 2)


def _down(attitude: Array) -> Array:
    """Unit vector downwards in the hull's axes (eq. 2's third row)."""
    roll, pitch = attitude.T
    return np.column_stack([-np.sin(pitch), np.sin(roll) * np.cos(pitch), np.cos(roll) * np.cos(pitch)])


WEIGHT = 20.0
"""Weight of the prior's intensity, as an equivalent number of resolved values."""


class SmoothedNoise(Protocol):
    """Results of a pass on the noise, as in `gliderhpc.kernels.smoother_memory.Backward`."""

    @property
    def noise_mean(self) -> Array:
        """Smoothed noise ``(n, 6)`` of the steps."""

    @property
    def noise_resolved(self) -> Array:
        """Part ``(n, 6)`` of each step's noise that the record resolves."""


def noise_sums(smoothed: SmoothedNoise, noise: Array, steps: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Sum the normalised squares of the smoothed noise, and the resolved values, over some steps.

    Parameters
    ----------
    smoothed : SmoothedNoise
        Smoothed noise and its resolved part.
    noise : (n, 6)
        Variances of the noise, by which the squares are divided.
    steps : (n,) mask
        Steps to sum over.

    Returns
    -------
    (6,) array, (6,) array
        Sums of the squares and of the resolved values, by channel.
    """
    squares, resolved, _ = _sums(smoothed, noise, steps)
    return squares, resolved


def _sums(smoothed: SmoothedNoise, noise: Array, steps: NDArray[np.bool_]) -> Array:
    """Sums ``(3, 6)`` as in `noise_sums`, and of the variances."""
    sums = np.empty((3, 6))
    sum_noise_values(smoothed.noise_mean, smoothed.noise_resolved, noise, steps, sums)
    return sums


def standardised_noise(smoothed: SmoothedNoise, noise: Array) -> Array:
    """Smoothed noise ``(n, 6)`` over its standard deviation; NaN where the record does not resolve it.

    If the noise is Gaussian with the variances ``noise (n, 6)``, these auxiliary residuals (Harvey and Koopman 1992)
    are standard normal. The smoothed noise is ``-q l`` with a costate of covariance ``L``, and its variance ``q^2 L``
    is the resolved part of ``q``.
    """
    variance = noise * smoothed.noise_resolved
    return np.asarray(smoothed.noise_mean / np.sqrt(np.where(variance > 0.0, variance, np.nan)))


@dataclass(frozen=True, eq=False)
class NoiseScale:
    """Scale of a profile's disturbances, estimated from the profile: one factor for each channel on the prior's noise.

    Attributes
    ----------
    prior, actuators : (n, 6)
        Variances of the steps' noise from the prior, and from lagging actuators.
    reference_steps : (n,) mask
        Steps from which the scale is estimated: outside the vibration set, with the actuators at rest.
    channels : tuple of int
        Channels that have a factor.

    Notes
    -----
    The same prior is used for many profiles, but the water is calmer in some than in others. If the prior is too wide,
    the intervals are too wide as well, and the mean is biased towards paths on which the record resolves the noise less
    (docs/smoother.md); if it is too narrow, the opposite occurs. The factor is estimated by evidence maximisation. With
    the right prior, the sum of the normalised squares of the smoothed noise would equal the number of values that the
    record resolves,

        sum of mean^2 / q = sum of q L,

    since the noise is ``-q l`` with a costate of covariance ``L``. The factor is the ratio of the two sums (MacKay
    1992), in which the prior itself has the weight of `WEIGHT` resolved values.
    """

    prior: Array
    actuators: Array
    reference_steps: NDArray[np.bool_]
    channels: tuple[int, ...]

    def factors(self, noise: Array) -> Array:
        """Factors ``(6,)`` of variances ``noise (n, 6)`` relative to the prior; one if there is no reference step."""
        if not self.reference_steps.any():
            return np.ones(6)
        return np.asarray(noise[self.reference_steps].sum(axis=0) / self._reference_prior)

    @cached_property
    def _reference_prior(self) -> Array:
        """Sum ``(6,)`` of the prior's variances over the reference steps."""
        return np.asarray(self.prior[self.reference_steps].sum(axis=0))

    def updated(self, noise: Array, linear: Backward) -> Array:
        """Variances ``(n, 6)`` that follow from a pass with variances ``noise (n, 6)``."""
        squares, resolved, variances = _sums(linear, noise, self.reference_steps)
        factors = variances / self._reference_prior if self.reference_steps.any() else np.ones(6)
        updated_factors = (factors * squares + WEIGHT) / (resolved + WEIGHT)
        channels = list(self.channels)
        if len(channels) == 6:
            return self.scaled(updated_factors)
        updated = noise.copy()
        updated[:, channels] = self.scaled(updated_factors)[:, channels]
        return updated

    def scaled(self, factors: Array) -> Array:
        """Variances ``(n, 6)`` with these factors ``(6,)``; channels without a factor have the prior's variances."""
        applied = np.ones(6)
        applied[list(self.channels)] = factors[list(self.channels)]
        return applied * self.prior + self.actuators

    def for_segment(self, steps: slice) -> "NoiseScale":
        """Return the scale of a segment of the profile."""
        return replace(
            self, prior=self.prior[steps], actuators=self.actuators[steps], reference_steps=self.reference_steps[steps]
        )


@dataclass(frozen=True, eq=False)
class HeavyTails:
    """Heavy-tailed noise by iterative reweighting, which preserves impulses (off by default).

    Attributes
    ----------
    nominal : (n, 6)
        Nominal variances q of the steps' noise.
    degrees_of_freedom : float
        Degrees of freedom nu.
    channels : tuple of int
        Channels with heavy-tailed noise.
    steps : int
        Number m of steps of a sample interval.

    Notes
    -----
    Student's t is a Gaussian with a random variance, here drawn once for every sample interval: ``f q`` in place of
    ``q`` at each of its ``m`` steps. A record resolves one number per interval, the sum of its noise. With ``R`` the
    expectation of that number's square over its variance ``m q``, expectation-maximisation gives
    ``f = (nu + R) / (nu + 1)``: near 1 in quiet stretches, larger where the record requires a jump (Aravkin et al.
    2014). The sweeps give the expected squares of the steps' noise, whose sum is ``S q``. All but one of its ``m``
    degrees of freedom have the prior's variance, and therefore ``R = S - (m - 1) f`` with the ``f`` used in the sweeps.
    """

    nominal: Array
    degrees_of_freedom: float
    channels: tuple[int, ...]
    steps: int

    def updated(self, noise: Array, linear: Backward) -> Array:
        """Variances ``(n, 6)`` that follow from a pass with variances ``noise (n, 6)``."""
        updated = noise.copy()
        starts = np.arange(0, len(noise), self.steps)
        counts = np.diff(np.append(starts, len(noise)))
        square = linear.noise_mean**2 + noise * (1.0 - linear.noise_resolved)
        for channel in self.channels:
            q = self.nominal[:, channel]
            total, factor = (np.add.reduceat(x[:, channel] / q, starts) for x in (square, noise))
            resolved = np.maximum(total - factor * (counts - 1) / counts, 0.0)
            weight = (self.degrees_of_freedom + resolved) / (self.degrees_of_freedom + 1.0)
            updated[:, channel] = q * np.repeat(weight, counts)
        return updated


class NoiseModel(Protocol):
    """Model that adapts the noise of the disturbances to the results of a pass."""

    def updated(self, noise: Array, linear: Backward) -> Array:
        """Variances ``(n, 6)`` of the next pass, from those of the last pass and its results."""
