"""Sum over the mission compared with dense algebra, on dives that agree, drift, scatter or do not fit."""

from dataclasses import replace

import numpy as np
import pytest
import scipy
from support.hull_dives import START, P, dive, information

from gliderhpc.mission_hull.estimate import (
    HullPrior,
    ProfileTerm,
    predicted_disagreement,
    solve_mission,
    widen_by_disagreement,
)
from gliderhpc.mission_hull.gaussian_chain import Gaussian, Information, Transition, information_about, solve_chain
from gliderhpc.mission_hull.turn_test import ProfileCurrent, TurnTestSettings


def test_chain_is_the_dense_posterior():
    """Filter, smoother and evidence against one normal distribution of all dives' unknowns."""
    rng = np.random.default_rng(1)
    count, prior = 4, Gaussian(rng.standard_normal(P), np.diag(rng.uniform(0.5, 2.0, P)))
    changes = [Transition(rng.uniform(0.5, 1.0, P), rng.uniform(0.0, 0.3, P)) for _ in range(count - 1)]
    terms = [Information(rng.standard_normal(P), information(rng, rank=2, size=2.0), 0.3 * i) for i in range(count)]
    chain = solve_chain(prior, changes, terms)

    # Joint prior of all dives, mapped from independent innovations.
    lift = np.zeros((count * P, count * P))
    for row in range(count):
        decay = np.ones(P)
        for column in range(row, -1, -1):
            lift[row * P : (row + 1) * P, column * P : (column + 1) * P] = np.diag(decay)
            decay = decay * (changes[column - 1].decay if column else 1.0)
    noise = scipy.linalg.block_diag(prior.covariance, *(np.diag(c.variance) for c in changes))
    joint = lift @ noise @ lift.T
    mean = lift[:, :P] @ prior.mean
    for upto in range(1, count + 1):
        inside = upto * P
        matrix = scipy.linalg.block_diag(*(t.matrix for t in terms[:upto]))
        vector = np.concatenate([t.vector for t in terms[:upto]])
        covariance = (
            joint[:inside, :inside]
            - joint[:inside, :inside]
            @ matrix
            @ np.linalg.inv(np.eye(inside) + joint[:inside, :inside] @ matrix)
            @ joint[:inside, :inside]
        )
        after = mean[:inside] + covariance @ (vector - matrix @ mean[:inside])
        last = slice(inside - P, inside)
        np.testing.assert_allclose(chain.sequential[upto - 1].mean, after[last], rtol=1e-9, atol=1e-10)
        np.testing.assert_allclose(chain.sequential[upto - 1].covariance, covariance[last, last], rtol=1e-8, atol=1e-9)
    for i, each in enumerate(chain.smoothed):
        own = slice(i * P, (i + 1) * P)
        np.testing.assert_allclose(each.mean, after[own], rtol=1e-9, atol=1e-10)
        np.testing.assert_allclose(each.covariance, covariance[own, own], rtol=1e-8, atol=1e-9)
    _, log_det = np.linalg.slogdet(np.eye(inside) + joint @ matrix)
    missing = vector - matrix @ mean
    evidence = (
        sum(t.constant for t in terms) + vector @ mean - 0.5 * mean @ matrix @ mean
        + 0.5 * missing @ covariance @ missing - 0.5 * log_det
    )  # fmt: skip
    assert chain.log_evidence == pytest.approx(evidence, rel=1e-10)


def test_updated_and_without_are_inverse():
    rng = np.random.default_rng(2)
    before = Gaussian(rng.standard_normal(P), np.eye(P))
    term = Information(rng.standard_normal(P), information(rng, rank=2))
    after, _ = before.updated(term)
    back = after.without(term)
    np.testing.assert_allclose(back.mean, before.mean, rtol=1e-7)
    np.testing.assert_allclose(back.covariance, before.covariance, rtol=1e-7, atol=1e-9)


def test_about_a_point_is_the_same_likelihood():
    rng = np.random.default_rng(4)
    score, matrix, point, x = rng.standard_normal(P), information(rng), rng.standard_normal(P), rng.standard_normal(P)
    term = information_about(score, matrix, point)
    value = term.constant + term.vector @ x - 0.5 * x @ term.matrix @ x
    assert value == pytest.approx(score @ (x - point) - 0.5 * (x - point) @ matrix @ (x - point), rel=1e-9)


def test_dives_of_one_hull_find_it_within_their_deviations():
    """The chi-square of estimates against the truth, over seeds, agrees with its degrees of freedom."""
    totals = []
    for seed in range(30):
        rng = np.random.default_rng([5, seed])
        truth = rng.standard_normal(P)
        found = solve_mission([dive(rng, truth, n, rank=2) for n in range(8)], HullPrior.plausible(np.zeros(P)))
        error = found.overall.mean - truth
        totals.append(error @ np.linalg.solve(found.overall.covariance, error))
    assert scipy.stats.chi2.ppf(1e-4, 30 * P) < sum(totals) < scipy.stats.chi2.ppf(1 - 1e-4, 30 * P)


def test_a_walk_is_followed():
    rng = np.random.default_rng(6)
    walk = np.array([0.5, 0.0, 0.0, 0.0, 0.0])
    truths = [np.array([0.04 * n, 0.2, 0.0, 0.0, 0.0]) for n in range(40)]
    dives = [dive(rng, truth, n, size=100.0) for n, truth in enumerate(truths)]
    found = solve_mission(dives, HullPrior.plausible(walk))
    inside = np.abs(found.eta[:, 0] - [t[0] for t in truths]) < 2.0 * found.std[:, 0]
    assert inside.mean() > 0.9
    assert found.sequential[-1].mean == pytest.approx(found.smoothed[-1].mean)
    assert found.sequential[0].std[0] > found.smoothed[0].std[0]


@pytest.mark.parametrize("factor", [1.0, 4.0, 25.0])
def test_scatter_between_dives_inflates_their_covariance(factor):
    """Scores of a wider scatter than the information states: the inflation is that factor on the variance."""
    found = []
    for seed in range(6):
        rng = np.random.default_rng([7, seed])
        dives = [dive(rng, np.zeros(P), n, size=3000.0, point=np.zeros(P)) for n in range(24)]
        dives = [replace(each, score=np.sqrt(factor) * each.score) for each in dives]
        found.append(solve_mission(dives, HullPrior.plausible(np.zeros(P))))
    assert np.median([each.inflation for each in found]) == pytest.approx(factor, rel=0.3)
    errors = np.array([each.overall.mean / each.overall.std for each in found])
    assert 0.6 < np.sqrt(np.mean(errors**2)) < 1.5


def test_a_dive_that_does_not_fit_counts_less():
    rng = np.random.default_rng(8)
    dives = [dive(rng, np.zeros(P), n, size=300.0) for n in range(16)]
    strange = dive(rng, np.full(P, 1.5), 16, size=300.0)
    found = solve_mission([*dives, strange], HullPrior.plausible(np.zeros(P)))
    assert int(np.argmin(found.weight)) == 16
    assert found.weight[16] < 0.05
    assert found.weight[:16].mean() > 0.9
    assert np.abs(found.overall.mean).max() < 0.1
    believed = solve_mission([*dives, strange], HullPrior.plausible(np.zeros(P)), robust=False)
    assert np.abs(believed.overall.mean).max() > 2.0 * np.abs(found.overall.mean).max()


def test_a_held_out_dive_is_predicted():
    rng = np.random.default_rng(9)
    dives = [dive(rng, np.full(P, 0.3), n) for n in range(12)]
    found = solve_mission(dives[:11], HullPrior.plausible(np.zeros(P)))
    chi_square, freedom = predicted_disagreement(found, dives[11])
    assert freedom == P
    assert chi_square < scipy.stats.chi2.ppf(0.999, P)
    assert predicted_disagreement(found, dive(rng, np.full(P, 3.0), 11))[0] > 100.0


def test_directions_say_what_is_determined():
    root = np.array([[1.0, 1.0, 0.0, 0.0, 0.0]])
    dives = [ProfileTerm(n, START, np.zeros(P), np.zeros(P), 50.0 * root.T @ root) for n in range(3)]
    ratio, vectors = solve_mission(dives, HullPrior.plausible(np.zeros(P))).directions()
    assert ratio[0] == pytest.approx(1.0 / np.sqrt(1.0 + 3 * 50.0 * 2.0))
    np.testing.assert_allclose(np.abs(vectors[0]), np.abs(root[0]) / np.sqrt(2.0), atol=1e-9)
    np.testing.assert_allclose(ratio[1:], 1.0, rtol=1e-9)


def currents_of(rng, error, headings, *, drift=(0.05, -0.1), noise=0.005):
    """Return the currents of dives of a glider that believes itself faster and turned by `error` (m/s, rad)."""
    speed, found = 0.25, []
    for heading in headings:
        along, across = np.array([np.cos(heading), np.sin(heading)]), np.array([-np.sin(heading), np.cos(heading)])
        sensitivity = np.zeros((2, P))
        sensitivity[:, 0], sensitivity[:, 1] = along, speed * across
        velocity = np.array(drift) + sensitivity[:, :2] @ error + noise * rng.standard_normal(2)
        found.append(ProfileCurrent(velocity, sensitivity, noise**2 * np.eye(2)))
    return found


@pytest.mark.parametrize(("headings", "separate"), [(np.linspace(0.0, 6.0, 12), True), (np.full(12, 0.4), False)])
def test_turns_separate_speed_and_compass_from_a_current(headings, separate):
    """A gain of 0.03 m/s and an offset of 0.05 rad appear in the current; only turns distinguish them from it."""
    rng = np.random.default_rng(11)
    error, nothing = np.array([0.03, 0.05]), np.zeros((P, P))
    dives = [
        ProfileTerm(n, START + np.timedelta64(6 * n, "h"), np.zeros(P), np.zeros(P), nothing, current=current)
        for n, current in enumerate(currents_of(rng, error, headings))
    ]
    prior = HullPrior(Gaussian(np.zeros(P), np.diag([0.05**2, 0.1**2, 1.0, 1.0, 1.0])), np.zeros(P))
    found = solve_mission(dives, prior, turn_test=TurnTestSettings(use=True, deviation=0.03), robust=False)
    assert (found.overall.std[0] < 0.02) == separate
    np.testing.assert_array_less(np.abs(found.overall.mean[:2] - error), 3.0 * found.overall.std[:2])
    without = solve_mission(dives, prior, turn_test=TurnTestSettings(use=False))
    np.testing.assert_array_equal(without.overall.mean, 0.0)


def test_the_currents_likelihood_is_the_dense_one():
    """Information of one current against conditioning the joint normal of eta, current and observation."""
    rng = np.random.default_rng(12)
    point = rng.standard_normal(P)
    current = ProfileCurrent(rng.standard_normal(2), rng.standard_normal((2, P)), np.diag([0.01, 0.04]))
    wide = Gaussian(np.zeros(P + 4), np.diag([1.0] * P + [0.09, 0.09, 0.01, 0.01]))
    after, evidence = wide.updated(current.information(point))
    design = np.hstack([current.sensitivity, np.eye(2), np.eye(2)])
    spread = design @ wide.covariance @ design.T + current.covariance
    observed = current.velocity + current.sensitivity @ point
    gain = wide.covariance @ design.T @ np.linalg.inv(spread)
    np.testing.assert_allclose(after.mean, gain @ observed, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(after.covariance, wide.covariance - gain @ design @ wide.covariance, atol=1e-12)
    assert evidence == pytest.approx(scipy.stats.multivariate_normal(cov=spread).logpdf(observed), rel=1e-9)


def test_dependence_on_the_assumed_noise_widens_the_covariance():
    """Under a wide prior the covariance grows by the square of how far the sum moves, along that direction alone."""
    rng, truth = np.random.default_rng(21), np.full(P, 0.2)
    dives = [dive(rng, truth, n) for n in range(8)]
    direction = np.array([1.0, -1.0, 0.0, 0.0, 0.0])
    shifted = [
        replace(one, others=((one.score + one.information @ direction, one.information), (one.score, one.information)))
        for one in dives
    ]
    prior = HullPrior(Gaussian(np.zeros(P), 1e6 * np.eye(P)), np.zeros(P))
    before, after = (solve_mission(each, prior, robust=False) for each in (dives, shifted))
    np.testing.assert_allclose(after.eta, before.eta, atol=1e-4)
    for one, other in zip(before.smoothed, after.smoothed, strict=True):
        expected = one.covariance + np.outer(direction, direction)
        np.testing.assert_allclose(other.covariance, expected, atol=1e-4)
    np.testing.assert_allclose(after.sequential[0].covariance - before.sequential[0].covariance,
                               np.outer(direction, direction), atol=1e-3)  # fmt: skip
    np.testing.assert_allclose(after.change_std, before.change_std, atol=1e-6)


def test_widening_equals_that_of_an_error_common_to_all_dives():
    """Against dense algebra: h = L eta + U c + e, with c among the unknowns, and eta's prior N(0, 1)."""
    rng = np.random.default_rng(23)
    root = rng.standard_normal((P, P))
    matrix, before = root @ root.T, Gaussian(np.zeros(P), np.eye(P))
    after, _ = before.updated(Information(rng.standard_normal(P), matrix))
    moved = rng.standard_normal((2, P))
    found = widen_by_disagreement(before, after, moved)
    precision = np.eye(P) + matrix
    changes = precision @ moved.T
    design = np.hstack([matrix, changes])
    joint = np.eye(P + 2) + design.T @ np.linalg.solve(matrix, design)
    expected = np.linalg.inv(joint)
    mean = expected @ design.T @ np.linalg.solve(matrix, precision @ after.mean)
    np.testing.assert_allclose(found.mean, mean[:P], rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(found.covariance, after.covariance + moved.T @ moved, rtol=1e-12)


def test_the_estimate_stays_at_the_prior_if_the_assumptions_contradict_each_other():
    """By far: the dives contain no information there, and all of it elsewhere."""
    direction = np.array([1.0, 0.0, 0.0, 0.0, 0.0])
    before = Gaussian(np.zeros(P), np.eye(P))
    after, _ = before.updated(Information(np.full(P, 2.0), np.diag([4.0] * P)))
    found = widen_by_disagreement(before, after, 1e4 * direction[None])
    np.testing.assert_allclose(np.diag(found.covariance), [1e8 + 0.2, 0.2, 0.2, 0.2, 0.2], rtol=1e-9)
    np.testing.assert_allclose(found.mean, [0.0, 0.4, 0.4, 0.4, 0.4], atol=1e-6)


def test_a_change_that_depends_on_the_assumed_noise_is_not_known():
    """One that another assumption sees in the later dives alone is in the change's deviation."""
    rng, shift = np.random.default_rng(22), np.array([0.0, 0.0, 0.5, 0.0, 0.0])
    dives = [dive(rng, np.zeros(P), n) for n in range(6)]
    shifted = [
        replace(one, others=((one.score + one.information @ (shift if n >= 3 else 0.0 * shift), one.information),))
        for n, one in enumerate(dives)
    ]
    prior = HullPrior(Gaussian(np.zeros(P), np.eye(P)), np.full(P, 10.0))
    before, after = (solve_mission(each, prior, robust=False) for each in (dives, shifted))
    grown = np.sqrt(after.change_std[-1] ** 2 - before.change_std[-1] ** 2)
    assert grown[2] == pytest.approx(0.5, abs=0.1)
    assert (grown[[0, 1, 3, 4]] < 0.1).all()
