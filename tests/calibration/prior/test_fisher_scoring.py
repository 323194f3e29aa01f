"""Maximisation of likelihoods with known maxima."""

import numpy as np
import pytest

from gliderhpc.calibration.prior.fisher_scoring import DAMPINGS, LONGEST_STEP, Expansion, maximise


class Parabola:
    """A log-likelihood of Gaussian shape: ``-1/2 (x - top)^T A (x - top)``."""

    def __init__(self, top, curvature):
        self.top, self.curvature, self.tried = np.array(top), np.array(curvature), []

    def value(self, point):
        return -0.5 * float((point - self.top) @ self.curvature @ (point - self.top))

    def values(self, points):
        self.tried.append([point.copy() for point in points])
        return [self.value(point) for point in points]

    def expanded(self, point, free):
        gradient = -(self.curvature @ (point - self.top))[free]
        return Expansion(self.value(point), gradient, self.curvature[np.ix_(free, free)])


FREE = np.array([True, True])
WIDE = (np.full(2, -50.0), np.full(2, 50.0))
CURVATURE = [[4.0, 1.0], [1.0, 2.0]]


def climb(likelihood, start, free=FREE, bounds=WIDE, tolerance=1e-9, max_rounds=50, **keywords):
    return maximise(likelihood, np.array(start), free, bounds, tolerance=tolerance, max_rounds=max_rounds, **keywords)


def test_a_climb_ends_at_the_top_and_reports_every_round():
    values = []
    found = climb(Parabola([1.5, -3.0], CURVATURE), [0.0, 0.0], on_round=values.append)
    np.testing.assert_allclose(found.point, [1.5, -3.0], atol=1e-4)
    assert found.settled
    assert len(values) == found.rounds + 1
    assert np.all(np.diff(values) > 0.0)


def test_the_steps_tried_are_those_of_the_dampings_and_no_longer_than_allowed():
    near, far = Parabola([0.4, 0.3], CURVATURE), Parabola([40.0, 0.0], CURVATURE)
    climb(near, [0.0, 0.0], max_rounds=1)
    gradient = np.array(CURVATURE) @ near.top
    expected = [np.linalg.solve(CURVATURE + damping * np.eye(2), gradient) for damping in DAMPINGS]
    np.testing.assert_allclose(near.tried[0], expected)
    climb(far, [0.0, 0.0], max_rounds=1)
    assert np.abs(far.tried[0]).max() == LONGEST_STEP


def test_a_maximisation_that_ends_early_is_not_settled():
    found = climb(Parabola([40.0, 0.0], CURVATURE), [0.0, 0.0], max_rounds=3)
    assert (found.rounds, found.settled) == (3, False)
    np.testing.assert_allclose(found.point[0], 3 * LONGEST_STEP)


def test_a_round_that_gains_no_more_than_the_tolerance_is_not_made():
    likelihood = Parabola([0.1, 0.0], CURVATURE)
    gain = -likelihood.value(np.zeros(2))
    found = climb(likelihood, [0.0, 0.0], tolerance=1.01 * gain)
    assert (found.rounds, found.settled) == (0, True)
    np.testing.assert_array_equal(found.point, [0.0, 0.0])
    assert climb(Parabola([0.1, 0.0], CURVATURE), [0.0, 0.0], tolerance=0.5 * gain).rounds == 1


def test_held_parameters_stay_and_free_ones_go_to_the_best_that_is_left():
    found = climb(Parabola([1.0, 1.0], CURVATURE), [0.0, 0.5], free=np.array([True, False]))
    assert found.point[1] == 0.5
    np.testing.assert_allclose(found.point[0], 1.0 + 0.5 / 4.0, atol=1e-4)


@pytest.mark.parametrize("top", [3.0, -3.0], ids=["upper", "lower"])
def test_a_climb_stops_at_a_bound_and_goes_on_along_it(top):
    bounds = (np.array([-1.0, -50.0]), np.array([1.0, 50.0]))
    found = climb(Parabola([top, 2.0], np.diag([4.0, 2.0])), [0.0, 0.0], bounds=bounds)
    np.testing.assert_allclose(found.point, [np.sign(top), 2.0], atol=1e-4)
    assert found.settled


def test_a_start_in_a_corner_with_nowhere_to_go_is_the_maximum():
    bounds = (np.zeros(2), np.ones(2))
    likelihood = Parabola([3.0, 3.0], np.eye(2))
    found = climb(likelihood, [1.0, 1.0], bounds=bounds)
    assert (found.rounds, found.settled, likelihood.tried) == (0, True, [])
