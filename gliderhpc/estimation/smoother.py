"""The iterated smoother of a whole dive: disturbances and motion from past and future samples, and how sure they are.

It is the Gauss-Newton iteration for the maximum a posteriori (MAP) problem of `gliderhpc.estimation.smoothing_problem`:
every pass linearises the flight model about the smoothed path of the pass before. By default a further term leads to
the mean in place of the most probable path (docs/smoother.md).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from gliderhpc.estimation.hold import Hold
from gliderhpc.estimation.settings import SmootherSettings
from gliderhpc.estimation.smoothing_problem import Path
from gliderhpc.estimation.window_problem import flyable
from gliderhpc.flight.glider import SENSED
from gliderhpc.kernels import smoother as kernel
from gliderhpc.kernels.parameters import Hull
from gliderhpc.kernels.smoother_memory import (
    DEFECTS,
    ROOM,
    Backward,
    Dive,
    allocate_backward,
    allocate_block,
    allocate_checkpoints,
    allocate_information,
)
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
_TILT_EVERY = 5
"""Steps that share a tilt, which changes with the covariances: a quarter of a pass's time in place of its half."""
_ROUNDING = 1e-11
"""Relative increase of the merit that rounding explains."""


class NoiseModel(Protocol):
    """By what the noise of the disturbances follows what a pass has found."""

    def renewed(self, noise: Array, linear: Backward) -> Array:
        """Variances ``(n, 6)`` of the next pass, from those of the last one and what it gave."""


@dataclass(frozen=True, eq=False)
class SmoothedEstimate:
    """What the smoother makes of one profile of ``n`` steps.

    Attributes
    ----------
    states, states_std : (n+1, 12)
        States (eq. 16, SI and rad) and their standard deviations, to which counts what the last pass moved them
        by; X and Y from the start of the profile.
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
        How it ended; where it is not usable, the filter's estimate stands in, its standard deviations NaN.
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


@dataclass(frozen=True, eq=False)
class Iterate:
    """The path a pass was linearised about and what it costs.

    Attributes
    ----------
    path : Path
        The path.
    costs : (3,)
        Of initial state, measurements and noise.
    room : float
        Half the logarithm of the Hessian's determinant, where the mean is wanted; else zero.
    defects : (10,)
        Sums of the sensed states' absolute defects.
    """

    path: Path
    costs: Array
    room: float
    defects: Array

    def merit(self, weights: Array, share: float) -> float:
        """What is to be least, the defects weighed by ``weights`` and the room by ``share``.

        Infinite for a path that is not finite or cannot be flown.
        """
        value = float(self.costs.sum() + share * self.room + weights @ self.defects)
        return value if np.isfinite(value) and flyable(self.path.states[:, SENSED]) else np.inf


class Sweeps:
    """The two sweeps of a pass, in buffers of their own."""

    def __init__(self, hull: Hull, dive: Dive, rows: tuple[int, ...] = (), *, tilt_every: int | None = None) -> None:
        steps = len(dive.bodies)
        self.dive = dive
        self._hull = hull
        self._block, self._checkpoints = allocate_block(), allocate_checkpoints(steps)
        self._information = allocate_information()
        self._tally = np.zeros(ROOM + 1)
        self._mean = tilt_every is not None
        self._backward = allocate_backward(steps, rows, every=tilt_every)

    def forward(self, path: Path, gate: float = np.inf) -> Iterate:
        """Filter about a path; X and Y of the path are replaced by the displacement along it."""
        kernel.forward(
            self._hull, self.dive, path.states, path.disturbances, gate, self._block, self._checkpoints, self._tally
        )
        room = float(self._tally[ROOM]) if self._mean else 0.0
        return Iterate(path, self._tally[:DEFECTS].copy(), room, self._tally[DEFECTS:ROOM].copy())

    def backward(self, path: Path) -> Backward:
        """Smooth about the path of the last forward sweep; the next backward sweep overwrites what this one gives."""
        kernel.backward(
            self._hull, self.dive, path.states, path.disturbances, self._block, self._checkpoints, self._tally,
            *self._information, self._backward,
        )  # fmt: skip
        return self._backward


def smooth_dive(
    hull: Hull,
    dive: Dive,
    start: Path,
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
        The problem; its variances are widened where the first pass needs it, its noise as the models of it ask.
    start : Path
        Path of the first linearisation; its X and Y are replaced.
    settings : SmootherSettings
        Tolerance, cap (unset: none), and whether the mean or the mode is wanted.
    gate : float
        Standard deviations beyond which the first pass widens a variance; infinite by default.
    noise_models : sequence of NoiseModel
        By which the noise follows what the passes find; none by default.
    usual : (n,) mask, optional
        Steps that tell how much of the noise the dive confirms; all by default.
    """
    nominal, noise = dive.variance.copy(), dive.noise.copy()
    dive.tilt[:] = 0.0
    usual = np.ones(len(noise), dtype=bool) if usual is None else usual
    sweeps = Sweeps(hull, dive, tilt_every=_TILT_EVERY if settings.estimate == "mean" else None)
    iteration = _Iteration(
        sweeps, start, settings, gate, noise_models, np.ones(len(noise), bool) if usual is None else usual
    )
    outcome = iteration.run()
    iterate, linear = iteration.iterate, iteration.linear
    values = dive.fed[:, None] & np.isfinite(dive.measured)
    return SmoothedEstimate(
        states=iterate.path.states,
        states_std=_state_deviations(linear),
        disturbances=iterate.path.disturbances[:-1],
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


class _Iteration:
    """Passes over a dive until nothing moves, each move held back where it must be."""

    def __init__(
        self, sweeps: Sweeps, start: Path, settings: SmootherSettings, gate: float, models: Sequence[NoiseModel],
        usual: NDArray[np.bool_],
    ) -> None:  # fmt: skip
        self._sweeps, self._settings, self._models, self._usual = sweeps, settings, models, usual
        self._hold = Hold(sweeps.dive)
        self.iterate = sweeps.forward(start, gate)
        self.passes = self.damped = 0
        self.movement = np.inf
        # Of the room, that the dive's own noise confirms.
        self.share = 1.0
        self._cap = np.inf if settings.max_passes is None else settings.max_passes
        self.linear = self._pass()

    def run(self) -> Outcome:
        """Iterate; afterwards nothing is held, so that variances are the problem's own."""
        if self._cap == 1:
            return self._only()
        outcome = self._iterate()
        if self._hold.active:
            self._hold.set(0.0)
            self.iterate = self._sweeps.forward(self.iterate.path)
            self.linear = self._pass()
        if outcome is Outcome.CONVERGED:
            self.iterate = self._sweeps.forward(self._moved(1.0))
        # One that would still move by a standard deviation, or gave no numbers, has no estimate.
        return outcome if self.movement <= _NEARLY_DONE else Outcome.DIVERGED

    def _only(self) -> Outcome:
        """Make the move of the only pass, as much of it as leads to a path that can be flown; the rest is in doubt."""
        for fraction in _FRACTIONS:
            trial = self._sweeps.forward(self._moved(fraction))
            if np.isfinite(trial.merit(np.zeros_like(trial.defects), 0.0)):
                self.damped += fraction < 1.0
                rest = (1.0 - fraction) * self.linear.correction
                self.iterate, self.linear = trial, self.linear._replace(correction=rest)
                return Outcome.ITERATION_LIMIT
        return Outcome.DIVERGED

    def _moved(self, fraction: float) -> Path:
        """The path, moved by a part of the last pass's correction."""
        states, disturbances = self.iterate.path.states.copy(), self.iterate.path.disturbances.copy()
        states[:, SENSED] += fraction * self.linear.correction[:, :10]
        disturbances += fraction * self.linear.correction[:, 10:]
        return Path(states, disturbances)

    def _iterate(self) -> Outcome:
        while self.passes < self._cap:
            noise = self._renewed_noise()
            if self.movement <= self._settings.tolerance and noise is self._sweeps.dive.noise:
                if not self._hold.active:
                    return Outcome.CONVERGED
                self._hold.set(0.0)
                self.iterate = self._sweeps.forward(self.iterate.path)
            else:
                self._move(noise)
            if self._hold.exhausted:
                return Outcome.STALLED
            self.linear = self._pass()
        return Outcome.ITERATION_LIMIT

    def _pass(self) -> Backward:
        linear = self._sweeps.backward(self.iterate.path)
        if len(linear.tilt) and not self._hold.active:
            # For the next pass: this one's came with the tilt about the path before.
            self.share = consistency(linear, self._sweeps.dive.noise, self._usual)
            self._sweeps.dive.tilt[:] = self.share * linear.tilt
        self.movement = _movement(linear)
        self.passes += 1
        return linear

    def _renewed_noise(self) -> Array:
        """What the noise is to be: the very array in use, unless something has moved."""
        used: Array = self._sweeps.dive.noise
        noise = used
        # Held rows would seem to be resolved better than the record does.
        for model in () if self._hold.active else self._models:
            noise = model.renewed(noise, self.linear)
        return noise if np.max(np.abs(noise / used - 1.0)) > _SETTLED else used

    def _move(self, noise: Array) -> None:
        """Move the path by the pass's correction, or by some of it, where that lowers the merit; else hold it more.

        The merit adds to the cost the absolute defects, each state's weighed by more than its largest costate: the
        defects' Lagrange multiplier. Then short moves always point downhill, and a path of least merit has no defects.
        """
        weights = _PENALTY * self.linear.steepest
        path, strength = self.iterate.path, self._hold.strength
        if self._hold.active:
            self._hold.loosen()
            self.iterate = self._sweeps.forward(path)
        merit = self.iterate.merit(weights, self.share)
        most = merit + _ROUNDING * abs(merit)
        for fraction in _FRACTIONS:
            trial = self._sweeps.forward(self._moved(fraction))
            if trial.merit(weights, self.share) <= most:
                self.iterate = trial
                self.damped += fraction < 1.0
                if noise is not self._sweeps.dive.noise:
                    self._sweeps.dive.noise[:] = noise
                    self.iterate = self._sweeps.forward(self.iterate.path)
                return
        self.damped += 1
        self._hold.set(strength)
        self._hold.tighten()
        self.iterate = self._sweeps.forward(path)


def consistency(linear: Backward, noise: Array, usual: NDArray[np.bool_]) -> float:
    """Squares of the smoothed noise over their variances, in sum, over what the record resolves of it; at most one.

    Steps ``usual`` count; where there is none, nothing speaks against the noise.
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
    """Deviations ``(n+1, 12)``; what the last pass moves a state by counts as uncertainty."""
    deviations = np.empty((len(linear.state_variance), 12))
    deviations[:, SENSED] = np.sqrt(linear.state_variance + linear.correction[:, :10] ** 2)
    deviations[:, 3:5] = np.sqrt(linear.track_variance)
    return deviations
