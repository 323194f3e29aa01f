"""The iterated smoother of a whole dive: disturbances and motion from past and future samples, and how sure they are.

It is the Gauss-Newton iteration for the maximum a posteriori (MAP) problem of `gliderhpc.estimation.smoothing_problem`:
every pass linearises the flight model about the smoothed path of the pass before (docs/smoother.md).
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gliderhpc.estimation.filter import FilterEstimate
from gliderhpc.estimation.heavy_tails import SETTLED, HeavyTails
from gliderhpc.estimation.outcomes import Outcome
from gliderhpc.estimation.preparation import controls_of
from gliderhpc.estimation.settings import EstimationSettings, SmootherSettings, candidate_priors
from gliderhpc.estimation.smoothing_problem import Path, pose_dive, starting_path
from gliderhpc.estimation.window_problem import flyable
from gliderhpc.flight.glider import SENSED, Glider
from gliderhpc.kernels import smoother as kernel
from gliderhpc.kernels.parameters import Hull
from gliderhpc.kernels.smoother_memory import (
    DEFECTS,
    Backward,
    Dive,
    allocate_backward,
    allocate_block,
    allocate_checkpoints,
    allocate_information,
)
from gliderhpc.observations.resample import ProfileSeries
from gliderhpc.store_schema.schema import CHANNELS

Array = NDArray[np.float64]

_SHORTEST = 1.0 / 64.0
"""Fraction of a pass's move below which no decrease is looked for any more."""
_PENALTY = 2.0
"""Weight of a defect over the largest costate of its state: above 1 the merit's minimum is that of the MAP problem."""
_ROUNDING = 1e-11
"""Relative increase of the merit that rounding explains."""


@dataclass(frozen=True, eq=False)
class SmoothedEstimate:
    """What the smoother makes of one profile of ``n`` steps.

    Attributes
    ----------
    states, states_std : (n+1, 12)
        States (eq. 16, SI and rad) and their standard deviations; X and Y from the start of the profile.
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
        Passes whose move was shortened.
    movement : float
        Largest move of the last pass, which is not made any more, in standard deviations.
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
    defects : (10,)
        Sums of the sensed states' absolute defects.
    """

    path: Path
    costs: Array
    defects: Array

    def merit(self, weights: Array) -> float:
        """Cost with the defects' penalty; infinite for a path that is not finite or cannot be flown."""
        value = float(self.costs.sum() + weights @ self.defects)
        return value if np.isfinite(value) and flyable(self.path.states[:, SENSED]) else np.inf


class Sweeps:
    """The two sweeps of a pass, in buffers of their own."""

    def __init__(self, hull: Hull, dive: Dive, rows: tuple[int, ...] = ()) -> None:
        steps = len(dive.bodies)
        self.dive = dive
        self._hull = hull
        self._block, self._checkpoints = allocate_block(), allocate_checkpoints(steps)
        self._information = allocate_information()
        self._tally = np.zeros(13)
        self._backward = allocate_backward(steps, rows)

    def forward(self, path: Path, gate: float = np.inf) -> Iterate:
        """Filter about a path; X and Y of the path are replaced by the displacement along it."""
        kernel.forward(
            self._hull, self.dive, path.states, path.disturbances, gate, self._block, self._checkpoints, self._tally
        )
        return Iterate(path, self._tally[:DEFECTS].copy(), self._tally[DEFECTS:].copy())

    def backward(self, path: Path) -> Backward:
        """Smooth about the path of the last forward sweep; the next backward sweep overwrites what this one gives."""
        kernel.backward(
            self._hull, self.dive, path.states, path.disturbances, self._block, self._checkpoints, self._tally,
            *self._information, self._backward,
        )  # fmt: skip
        return self._backward


def smooth_profile(
    glider: Glider,
    series: ProfileSeries,
    shaken: NDArray[np.bool_],
    estimate: FilterEstimate,
    prior: str,
    settings: EstimationSettings,
) -> SmoothedEstimate:
    """Smooth one profile that was filtered.

    Parameters
    ----------
    glider, series : Glider, ProfileSeries
        The hull and the record on the steps.
    shaken : (n+1,)
        The vibration set.
    estimate, prior : FilterEstimate, str
        The filter's estimate, and the name of the disturbance prior that it took (`candidate_priors`).
    settings : EstimationSettings
        Uses ``step``, ``filter`` and ``smoother``.
    """
    bodies = glider.bodies(controls_of(glider.platform, series))
    dive = pose_dive(glider, series, bodies, shaken, estimate, candidate_priors(glider.platform)[prior], settings)
    tails = _tails(dive, series, settings.smoother)
    smoothed = smooth_dive(
        glider.hull, dive, starting_path(estimate), settings.smoother, gate=settings.filter.gate, tails=tails
    )
    if not smoothed.outcome.usable:
        return _stand_in(smoothed, estimate)
    return smoothed


def _stand_in(smoothed: SmoothedEstimate, estimate: FilterEstimate) -> SmoothedEstimate:
    return replace(
        smoothed,
        states=estimate.states,
        states_std=np.full_like(smoothed.states_std, np.nan),
        disturbances=estimate.disturbances[:-1],
        disturbances_std=np.full_like(smoothed.disturbances_std, np.nan),
        displacement_covariance=np.full((2, 2), np.nan),
    )


def smooth_dive(
    hull: Hull,
    dive: Dive,
    start: Path,
    settings: SmootherSettings,
    *,
    gate: float = np.inf,
    tails: HeavyTails | None = None,
) -> SmoothedEstimate:
    """Iterate passes over a dive until nothing moves by more than the tolerance.

    Parameters
    ----------
    hull, dive : Hull, Dive
        The problem; its variances are widened where the first pass needs it, its noise where tails are heavy.
    start : Path
        Path of the first linearisation; its X and Y are replaced.
    settings : SmootherSettings
        Tolerance and cap.
    gate : float
        Standard deviations beyond which the first pass widens a variance; infinite by default.
    tails : HeavyTails, optional
        Channels with Student-t noise.
    """
    nominal = dive.variance.copy()
    sweeps = Sweeps(hull, dive)
    iterate, outcome = sweeps.forward(start, gate), Outcome.ITERATION_LIMIT
    damped = 0
    for passes in range(1, settings.max_passes + 1):
        linear = sweeps.backward(iterate.path)
        movement = _movement(linear)
        noise, change = tails.reweighted(dive.noise, linear.noise_square) if tails else (dive.noise, 0.0)
        end = _end(movement, change, passes, settings)
        if end is not None:
            outcome = end
            break
        moved, shortened = _moved(sweeps, iterate, linear)
        if moved is None:
            outcome = Outcome.STALLED
            break
        damped += shortened
        dive.noise[:] = noise
        iterate = sweeps.forward(moved.path) if tails else moved
    values = dive.fed[:, None] & np.isfinite(dive.measured)
    return SmoothedEstimate(
        states=iterate.path.states,
        states_std=_state_deviations(linear),
        disturbances=iterate.path.disturbances[:-1],
        disturbances_std=np.sqrt(linear.disturbance_variance[:-1]),
        displacement_covariance=linear.displacement,
        cost=float(iterate.costs.sum()),
        passes=passes,
        damped=damped,
        movement=movement,
        used=int(values.sum()),
        widened=int((values & (dive.variance > nominal)).sum()),
        outcome=outcome,
    )


def _end(movement: float, change: float, passes: int, settings: SmootherSettings) -> Outcome | None:
    if not np.isfinite(movement):
        return Outcome.DIVERGED
    if movement <= settings.tolerance and change <= SETTLED:
        return Outcome.CONVERGED
    return Outcome.ITERATION_LIMIT if passes == settings.max_passes else None


def _movement(linear: Backward) -> float:
    """Largest move in standard deviations; NaN where the pass gave no numbers."""
    variance = np.hstack([linear.state_variance, linear.disturbance_variance])
    square = linear.correction**2
    known = variance > 0.0
    if not (np.isfinite(square).all() and np.isfinite(variance).all()):
        return float("nan")
    return float(np.sqrt(np.max(square[known] / variance[known], initial=0.0)))


def _moved(sweeps: Sweeps, iterate: Iterate, linear: Backward) -> tuple[Iterate | None, bool]:
    """Move the path by the pass's correction, or by the half of it, ... until the merit does not rise; none: None.

    The merit adds to the cost the absolute defects, each state's weighed by more than its largest costate: the defects'
    Lagrange multiplier. Then the correction always points downhill, and a path of least merit has no defects.
    """
    weights = _PENALTY * linear.steepest
    least = iterate.merit(weights)
    fraction = 1.0
    while fraction >= _SHORTEST:
        states, disturbances = iterate.path.states.copy(), iterate.path.disturbances.copy()
        states[:, SENSED] += fraction * linear.correction[:, :10]
        disturbances += fraction * linear.correction[:, 10:]
        trial = sweeps.forward(Path(states, disturbances))
        if trial.merit(weights) <= least * (1.0 + _ROUNDING):
            return trial, fraction < 1.0
        fraction *= 0.5
    return None, True


def _state_deviations(linear: Backward) -> Array:
    deviations = np.empty((len(linear.state_variance), 12))
    deviations[:, SENSED] = np.sqrt(linear.state_variance)
    deviations[:, 3:5] = np.sqrt(linear.track_variance)
    return deviations


def _tails(dive: Dive, series: ProfileSeries, settings: SmootherSettings) -> HeavyTails | None:
    if settings.degrees_of_freedom is None:
        return None
    channels = tuple(list(CHANNELS).index(name) for name in settings.heavy_tailed)
    steps = max(1, round(series.sample_interval / series.step))
    return HeavyTails(dive.noise.copy(), settings.degrees_of_freedom, channels, steps)
