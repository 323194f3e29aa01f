"""Inflation and weights of the sum over the dives."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2
from support.hull_dives import P, dive

from gliderhpc.mission_hull import weighted_sum
from gliderhpc.mission_hull.estimate import transitions_between
from gliderhpc.mission_hull.gaussian_chain import Gaussian, Information
from gliderhpc.mission_hull.weighted_sum import SumProblem, WeightedSum


def total(scatter, outlier=0.0):
    """Return a sum of eight dives whose truths differ by a scatter, and the last one's by more."""
    rng = np.random.default_rng(2)
    dives = [dive(rng, 0.4 + scatter * rng.standard_normal(P) + (number == 7) * outlier, number) for number in range(8)]
    problem = SumProblem(
        Gaussian(np.zeros(P), np.eye(P)), transitions_between(dives, np.zeros(P)), [d.term for d in dives]
    )
    return WeightedSum.plain(problem)


@pytest.fixture
def chains(monkeypatch):
    """Count the chains that are solved."""
    count = []
    real = weighted_sum.solve_chain
    monkeypatch.setattr(weighted_sum, "solve_chain", lambda *a: count.append(1) or real(*a))
    return count


def test_inflation_and_weights_are_those_of_four_rounds():
    """Against dense algebra: the hull does not change, so every dive measures the same five unknowns."""
    whole = total(0.2, outlier=2.0)
    own = [np.linalg.inv(term.matrix) for term in whole.problem.terms]
    measured = [covariance @ term.vector for covariance, term in zip(own, whole.problem.terms, strict=True)]

    def disagreements(inflation, weight):
        """Squared distance of every dive's unknowns, with full weight, from those of prior and other dives."""
        found = []
        for n in range(8):
            others = [(weight[i] / inflation, whole.problem.terms[i]) for i in range(8) if i != n]
            rest = np.linalg.inv(np.eye(P) + sum(part * term.matrix for part, term in others))
            apart = measured[n] - rest @ sum(part * term.vector for part, term in others)
            found.append(apart @ np.linalg.solve(inflation * own[n] + rest, apart))
        return np.array(found)

    inflation, weight = 1.0, np.ones(8)
    for _ in range(4):
        excess = np.median(disagreements(inflation, weight)) / chi2.ppf(0.5, P)
        inflation = max(1.0, inflation * excess)
        weight = np.minimum(1.0, chi2.ppf(0.99, P) / disagreements(inflation, weight))
    found = whole.agreeing()
    assert inflation > 2.0
    assert weight.min() < 0.9
    assert found.inflation == pytest.approx(inflation, rel=1e-9)
    np.testing.assert_allclose(found.weight, weight, rtol=1e-9)


def test_dives_that_agree_are_summed_once(chains):
    whole = total(0.0)
    weak = [term.weighted(1e-3) for term in whole.problem.terms]
    agreeing = WeightedSum.plain(SumProblem(whole.problem.prior, whole.problem.changes, weak))
    found = agreeing.agreeing()
    assert found is agreeing
    assert (found.inflation, found.weight.tolist()) == (1.0, [1.0] * 8)
    assert found.chain is agreeing.chain
    assert len(chains) == 1


def test_several_sums_at_once_are_those_of_each():
    one, other = total(0.0), total(1.0)
    terms = [Information.stacked(pair) for pair in zip(one.problem.terms, other.problem.terms, strict=True)]
    both = WeightedSum.plain(replace(one.problem, terms=terms)).agreeing()
    for index, alone in enumerate((one.agreeing(), other.agreeing())):
        assert both.inflation[index] == pytest.approx(alone.inflation, rel=1e-9)
        np.testing.assert_allclose(both.weight[index], alone.weight, rtol=1e-9)
        assert both.chain.log_evidence[index] == pytest.approx(alone.chain.log_evidence, rel=1e-9)
        np.testing.assert_array_equal(both.disagreements[1][index], alone.disagreements[1])
