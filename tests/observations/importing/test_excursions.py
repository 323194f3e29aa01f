"""Clocks that were wrong for a while: a damaged time loses its row; a file with wrong times is skipped alone."""

import re
import shutil

import netCDF4
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support import seaglider_files as made
from support.missions import program
from support.seaexplorer_files import DIVE, edit, shift_rows, write_mission
from support.slocum_files import flight, joined, write_netcdf

from gliderhpc.observations.importing.clock_steps import find_clock_steps
from gliderhpc.observations.importing.excursions import find_excursions, find_lost
from gliderhpc.observations.importing.rows import increasing
from gliderhpc.observations.instruments.og1 import import_og1
from gliderhpc.observations.instruments.seaexplorer import import_seaexplorer
from gliderhpc.observations.instruments.seaglider import import_seaglider
from gliderhpc.observations.instruments.slocum import import_slocum

DAY = 86_400.0
DECADE = 3652.0 * DAY


def minutes(*values):
    return np.datetime64("2024-05-01T12:00", "ns") + np.array(values) * np.timedelta64(60, "s")


@pytest.mark.parametrize(
    ("values", "wrong"),
    [
        ((0, 1, 2, 3, 4), []),
        ((0, 1, 9000, 3, 4), [2]),
        ((0, 1, -9000, 3, 4), [2]),
        ((9000, 1, 2, 3, 4), [0]),
        ((0, 1, 9000, 8000, 4, 5), [2, 3]),
        ((0, 1, 2, 1441, 1442, 1443, 6, 7, 8), [3, 4, 5]),
        ((0, 1, 20, 21, 22, 10), []),
        ((0, 1, 2, -1441, -1440, -1439, 6, 7), [3, 4, 5]),
        ((0, 1, 2, 5, 6, 7, 8, 9, 7, 8, 9, 10, 11, 12, 13, 14, 15), []),
        ((0, 1, 2, 33, 34, 35, 36, *range(7, 50)), [3, 4, 5, 6]),
        ((*range(40), *range(10, 40), *range(70, 90)), list(range(40, 70))),
        ((*range(40), *range(85, 145), *range(100, 140)), list(range(40, 100))),
    ],
    ids=["none", "ahead", "behind", "first", "two", "a day ahead", "last behind", "a day behind", "set back",
         "ahead of few", "overlapping behind", "overlapping ahead"],
)  # fmt: skip
def test_excursions_are_the_rows_that_fit_between_their_neighbours(values, wrong):
    time = minutes(*values)
    found = np.zeros(len(time), dtype=bool)
    for excursion in find_excursions(time):
        found[excursion.start : excursion.stop] = True
    np.testing.assert_array_equal(np.flatnonzero(found), wrong)


def test_a_clock_set_back_for_good_is_no_excursion():
    time = minutes(*range(100), *range(40, 200))
    assert find_excursions(time) == []
    assert np.count_nonzero(increasing(time)) == 200


def test_a_record_given_twice_is_no_excursion():
    time = minutes(*range(50), *range(50), *range(50, 70))
    assert find_excursions(time) == []
    part = np.repeat([1, 2, 3], [50, 50, 20])
    lost = find_lost(time, part, np.full(120, 50.0), increasing(time))
    assert list(lost) == [2]
    assert "or the record is given twice" in lost[2]


def test_an_excursion_costs_the_parts_that_lose_more_than_a_minute_of_a_dive():
    time = minutes(0, 1, 2, 1441, 1442, 1443, 6, 7, 8)
    depth = np.array([2.0, 9.0, 9.0, 9.0, 9.0, 9.0, 9.0, 9.0, 9.0])
    part = np.array([1, 1, 1, 2, 2, 3, 3, 3, 3])
    keep = increasing(time)
    assert list(find_lost(time, part, depth, keep)) == [2, 3]
    assert list(find_lost(time, part, np.ones(9), keep)) == [2]
    assert "follow 2024-05-01T12:02:00 and precede 2024-05-01T12:06:00" in find_lost(time, part, depth, keep)[2]
    assert find_clock_steps(time, keep, depth) == []


@given(st.lists(st.integers(0, 40), max_size=60))
def test_any_times_end_in_increasing_ones(values):
    time = minutes(*(2.0 * value for value in values)) if values else minutes()
    chosen = time[increasing(time)]
    assert np.all(np.diff(chosen) > np.timedelta64(0))
    assert len(chosen) > 0 or not values


# SeaExplorer


@pytest.mark.parametrize("hours", [24, -24, 8, -8, 1])
def test_a_seaexplorer_file_with_wrong_times_costs_its_cycle(tmp_path, hours):
    """The later cycles were lost, with the reason that their files were missing."""
    folder = write_mission(tmp_path / "m")
    shift_rows(folder, 6, 1, hours)
    answer = program("import", "seaexplorer", folder, tmp_path / "out.nc")
    assert answer.status == 1
    assert "cycle 6: left out:" in answer.out
    assert "sea099.3.gli.sub.6: the clock was wrong: times from 2023-07-" in answer.out
    assert "2 profiles, 2 complete" in answer.out
    summary = import_seaexplorer([folder], tmp_path / "out.nc", overwrite=True)
    assert [profile.number for profile in summary.complete] == [5, 7]
    assert list(summary.rejected) == ["cycle 6"]
    assert summary.without_profile == {"cycle 8": "only a surface record"}


@pytest.mark.parametrize("span", [(60, None), (1, 60), (60, 90), (110, None)])
@pytest.mark.parametrize("hours", [24, 48, 5, -48])
def test_wrong_times_within_a_seaexplorer_dive_cost_its_cycle(tmp_path, span, hours):
    """If most of the file was right, the dive was cut short without a line."""
    folder = write_mission(tmp_path / "m")
    shift_rows(folder, 6, span[0], hours, span[1])
    summary = import_seaexplorer([folder], tmp_path / "out.nc")
    assert [profile.number for profile in summary.complete] == [5, 7]
    assert list(summary.rejected) == ["cycle 6"]


@pytest.mark.parametrize("year", ["2033", "2022"])
def test_a_row_of_a_wrong_year_costs_that_row(tmp_path, year):
    """All rows before it were dropped, as made before the clock was set."""
    folder = write_mission(tmp_path / "m")

    def change(lines):
        lines[100] = lines[100].replace("/2023 ", f"/{year} ")

    edit(folder, 6, change)
    summary = import_seaexplorer([folder], tmp_path / "out.nc")
    assert summary.rows_dropped == {"time not increasing": 1}
    assert [(profile.number, profile.samples) for profile in summary.complete] == [
        (5, 2 * DIVE + 2), (6, 2 * DIVE + 1), (7, 2 * DIVE + 2)
    ]  # fmt: skip


def test_a_payload_file_with_wrong_times_costs_its_own_data(shared_data, tmp_path):
    folder = shutil.copytree(shared_data / "seaexplorer-sea035-M012", tmp_path / "m", copy_function=shutil.copyfile)
    for kind in ("gli", "pld1"):
        path = folder / f"sea035.12.{kind}.sub.39"
        path.write_text(path.read_text().replace("22/07/2019", "23/07/2019"))
    summary = import_seaexplorer([folder], tmp_path / "out.nc")
    assert [profile.number for profile in summary.complete] == [37, 38, *range(40, 48)]
    assert list(summary.rejected) == ["cycle 39"]
    assert summary.ctd_samples > 5000
    assert [remark.split(": ")[0] for remark in summary.remarks] == ["cycle 39", "cycle 39"]


# Seaglider and OG1


@pytest.mark.parametrize("shift", [DAY, -DAY])
def test_a_seaglider_file_with_wrong_times_costs_that_dive(tmp_path, shift):
    """The dives after it were lost without a line."""
    for dive in range(1, 7):
        made.write_dive(tmp_path / "m", dive, columns=True, time=made.clock(dive) + shift * (dive == 3))
    summary = import_seaglider([tmp_path / "m"], tmp_path / "out.nc")
    assert [profile.number for profile in summary.complete] == [1, 2, 4, 5, 6]
    assert list(summary.rejected) == ["dive 3"]
    assert "p0990003.nc: the clock was wrong" in summary.rejected["dive 3"]
    assert summary.rows_dropped == {}


def test_a_seaglider_file_whose_times_have_another_epoch_is_named_by_them(tmp_path):
    """Its times count from 2000 but are declared from 1970; "has no depth" was reported."""
    for dive in range(1, 4):
        made.write_dive(tmp_path / "m", dive, columns=True, time=made.clock(dive) - 946_684_800.0 * (dive == 2))
    summary = import_seaglider([tmp_path / "m"], tmp_path / "out.nc")
    assert [profile.number for profile in summary.complete] == [1, 3]
    assert re.search(
        r"p0990002\.nc: none of its \d+ times is in the years 2000 to 2099: time is in 'seconds since 1970.*'; correct",
        summary.rejected["dive 2"],
    )


def test_every_dive_without_a_profile_is_named(tmp_path):
    for dive in range(1, 5):
        copied = 2 if dive == 3 else dive
        made.write_dive(tmp_path / "m", dive, columns=True, time=made.clock(copied))
    summary = import_seaglider([tmp_path / "m"], tmp_path / "out.nc")
    assert [profile.number for profile in summary.complete] == [1, 2, 4]
    assert "p0990003.nc: the clock was wrong" in summary.rejected["dive 3"]


@pytest.mark.parametrize("shift", [DECADE, -DECADE, 7200.0])
def test_a_damaged_time_in_a_seaglider_dive_costs_that_row(tmp_path, shift):
    time = made.clock(2)
    time[60] += shift
    for dive in (1, 2, 3):
        made.write_dive(tmp_path / "m", dive, columns=True, time=time if dive == 2 else made.clock(dive))
    summary = import_seaglider([tmp_path / "m"], tmp_path / "out.nc")
    assert [profile.number for profile in summary.complete] == [1, 2, 3]
    assert (summary.rows_dropped, summary.rejected) == ({"time not increasing": 1}, {})


def og1_with_times(path, change):
    """A file of three dives; `change` alters its times, given with the numbers of the dives."""
    made.write_og1(path, (1, 2, 3))
    with netCDF4.Dataset(path, "a") as file:
        time = file["TIME"][:].filled(np.nan)
        change(time, file["divenum"][:].filled(-1.0))
        file["TIME"][:] = time
    return path


@pytest.mark.parametrize("row", [0, 40])
def test_a_damaged_time_in_an_og1_file_costs_that_row(tmp_path, row):
    def damage(time, numbers):
        attitude = np.flatnonzero(numbers == 2)
        time[0 if row == 0 else attitude[row]] += DECADE

    summary = import_og1([og1_with_times(tmp_path / "a.nc", damage)], tmp_path / "out.nc", declination=0.0)
    assert [profile.number for profile in summary.complete] == [1, 2, 3]
    assert sum(summary.rows_dropped.values()) <= 1
    assert summary.rejected == {}


def test_a_dive_with_wrong_times_in_an_og1_file_is_left_out(tmp_path):
    def shift(time, numbers):
        time[numbers == 2] += DAY

    summary = import_og1([og1_with_times(tmp_path / "a.nc", shift)], tmp_path / "out.nc", declination=0.0)
    assert [profile.number for profile in summary.complete] == [1, 3]
    assert list(summary.rejected) == ["dive 2"]
    assert "a.nc: the clock was wrong" in summary.rejected["dive 2"]


def test_a_damaged_time_in_the_real_og1_file_costs_that_row(shared_data, tmp_path):
    """Twelve of nineteen dives were lost, with exit status 0."""
    name = "sg033_20100903T182416_delayed.nc"
    path = shutil.copyfile(shared_data / "seaglider-sg033-og1-2010" / name, tmp_path / name)
    with netCDF4.Dataset(path, "a") as file:
        file["TIME"][3000] += DECADE
    summary = import_og1([path], tmp_path / "out.nc")
    assert len(summary.complete) == 19
    assert (summary.rows, summary.rows_dropped) == (10885, {"time not increasing": 1})


# Slocum


def test_a_damaged_time_in_a_slocum_record_costs_that_row(tmp_path):
    flown = joined([flight(0), flight(1), flight(2)])
    plain = import_slocum([write_netcdf(tmp_path / "plain.nc", flown)], tmp_path / "out.nc")
    flown["m_present_time"][300] += DECADE
    summary = import_slocum([write_netcdf(tmp_path / "glider.nc", flown)], tmp_path / "out2.nc")
    assert len(summary.complete) == len(plain.complete)
    assert summary.rejected == {}
    assert summary.rows == plain.rows - 1
