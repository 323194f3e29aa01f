r"""Nowcast of the current: a Kalman filter over depth-averaged currents and surface drifts.

Each component of the current is a constant mean plus a Gauss-Markov process plus tidal lines of known period,

.. math:: u(t) = m + g(t) + \sum_k c_k(t), \qquad \dot g = -g / \tau + w, \qquad \operatorname{Var} g = \sigma^2,
   \qquad \dot c_k = -\omega_k s_k, \qquad \dot s_k = \omega_k c_k .

A depth-averaged current is the average of :math:`u` over a dive, a surface drift is :math:`u` at an instant. The states
of the filter include the integral of :math:`u`, which makes both observations exact. The same integral predicts the
displacement of the water. North and east are independent, with the same process and the same errors of observation, so
that one covariance serves both.

Deviation, correlation time and tidal amplitude are unknown. The filter runs for a grid of them at once, and the
prediction is the average over the grid, weighted by posterior probability. The prior probability of no tide is one
half.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gliderhpc.vocabulary import TIDAL_PERIODS

Array = NDArray[np.float64]

DEVIATIONS = (0.02, 0.04, 0.08, 0.16, 0.32)
CORRELATION_TIMES = (3.0, 6.0, 12.0, 24.0, 48.0, 120.0)
TIDAL_DEVIATIONS = {0.0: 0.5, 0.03: 0.35, 0.12: 0.15}
"""Grid of the process: deviations (m/s), correlation times (h), and standard deviations of the coefficients of a tidal
line (m/s) with their prior probabilities."""

_USUAL_DEVIATION, _USUAL_HOURS, _SPREAD = 0.08, 24.0, 1.0
"""Centre of the prior of deviation and correlation time, and its standard deviation in the logarithm."""


_INTEGRAL = 2
"""Index of the integral among the states."""


@dataclass(frozen=True, eq=False)
class CurrentProcess:
    """Process of the current, or a batch of processes.

    Attributes
    ----------
    deviation : float or (...,) array
        Standard deviation of the Gauss-Markov part, m/s.
    correlation_time : float or (...,) array
        Its correlation time, s.
    mean_deviation : float
        Standard deviation of the constant mean about zero, m/s.
    tidal_deviation : float or (...,) array
        Standard deviation of the two coefficients of each tidal line about zero, m/s.
    periods : tuple of float
        Periods of the lines, s.
    """

    deviation: float | Array
    correlation_time: float | Array
    mean_deviation: float = 0.5
    tidal_deviation: float | Array = 0.0
    periods: tuple[float, ...] = ()

    @property
    def size(self) -> int:
        """Number of states of one component."""
        return 3 + 2 * len(self.periods)

    @property
    def initial_variances(self) -> Array:
        """Variances (..., size) of the states of one component before any observation."""
        deviation, tidal = np.broadcast_arrays(self.deviation, self.tidal_deviation)
        variances = np.zeros((*deviation.shape, self.size))
        variances[..., 0] = self.mean_deviation**2
        variances[..., 1] = deviation**2
        variances[..., 3:] = tidal[..., None] ** 2
        return variances

    def transition(self, elapsed: float) -> tuple[Array, Array]:
        """Return the transition matrix and the noise covariance of one component, (..., size, size) each.

        The states are mean, Gauss-Markov part, integral, and cosine and sine of each line.
        """
        tau, deviation = np.broadcast_arrays(self.correlation_time, self.deviation)
        variance, decay, lost = deviation**2, np.exp(-elapsed / tau), -np.expm1(-elapsed / tau)
        moves = np.zeros((*tau.shape, self.size, self.size))
        moves[..., 0, 0] = moves[..., 2, 2] = 1.0
        moves[..., 1, 1] = decay
        moves[..., 2, 0], moves[..., 2, 1] = elapsed, tau * lost
        for line, period in enumerate(self.periods):
            self._add_line(moves, 3 + 2 * line, 2.0 * np.pi / period, elapsed)
        noise = np.zeros_like(moves)
        noise[..., 1, 1] = variance * (1.0 - decay**2)
        noise[..., 1, 2] = noise[..., 2, 1] = variance * tau * lost**2
        noise[..., 2, 2] = variance * tau**2 * np.maximum(2.0 * elapsed / tau - 3.0 + 4.0 * decay - decay**2, 0.0)
        return moves, noise

    @staticmethod
    def _add_line(moves: Array, at: int, frequency: float, elapsed: float) -> None:
        cosine, sine = np.cos(frequency * elapsed), np.sin(frequency * elapsed)
        moves[..., at, at] = moves[..., at + 1, at + 1] = cosine
        moves[..., at, at + 1], moves[..., at + 1, at] = -sine, sine
        moves[..., 2, at], moves[..., 2, at + 1] = sine / frequency, (cosine - 1.0) / frequency


@dataclass(frozen=True, eq=False)
class CurrentObservation:
    """An average of the current over an interval, or its value at an instant if the interval has no length.

    Attributes
    ----------
    begin, end : float
        Interval, s.
    velocity : (2,) array
        Observed current, north and east, m/s.
    variance : float
        Variance of its error, north and east each, m2/s2.
    """

    begin: float
    end: float
    velocity: Array
    variance: float


@dataclass(frozen=True, eq=False)
class CurrentState:
    """Distribution of the current at a time, given the earlier observations; one for each process of a batch.

    Attributes
    ----------
    process : CurrentProcess
        Process of the current.
    time : float
        Time, s.
    mean : (..., n, 2) array
        Means of the n = `CurrentProcess.size` states of `CurrentProcess.transition`, north and east.
    covariance : (..., n, n) array
        Their covariance, the same for north and east.
    log_likelihood : float or (...,) array
        Log-likelihood of the observations.
    """

    process: CurrentProcess
    time: float
    mean: Array
    covariance: Array
    log_likelihood: float | Array = 0.0

    @classmethod
    def initial(cls, process: CurrentProcess, time: float) -> "CurrentState":
        """Distribution before any observation."""
        variances = process.initial_variances
        return cls(process, time, np.zeros((*variances.shape, 2)), variances[..., None] * np.eye(process.size))

    def at(self, time: float) -> "CurrentState":
        """Distribution at a later time."""
        moves, noise = self.process.transition(time - self.time)
        covariance = moves @ self.covariance @ np.swapaxes(moves, -1, -2) + noise
        return CurrentState(self.process, time, moves @ self.mean, covariance, self.log_likelihood)

    def restarted(self) -> "CurrentState":
        """Distribution with an integral that starts from zero at this time."""
        mean, covariance = self.mean.copy(), self.covariance.copy()
        mean[..., _INTEGRAL, :] = covariance[..., _INTEGRAL, :] = covariance[..., _INTEGRAL] = 0.0
        return CurrentState(self.process, self.time, mean, covariance, self.log_likelihood)

    def observed(self, observation: CurrentObservation) -> "CurrentState":
        """Distribution at the end of an observation, given this observation.

        Raises
        ------
        ValueError
            The observation begins before this time.
        """
        if observation.begin < self.time:
            raise ValueError(f"observation from {observation.begin} s, but the filter is already at {self.time} s")
        ahead = self.at(observation.begin)
        length = observation.end - observation.begin
        weights = np.zeros(self.process.size)
        if length > 0.0:
            ahead = ahead.restarted().at(observation.end)
            weights[_INTEGRAL] = 1.0 / length
        else:
            weights[:_INTEGRAL] = weights[_INTEGRAL + 1 :: 2] = 1.0
        return ahead._updated(weights, observation)

    def _updated(self, weights: Array, observation: CurrentObservation) -> "CurrentState":
        innovation = observation.velocity - weights @ self.mean
        covariances = self.covariance @ weights
        variance = covariances @ weights + observation.variance
        gain = covariances / variance[..., None]
        rest = np.eye(self.process.size) - gain[..., None] * weights
        # Joseph's form stays positive definite for an accurate observation and a wide prior.
        covariance = rest @ self.covariance @ np.swapaxes(rest, -1, -2)
        covariance += observation.variance * gain[..., None] * gain[..., None, :]
        term = -0.5 * np.sum(innovation**2, axis=-1) / variance - np.log(2.0 * np.pi * variance)
        mean = self.mean + gain[..., None] * innovation[..., None, :]
        return CurrentState(self.process, self.time, mean, covariance, self.log_likelihood + term)

    def drift(self, begin: float, end: float) -> tuple[Array, Array]:
        """Predict the water's displacement over a future interval.

        Parameters
        ----------
        begin, end : float
            Interval, not before `time`, s.

        Returns
        -------
        displacement, variance : (..., 2), (...) arrays
            Displacement north and east, and the variance of each, m and m2.
        """
        ahead = self.at(begin).restarted().at(end)
        return ahead.mean[..., _INTEGRAL, :], ahead.covariance[..., _INTEGRAL, _INTEGRAL]


def filtered_states(observations: Sequence[CurrentObservation], process: CurrentProcess) -> Iterator[CurrentState]:
    """Yield the state after each of several observations that follow one another without overlap.

    Parameters
    ----------
    observations : sequence of CurrentObservation
        At least one observation, in the order of time.
    process : CurrentProcess
        One process, or a batch of processes.
    """
    state = CurrentState.initial(process, observations[0].begin)
    for observation in observations:
        state = state.observed(observation)
        yield state


@dataclass(frozen=True, eq=False)
class Nowcast:
    """Distribution of the current, averaged over processes.

    Attributes
    ----------
    state : CurrentState
        Distributions given each of the processes of a batch ``(p,)``.
    weights : (p,) array
        Posterior probabilities of the processes.
    """

    state: CurrentState
    weights: Array

    @property
    def deviation(self) -> float:
        """Standard deviation of the Gauss-Markov part in the most probable process, m/s."""
        return float(np.asarray(self.state.process.deviation)[np.argmax(self.weights)])

    @property
    def correlation_time(self) -> float:
        """Correlation time of the Gauss-Markov part in the most probable process, s."""
        return float(np.asarray(self.state.process.correlation_time)[np.argmax(self.weights)])

    @property
    def time(self) -> float:
        """End of the last observation, s."""
        return self.state.time

    def drift(self, begin: float, end: float) -> tuple[Array, Array]:
        """Predict the water's displacement (2,) over a future interval, m, and its covariance (2, 2), m2."""
        means, variances = self.state.drift(begin, end)
        mean = self.weights @ means
        misses = means - mean
        return mean, self.weights @ variances * np.eye(2) + misses.T @ (self.weights[:, None] * misses)


def nowcasts(
    observations: Sequence[CurrentObservation], tides: Sequence[str] = tuple(TIDAL_PERIODS)
) -> Iterator[Nowcast]:
    """Filter observations with the processes of a grid, and yield the nowcast after each of them.

    Parameters
    ----------
    observations : sequence of CurrentObservation
        At least one observation, in the order of time, without overlap.
    tides : sequence of str
        Tidal lines of `TIDAL_PERIODS`; empty for a process without a tide.
    """
    amplitudes = list(TIDAL_DEVIATIONS) if tides else [0.0]
    axes = np.meshgrid(DEVIATIONS, CORRELATION_TIMES, amplitudes, indexing="ij")
    deviation, hours, tidal = (axis.ravel() for axis in axes)
    periods = tuple(3600.0 * TIDAL_PERIODS[name] for name in tides)
    process = CurrentProcess(deviation, 3600.0 * hours, tidal_deviation=tidal, periods=periods)
    steps = np.log(deviation / _USUAL_DEVIATION) ** 2 + np.log(hours / _USUAL_HOURS) ** 2
    log_prior = -0.5 * steps / _SPREAD**2 + np.log([TIDAL_DEVIATIONS[value] for value in tidal.tolist()])
    for state in filtered_states(observations, process):
        logarithm = state.log_likelihood + log_prior
        weights = np.exp(logarithm - np.max(logarithm))
        yield Nowcast(state, weights / np.sum(weights))
