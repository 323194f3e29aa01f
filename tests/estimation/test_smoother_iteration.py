"""Termination of the smoother's iteration, on problems with and without a descent step without damping."""

from types import SimpleNamespace

import numpy as np

from gliderhpc.estimation.settings import SmootherSettings
from gliderhpc.estimation.smoother.iterate import iterate_passes
from gliderhpc.outcomes import Outcome

ROWS = 4


class NoWayDown:
    """Sweeps over a problem whose undamped moves are large and never lower the merit; damped moves are small."""

    rows = np.arange(ROWS + 1)

    def __init__(self, _, dive, *, mean):
        self.problem, self.mean_shift, self.forwards = dive, np.zeros((0, 16)), 0

    def forward(self, trajectory, gate=np.inf):
        """Run; the merit grows with every move."""
        self.forwards += 1
        return SimpleNamespace(
            trajectory=trajectory, defects=np.zeros(10), costs=np.zeros(3),
            merit=lambda weights, share: float(trajectory.states[0, 0]),
        )  # fmt: skip

    def backward(self, trajectory):
        """Move by five deviations, or by a tenth with damping."""
        damped = np.isfinite(self.problem.damping).any()
        return SimpleNamespace(
            correction=np.full((ROWS + 1, 16), 0.1 if damped else 5.0), state_variance=np.ones((ROWS + 1, 10)),
            disturbance_variance=np.ones((ROWS + 1, 6)), track_variance=np.ones((ROWS + 1, 2)), steepest=np.ones(10),
            mean_shift=np.zeros((0, 16)), displacement=np.eye(2), noise_mean=np.zeros((ROWS, 6)),
            noise_resolved=np.ones((ROWS, 6)),
        )  # fmt: skip

    def moved(self, trajectory, linear, fraction):
        """Return a trajectory of larger merit."""
        return SimpleNamespace(states=trajectory.states + fraction, disturbances=trajectory.disturbances)


def test_the_same_passes_are_not_made_again(monkeypatch):
    """Released, the damping is needed again, and nothing has moved: the iteration has stalled, far from its limit."""
    monkeypatch.setattr("gliderhpc.estimation.smoother.iterate.Sweeps", NoWayDown)
    dive = SimpleNamespace(
        variance=np.ones((ROWS + 1, 4)), noise=np.ones((ROWS, 6)), fed=np.ones(ROWS + 1, bool),
        damping=np.full(6, np.inf), measured=np.zeros((ROWS + 1, 4)), deviation=np.ones(16),
    )  # fmt: skip
    start = SimpleNamespace(states=np.zeros((ROWS + 1, 12)), disturbances=np.zeros((ROWS + 1, 6)))
    found = iterate_passes(None, dive, start, SmootherSettings(max_passes=20))
    assert found.passes < 10
    assert found.outcome is Outcome.DIVERGED
    assert found.movement == 5.0
    assert np.isinf(dive.damping).all()
    np.testing.assert_array_equal(found.states, start.states)
