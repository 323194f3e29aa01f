"""Arithmetic of the page on real missions: choice of profiles and counts."""

from types import SimpleNamespace

from support.archives import STEPS, Content, true_disturbances, write_archive

from benchmarks.real_calibration import changes, medians, merged, shares
from gliderhpc import open_mission
from gliderhpc.vocabulary import QUALITY


def test_no_profile_is_both_fitted_and_inverted():
    records = SimpleNamespace(profile_numbers=list(range(1, 10)), faults={3: "no battery_position"})
    inverted, fitted = shares(records, 2)
    assert (inverted, fitted) == ([1, 4, 6, 8], [2, 5, 7, 9])
    assert shares(records, 1) == ([1, 2, 4, 5, 6, 7, 8, 9], [])


def test_medians_are_those_of_steady_dives_and_climbs(tmp_path):
    force = true_disturbances(1)
    force[:2000, 0], force[2000:, 0], force[500:700, 0] = -1.0, 0.5, 100.0
    content = Content(1, adjoint=force)
    content.quality[500:700] = QUALITY.meanings["vibration"]
    content.quality[2000:] = QUALITY.meanings["climbing"]
    assert len(content.quality) == STEPS + 1
    with open_mission(write_archive(tmp_path / "one.zarr", content)) as tree:
        assert medians(tree, "series", "B_cu", [1]) == "-1.00, +0.50, 1.00"


def test_before_and_after_are_in_one_cell():
    before, after = [("a", "1"), ("b", "2")], [("a", "1"), ("b", "3")]
    assert changes(before, after) == [("a", "1"), ("b", "2 → 3")]
    assert merged({"both": (before, after), "one": (before, None)}) == {"both": [("a", "1"), ("b", "2 → 3")]}
