"""Overlapping observation files: the fullest ones are used, in whatever order they arrive."""

from itertools import permutations
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from support.missions import changed_observations

from gliderhpc.observations import joined as joined_files
from gliderhpc.observations.joined import join_observations


@pytest.fixture(scope="module")
def files(swift, tmp_path_factory):
    """Files of the mission: whole dives 1 to 3, the dives one by one, and every fourth sample of each of these."""
    folder = tmp_path_factory.mktemp("joined")

    def write(name, numbers, every=1, fixes=True):
        def change(content):
            samples = np.flatnonzero(np.isin(content["profile"].values, numbers))[::every]
            chosen = content.isel(time=samples)
            return chosen if fixes else chosen.drop_dims("fix")

        return changed_observations(swift, folder / name, change)

    found = {"123": write("123.nc", [1, 2, 3]), "12": write("12.nc", [1, 2])}
    for number in (1, 2, 3):
        found[f"{number}"] = write(f"{number}.nc", [number])
        found[f"{number} decimated"] = write(f"{number}-decimated.nc", [number], every=4)
    return found | {"1 without fixes": write("1-without.nc", [1], fixes=False)}


def joined(files, names, folder):
    left_out = join_observations([files[name] for name in names], folder / "all.nc")
    with xr.open_dataset(folder / "all.nc") as found:
        numbers, counts = np.unique(found["profile"].values, return_counts=True)
        return left_out, {int(number): int(count) for number, count in zip(numbers, counts, strict=True) if number}


@pytest.fixture(scope="module")
def whole(files, tmp_path_factory):
    """Number of samples of every dive."""
    return joined(files, ["123"], tmp_path_factory.mktemp("whole"))[1]


@pytest.mark.parametrize("names", list(permutations(["1 decimated", "1", "2"])))
def test_a_decimated_dive_gives_way_to_the_full_one(files, whole, tmp_path, names):
    assert joined(files, names, tmp_path) == ({}, {1: whole[1], 2: whole[2]})


@pytest.mark.parametrize("names", [("1 decimated", "2 decimated", "3 decimated", "123"), ("1", "12", "123", "3")])
def test_files_give_way_to_one_that_contains_them_all(files, whole, tmp_path, names):
    assert joined(files, names, tmp_path) == ({}, whole)


def test_a_dive_stays_where_its_fuller_file_cannot_be_used(files, whole, tmp_path):
    """Whole dive 2 contradicts the longer file, which is refused; the decimated dive 1 remains."""
    shifted = changed_observations(
        files["2"], tmp_path / "shifted.nc", lambda content: content.assign(depth=content["depth"] + 5.0)
    )
    left_out, counts = joined({**files, "other 2": shifted}, ["1 decimated", "other 2", "123"], tmp_path)
    assert list(left_out) == ["123.nc"]
    assert counts[1] < whole[1] / 3
    assert counts[2] == whole[2]


def test_another_record_of_the_same_time_replaces_nothing(files, whole, tmp_path):
    other = changed_observations(
        files["1"], tmp_path / "other.nc", lambda content: content.assign(depth=0.5 * content["depth"])
    )
    left_out, counts = joined({**files, "other": other}, ["1 decimated", "other"], tmp_path)
    assert "overlaps 1-decimated.nc in time" in left_out["other.nc"]
    assert counts[1] < whole[1] / 3


def test_a_fuller_file_without_the_fixes_replaces_nothing(files, tmp_path):
    left_out, _ = joined(files, ["1 decimated", "1 without fixes"], tmp_path)
    assert list(left_out) == ["1-without.nc"]


def test_a_fuller_file_with_a_faulty_profile_replaces_nothing(files, whole, tmp_path):
    """Its pitches are those of no glider."""
    faulty = changed_observations(
        files["1"], tmp_path / "faulty.nc", lambda content: content.assign(pitch=content["pitch"] + 80.0)
    )
    left_out, counts = joined({**files, "faulty": faulty}, ["1 decimated", "faulty"], tmp_path)
    assert list(left_out) == ["faulty.nc"]
    assert counts[1] < whole[1] / 3


@pytest.mark.parametrize("numbered", [True, False])
def test_conflicts_found_among_ordered_files_are_those_of_all_pairs(numbered):
    rng = np.random.default_rng(3)

    def content(index):
        time = np.datetime64("2024-01-01", "ns") + np.sort(rng.integers(0, 400) + rng.integers(0, 12, 2))
        variables = {"time": (("time",), time, {}), "depth": (("time",), np.zeros(2), {})}
        if numbered or rng.random() < 0.1:
            variables["profile"] = (("time",), rng.integers(1, 200, 2).astype(float), {})
        return joined_files._FileContent(Path(f"{index}.nc"), variables, {})

    chosen = joined_files._ChosenFiles()
    conflicts = 0
    for index in range(120):
        one = content(index)
        expected = [other for other in chosen.in_order if joined_files._conflict(one, other)]
        assert set(chosen.in_conflict_with(one)) == set(expected)
        conflicts += len(expected)
        for other in expected[: int(rng.integers(0, 3))]:
            chosen.remove(other)
        if not chosen.in_conflict_with(one):
            chosen.add(one)
    assert conflicts > 20
    assert len(chosen.in_order) > 20
