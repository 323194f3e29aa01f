"""Joining of the windows of a profile into one trajectory.

If each window starts from the state at which the previous one ends, the windows form one trajectory of the flight
model. Their corrections, however, jump from window to window, because a correction is largest at the start of its
window and vanishes at its end. A search for impulses would find these jumps. Windows that start from the states of a
given path are therefore joined without seams: in the overlap one solution fades into the next, and a run of the model
that is steered along the result (`gliderhpc.kernels.follow`) makes it a single trajectory again.
"""

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from gliderhpc.angles import principal_angle
from gliderhpc.estimation.filter import FilterEstimate
from gliderhpc.estimation.preparation import PreparedProfile
from gliderhpc.flight.glider import SENSED
from gliderhpc.kernels import window as kernel
from gliderhpc.kernels.follow import follow
from gliderhpc.kernels.quasi_newton import MAX_PITCH, MAX_RATE2, MAX_SPEED2

Array = NDArray[np.float64]

STEERING_RATE = 0.2
"""Decay rate (1/s) of a joined path's distance from the windows' solutions.

The decay is faster than a window. The noise of heave, which steers the depth, grows with the square of the rate.
"""


def flyable(states: Array) -> bool:
    """Return whether states ``(n+1, 10)`` are finite and in the model's domain.

    Its bounds are a pitch of 89 degrees, a speed of 5 m/s, and a rate of turning of 6 rad/s.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        speed2, rate2 = (np.einsum("ij,ij->i", part, part) for part in (states[:, 4:7], states[:, 7:10]))
    # NaN fails the comparisons, as intended.
    inside = (np.abs(states[:, 1]) < MAX_PITCH).all() and (speed2 < MAX_SPEED2).all() and (rate2 < MAX_RATE2).all()
    return bool(inside and np.isfinite(states).all())


def fading(count: int) -> Array:
    """Weights ``(count + 1,)`` from 0 to 1, without a kink at either end: ``t^2 (3 - 2 t)``."""
    t = np.arange(count + 1) / count
    return np.asarray(t * t * (3.0 - 2.0 * t))


class JoinedWindows:
    """Solutions of windows on the steps of a profile.

    In an overlap the later solution replaces the earlier one, or fades in if there is a path.

    Attributes
    ----------
    disturbances, states : (n, 6), (n+1, 10)
        Disturbances and sensed states; the filter's where there is no window yet.
    failed : (n,) mask
        Steps of windows without a usable solution.
    source : (n,)
        Number of the window whose solution is used at each step; over an overlap, that of the later one.
    """

    def __init__(self, profile: PreparedProfile, filtered: FilterEstimate, path: Array | None) -> None:
        self._profile, self._filtered, self._path = profile, filtered, path
        n = len(profile.bodies)
        self.disturbances, self.states = filtered.disturbances[:n].copy(), filtered.states[:, SENSED].copy()
        self.failed, self.source = np.zeros(n, dtype=np.bool_), np.zeros(n, dtype=np.int64)
        self._reach = 0

    def state_at(self, begin: int) -> Array:
        """Sensed state ``(10,)`` from which a window starts."""
        return np.asarray(self.states[begin] if self._path is None else self._path[begin])

    def add(self, begin: int, number: int, disturbances: Array, states: Array) -> None:
        """Add a window's solution: disturbances ``(m, 6)`` and states ``(m+1, 10)`` from its first step on."""
        end = begin + len(disturbances)
        overlap = min(self._reach, end) - begin
        if self._path is not None and overlap > 0:
            disturbances, states = self._faded(begin, overlap, disturbances, states)
        elif self._path is not None and (begin == 0 or self.failed[begin - 1]):
            self.states[begin] = states[0]
        self.disturbances[begin:end], self.states[begin + 1 : end + 1] = disturbances, states[1:]
        self._mark(begin, end, number, failed=False)

    def add_filter(self, begin: int, end: int, number: int) -> None:
        """Add the filter's estimate in place of a window without a usable solution."""
        self.disturbances[begin:end] = self._filtered.disturbances[begin:end]
        self.states[begin + 1 : end + 1] = self._filtered.states[begin + 1 : end + 1, SENSED]
        self._mark(begin, end, number, failed=True)

    def _mark(self, begin: int, end: int, number: int, *, failed: bool) -> None:
        self.failed[begin:end], self.source[begin:end], self._reach = failed, number, end

    def _faded(self, begin: int, overlap: int, disturbances: Array, states: Array) -> tuple[Array, Array]:
        """Return a solution into which the previous one fades over its first steps."""
        weights, end = fading(overlap)[:, None], begin + overlap
        disturbances, states = disturbances.copy(), states.copy()
        disturbances[:overlap] -= (1.0 - 0.5 * (weights[1:] + weights[:-1])) * (
            disturbances[:overlap] - self.disturbances[begin:end]
        )
        difference = states[: overlap + 1] - self.states[begin : end + 1]
        difference[:, 2] = principal_angle(difference[:, 2])
        states[: overlap + 1] -= (1.0 - weights) * difference
        return disturbances, states

    def trajectory(self) -> tuple[Array, Array]:
        """Return the disturbances ``(n, 6)`` and the twelve-state rows ``(n+1, 12)`` of the whole profile.

        If windows start from a path, this is a run steered along their solutions, from one failed window to the next.
        """
        if self._path is not None:
            edges = np.flatnonzero(np.diff(self.failed, prepend=True, append=True))
            for begin, end in pairwise(edges.tolist()):
                if not self.failed[begin]:
                    self._steer(begin, end)
        return self.disturbances, self._with_track()

    def _steer(self, begin: int, end: int) -> None:
        profile, steps, rows = self._profile, slice(begin, end), slice(begin, end + 1)
        disturbances, states = self.disturbances[steps].copy(), self.states[rows].copy()
        follow(
            profile.glider.hull, profile.bodies[steps], disturbances, profile.series.step, STEERING_RATE, STEERING_RATE,
            states,
        )  # fmt: skip
        if flyable(states):
            self.disturbances[steps], self.states[rows] = disturbances, states

    def _with_track(self) -> Array:
        """Twelve-state rows: the states and the resulting track, which is the filter's where a window failed."""
        profile, filtered = self._profile, self._filtered.states
        moves = np.empty((len(self.disturbances), 2))
        kernel.moves(profile.glider.hull, profile.bodies, self.states, self.disturbances, profile.series.step, moves)
        moves[self.failed] = np.diff(filtered[:, 3:5], axis=0)[self.failed]
        trajectory = np.empty((len(self.states), 12))
        trajectory[:, SENSED] = self.states
        trajectory[0, 3:5] = filtered[0, 3:5]
        trajectory[1:, 3:5] = trajectory[0, 3:5] + np.cumsum(moves, axis=0)
        return trajectory
