r"""Nowcast of the current: a Kalman filter over depth-averaged currents and surface drifts.

Each component of the current is a constant mean plus a Gauss-Markov process,

.. math:: u(t) = m + g(t), \qquad \dot g = -g / \tau + w, \qquad \operatorname{Var} g = \sigma^2 .

A depth-averaged current is the average of :math:`u` over a dive, a surface drift is :math:`u` at an instant. The filter
carries the integral of :math:`u` along, so that both are observed exactly; the same integral gives how far the water
will move a glider. North and east have the same process and share the observations' covariances.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

DEVIATIONS = (0.02, 0.04, 0.08, 0.16, 0.32)
CORRELATION_TIMES = (3.0, 6.0, 12.0, 24.0, 48.0, 120.0)
"""Deviations (m/s) and correlation times (h) among which the likelihood chooses."""

_USUAL_DEVIATION, _USUAL_HOURS, _SPREAD = 0.08, 24.0, 1.0
"""Middle of their prior, and its standard deviation in the logarithm."""


def _both(component: Array) -> Array:
    """Matrix for north and east in turn from that of one component."""
    rows, columns = component.shape
    full = np.zeros((rows, 2, columns, 2))
    full[:, 0, :, 0] = full[:, 1, :, 1] = component
    return full.reshape(2 * rows, 2 * columns)


@dataclass(frozen=True)
class CurrentProcess:
    """Process of the current.

    Attributes
    ----------
    deviation : float
        Standard deviation of the Gauss-Markov part, m/s.
    correlation_time : float
        Its correlation time, s.
    mean_deviation : float
        Standard deviation of the constant mean about zero, m/s.
    """

    deviation: float
    correlation_time: float
    mean_deviation: float = 0.5

    def transition(self, elapsed: float) -> tuple[Array, Array]:
        """Transition and noise covariance (6, 6) of mean, Gauss-Markov part and integral (each north, east)."""
        tau, variance = self.correlation_time, self.deviation**2
        decay = np.exp(-elapsed / tau)
        lost = -np.expm1(-elapsed / tau)
        moves = np.array([[1.0, 0.0, 0.0], [0.0, decay, 0.0], [elapsed, tau * lost, 1.0]])
        noise = np.zeros((3, 3))
        noise[1, 1] = variance * (1.0 - decay**2)
        noise[1, 2] = noise[2, 1] = variance * tau * lost**2
        noise[2, 2] = variance * tau**2 * max(2.0 * elapsed / tau - 3.0 + 4.0 * decay - decay**2, 0.0)
        return _both(moves), _both(noise)


@dataclass(frozen=True, eq=False)
class CurrentObservation:
    """An average of the current over an interval, or its value at an instant where the interval has no length.

    Attributes
    ----------
    begin, end : float
        Interval, s.
    velocity : (2,) array
        North and east, m/s.
    covariance : (2, 2) array
        Of its error, m2/s2.
    """

    begin: float
    end: float
    velocity: Array
    covariance: Array


@dataclass(frozen=True, eq=False)
class CurrentState:
    """Distribution of the current at a time, by what was observed before.

    Attributes
    ----------
    process : CurrentProcess
        The process.
    time : float
        s.
    mean, covariance : (6,), (6, 6) arrays
        Of mean, Gauss-Markov part and integral, each north and east.
    log_likelihood : float
        Of the observations.
    """

    process: CurrentProcess
    time: float
    mean: Array
    covariance: Array
    log_likelihood: float = 0.0

    @classmethod
    def initial(cls, process: CurrentProcess, time: float) -> "CurrentState":
        """Distribution before any observation."""
        variances = np.repeat([process.mean_deviation**2, process.deviation**2, 0.0], 2)
        return cls(process, time, np.zeros(6), np.diag(variances))

    def at(self, time: float) -> "CurrentState":
        """Distribution at a later time."""
        moves, noise = self.process.transition(time - self.time)
        covariance = moves @ self.covariance @ moves.T + noise
        return CurrentState(self.process, time, moves @ self.mean, covariance, self.log_likelihood)

    def restarted(self) -> "CurrentState":
        """Distribution with an integral that begins now."""
        keep = np.diag([1.0, 1.0, 1.0, 1.0, 0.0, 0.0])
        covariance = keep @ self.covariance @ keep
        return CurrentState(self.process, self.time, keep @ self.mean, covariance, self.log_likelihood)

    def observed(self, observation: CurrentObservation) -> "CurrentState":
        """Distribution at the end of an observation, given it.

        Raises
        ------
        ValueError
            The observation begins before this time.
        """
        if observation.begin < self.time:
            raise ValueError(f"observation from {observation.begin} s, but the filter is at {self.time} s already")
        ahead = self.at(observation.begin).restarted().at(observation.end)
        length = observation.end - observation.begin
        weights = [0.0, 0.0, 1.0 / length] if length > 0.0 else [1.0, 1.0, 0.0]
        return ahead._updated(_both(np.array([weights])), observation)

    def _updated(self, sees: Array, observation: CurrentObservation) -> "CurrentState":
        innovation = observation.velocity - sees @ self.mean
        variance = sees @ self.covariance @ sees.T + observation.covariance
        gain = np.linalg.solve(variance, sees @ self.covariance).T
        rest = np.eye(6) - gain @ sees
        # Joseph's form stays positive where a good observation meets a wide prior.
        covariance = rest @ self.covariance @ rest.T + gain @ observation.covariance @ gain.T
        square = float(innovation @ np.linalg.solve(variance, innovation))
        term = -0.5 * (square + float(np.linalg.slogdet(2.0 * np.pi * variance)[1]))
        return CurrentState(
            self.process, self.time, self.mean + gain @ innovation, covariance, self.log_likelihood + term
        )

    def drift(self, begin: float, end: float) -> tuple[Array, Array]:
        """Predict the water's displacement over an interval to come.

        Parameters
        ----------
        begin, end : float
            From `time` on, s.

        Returns
        -------
        displacement, covariance : (2,), (2, 2) arrays
            North and east, m and m2.
        """
        ahead = self.at(begin).restarted().at(end)
        return ahead.mean[4:], ahead.covariance[4:, 4:]


def filter_currents(observations: Sequence[CurrentObservation], process: CurrentProcess) -> CurrentState:
    """Filter observations that follow one another without overlap.

    Parameters
    ----------
    observations : sequence of CurrentObservation
        One at least, in the order of time.
    process : CurrentProcess
        The process.
    """
    state = CurrentState.initial(process, observations[0].begin)
    for observation in observations:
        state = state.observed(observation)
    return state


def nowcast(observations: Sequence[CurrentObservation]) -> CurrentState:
    """Filter observations with the most probable of the processes of `DEVIATIONS` and `CORRELATION_TIMES`."""
    states = [
        filter_currents(observations, CurrentProcess(deviation, 3600.0 * hours))
        for deviation, hours in product(DEVIATIONS, CORRELATION_TIMES)
    ]
    return max(states, key=lambda state: state.log_likelihood + _log_prior(state.process))


def _log_prior(process: CurrentProcess) -> float:
    steps = np.log([process.deviation / _USUAL_DEVIATION, process.correlation_time / (3600.0 * _USUAL_HOURS)])
    return float(-0.5 * np.sum((steps / _SPREAD) ** 2))
