"""Standard deviation of the windows' disturbances: the expected squared error under the smoother's posterior."""

from types import SimpleNamespace

import numpy as np
import pytest

from gliderhpc.estimation.smoother.posterior import adjoint_deviation, deviation_about


def test_a_constant_difference_adds_its_square():
    mean, std = np.zeros((200, 2)), np.full((200, 2), 0.3)
    estimate = mean + np.array([0.4, 0.0])
    np.testing.assert_allclose(deviation_about(estimate, mean, std, 31), std * [5.0 / 3.0, 1.0], rtol=1e-12)


def test_a_difference_is_averaged_over_the_width():
    estimate, mean, std = np.zeros((100, 1)), np.zeros((100, 1)), np.full((100, 1), 0.5)
    estimate[50] = 1.0
    variance = deviation_about(estimate, mean, std, 5)[:, 0] ** 2 - 0.25
    np.testing.assert_allclose(variance[48:53], 0.2, rtol=1e-12)
    np.testing.assert_allclose(np.delete(variance, range(48, 53)), 0.0, atol=1e-15)


def test_the_deviation_is_never_below_the_posterior_s():
    """The running sum's rounding after a large difference must not reduce it."""
    estimate, mean, std = np.full((400, 1), 0.1), np.zeros((400, 1)), np.full((400, 1), 1e-9)
    estimate[20:40] = 1e3
    estimate[60:] = 0.0
    assert (deviation_about(estimate, mean, std, 31) >= std).all()


def test_intervals_hold_the_share_of_the_truth():
    """The truth is drawn from the posterior, the estimate differs from its mean by noise and by a slow part."""
    rng, n = np.random.default_rng(4), 40_000
    mean, std = np.zeros((n, 3)), np.full((n, 3), 0.5)
    slow = np.cumsum(rng.standard_normal((n, 3)), axis=0) / 100.0
    estimate = mean + np.array([0.0, 1.0, 3.0]) * rng.standard_normal((n, 3)) + 0.05 * slow
    truth = mean + std * rng.standard_normal((n, 3))
    deviation = deviation_about(estimate, mean, std, 31)
    for width, share in ((0.9945, 0.68), (1.96, 0.95)):
        inside = np.mean(np.abs(estimate - truth) <= width * deviation, axis=0)
        np.testing.assert_allclose(inside, share, atol=0.02)


@pytest.mark.parametrize(("interval", "width"), [(1.0, 31), (0.5, 61), (10.0, 5), (60.0, 1)])
def test_thirty_seconds_are_averaged_about_every_record(interval, width):
    rng = np.random.default_rng(5)
    steps, records, std = rng.standard_normal((1000, 6)), rng.standard_normal((100, 6)), rng.random((100, 6))
    std[70:] = np.nan
    smoothed = SimpleNamespace(disturbances=records, disturbances_std=std)
    found = adjoint_deviation(SimpleNamespace(disturbances=steps), smoothed, 10, interval)
    np.testing.assert_array_equal(found, deviation_about(steps[::10], records, std, width))
    np.testing.assert_array_equal(np.isnan(found), np.isnan(std))
    if width == 1:
        np.testing.assert_allclose(found, np.hypot(std, steps[::10] - records), rtol=1e-12)
