"""Doubts about the fixes of profiles among many whose fixes lie under water."""

from gliderhpc.observations.navigation_fixes import with_neighbours


def test_a_profile_among_doubted_ones_is_doubted():
    doubts = dict.fromkeys((1, 2, 4), "under water")
    found = with_neighbours(doubts, [1, 2, 3, 4, 5])
    assert set(found) == {1, 2, 3, 4, 5}
    assert found[1] == "under water"
    assert "3 of the profiles" in found[3]


def test_one_doubted_profile_and_distant_ones_leave_the_others_alone():
    numbers = list(range(1, 31))
    assert with_neighbours({7: "under water"}, numbers) == {7: "under water"}
    found = with_neighbours(dict.fromkeys((1, 2, 3, 4), "under water"), numbers)
    # Of the profiles 1 to 13 around profile 8, a quarter would be 2.75.
    assert set(found) == set(range(1, 8))
    assert with_neighbours({}, numbers) == {}
