"""Inflation and weights of the sum over the dives."""

from dataclasses import replace

import numpy as np
import pytest
from test_mission_hull import P, dive

from gliderhpc.tuning import weighted_sum
from gliderhpc.tuning.gaussian_chain import Gaussian, Information
from gliderhpc.tuning.mission_hull import changes_of
from gliderhpc.tuning.weighted_sum import SumProblem, WeightedSum, _excess, _weights


def total(scatter):
    """Return a sum of eight dives whose truths differ by a scatter."""
    rng = np.random.default_rng(2)
    dives = [dive(rng, 0.4 + scatter * rng.standard_normal(P), number) for number in range(8)]
    problem = SumProblem(Gaussian(np.zeros(P), np.eye(P)), changes_of(dives, np.zeros(P)), [d.term for d in dives])
    return WeightedSum.plain(problem)


@pytest.fixture
def chains(monkeypatch):
    """Count the chains that are solved."""
    count = []
    real = weighted_sum.solve_chain
    monkeypatch.setattr(weighted_sum, "solve_chain", lambda *a: count.append(1) or real(*a))
    return count


def test_inflation_and_weights_are_those_of_four_rounds():
    whole = total(1.0)
    expected, weight = np.ones(()), np.ones(8)
    for _ in range(4):
        expected = np.maximum(1.0, expected * _excess(*WeightedSum(whole.problem, expected, weight).disagreements))
        weight = _weights(*WeightedSum(whole.problem, expected, weight).disagreements)
    found = whole.agreeing()
    assert found.inflation == expected > 2.0
    np.testing.assert_array_equal(found.weight, weight)


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
