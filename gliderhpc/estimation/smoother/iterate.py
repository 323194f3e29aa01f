"""The iterated smoother of a whole dive: disturbances and motion from past and future samples, and how sure they are.

It is the Gauss-Newton iteration for the maximum a posteriori (MAP) problem of `gliderhpc.estimation.smoother.problem`:
every pass linearises the flight model about the smoothed trajectory of the pass before. By default a further term leads
to the mean in place of the most probable trajectory (docs/smoother.md).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gliderhpc.estimation.settings import SmootherSettings
from gliderhpc.estimation.smoother.noise import NoiseModel
from gliderhpc.estimation.smoother.problem import Sweeps, Trajectory
from gliderhpc.flight.glider import SENSED
from gliderhpc.kernels.parameters import Hull
from gliderhpc.kernels.smoother_memory import Backward, Dive
from gliderhpc.outcomes import Outcome

Array = NDArray[np.float64]

_FRACTIONS = (1.0, 0.5, 0.25, 0.125)
"""Parts of a pass's move that are tried."""
_PENALTY = 1.5
"""Weight of a defect over the largest costate of its state: above 1 the merit's minimum is that of the MAP problem."""
_NEARLY_DONE = 1.0
"""Move left, in standard deviations, with which an iteration that ended early still gives an estimate."""
_SETTLED = 0.1
"""Relative change of a variance of the noise below which it counts as settled."""
_MEAN_SHIFT_EVERY = 5
"""Steps that share a mean shift, which changes with the covariances: a quarter of a pass's time in place of half."""
_ROUNDING = 1e-11
"""Relative increase of the merit that rounding explains."""


@dataclass(frozen=True, eq=False)
class SmoothedEstimate:
    """Smoothed estimate of one profile of ``n`` steps.

    Attributes
    ----------
    states, states_std : (n+1, 12)
        States (eq. 16, SI and rad) and their standard deviations, the last pass's move included; X and Y from the start
        of the profile.
    disturbances, disturbances_std : (n, 6)
        Disturbance over each step and its standard deviation, N and N m.
    displacement_covariance : (2, 2)
        Of X and Y at the end, m2.
    cost : float
        Half the sum of all squares over variances: initial state, noise and measurements (heavy tails: with the last
        weights).
    passes : int
        Linearisations.
    damped : int
        Passes whose move was shortened or not made at all.
    movement : float
        Move of the last pass, in standard deviations, root mean square over rows and states.
    noise_factor : (6,)
        Variance that the steps added in the end, over that of the prior (of `smooth_dive`: over that given, median).
    used, widened : int
        Values that counted, and those with a widened variance.
    outcome : Outcome
        How it ended; where it is not usable, the values are the filter's and the standard deviations NaN.
    """

    states: Array
    states_std: Array
    disturbances: Array
    disturbances_std: Array
    displacement_covariance: Array
    cost: float
    passes: int
    damped: int
    movement: float
    noise_factor: Array
    used: int
    widened: int
    outcome: Outcome


def smooth_dive(
    hull: Hull,
    dive: Dive,
    start: Trajectory,
    settings: SmootherSettings,
    *,
    gate: float = np.inf,
    noise_models: Sequence[NoiseModel] = (),
    usual: NDArray[np.bool_] | None = None,
) -> SmoothedEstimate:
    """Iterate passes over a dive until nothing moves by more than the tolerance.

    Parameters
    ----------
    hull, dive : Hull, Dive
        The problem; its variances are widened where the first pass needs it, its noise renewed by the models.
    start : Trajectory
        Trajectory of the first linearisation; its X and Y are replaced.
    settings : SmootherSettings
        Tolerance, cap (unset: none), and mean or mode.
    gate : float
        Standard deviations beyond which the first pass widens a variance; infinite by default.
    noise_models : sequence of NoiseModel
        Models by which the noise follows the passes; none by default.
    usual : (n,) mask, optional
        Steps by which the noise is judged; all by default.
    """
    nominal, noise = dive.variance.copy(), dive.noise.copy()
    dive.mean_shift[:] = 0.0
    sweeps = Sweeps(hull, dive, mean_shift_every=_MEAN_SHIFT_EVERY if settings.estimate == "mean" else None)
    iteration = _Iteration(
        sweeps, start, settings, gate, noise_models, np.ones(len(noise), bool) if usual is None else usual
    )
    outcome = iteration.run()
    iterate, linear = iteration.iterate, iteration.linear
    values = dive.fed[:, None] & np.isfinite(dive.measured)
    return SmoothedEstimate(
        states=iterate.trajectory.states,
        states_std=_state_deviations(linear),
        disturbances=iterate.trajectory.disturbances[:-1],
        disturbances_std=np.sqrt(linear.disturbance_variance + linear.correction[:, 10:] ** 2)[:-1],
        displacement_covariance=linear.displacement,
        cost=float(iterate.costs.sum()),
        passes=iteration.passes,
        damped=iteration.damped,
        movement=iteration.movement,
        noise_factor=np.median(dive.noise / noise, axis=0),
        used=int(values.sum()),
        widened=int((values & (dive.variance > nominal)).sum()),
        outcome=outcome,
    )


_FIRST = 1.0
_TIGHTER = 10.0
_LOOSER = 0.1
_WEAKEST = 0.5
_STRONGEST = 1e6


class Damping:
    """Levenberg-Marquardt damping: rows are held to the trajectory where no part of a move lowers the merit.

    Notes
    -----
    Near rest the angle of attack swings by tens of degrees within the velocity's uncertainty, and a Gauss-Newton move
    overshoots there while the rest of the dive needs it; shortening the whole move further and further would hold up
    everything for a few seconds. Velocities and rates are held, with the deviations of the initial state's prior over
    the root of a strength: rows that the record pins down better than that hardly notice (Särkkä and Svensson 2020,
    Levenberg-Marquardt and line-search extended Kalman smoothers, ICASSP 2020, 5875-5879).
    """

    def __init__(self, dive: Dive) -> None:
        self._dive = dive
        self._variance = np.square(dive.deviation[4:10])
        self.strength = 0.0

    @property
    def active(self) -> bool:
        """Return whether rows are held at all."""
        return self.strength > 0.0

    @property
    def exhausted(self) -> bool:
        """Return whether further tightening is pointless."""
        return self.strength > _STRONGEST

    def set(self, strength: float) -> None:
        """Damp with a strength; less than the weakest is none."""
        self.strength = strength if strength >= _WEAKEST else 0.0
        self._dive.damping[:] = self._variance / self.strength if self.active else np.inf

    def loosen(self) -> None:
        """Damp less, as after a move that was good."""
        self.set(self.strength * _LOOSER)

    def tighten(self) -> None:
        """Damp more, as after a move that was not."""
        self.set(max(self.strength * _TIGHTER, _FIRST))


class _Iteration:
    """Passes over a dive until nothing moves, each move damped where it must be."""

    def __init__(
        self, sweeps: Sweeps, start: Trajectory, settings: SmootherSettings, gate: float, models: Sequence[NoiseModel],
        usual: NDArray[np.bool_],
    ) -> None:  # fmt: skip
        self._sweeps, self._settings, self._models, self._usual = sweeps, settings, models, usual
        self._damping = Damping(sweeps.dive)
        self.iterate = sweeps.forward(start, gate)
        self.passes = self.damped = 0
        self.movement = np.inf
        # Part of the log determinant that the dive's own noise confirms.
        self.share = 1.0
        self._cap = np.inf if settings.max_passes is None else settings.max_passes
        self.linear = self._pass()

    def run(self) -> Outcome:
        """Iterate; afterwards nothing is held, so that variances are the problem's own."""
        if self._cap == 1:
            return self._only()
        outcome = self._iterate()
        if self._damping.active:
            self._damping.set(0.0)
            self.iterate = self._sweeps.forward(self.iterate.trajectory)
            self.linear = self._pass()
        if outcome is Outcome.CONVERGED:
            self.iterate = self._sweeps.forward(self._moved(1.0))
        # One that would still move by a standard deviation, or gave no numbers, has no estimate.
        return outcome if self.movement <= _NEARLY_DONE else Outcome.DIVERGED

    def _only(self) -> Outcome:
        """Make as much of the only pass's move as can be flown; the rest counts as uncertainty."""
        for fraction in _FRACTIONS:
            trial = self._sweeps.forward(self._moved(fraction))
            if np.isfinite(trial.merit(np.zeros_like(trial.defects), 0.0)):
                self.damped += fraction < 1.0
                rest = (1.0 - fraction) * self.linear.correction
                self.iterate, self.linear = trial, self.linear._replace(correction=rest)
                return Outcome.ITERATION_LIMIT
        return Outcome.DIVERGED

    def _moved(self, fraction: float) -> Trajectory:
        """The trajectory, moved by a part of the last pass's correction."""
        states, disturbances = self.iterate.trajectory.states.copy(), self.iterate.trajectory.disturbances.copy()
        states[:, SENSED] += fraction * self.linear.correction[:, :10]
        disturbances += fraction * self.linear.correction[:, 10:]
        return Trajectory(states, disturbances)

    def _iterate(self) -> Outcome:
        while self.passes < self._cap:
            noise = self._renewed_noise()
            if self.movement <= self._settings.tolerance and noise is self._sweeps.dive.noise:
                if not self._damping.active:
                    return Outcome.CONVERGED
                self._damping.set(0.0)
                self.iterate = self._sweeps.forward(self.iterate.trajectory)
            else:
                self._move(noise)
            if self._damping.exhausted:
                return Outcome.STALLED
            self.linear = self._pass()
        return Outcome.ITERATION_LIMIT

    def _pass(self) -> Backward:
        linear = self._sweeps.backward(self.iterate.trajectory)
        if len(linear.mean_shift) and not self._damping.active:
            # For the next pass: this one used the mean shift about the trajectory before.
            self.share = consistency(linear, self._sweeps.dive.noise, self._usual)
            self._sweeps.dive.mean_shift[:] = self.share * linear.mean_shift
        self.movement = _movement(linear)
        self.passes += 1
        return linear

    def _renewed_noise(self) -> Array:
        """Variances of the noise for the next pass: the very array in use, unless something has moved."""
        used: Array = self._sweeps.dive.noise
        noise = used
        # Held rows would seem to be resolved better than the record does.
        for model in () if self._damping.active else self._models:
            noise = model.renewed(noise, self.linear)
        return noise if np.max(np.abs(noise / used - 1.0)) > _SETTLED else used

    def _move(self, noise: Array) -> None:
        """Move the trajectory by the pass's correction, or by a part, where that lowers the merit; else damp more.

        The merit adds to the cost the absolute defects, each state's weighed by more than its largest costate: the
        defects' Lagrange multiplier. Then short moves always point downhill, and a trajectory of least merit has no
        defects.
        """
        weights = _PENALTY * self.linear.steepest
        trajectory, strength = self.iterate.trajectory, self._damping.strength
        if self._damping.active:
            self._damping.loosen()
            self.iterate = self._sweeps.forward(trajectory)
        merit = self.iterate.merit(weights, self.share)
        most = merit + _ROUNDING * abs(merit)
        for fraction in _FRACTIONS:
            trial = self._sweeps.forward(self._moved(fraction))
            if trial.merit(weights, self.share) <= most:
                self.iterate = trial
                self.damped += fraction < 1.0
                if noise is not self._sweeps.dive.noise:
                    self._sweeps.dive.noise[:] = noise
                    self.iterate = self._sweeps.forward(self.iterate.trajectory)
                return
        self.damped += 1
        self._damping.set(strength)
        self._damping.tighten()
        self.iterate = self._sweeps.forward(trajectory)


def consistency(linear: Backward, noise: Array, usual: NDArray[np.bool_]) -> float:
    """Sum of the smoothed noise's squares over their variances, relative to the number of resolved values; at most one.

    Steps ``usual`` count; without any the noise is not contradicted, and the ratio is one.
    """
    resolved = float(np.sum(linear.noise_resolved[usual]))
    spent = float(np.sum((linear.noise_mean**2 / noise)[usual]))
    return min(1.0, spent / resolved) if resolved > 0.0 else 1.0


def _movement(linear: Backward) -> float:
    """Root mean square of the move in standard deviations; NaN where the pass gave no numbers."""
    variance = np.hstack([linear.state_variance, linear.disturbance_variance])
    square = linear.correction**2
    known = variance > 0.0
    if not (np.isfinite(square).all() and np.isfinite(variance).all()):
        return float("nan")
    return float(np.sqrt(np.mean(square[known] / variance[known]))) if known.any() else 0.0


def _state_deviations(linear: Backward) -> Array:
    """Standard deviations ``(n+1, 12)``; the last pass's move of a state counts as uncertainty."""
    deviations = np.empty((len(linear.state_variance), 12))
    deviations[:, SENSED] = np.sqrt(linear.state_variance + linear.correction[:, :10] ** 2)
    deviations[:, 3:5] = np.sqrt(linear.track_variance)
    return deviations
