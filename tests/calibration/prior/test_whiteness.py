"""Whiteness of the filter's innovations: level of the test, and its statistic computed with loops."""

import numpy as np
import pytest
from scipy.stats import chi2

from gliderhpc.calibration.prior.likelihood import whiteness


def test_white_noise_passes_the_whiteness_test():
    parts = np.split(np.random.default_rng(1).standard_normal(6000), 3)
    found = whiteness(parts, 20)
    assert found.count == 6000
    assert abs(found.mean) < 0.04
    assert found.variance == pytest.approx(1.0, abs=0.06)
    assert np.abs(found.autocorrelation).max() < 0.05
    assert found.portmanteau < 1.9
    assert found.p > 0.01


def test_the_portmanteau_keeps_its_level():
    """Of 400 white records a twentieth has a p-value below 5 %."""
    rng = np.random.default_rng(2)
    small = [whiteness([rng.standard_normal(300)], 10).p < 0.05 for _ in range(400)]
    assert 0.025 < np.mean(small) < 0.085


def test_coloured_noise_fails_the_whiteness_test():
    rng = np.random.default_rng(3)
    values = np.zeros(4000)
    for k in range(1, 4000):
        values[k] = 0.5 * values[k - 1] + rng.standard_normal()
    found = whiteness([values], 10)
    np.testing.assert_allclose(found.autocorrelation[:3], [0.5, 0.25, 0.125], atol=0.06)
    assert found.p < 1e-12
    assert found.portmanteau > 50.0


def test_pairs_across_a_missing_one_or_a_profile_s_end_do_not_count():
    apart = np.full(200, np.nan)
    apart[::2] = np.tile([1.0, 1.0, -1.0, -1.0], 25)
    found = whiteness([apart[:100], apart[100:]], 4)
    np.testing.assert_array_equal(found.autocorrelation[[0, 2]], 0.0)
    assert found.autocorrelation[3] < -0.9


def test_too_few_innovations_say_nothing():
    assert np.isnan(whiteness([np.ones(5)], 10).p)


def naive_correlation(parts, lag):
    """Autocorrelation at a lag by a loop over the pairs, and how many there are."""
    known = [value for part in parts for value in part if np.isfinite(value)]
    mean = sum(known) / len(known)
    products = [
        (part[row] - mean) * (part[row + lag] - mean)
        for part in parts
        for row in range(len(part) - lag)
        if np.isfinite(part[row]) and np.isfinite(part[row + lag])
    ]
    return sum(products) / sum((value - mean) ** 2 for value in known), len(products)


def test_whiteness_is_ljung_and_box_s():
    """Ljung and Box (1978), ``Q = n (n + 2) sum r^2 / pairs``, by loops over the pairs."""
    rng = np.random.default_rng(11)
    parts = [rng.normal(0.4, 1.7, length) for length in (9, 14, 6)]
    parts[1][[3, 8]] = np.nan
    found, known = whiteness(parts, 3), np.concatenate([part[np.isfinite(part)] for part in parts])
    r, pairs = np.transpose([naive_correlation(parts, lag) for lag in (1, 2, 3)])
    statistic = 27 * 29 * np.sum(r**2 / pairs)
    assert found.count == len(known) == 27
    assert found.mean == pytest.approx(sum(known) / 27)
    assert found.variance == pytest.approx(sum((known - sum(known) / 27) ** 2) / 27)
    np.testing.assert_allclose(found.autocorrelation, r)
    assert found.portmanteau == pytest.approx(statistic / 3)
    assert found.p == pytest.approx(chi2.sf(statistic, 3))


def test_one_innovation_more_than_lags_is_needed():
    values = np.random.default_rng(5).standard_normal(6)
    too_few, enough = whiteness([values], 6), whiteness([values], 5)
    assert too_few.count == 6
    assert too_few.autocorrelation.shape == (6,)
    assert np.isnan([too_few.mean, too_few.variance, too_few.portmanteau, too_few.p, *too_few.autocorrelation]).all()
    assert np.isfinite([enough.mean, enough.variance, enough.portmanteau, enough.p, *enough.autocorrelation]).all()


def test_a_lag_without_a_pair_has_no_correlation():
    found = whiteness([np.array([1.0, 2.0]), np.array([4.0, -3.0])], 3)
    assert found.autocorrelation[0] != 0.0
    np.testing.assert_array_equal(found.autocorrelation[1:], 0.0)
    assert np.isfinite(found.portmanteau)
