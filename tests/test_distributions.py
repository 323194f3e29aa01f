"""Quantiles and tails equal those of `scipy.stats`, in the centre and far out."""

import numpy as np
import pytest
from scipy import stats

from gliderhpc import distributions as ours

PROBABILITIES = [1e-6, 0.025, 0.5, 0.84, 0.999]


@pytest.mark.parametrize("probability", PROBABILITIES)
def test_quantiles(probability):
    assert ours.normal_quantile(probability) == pytest.approx(stats.norm.ppf(probability), abs=1e-12)
    for freedom in (1, 7, 240):
        assert ours.student_quantile(probability, freedom) == pytest.approx(stats.t.ppf(probability, freedom), rel=1e-8)
        assert ours.chi_square_quantile(probability, freedom) == pytest.approx(stats.chi2.ppf(probability, freedom))
        assert ours.f_quantile(probability, 3, freedom) == pytest.approx(stats.f.ppf(probability, 3, freedom), rel=1e-8)


def test_quantiles_of_several_degrees_of_freedom():
    freedom = np.array([1, 2, 30])
    np.testing.assert_allclose(ours.chi_square_quantile(0.5, freedom), stats.chi2.median(freedom))


@pytest.mark.parametrize("value", [0.0, 0.3, 4.0, 300.0])
def test_tails(value):
    for freedom in (1, 7, 240):
        assert ours.chi_square_tail(value, freedom) == pytest.approx(stats.chi2.sf(value, freedom), rel=1e-10)
        assert ours.gamma_tail(value, freedom, 2.5) == pytest.approx(
            stats.gamma.sf(value, freedom, scale=2.5), rel=1e-10
        )
