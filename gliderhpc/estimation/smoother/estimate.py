"""What the smoother makes of a dive: the estimate with its deviations, and the filter's in its place."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gliderhpc.estimation.filter import FilterEstimate
from gliderhpc.kernels.smoother_memory import Dive
from gliderhpc.outcomes import Outcome

Array = NDArray[np.float64]


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
    displacement, displacement_covariance : (2,), (2, 2)
        North and east from start to end, m and m2.
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
        Variance that the steps added in the end, over that of the prior (of `iterate_passes`: over that given, median).
    used, widened : int
        Values that counted, and those with a widened variance.
    outcome : Outcome
        How it ended; where it is not usable, the values are the filter's and the standard deviations NaN.
    trouble : str
        Error that ended the smoother early; empty as a rule.
    noise_held : bool
        Whether the noise is the prior's because no estimate was found with one that follows the dive.
    last_pass : LastPass, optional
        The problem as it ended; not retained by `thinned`.
    """

    states: Array
    states_std: Array
    disturbances: Array
    disturbances_std: Array
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
    trouble: str = ""
    noise_held: bool = False
    last_pass: "LastPass | None" = None

    def thinned(self, every: int) -> "SmoothedEstimate":
        """Return the estimate at every so many steps; the others, ten times as much as a rule, are freed."""
        # Copies, not views, so that the steps' arrays are freed.
        names = ("states", "states_std", "disturbances", "disturbances_std")
        return replace(self, last_pass=None, **{name: getattr(self, name)[::every].copy() for name in names})


@dataclass(frozen=True, eq=False)
class LastPass:
    """A dive's problem as the smoother ended, and what its last pass found of the noise.

    Attributes
    ----------
    dive : Dive
        The problem, with the last variances and noise.
    noise_mean, noise_resolved : (n, 6), (n, 6)
        As in `gliderhpc.kernels.smoother_memory.Backward`.
    """

    dive: Dive
    noise_mean: Array
    noise_resolved: Array


def filter_fallback(filtered: FilterEstimate) -> SmoothedEstimate:
    """Return the filter's estimate in place of a smoothed one that failed; quantities of a smoother alone are NaN."""
    states, disturbances = filtered.states, filtered.disturbances[:-1]
    return SmoothedEstimate(
        states, np.full_like(states, np.nan), disturbances, np.full_like(disturbances, np.nan), displacement(states),
        displacement_covariance=np.full((2, 2), np.nan), cost=np.nan, passes=0, damped=0, movement=np.nan,
        noise_factor=np.full(6, np.nan), used=0, widened=0, outcome=Outcome.DIVERGED,
    )  # fmt: skip


def displacement(states: Array) -> Array:
    """Return the way (2,) north and east from the first to the last of states (n, 12), m."""
    return np.asarray(states[-1, 3:5] - states[0, 3:5])
