"""Least squares with clustered errors against direct computations."""

import numpy as np
import pytest

from gliderhpc.estimation.least_squares import (
    biweight_stiffness,
    biweights,
    cluster_inflation,
    directions,
    jackknife_covariance,
    left_out_covariance,
    sensitivity,
    solve_normal_equations,
)

RNG = np.random.default_rng(5)
JACOBIAN = RNG.normal(size=(40, 3))
RESIDUALS = RNG.normal(size=40)
CLUSTER = np.repeat(np.arange(8), 5)


def test_directions_are_the_right_singular_vectors_best_determined_first():
    found = directions(JACOBIAN)
    _, values, vectors = np.linalg.svd(JACOBIAN)
    np.testing.assert_allclose([one.singular_value for one in found], values)
    for one, vector in zip(found, vectors, strict=True):
        np.testing.assert_allclose(np.abs(one.vector @ vector), 1.0)


def test_a_direction_that_no_residual_sees_has_value_zero():
    found = directions(np.array([[2.0, 0.0, 0.0]]))
    np.testing.assert_allclose([one.singular_value for one in found], [2.0, 0.0, 0.0], atol=1e-15)
    np.testing.assert_allclose(np.abs(found[0].vector), [1.0, 0.0, 0.0])


def test_the_jackknife_is_the_scatter_of_estimates_that_leave_one_cluster_out():
    """Of a linear problem at its solution the formula is exact."""
    estimate, *_ = np.linalg.lstsq(JACOBIAN, RESIDUALS, rcond=None)
    left = RESIDUALS - JACOBIAN @ estimate
    moves = []
    for number in range(8):
        rest = number != CLUSTER
        moves.append(np.linalg.lstsq(JACOBIAN[rest], RESIDUALS[rest], rcond=None)[0] - estimate)
    expected = 7 / 8 * np.array(moves).T @ np.array(moves)
    np.testing.assert_allclose(jackknife_covariance(JACOBIAN, left, CLUSTER), expected, rtol=1e-9, atol=1e-12)


def test_a_parameter_determined_by_one_cluster_keeps_the_covariance_finite():
    jacobian = np.column_stack([JACOBIAN[:, 0], np.where(CLUSTER == 0, 1.0, 0.0)])
    covariance = jackknife_covariance(jacobian, RESIDUALS, CLUSTER)
    assert np.isfinite(covariance).all()


def test_sensitivity_is_how_the_estimate_moves_with_what_is_held():
    held = RNG.normal(size=(40, 2))
    found = sensitivity(JACOBIAN, held)
    before, *_ = np.linalg.lstsq(JACOBIAN, RESIDUALS, rcond=None)
    for index in range(2):
        after, *_ = np.linalg.lstsq(JACOBIAN, RESIDUALS - held[:, index], rcond=None)
        np.testing.assert_allclose(found[:, index], after - before)


def test_biweights_are_tukeys():
    residuals = np.array([-1.0, 0.0, 1.0, 2.0, 100.0])
    scale = 1.4826 * 1.0 + 0.5
    expected = (1.0 - (residuals / (4.685 * scale)) ** 2) ** 2 / scale**2
    expected[-1] = 0.0
    np.testing.assert_allclose(biweights(residuals, 0.5), expected)


def test_the_stiffness_is_the_losses_curvature_over_its_weight():
    """By differences of the influence ``r w(r)`` at a scale held; four fifths for normal residuals."""
    residuals = np.random.default_rng(3).standard_normal(20_001)
    scale, move = 1.4826 * np.median(np.abs(residuals)) + 0.5, 1e-6

    def influence(values):
        return values * np.maximum(1.0 - (values / (4.685 * scale)) ** 2, 0.0) ** 2

    curvature = (influence(residuals + move) - influence(residuals - move)) / (2.0 * move)
    expected = curvature.sum() / (influence(residuals) / residuals).sum()
    assert biweight_stiffness(residuals, 0.5) == pytest.approx(expected, rel=1e-6)
    assert biweight_stiffness(residuals, 0.0) == pytest.approx(0.83, abs=0.03)


def test_errors_of_a_robust_mean_agree_with_its_covariance():
    """Of a mean of 40 profiles, 500 draws: scatter over the stated error within a tenth, with the stiffness."""
    rng, profile = np.random.default_rng(4), np.repeat(np.arange(40), 5)
    design, found, stated = np.ones((200, 1)), [], []
    for _ in range(500):
        values, mean = rng.standard_normal(200), 0.0
        for _ in range(10):
            weights = biweights(values - mean, 1e-6)
            mean = float(np.average(values, weights=weights))
        left = values - mean
        found.append(mean)
        stiffness = biweight_stiffness(left, 1e-6)
        stated.append(left_out_covariance(design, weights, left, profile, np.zeros(1), stiffness)[0, 0])
    assert np.std(found) / np.sqrt(np.mean(stated)) == pytest.approx(1.0, abs=0.1)


def test_undetermined_directions_of_the_normal_equations_stay():
    normal, score = np.diag([4.0, 0.0]), np.array([2.0, 0.0])
    np.testing.assert_allclose(solve_normal_equations(normal, score), [0.5, 0.0])


def test_leaving_out_a_profile_moves_the_estimate_with_its_prior():
    weights, prior = RNG.uniform(0.5, 2.0, 40), np.array([0.3, 0.0, 4.0])
    normal = JACOBIAN.T @ (weights[:, None] * JACOBIAN) + np.diag(prior)
    estimate = np.linalg.solve(normal, JACOBIAN.T @ (weights * RESIDUALS))
    moves = []
    for number in range(8):
        rest = number != CLUSTER
        without = JACOBIAN[rest].T @ (weights[rest, None] * JACOBIAN[rest]) + np.diag(prior)
        moves.append(np.linalg.solve(without, JACOBIAN[rest].T @ (weights[rest] * RESIDUALS[rest])) - estimate)
    inverse = np.linalg.inv(normal)
    # The prior pulls the estimate to zero by a part that all profiles share.
    pull = inverse @ np.diag(prior) @ inverse
    found = left_out_covariance(JACOBIAN, weights, RESIDUALS - JACOBIAN @ estimate, CLUSTER, prior)
    own = [
        inverse_rest @ (JACOBIAN[own].T @ (weights[own] * (RESIDUALS - JACOBIAN @ estimate)[own]))
        for number in range(8)
        for own in [number == CLUSTER]
        for inverse_rest in [np.linalg.inv(normal - JACOBIAN[own].T @ (weights[own, None] * JACOBIAN[own]))]
    ]
    np.testing.assert_allclose(np.array(own), -np.array(moves), rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(found, 7 / 8 * np.array(moves).T @ np.array(moves) + pull, rtol=1e-9)


def test_residuals_that_are_alike_within_clusters_inflate_by_their_number():
    signs = np.repeat([1.0, -1.0, 1.0, -1.0], 5)
    assert cluster_inflation(signs, np.repeat(np.arange(4), 5)) == pytest.approx(5.0)
    assert cluster_inflation(3.0 * signs, np.repeat(np.arange(4), 5)) == pytest.approx(5.0)


def test_residuals_that_cancel_within_clusters_do_not_deflate():
    assert cluster_inflation(np.tile([1.0, -1.0], 10), np.repeat(np.arange(10), 2)) == 1.0
    assert cluster_inflation(np.zeros(4), np.arange(4)) == 1.0


def test_undetermined_directions_of_the_solution_are_zero():
    normal = np.array([[4.0, 2.0], [2.0, 1.0]])
    found = solve_normal_equations(normal, normal @ np.array([1.0, 1.0]))
    np.testing.assert_allclose(normal @ found, normal @ np.array([1.0, 1.0]))
    np.testing.assert_allclose(found @ np.array([1.0, -2.0]), 0.0, atol=1e-12)


def test_clusters_inflate_by_what_they_share():
    """Four residuals that are one number count as one of four; independent ones are not inflated below one."""
    together = np.repeat([1.0, -1.0, 1.0, -1.0], 4)
    assert cluster_inflation(together, np.repeat(np.arange(4), 4)) == pytest.approx(4.0)
    assert cluster_inflation(np.array([1.0, -1.0] * 8), np.repeat(np.arange(4), 4)) == 1.0
    uneven = np.array([1.0, 1.0, 1.0, -1.0])
    assert cluster_inflation(uneven, np.array([0, 0, 0, 1])) == pytest.approx(0.5 * (9.0 / 3.0 + 1.0))
    assert cluster_inflation(np.zeros(4), np.array([0, 0, 1, 1])) == 1.0
