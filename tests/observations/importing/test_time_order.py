"""Rows of a file that are out of time order, or repeated."""

import numpy as np
import pytest
import xarray as xr
from support import seaglider_files as made
from support.slocum_files import flight, joined, science, write_netcdf

from gliderhpc.observations.importing.time_order import order_of_rows
from gliderhpc.observations.instruments.og1 import import_og1
from gliderhpc.observations.instruments.slocum import import_slocum

ROWS = 2 * (made.AFLOAT + made.HALF) + 3
"""Rows of one dive of the synthetic file."""


def order_of(*seconds, values=None):
    time = np.datetime64("2024-05-01", "ns") + np.array(seconds) * np.timedelta64(1, "s")
    return order_of_rows(time, [np.arange(float(len(time))) if values is None else np.array(values)])


@pytest.mark.parametrize(
    ("seconds", "rows"),
    [
        ((0, 1, 2, 4, 3, 5, 6), [0, 1, 2, 4, 3, 5, 6]),
        ((0, 1, 2, 4, 5, 6, 3, 7), [0, 1, 2, 6, 3, 4, 5, 7]),
        ((0, 1, 6, 2, 3, 4, 5, 7), [0, 1, 3, 4, 5, 6, 2, 7]),
        ((1, 0, 2, 3, 4), [1, 0, 2, 3, 4]),
        ((0, 1, 2, 4, 3), [0, 1, 2, 4, 3]),
    ],
    ids=["exchanged", "late", "early", "first", "last"],
)
def test_single_rows_are_moved_to_the_gap_that_they_left(seconds, rows):
    found = order_of(*seconds)
    np.testing.assert_array_equal(np.array(seconds)[found.rows], np.sort(seconds))
    assert found.rows.tolist() == rows
    assert found.parts + found.late > 0


@pytest.mark.parametrize(
    "seconds",
    [
        (0, 1, 2, 3, 4, 5, 6, 7, 8),
        (0, 2, 4, 6, 8, 10, 5, 7, 9, 11, 13),
        (0, 1, 2, 3, 4, 5, 3, 4, 5, 6, 7, 8),
        (0, 1, 2, 50_000, 3, 4, 5, 6),
        (0, 1, 2, 300, 3, 4, 5, 6),
        (90_000, 90_001, 90_002, 0, 1, 2),
        (0, 1, 2, 3, 300, 301, 302, 150, 303, 304),
    ],
    ids=["in order", "set back", "set back by whole steps", "damaged", "damaged nearby", "a day apart", "in a pause"],
)
def test_wrong_clocks_are_not_sorted(seconds):
    found = order_of(*seconds)
    assert found.rows.tolist() == list(range(len(seconds)))
    assert found.describe() == ()


def test_rows_given_twice_are_taken_once_even_if_a_value_is_missing():
    found = order_of(0, 1, 2, 3, 2, 3, 4, values=[0.0, 1.0, 2.0, np.nan, 2.0, np.nan, 4.0])
    assert found.rows.tolist() == [0, 1, 2, 3, 6]
    assert found.describe() == ("2 rows repeated from elsewhere in the file, each taken once",)
    other = order_of(0, 1, 2, 3, 2, 3, 4, values=[0.0, 1.0, 2.0, 3.0, 2.5, 3.5, 4.0])
    assert other.rows.tolist() == list(range(7)), "of rows that differ it is unknown which are right"


def test_a_long_pause_elsewhere_does_not_prevent_sorting():
    found = order_of(100_000, 100_001, 200_000, 200_001, 99_990, 99_991)
    assert found.rows.tolist() == [4, 5, 0, 1, 2, 3]
    assert found.describe() == ("its rows are not in time order; 2 parts are sorted",)


def test_rows_without_a_time_come_last():
    time = np.datetime64("2024-05-01", "ns") + np.array([5, 0, 6, 2, 3]) * np.timedelta64(1, "s")
    time[1] = np.datetime64("NaT")
    assert order_of_rows(time, [np.arange(5.0)]).rows.tolist() == [3, 4, 0, 2, 1]


# OG1


def rearranged(path, rows, dives=(1, 2, 3), **changes):
    """OG1 file with some rows of the usual one, in another order."""
    made.write_og1(path, dives, **changes)
    with xr.open_dataset(path, decode_times=False) as dataset:
        stored = dataset.load()
    stored.isel(N_MEASUREMENTS=rows).to_netcdf(path)
    return path


def assert_equal_to_usual(tmp_path, summary, **changes):
    """Compare the imported file with that of the usual order."""
    usual = import_og1([made.write_og1(tmp_path / "usual.nc", (1, 2, 3), **changes)], tmp_path / "expected.nc")
    assert summary.rows_dropped == usual.rows_dropped == {}
    assert summary.rejected == {}
    with xr.open_dataset(tmp_path / "expected.nc") as expected, xr.open_dataset(tmp_path / "out.nc") as found:
        assert set(found.variables) == set(expected.variables)
        for name in expected.variables:
            np.testing.assert_array_equal(found[name].values, expected[name].values)


EVERY = np.arange(3 * ROWS)
SWAPPED = np.concatenate([EVERY[ROWS + 40 :], EVERY[: ROWS + 40]])
DISPLACED = np.concatenate([EVERY[:60], EVERY[61:66], EVERY[60:61], EVERY[66:]])
REPEATED = np.concatenate([EVERY[: ROWS + 40], EVERY[ROWS + 20 :]])


@pytest.mark.parametrize("changes", [{}, {"divenum": None}], ids=["numbered", "from depth"])
@pytest.mark.parametrize(
    ("rows", "words"),
    [
        (SWAPPED, "its rows are not in time order; 2 parts are sorted"),
        (DISPLACED, "its rows are not in time order; 1 row moved to where the time fits"),
        (REPEATED, "20 rows repeated from elsewhere in the file, each taken once"),
    ],
    ids=["swapped", "displaced", "repeated"],
)
def test_og1_rows_in_another_order_are_sorted_with_a_remark(tmp_path, rows, words, changes):
    summary = import_og1([rearranged(tmp_path / "sg099.nc", rows, **changes)], tmp_path / "out.nc")
    assert [remark for remark in summary.remarks if "row" in remark] == [f"sg099.nc: {words}"]
    assert_equal_to_usual(tmp_path, summary, **changes)


def test_an_og1_clock_set_back_is_not_sorted(tmp_path):
    time = np.concatenate([made.og1_rows(dive)["TIME"] for dive in (1, 2, 3)])
    time[ROWS + 60 :] -= 405.0
    path = made.write_og1(tmp_path / "sg099.nc", (1, 2, 3), TIME=time)
    summary = import_og1([path], tmp_path / "out.nc")
    assert "the clock was set back by" in summary.rejected["dive 2"]
    assert not any("in time order" in remark for remark in summary.remarks)


def test_og1_dives_that_were_counted_in_the_order_of_the_file_are_not_sorted(tmp_path):
    """A clock that was wrong for the second of four dives gives times just after the last one."""
    time = np.concatenate([made.og1_rows(dive)["TIME"] for dive in (1, 2, 3, 4)])
    time[ROWS : 2 * ROWS] += 3.0 * 3600.0
    summary = import_og1([made.write_og1(tmp_path / "sg099.nc", (1, 2, 3, 4), TIME=time)], tmp_path / "out.nc")
    assert [profile.number for profile in summary.complete] == [1, 3, 4]
    assert "the clock was wrong" in summary.rejected["dive 2"]
    assert not any("in time order" in remark for remark in summary.remarks)


# Slocum


def test_slocum_rows_given_twice_are_taken_once_with_a_warning(tmp_path, caplog):
    """Consecutive parts of a file that overlap within a dive."""
    flown, sampled = joined([flight(0), flight(1), flight(2)]), joined([science(0), science(1), science(2)])
    whole = import_slocum([write_netcdf(tmp_path / "whole.nc", flown, sampled)], tmp_path / "expected.nc")
    assert not caplog.text
    twice = []
    for columns in (flown, sampled):
        half = len(next(iter(columns.values()))) // 2
        twice.append({name: np.concatenate([values[:half], values[half - 200 :]]) for name, values in columns.items()})
    summary = import_slocum([write_netcdf(tmp_path / "twice.nc", *twice)], tmp_path / "out.nc")
    assert caplog.text.count("200 rows repeated from elsewhere in the file, each taken once") == 2
    assert (len(summary.complete), summary.rejected) == (len(whole.complete), {})
    with xr.open_dataset(tmp_path / "expected.nc") as expected, xr.open_dataset(tmp_path / "out.nc") as found:
        for name in expected.variables:
            np.testing.assert_array_equal(found[name].values, expected[name].values)


def test_slocum_rows_of_equal_times_that_differ_are_left_to_the_clock(tmp_path):
    flown = joined([flight(0), flight(1), flight(2)])
    half = len(flown["m_depth"]) // 2
    twice = {name: np.concatenate([values[:half], values[half - 200 :]]) for name, values in flown.items()}
    twice["m_depth"][half:] += 0.5
    summary = import_slocum([write_netcdf(tmp_path / "twice.nc", twice)], tmp_path / "out.nc")
    assert any("the clock was set back by" in why for why in summary.rejected.values())


# A real mission


def test_sg033_with_its_parts_exchanged(shared_data, tmp_path):
    """The record has a pause of 16 hours elsewhere, and rows of one time."""
    (path,) = (shared_data / "seaglider-sg033-og1-2010").glob("*.nc")
    import_og1([path], tmp_path / "expected.nc")
    with xr.open_dataset(path, decode_times=False) as dataset:
        stored = dataset.load()
    rows = np.roll(np.arange(stored.sizes["N_MEASUREMENTS"]), 4000)
    stored.isel(N_MEASUREMENTS=rows).to_netcdf(tmp_path / "exchanged.nc")
    summary = import_og1([tmp_path / "exchanged.nc"], tmp_path / "out.nc")
    assert [profile.number for profile in summary.complete] == list(range(1, 20))
    with xr.open_dataset(tmp_path / "expected.nc") as expected, xr.open_dataset(tmp_path / "out.nc") as found:
        for name in expected.variables:
            np.testing.assert_array_equal(found[name].values, expected[name].values)
