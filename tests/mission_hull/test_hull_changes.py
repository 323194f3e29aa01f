"""Changes of the hull during a mission: evidence compared with the augmented chain, onset, size, and false alarms."""

from dataclasses import replace

import numpy as np
import pytest
from support.hull_dives import P, changes_alone, dive, information

from gliderhpc.mission_hull.change_scatter import variance_ratio, with_scatter
from gliderhpc.mission_hull.estimate import HullPrior, solve_mission
from gliderhpc.mission_hull.gaussian_chain import Gaussian, Information, Transition, solve_chain
from gliderhpc.mission_hull.single_changes import PROBABLE, _candidates, _parts, size_likelihood


def test_size_likelihood_is_that_of_the_chain_with_the_size_as_an_unknown():
    """The separate-bias form (Friedland 1969) against the evidence of the augmented chain."""
    rng = np.random.default_rng(3)
    count, parameter, deviation = 6, 2, 0.7
    prior = Gaussian(rng.standard_normal(P), np.diag(rng.uniform(0.5, 2.0, P)))
    changes = [Transition(rng.uniform(0.6, 1.0, P), rng.uniform(0.0, 0.2, P)) for _ in range(count - 1)]
    terms = [Information(rng.standard_normal(P), information(rng, rank=3, size=2.0), 0.1) for _ in range(count)]
    shapes = rng.uniform(-1.0, 1.0, (4, count))
    likelihood = size_likelihood(prior, changes, terms, (parameter,), shapes)
    score, curvature = (x.reshape(-1) for x in likelihood[:2])
    plain = solve_chain(prior, changes, terms).log_evidence
    assert likelihood.log_evidence == pytest.approx(plain, rel=1e-12)
    for shape, g, i in zip(shapes, score, curvature, strict=True):
        covariance = np.zeros((P + 1, P + 1))
        covariance[:P, :P], covariance[P, P] = prior.covariance, deviation**2
        wide = [Transition(np.append(c.decay, 1.0), np.append(c.variance, 0.0)) for c in changes]
        seen = [_seen_with_size(term, parameter, x) for term, x in zip(terms, shape, strict=True)]
        chain = solve_chain(Gaussian(np.append(prior.mean, 0.0), covariance), wide, seen)
        precision = i + deviation**-2
        gained = 0.5 * g**2 / precision - 0.5 * np.log(precision * deviation**2)
        assert chain.log_evidence - plain == pytest.approx(gained, rel=1e-9)
        assert chain.smoothed[-1].mean[P] == pytest.approx(g / precision, rel=1e-8)
        assert chain.smoothed[-1].std[P] ** 2 == pytest.approx(1.0 / precision, rel=1e-8)


def test_two_sizes_are_two_unknowns_of_the_chain():
    rng = np.random.default_rng(4)
    count, parameters = 6, (2, 0)
    prior = Gaussian(rng.standard_normal(P), np.diag(rng.uniform(0.5, 2.0, P)))
    changes = [Transition(np.ones(P), rng.uniform(0.0, 0.2, P)) for _ in range(count - 1)]
    terms = [Information(rng.standard_normal(P), information(rng, rank=3, size=2.0), 0.1) for _ in range(count)]
    shapes = rng.uniform(-1.0, 1.0, (3, count))
    found = _candidates(*size_likelihood(prior, changes, terms, parameters, shapes)[:2], 0.7)
    plain = solve_chain(prior, changes, terms).log_evidence
    for place, shape in enumerate(shapes):
        covariance = np.diag(np.append(np.diag(prior.covariance), [0.49, 0.49]))
        wide = [Transition(np.ones(P + 2), np.append(c.variance, [0.0, 0.0])) for c in changes]
        seen = []
        for term, x in zip(terms, shape, strict=True):
            lift = np.eye(P, P + 2)
            lift[parameters, (P, P + 1)] = x
            seen.append(Information(lift.T @ term.vector, lift.T @ term.matrix @ lift, term.constant))
        chain = solve_chain(Gaussian(np.append(prior.mean, [0.0, 0.0]), covariance), wide, seen)
        assert chain.log_evidence - plain == pytest.approx(found.log_ratio[place], rel=1e-9)
        assert chain.smoothed[-1].mean[P] == pytest.approx(found.size[place], rel=1e-8)
        assert chain.smoothed[-1].std[P] ** 2 == pytest.approx(found.variance[place], rel=1e-8)


def test_a_change_that_comes_with_another_one_has_its_own_size():
    """Without the other parameter it absorbs a part of that change, and its interval is too narrow."""
    rng = np.random.default_rng(12)
    both, alone = [], []
    for _ in range(8):
        courses = [
            truth + np.array([0.0, 0.6 * (n >= 12), 0, 0, 0]) for n, truth in enumerate(_course(24, 12, 0.8, "step"))
        ]
        dives = [dive(rng, truth, n, rank=2, size=40.0) for n, truth in enumerate(courses)]
        prior = HullPrior.plausible(np.array([0.05, 0.0, 0.0, 0.0, 0.0]))
        both.append(changes_alone(dives, (0,), prior, companions={0: 1})[0])
        alone.append(changes_alone(dives, (0,), prior)[0])
    assert np.mean([abs(one.total - 0.8) < 2.0 * one.total_std for one in both]) >= 0.85
    errors = [np.sqrt(np.mean([(one.total - 0.8) ** 2 for one in each])) for each in (both, alone)]
    assert errors[0] < errors[1]
    assert [one.probability for one in both] == [one.probability for one in alone]


@pytest.mark.parametrize("changed", [0, 1])
def test_one_change_is_not_found_again_in_an_error_that_resembles_it(changed):
    """As lost weight and an offset of the pitch: the dives determine their sum a hundred times better than each."""
    rng = np.random.default_rng([14, changed])
    sum_of_both = np.array([1.0, 1.0, 0.0, 0.0, 0.0])
    like = 400.0 * np.outer(sum_of_both, sum_of_both) + np.diag([4.0, 4.0, 9.0, 9.0, 9.0])
    dives = []
    for n in range(24):
        truth = np.zeros(P)
        truth[changed] = 1.0 * (n >= 12)
        score = np.linalg.cholesky(like) @ rng.standard_normal(P)
        dives.append(replace(dive(rng, truth, n, point=np.zeros(P)), score=score + like @ truth, information=like))
    prior = HullPrior.plausible(np.array([0.05, 0.05, 0.0, 0.0, 0.0]))
    both = changes_alone(dives, (0, 1), prior)
    other = 1 - changed
    assert both[changed].probability > PROBABLE
    assert both[other].probability < 0.5
    assert changes_alone(dives, (other,), prior)[other].probability > PROBABLE


def test_dives_that_agree_better_than_they_state_show_a_change_sooner():
    """The stated errors include errors common to all dives, which are no change; unchanged hulls give few alarms."""
    changed = [_agreeing(seed, 0.3) for seed in range(8)]
    assert min(robust.probability for robust, _ in changed) > PROBABLE
    assert np.median([plain.probability for _, plain in changed]) < PROBABLE
    assert np.mean([abs(robust.total - 0.3) < 2.0 * robust.total_std for robust, _ in changed]) >= 0.85
    still = [_agreeing(100 + seed, 0.0)[0].probability for seed in range(40)]
    assert np.mean(np.array(still) > PROBABLE) <= 0.05


def test_a_walk_that_is_too_large_does_not_pass_for_dives_that_agree():
    rng = np.random.default_rng(22)
    dives = [
        dive(rng, truth, n, rank=3, size=1e4, point=np.zeros(P)) for n, truth in enumerate(_course(30, 12, 0.0, "step"))
    ]
    assert np.median(_parts([dives], HullPrior.plausible(np.full(P, 0.05)))) < 1.5
    assert np.max(_parts([dives[:4]], HullPrior.plausible(np.zeros(P)))) <= 1.0


def _agreeing(seed, total):
    """Find the change in 20 dives, four of them after it, that scatter by half of their stated deviation."""
    rng = np.random.default_rng([21, seed])
    dives = []
    for n, truth in enumerate(_course(20, 16, total, "step")):
        one = dive(rng, truth, n, rank=3, size=12.0, point=np.zeros(P))
        exact = one.information @ truth
        dives.append(replace(one, score=exact + 0.5 * (one.score - exact)))
    prior = HullPrior.plausible(np.array([0.02, 0.0, 0.0, 0.0, 0.0]))
    return [changes_alone(dives, (0,), prior, robust=robust)[0] for robust in (True, False)]


LEAKING = (0, 1)
"""Errors that vary less from dive to dive than the dives state in `_steady_dives`."""


def _steady_dives(seed, total, share=0.25, count=20):
    """Return dives whose first two errors vary by a share of their stated deviation, and whose first one grows.

    As with a prior that allows slow forces of the water: only the errors that resemble them are stated too uncertain.
    """
    rng = np.random.default_rng([41, seed])
    matrix, found = information(rng, rank=P, size=4.0), []
    for n, truth in enumerate(_course(count, count // 2, total, "ramp")):
        noise = np.linalg.cholesky(matrix) @ rng.standard_normal(P)
        noise[list(LEAKING)] *= share
        found.append(dive(rng, truth, n, point=np.zeros(P)))
        found[-1] = replace(found[-1], information=matrix, score=matrix @ truth + noise)
    return found


def test_variance_between_successive_dives_relative_to_the_stated_one():
    """An upper bound: at or above the true ratio in 95 % of missions, with or without a change, and not far above."""
    prior = HullPrior.plausible(np.zeros(P)).eta
    for total in (0.0, 1.0):
        for share in (1.0, 0.25):
            ratio = [
                variance_ratio([each.term for each in _steady_dives(seed, total, share)], prior, LEAKING)
                for seed in range(40)
            ]
            assert np.mean(np.array(ratio) >= share**2) >= 0.9
            assert np.median(ratio) < 4.0 * share**2


def test_a_suspect_without_information_has_no_variance_ratio():
    rng = np.random.default_rng(5)
    terms = [dive(rng, np.zeros(P), n, rank=1).term for n in range(6)]
    assert variance_ratio(terms, HullPrior.plausible(np.zeros(P)).eta, (0, 1, 2, 3)) == np.inf


def test_a_leak_shows_if_successive_dives_agree_better_than_stated():
    prior = HullPrior.plausible(np.array([0.02, 0.02, 0.0, 0.0, 0.0]))
    leaks = [changes_alone(_steady_dives(seed, 0.35), LEAKING, prior)[0].probability for seed in range(8)]
    plain = [changes_alone(_steady_dives(seed, 0.35), LEAKING, prior, robust=False)[0].probability for seed in range(8)]
    assert np.median(leaks) > PROBABLE
    assert np.median(plain) < 0.8
    still = [
        max(change.probability for change in changes_alone(_steady_dives(100 + seed, 0.0), LEAKING, prior).values())
        for seed in range(30)
    ]
    assert np.mean(np.array(still) > PROBABLE) <= 0.05


def _crossing_waves(seed, total=0.0):
    """Return dives of which some, in packets of waves, have another second error, and whose first error may change."""
    rng = np.random.default_rng([31, seed])
    dives = []
    for n, truth in enumerate(_course(16, 8, total, "step")):
        apart = truth + np.array([0.0, 1.2 * rng.standard_normal() * (n % 2), 0.0, 0.0, 0.0])
        dives.append(dive(rng, apart, n, rank=3, size=40.0, point=np.zeros(P)))
    return dives


def test_an_error_that_differs_from_dive_to_dive_has_not_changed():
    """A few unusual dives near one end of the mission, each well determined, would pass for a step."""
    prior = HullPrior.plausible(np.array([0.05, 0.02, 0.0, 0.0, 0.0]))
    scattered = [changes_alone(_crossing_waves(seed), (0, 1), prior)[1].probability for seed in range(20)]
    assert np.mean(np.array(scattered) > PROBABLE) <= 0.05
    assert np.median(scattered) < 0.5
    changed = [changes_alone(_crossing_waves(seed, 1.6), (0, 1), prior)[0].probability for seed in range(8)]
    assert np.mean(np.array(changed) > PROBABLE) >= 0.75


def test_information_with_scatter_is_the_integral_over_the_scatter():
    """Log likelihood of a dive whose own unknowns differ from the mission's, by quadrature over the difference."""
    rng = np.random.default_rng(8)
    term = Information(rng.standard_normal(P), information(rng, rank=3, size=2.0), 0.4)
    deviation = np.array([0.0, 0.7, 0.0, 0.0, 0.0])
    found = with_scatter(term, deviation)
    difference = np.linspace(-8.0, 8.0, 4001) * deviation[1]
    weight = np.exp(-0.5 * (difference / deviation[1]) ** 2) / deviation[1] / np.sqrt(2.0 * np.pi)
    for _ in range(3):
        x = rng.standard_normal(P)
        at = x + difference[:, None] * (np.arange(P) == 1)
        value = term.constant + at @ term.vector - 0.5 * np.einsum("ni,ij,nj->n", at, term.matrix, at)
        expected = np.log(np.trapezoid(np.exp(value) * weight, difference))
        assert found.constant + found.vector @ x - 0.5 * x @ found.matrix @ x == pytest.approx(expected, rel=1e-9)
    assert with_scatter(term, np.zeros(P)) is term


def test_a_change_under_one_assumption_of_the_noise_is_not_certain():
    rng = np.random.default_rng(15)
    dives = [
        dive(rng, truth, n, rank=3, size=40.0, point=np.zeros(P))
        for n, truth in enumerate(_course(24, 12, 0.8, "step"))
    ]
    calm = [
        dive(rng, truth, n, rank=3, size=40.0, point=np.zeros(P))
        for n, truth in enumerate(_course(24, 12, 0.0, "step"))
    ]
    doubted = [replace(one, others=((other.score, other.information),)) for one, other in zip(dives, calm, strict=True)]
    prior = HullPrior.plausible(np.array([0.05, 0.0, 0.0, 0.0, 0.0]))
    sure, unsure = (changes_alone(each, (0,), prior)[0] for each in (dives, doubted))
    assert sure.probability > PROBABLE
    assert 0.4 < unsure.probability < 0.7
    assert unsure.total_std > 3.0 * sure.total_std


def test_a_jump_in_the_prior_lets_the_hull_change_at_once():
    rng = np.random.default_rng(13)
    dives = [dive(rng, truth, n, rank=3, size=40.0) for n, truth in enumerate(_course(24, 12, 0.8, "step"))]
    walk = np.array([0.05, 0.0, 0.0, 0.0, 0.0])
    still = solve_mission(dives, HullPrior.plausible(walk))
    jumping = solve_mission(dives, replace(HullPrior.plausible(walk), jumps={12: np.array([1.0, 0, 0, 0, 0])}))
    assert jumping.log_evidence > still.log_evidence + 5.0
    assert abs(jumping.change[-1][0] - 0.8) < 2.0 * jumping.change_std[-1][0]
    assert abs(jumping.change[11][0]) < 2.0 * jumping.change_std[11][0]


def _seen_with_size(term, parameter, part):
    """Return a dive's information where the size's part adds to one unknown."""
    lift = np.eye(P, P + 1)
    lift[parameter, P] = part
    return Information(lift.T @ term.vector, lift.T @ term.matrix @ lift, term.constant)


def _found(courses, seed, size=40.0):
    rng = np.random.default_rng([11, seed])
    dives = [dive(rng, truth, n, rank=3, size=size) for n, truth in enumerate(courses)]
    prior = HullPrior.plausible(np.array([0.05, 0.0, 0.0, 0.0, 0.0]))
    return changes_alone(dives, (0,), prior)[0]


def _course(count, onset, total, form):
    base = np.array([0.4, -0.2, 0.1, 0.0, 0.3])
    part = np.clip((np.arange(count) - onset + 1) / (count - onset), 0.0, 1.0)
    part = (part > 0.0) if form == "step" else part
    return [base + np.array([total * x, 0, 0, 0, 0]) for x in part]


@pytest.mark.parametrize(("form", "onset"), [("step", 12), ("ramp", 10)])
def test_a_change_is_found_with_its_onset_size_and_form(form, onset):
    found = [_found(_course(30, onset, 0.8, form), seed) for seed in range(8)]
    assert min(each.probability for each in found) > 0.95
    assert np.mean([abs(each.total - 0.8) < 2.0 * each.total_std for each in found]) >= 0.85
    assert np.mean([each.onset[0] <= onset <= each.onset[2] for each in found]) >= 0.75
    assert np.median([abs(each.onset[1] - onset) for each in found]) <= (1 if form == "step" else 5)
    assert np.mean([(each.step_probability > 0.5) == (form == "step") for each in found]) >= 0.75


def test_a_hull_that_stays_gives_few_alarms():
    """Probabilities of the posterior: of hulls that stay, few get more than 0.95, and most less than one half."""
    found = [_found(_course(20, 10, 0.0, "step"), seed).probability for seed in range(40)]
    assert np.mean(np.array(found) > 0.95) <= 0.05
    assert np.median(found) < 0.5


def test_dives_that_all_contradict_the_platform_file_show_no_change():
    """A step after the first dive would otherwise excuse all later dives from a prior that is too narrow."""
    rng = np.random.default_rng(23)
    dives = [dive(rng, truth, n, rank=3, size=12.0) for n, truth in enumerate(_course(20, 10, 0.0, "step"))]
    walk = np.array([0.02, 0.0, 0.0, 0.0, 0.0])
    overconfident = HullPrior(Gaussian(np.array([-0.8, 0.0, 0.0, 0.0, 0.0]), np.diag([0.01, 1.0, 1.0, 1.0, 1.0])), walk)
    same, expected = (changes_alone(dives, (0,), each)[0] for each in (overconfident, HullPrior.plausible(walk)))
    assert same.probability < 0.5
    assert same.probability == pytest.approx(expected.probability, abs=0.1)


def test_change_since_the_first_dive_is_that_of_the_joint_posterior():
    """Var(x_n - x_1) by the smoother's gains, against a chain that carries the first dive's unknowns along."""
    rng = np.random.default_rng(21)
    count = 5
    prior = Gaussian(np.zeros(P), np.eye(P))
    changes = [Transition(np.ones(P), rng.uniform(0.05, 0.3, P)) for _ in range(count - 1)]
    terms = [Information(rng.standard_normal(P), information(rng, rank=2, size=2.0)) for _ in range(count)]
    mean, std = solve_chain(prior, changes, terms).since_first()
    both = Gaussian(np.zeros(2 * P), np.kron(np.ones((2, 2)), np.eye(P)) + 1e-12 * np.eye(2 * P))
    wide = [Transition(np.ones(2 * P), np.concatenate([c.variance, np.zeros(P)])) for c in changes]
    lift = np.eye(P, 2 * P)
    seen = [Information(lift.T @ t.vector, lift.T @ t.matrix @ lift) for t in terms]
    last = solve_chain(both, wide, seen).smoothed[-1]
    apart = np.hstack([np.eye(P), -np.eye(P)])
    np.testing.assert_allclose(mean[-1], apart @ last.mean, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(std[-1] ** 2, np.diag(apart @ last.covariance @ apart.T), rtol=1e-6)
