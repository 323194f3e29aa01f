"""Estimate of the smoother for a profile, with standard deviations, and the filter's estimate as the fallback."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gliderhpc.estimation.filter import FilterEstimate
from gliderhpc.estimation.smoother.problem import Trajectory
from gliderhpc.kernels.smoother_memory import SmootherProblem
from gliderhpc.outcomes import Outcome

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SmoothedEstimate:
    """Smoothed estimate of one profile of ``n`` steps.

    Attributes
    ----------
    states, states_std : (n+1, 12)
        States (eq. 16, SI and rad) and their standard deviations, including the last pass's move; X and Y from the
        start of the profile.
    disturbances, disturbances_std : (n, 6)
        Disturbance over each step and its standard deviation, N and N m.
    standardised_noise : (n, 6)
        Smoothed noise of each step over its standard deviation: standard normal if the disturbances' noise is Gaussian
        with the final variances; NaN where the record does not resolve it.
    displacement, displacement_covariance : (2,), (2, 2)
        Displacement north and east from start to end, and its covariance, m and m2.
    cost : float
        Half the sum of all squares over variances: initial state, noise and measurements (heavy tails: with the last
        weights).
    passes : int
        Number of linearisations.
    damped : int
        Number of passes whose move was shortened or rejected.
    movement : float
        Move of the last pass, in standard deviations, root mean square over rows and states.
    noise_factor : (6,)
        Ratio of the final variance of the steps' noise to that of the prior (from `iterate_passes` alone: median ratio
        to the initial one).
    used, widened : int
        Number of values used, and of those with a widened variance.
    outcome : Outcome
        Outcome of the smoother; if it is not usable, the values are the filter's and the standard deviations NaN.
    failure : str
        Error that ended the smoother early; empty if there was none.
    simplified : str
        Simplification without which there was no estimate (`run_smoother`); empty if there was none.
    unscaled : tuple of int
        Channels whose noise is not scaled to the profile, since gusts rolled the glider (`pose_problem`).
    last_pass : LastPass, optional
        Final state of the problem; not retained by `thinned`.
    """

    states: Array
    states_std: Array
    disturbances: Array
    disturbances_std: Array
    standardised_noise: Array
    displacement: Array
    displacement_covariance: Array
    cost: float
    passes: int
    damped: int
    movement: float
    noise_factor: Array
    used: int
    widened: int
    outcome: Outcome
    failure: str = ""
    simplified: str = ""
    unscaled: tuple[int, ...] = ()
    last_pass: "LastPass | None" = None

    def path(self, decay: Array) -> Trajectory:
        """Return the smoothed path, given the decay ``(6,)`` of the disturbances over a step.

        No step follows the last row; its disturbance is the previous one, decayed.
        """
        return Trajectory(self.states.copy(), np.vstack([self.disturbances, decay * self.disturbances[-1]]))

    def thinned(self, every: int) -> "SmoothedEstimate":
        """Return the estimate at steps that are multiples of `every`; the larger arrays of all steps are freed."""
        # Copies, not views, to free the steps' arrays.
        names = ("states", "states_std", "disturbances", "disturbances_std", "standardised_noise")
        return replace(self, last_pass=None, **{name: getattr(self, name)[::every].copy() for name in names})


@dataclass(frozen=True, eq=False)
class LastPass:
    """A profile's problem at the end of the smoother, and the noise from its last pass.

    Attributes
    ----------
    problem : SmootherProblem
        Problem with the last variances and noise.
    noise_mean, noise_resolved : (n, 6), (n, 6)
        Mean of the noise and its resolved part, as in `gliderhpc.kernels.smoother_memory.Backward`.
    """

    problem: SmootherProblem
    noise_mean: Array
    noise_resolved: Array


def filter_fallback(filtered: FilterEstimate) -> SmoothedEstimate:
    """Return the filter's estimate in place of a failed smoothed one; quantities of the smoother alone are NaN."""
    states, disturbances = filtered.states, filtered.disturbances[:-1]
    return SmoothedEstimate(
        states, np.full_like(states, np.nan), disturbances, np.full_like(disturbances, np.nan),
        np.full_like(disturbances, np.nan), displacement(states), displacement_covariance=np.full((2, 2), np.nan),
        cost=np.nan, passes=0, damped=0, movement=np.nan, noise_factor=np.full(6, np.nan), used=0, widened=0,
        outcome=Outcome.DIVERGED,
    )  # fmt: skip


def displacement(states: Array) -> Array:
    """Return the displacement (2,) north and east from the first to the last of states (n, 12), m."""
    return np.asarray(states[-1, 3:5] - states[0, 3:5])
