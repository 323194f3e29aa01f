"""Doubtful fixes of profiles among many whose fixes lie under water."""

import numpy as np

from gliderhpc.observations.fixes import Fixes, drop_outliers
from gliderhpc.observations.navigation.fixes import with_neighbours


def test_fixes_of_a_surfacing_may_lie_on_both_sides_of_the_date_line():
    time = np.datetime64("2024-05-01T12:00:00", "ns") + np.array([0, 60]) * np.timedelta64(1, "s")
    kept = drop_outliers(Fixes(time, np.array([10.0, 10.0001]), np.array([179.9999, -179.9999])))
    assert len(kept.time) == 2
    assert kept.outliers == 0


def test_a_profile_with_mostly_doubtful_neighbours_is_doubtful():
    doubts = dict.fromkeys((1, 2, 4), "under water")
    found = with_neighbours(doubts, [1, 2, 3, 4, 5])
    assert set(found) == {1, 2, 3, 4, 5}
    assert found[1] == "under water"
    assert "3 of the profiles" in found[3]


def test_single_or_distant_doubtful_profiles_do_not_affect_others():
    numbers = list(range(1, 31))
    assert with_neighbours({7: "under water"}, numbers) == {7: "under water"}
    found = with_neighbours(dict.fromkeys((1, 2, 3, 4), "under water"), numbers)
    # Of the profiles 1 to 13 around profile 8, a quarter would be 2.75.
    assert set(found) == set(range(1, 8))
    assert with_neighbours({}, numbers) == {}
