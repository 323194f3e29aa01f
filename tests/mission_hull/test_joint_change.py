"""Change of any error of the hull: several that begin together, one alone, none, and errors that scatter."""

from dataclasses import replace

import numpy as np
import pytest
from support.hull_dives import P, changes_alone, dive

from gliderhpc.mission_hull.estimate import HullPrior
from gliderhpc.mission_hull.joint_change import find_hull_changes
from gliderhpc.mission_hull.single_changes import POSSIBLE, PROBABLE

SUSPECTS = (0, 1, 2)
PRIOR = HullPrior.plausible(np.array([0.02, 0.02, 0.02, 0.0, 0.0]))


LIKE = 100.0 * np.outer([1.0, 1.0, 0.0, 0.0, 0.0], [1.0, 1.0, 0.0, 0.0, 0.0])
"""Information on two errors whose effects are alike, so that they cancel where one grows as the other decreases."""


def _mission(seed, changed, count=20, onset=10, information=9.0, like=0.0):
    """Dives with the same information on all errors, or more on the sum of two; some of these grow from a dive on."""
    rng = np.random.default_rng([51, seed])
    part = np.clip((np.arange(count) - onset + 1) / (count - onset), 0.0, 1.0)
    dives = []
    for n in range(count):
        truth = np.array([0.4, -0.2, 0.1, 0.0, 0.3])
        for i, total in changed.items():
            truth[i] += total * part[n]
        one = dive(rng, truth, n, point=np.zeros(P))
        matrix = information * np.eye(P) + like
        score = matrix @ truth + np.linalg.cholesky(matrix) @ rng.standard_normal(P)
        dives.append(replace(one, score=score, information=matrix))
    return dives


def test_two_changes_that_each_remain_doubtful_are_certain_together():
    """As fouling with a leak: neither is found by itself in most missions, and something has changed in nearly all."""
    found = [find_hull_changes(_mission(seed, {0: 1.2, 1: -1.2}, like=LIKE), SUSPECTS, PRIOR) for seed in range(12)]
    alone = np.array([max(change.probability for change in changes.values()) for changes, _ in found])
    together = np.array([joint.probability for _, joint in found])
    assert np.mean(alone > PROBABLE) < 0.5
    assert np.mean(together > PROBABLE) > 0.85
    assert np.mean([set(joint.combination) == {0, 1} for _, joint in found]) > 0.75
    assert np.mean([joint.included[2] for _, joint in found]) < 0.5 < np.mean([j.included[0] for _, j in found])
    both = [joint for _, joint in found if joint.combination == (0, 1)]
    assert np.mean([abs(joint.total[0] - 1.2) < 2.0 * joint.total_std[0] for joint in both]) >= 0.75
    assert np.mean([joint.onset[0] <= 10 <= joint.onset[2] for _, joint in found]) >= 0.75


def test_a_single_change_is_the_most_probable_combination():
    found = [find_hull_changes(_mission(seed, {1: 1.2}), SUSPECTS, PRIOR) for seed in range(6)]
    assert all(joint.combination == (1,) for _, joint in found)
    assert all(joint.probability >= max(change.probability for change in changes.values()) for changes, joint in found)
    for seed, (changes, _) in enumerate(found):
        single = changes_alone(_mission(seed, {1: 1.2}), SUSPECTS, PRIOR)
        assert [each.probability for each in changes.values()] == pytest.approx(
            [each.probability for each in single.values()]
        )


def test_a_hull_that_stays_gives_few_alarms_for_all_its_errors_together():
    still = np.array([find_hull_changes(_mission(seed, {}), SUSPECTS, PRIOR)[1].probability for seed in range(40)])
    assert np.mean(still > PROBABLE) <= 0.05
    assert np.median(still) < 0.5


def test_errors_that_scatter_from_dive_to_dive_show_no_joint_change():
    """Every second dive has another lift, as in packets of internal waves."""
    probabilities = []
    for seed in range(10):
        rng = np.random.default_rng([52, seed])
        dives = []
        for n, one in enumerate(_mission(seed, {}, information=40.0)):
            apart = np.zeros(P)
            apart[2] = 1.2 * rng.standard_normal() * (n % 2)
            dives.append(replace(one, score=one.score + one.information @ apart))
        probabilities.append(find_hull_changes(dives, SUSPECTS, PRIOR)[1].probability)
    assert np.max(probabilities) < PROBABLE
    assert np.median(probabilities) < POSSIBLE


def test_a_companion_shares_the_course_but_is_no_suspect():
    changes, joint = find_hull_changes(_mission(1, {0: 1.2, 3: 1.0}), SUSPECTS, PRIOR, companions={0: 3})
    assert set(joint.included) == set(changes) == set(SUSPECTS)
    assert set(joint.combination) <= set(SUSPECTS)
    assert abs(joint.total[joint.combination.index(0)] - 1.2) < 3.0 * joint.total_std[joint.combination.index(0)]


@pytest.mark.parametrize(("count", "suspects"), [(3, SUSPECTS), (8, ())])
def test_few_dives_or_no_suspects_show_no_joint_change(count, suspects):
    changes, joint = find_hull_changes(_mission(0, {}, count=count, onset=2), suspects, PRIOR)
    assert joint is None
    assert changes == dict.fromkeys(suspects)
