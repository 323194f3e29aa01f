"""Errors common to all dives of a mission, and their effect on the dives' information."""

import numpy as np
import pytest

from gliderhpc import load_platform
from gliderhpc.calibration.dives.rounds import TURNING_MOTION, inflation_ratios, with_inflated_variance
from gliderhpc.calibration.settings import RoundSettings
from gliderhpc.flight.hull_parameters import hull_parameters

PARAMETERS = [
    p for p in hull_parameters(load_platform("petrel-l")) if p.key in (*TURNING_MOTION, "viscous.K_D0", "viscous.K_L")
]
COUNT = len(PARAMETERS)


def an_information(seed, rank=COUNT):
    """Return an information matrix of a rank."""
    root = np.random.default_rng(seed).normal(size=(COUNT, rank))
    return root @ root.T


def test_one_ratio_divides_everything():
    settings = RoundSettings(misfit=0.5, turning_misfit=0.0)
    ratios = inflation_ratios(PARAMETERS, 12, settings)
    np.testing.assert_array_equal(ratios, 7.0)
    score, information = np.arange(1.0, COUNT + 1), an_information(1)
    left = with_inflated_variance(score, information, ratios)
    np.testing.assert_allclose(left[0], score / 7.0, rtol=1e-9)
    np.testing.assert_allclose(left[1], information / 7.0, rtol=1e-9)


def test_only_the_terms_of_turns_have_the_larger_ratio():
    ratios = inflation_ratios(PARAMETERS, 10, RoundSettings(misfit=1.0, turning_misfit=6.0))
    turning = np.array([p.key in TURNING_MOTION for p in PARAMETERS])
    assert set(ratios[np.ix_(turning, turning)].ravel()) == {71.0}
    assert set(ratios[~turning].ravel()) == {11.0}


def test_sum_of_dives_with_a_common_error_is_unbiased_and_has_the_stated_covariance():
    """Scores with one error per mission in the terms of turns: errors have the stated covariance."""
    rng, dives, true = np.random.default_rng(3), 8, np.linspace(-1.0, 1.0, COUNT)
    settings = RoundSettings(misfit=0.3, turning_misfit=5.0)
    ratios, information = inflation_ratios(PARAMETERS, dives, settings), an_information(2)
    own = np.linalg.cholesky(information)
    # The same matrix for all dives: the variance of the common error of the summed score is n^2 times that of one.
    shared = np.linalg.cholesky((ratios - 1.0) / dives * information)
    errors = []
    for _ in range(4000):
        common = shared @ rng.normal(size=COUNT)
        scores = information @ true + common + (own @ rng.normal(size=(COUNT, dives))).T
        left = [with_inflated_variance(score, information, ratios) for score in scores]
        total = sum(matrix for _, matrix in left)
        errors.append(np.linalg.solve(total, sum(score for score, _ in left)) - true)
    stated = np.diag(np.linalg.inv(total))
    np.testing.assert_allclose(np.mean(errors, axis=0), 0.0, atol=5.0 * np.sqrt(stated.max() / len(errors)))
    np.testing.assert_allclose(np.var(errors, axis=0), stated, rtol=0.12)


@pytest.mark.parametrize("rank", [1, COUNT - 3])
def test_combinations_without_information_remain_without(rank):
    information = an_information(4, rank)
    score = information @ np.ones(COUNT)
    ratios = inflation_ratios(PARAMETERS, 5, RoundSettings())
    left, matrix = with_inflated_variance(score, information, ratios)
    assert np.isfinite(left).all()
    none = np.linalg.svd(information)[2][rank:]
    np.testing.assert_allclose(matrix @ none.T, 0.0, atol=1e-8 * np.abs(information).max())
    assert np.linalg.eigvalsh(matrix)[0] > -1e-9 * np.abs(information).max()
