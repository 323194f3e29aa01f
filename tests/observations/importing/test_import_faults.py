"""Damaged records and clock faults: only the affected part is lost, with a line that gives the reason."""

import gzip
import os
import sys
from pathlib import Path

import netCDF4
import numpy as np
import pytest
import xarray as xr
from support import seaglider_files as made
from support.missions import program
from support.seaexplorer_files import edit, shift_rows, write_mission
from support.slocum_files import AFLOAT, DIVE, INTERVAL, binary, flight, joined, write_binary, write_netcdf

from gliderhpc.cli.records import profile_table, summary_lines
from gliderhpc.errors import InputError
from gliderhpc.observations import open_observations
from gliderhpc.observations.importing.clock_steps import find_clock_steps, times_by_two_clocks
from gliderhpc.observations.importing.rows import increasing
from gliderhpc.observations.importing.workflow import ImportedProfile, ImportSummary
from gliderhpc.observations.instruments import slocum_binary
from gliderhpc.observations.instruments.og1 import import_og1
from gliderhpc.observations.instruments.seaexplorer import import_seaexplorer
from gliderhpc.observations.instruments.seaglider import import_seaglider
from gliderhpc.observations.instruments.slocum import import_slocum


def minutes(*values):
    return np.datetime64("2024-05-01T12:00", "ns") + np.array(values) * np.timedelta64(60, "s")


# Clocks


def test_a_clock_set_back_is_found_with_what_it_costs():
    time = minutes(0, 1, 2, 3, -57, -56, 4, 5)
    depth = np.array([0.0, 1.0, 9.0, 9.0, 30.0, 20.0, 9.0, 1.0])
    (step,) = find_clock_steps(time, increasing(time), depth)
    assert (step.place, step.seconds, step.submerged) == (4, 3600.0, True)
    assert find_clock_steps(minutes(0, 1, 2), np.ones(3, bool), np.zeros(3)) == []


def test_pieces_in_another_order_are_no_clock_set_back():
    assert times_by_two_clocks(minutes(10, 11, 12, 0, 1, 2)) == []
    assert times_by_two_clocks(minutes(0, 10, 20, 5, 15, 25)) == [(minutes(5)[0], minutes(20)[0])]


def test_a_seaexplorer_clock_set_back_within_a_dive_costs_that_dive(tmp_path):
    """Otherwise the dive without its beginning was inverted, with a wrong current."""
    folder = write_mission(tmp_path / "m")
    for cycle, first in ((6, 60), (7, 1), (8, 1)):
        shift_rows(folder, cycle, first, -1)
    answer = program("import", "seaexplorer", folder, tmp_path / "out.nc")
    assert answer.status == 1
    assert "cycle 6: left out: the clock was set back by" in answer.out
    with open_observations(tmp_path / "out.nc") as observations:
        assert 6 not in observations.profile_numbers


def test_a_seaglider_clock_set_back_costs_that_dive(tmp_path):
    for dive in (1, 2, 3):
        time = made.clock(dive)
        if dive == 2:
            time[60:] -= 400.0
        made.write_dive(tmp_path / "m", dive, columns=True, time=time)
    summary = import_seaglider([tmp_path / "m"], tmp_path / "out.nc")
    assert "the clock was set back by 390 s during the dive" in summary.rejected["dive 2"]
    assert [profile.number for profile in summary.profiles] == [1, 3]


def test_a_dive_that_begins_before_the_last_one_ended_is_left_out(tmp_path):
    for dive in (1, 2, 3):
        made.write_dive(tmp_path / "m", dive, columns=True, time=made.clock(dive) - 3000.0 * (dive == 2))
    summary = import_seaglider([tmp_path / "m"], tmp_path / "out.nc")
    assert "the clock was set back by" in summary.rejected["dive 2"]
    assert [profile.number for profile in summary.profiles] == [1, 3]


def test_a_slocum_clock_set_back_costs_the_profiles_of_both_clocks(tmp_path):
    flown = joined([flight(0), flight(1), flight(2)])
    flown["m_present_time"][2 * (2 * AFLOAT + 2 * DIVE) - 200 :] -= 100 * INTERVAL
    summary = import_slocum([write_netcdf(tmp_path / "glider.nc", flown)], tmp_path / "out.nc")
    assert "the clock was set back by" in summary.rejected["profile 2"]
    assert len(summary.profiles) == 2


# SeaExplorer


@pytest.mark.parametrize("year", [1600, 1677, 2263, 9999])
def test_years_that_nanoseconds_do_not_reach_are_dropped(tmp_path, year):
    """They used to be read as 2185 and 1815."""
    folder = write_mission(tmp_path / "m")

    def change(lines):
        day, month, rest = lines[20].split("/", 2)
        lines[20] = f"{day}/{month}/{year}{rest[4:]}"

    edit(folder, 6, change)
    summary = import_seaexplorer([folder], tmp_path / "out.nc")
    assert summary.rows_dropped == {"clock not set": 1}
    assert len(summary.profiles) == 3


def test_a_mission_of_impossible_years_is_refused(tmp_path):
    folder = write_mission(tmp_path / "m")
    for path in folder.iterdir():
        path.write_text(path.read_text().replace("/20", "/16"))
    with pytest.raises(InputError, match=r"no usable navigation row .*clock not set"):
        import_seaexplorer([folder], tmp_path / "out.nc")


def test_a_byte_order_mark_is_no_part_of_the_first_column(tmp_path):
    folder = write_mission(tmp_path / "m")
    plain = import_seaexplorer([folder], tmp_path / "plain.nc")
    for path in folder.iterdir():
        path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    marked = import_seaexplorer([folder], tmp_path / "marked.nc")
    assert (marked.rows, marked.rejected) == (plain.rows, {})


def test_a_broken_gzip_block_costs_its_cycle(tmp_path):
    folder = write_mission(tmp_path / "m")
    path = folder / "sea099.3.gli.sub.6"
    packed = bytearray(gzip.compress(path.read_bytes(), mtime=0))
    packed[len(packed) // 2] ^= 0xFF
    path.unlink()
    path.with_name(f"{path.name}.gz").write_bytes(packed)
    summary = import_seaexplorer([folder], tmp_path / "out.nc")
    assert "cannot be read" in summary.rejected["cycle 6"]


@pytest.mark.parametrize(
    ("verb", "name"),
    [
        ("seaexplorer", "sea099.3.gli.sub.9"),
        ("seaglider", "p0990009.nc"),
        ("og1", "x.nc"),
        ("slocum", "a-2015-1-0-9.dbd"),
    ],
)
def test_a_pipe_named_like_a_record_is_not_waited_for(tmp_path, verb, name):
    os.mkfifo(tmp_path / name)
    for source in (tmp_path, tmp_path / name):
        answer = program("import", verb, source, tmp_path / "out.nc")
        assert answer.status == 2
        assert answer.line.startswith("gliderhpc: ")


# netCDF


def overwrite_variable(path: Path, name: str, *, values=None, **attributes) -> None:
    with netCDF4.Dataset(path, "a") as file:
        if values is not None:
            file[name][:] = values
        file[name].setncatts(attributes)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"log_gps_lat": "sg_data_point"}, "they must have the same length"),
        ({"eng_pitchAng": "gps_info"}, "not sampled with time"),
        ({"time": np.full(132, np.inf)}, "none of its 132 times is in the years"),
        ({"time": np.full(132, 1e300)}, "none of its 132 times is in the years"),
        ({"log_D_FLARE": 9.96921e36, "log_D_SURF": 1e9}, "a dive begins below"),
        ({"eng_head": np.full(132, np.inf)}, "has no sample of heading"),
    ],
    ids=["fixes", "short", "infinite", "huge", "flare", "heading"],
)
def test_a_dive_with_an_unusable_variable_does_not_exclude_the_others(tmp_path, change, words):
    folder = tmp_path / "m"
    along = {name: value for name, value in change.items() if isinstance(value, str)}
    path = made.write_dive(folder, 1, columns=True, **(dict.fromkeys(along) if along else change))
    made.write_dive(folder, 2, columns=True)
    with netCDF4.Dataset(path, "a") as file:
        for name, dimension in along.items():
            made.put(file, name, dimension, np.ones(file.dimensions[dimension].size), "degree")
    summary = import_seaglider([folder], tmp_path / "out.nc")
    assert [profile.number for profile in summary.profiles] == [2]
    assert words in (summary.rejected | summary.without_profile)["dive 1"]


def test_attributes_that_are_no_utf8_are_read(tmp_path):
    path = made.write_og1(tmp_path / "sg099.nc")
    with netCDF4.Dataset(path, "a") as file:
        file["HEADING"].setncattr("comment", b"cap magn\xe9tique")
    summary = import_og1([path], tmp_path / "out.nc", declination=1.0)
    assert len(summary.profiles) == 2


@pytest.mark.parametrize("fill", [9.96921e36, -2147483647.0])
def test_fill_values_are_no_numbers_of_dives(tmp_path, fill):
    path = made.write_og1(tmp_path / "sg099.nc")
    with netCDF4.Dataset(path, "a") as file:
        numbers = file["divenum"][:].filled(0.0)
        numbers[:5] = fill
        file["divenum"][:] = numbers
    assert [profile.number for profile in import_og1([path], tmp_path / "out.nc").profiles] == [1, 2]


def test_a_zone_by_name_costs_the_dive(tmp_path):
    made.write_dive(tmp_path / "m", 2, columns=True)
    path = made.write_dive(tmp_path / "m", 1, columns=True)
    overwrite_variable(path, "time", units="seconds since 1970-01-01 00:00:00 EST")
    summary = import_seaglider([tmp_path / "m"], tmp_path / "out.nc")
    assert "'EST' is not a readable time zone" in summary.rejected["dive 1"]


# Slocum's binary files


@pytest.fixture
def dbd(tmp_path):
    """One binary file."""
    pytest.importorskip("dbdreader")
    name = "ammonite-2015-175-0-0"
    folder = tmp_path / "card"
    folder.mkdir()
    return write_binary(folder / f"{name}.dbd", flight(), name=name)


@pytest.mark.parametrize("crc", ["../escaped", "/tmp/escaped", "zzzzzzzz", "0123456789", "..%2f"])
def test_a_header_cannot_name_a_file_elsewhere(dbd, tmp_path, crc):
    before = sorted(tmp_path.rglob("*"))
    dbd.write_bytes(binary(flight(), name=dbd.stem).replace(b"0BADCAFE", crc.encode()))
    with pytest.raises(InputError, match="its sensor_list_crc is not a hexadecimal checksum"):
        import_slocum([dbd], tmp_path / "out.nc")
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (b"state_bytes_per_cycle:    4", b"state_bytes_per_cycle:    9"),
        (b"sensors_per_cycle:    13", b"sensors_per_cycle:    99"),
        (b"total_num_sensors:    13", b"total_num_sensors:    99999999999999999999999"),
        (b"s: T 3 3 4 ", b"s: T 3 3 7 "),
        (b"s: T 3 3 4 ", b"s: T 3 9999 4 "),
    ],
)
def test_a_header_that_contradicts_itself_is_refused(dbd, tmp_path, old, new):
    content = dbd.read_bytes()
    assert content.count(old) == 1
    dbd.write_bytes(content.replace(old, new))
    with pytest.raises(InputError, match=r"damaged|truncated"):
        import_slocum([dbd], tmp_path / "out.nc")


CRASH = "import os, signal, sys\nsys.stdin.readline()\nos.kill(os.getpid(), signal.SIGSEGV)\n"
SILENCE = "import sys, time\nsys.stdin.readline()\ntime.sleep(60)\n"


@pytest.mark.parametrize(("script", "words"), [(CRASH, "dbdreader ended by signal SIGSEGV"), (SILENCE, "within 1 s")])
def test_a_library_that_dies_is_one_line(dbd, tmp_path, monkeypatch, script, words):
    """Compiled code that trusts a file can crash its process, which must not be ours."""
    stand = tmp_path / "script.py"
    stand.write_text(script)
    monkeypatch.setattr(slocum_binary, "_SCRIPT", stand)
    monkeypatch.setattr(slocum_binary, "READ_TIMEOUT", 1.0 if script is SILENCE else 60.0)
    answer = program("import", "slocum", dbd, tmp_path / "out.nc")
    assert answer.status == 2
    assert words in answer.line
    assert f"{dbd}: cannot be read" in answer.line


def test_noise_in_a_binary_file_ends_in_a_line_or_in_rows(dbd, tmp_path):
    content, generator = dbd.read_bytes(), np.random.default_rng(5)
    good = dbd.with_name("ammonite-2015-175-0-1.dbd")
    good.write_bytes(binary(flight(1), name=good.stem))
    for number in range(8):
        damaged = bytearray(content)
        for place in generator.integers(0, len(content), 20).tolist():
            damaged[place] = int(generator.integers(256))
        dbd.write_bytes(damaged)
        summary = import_slocum([dbd.parent], tmp_path / f"{number}.nc")
        assert len(summary.complete) >= 1
    with xr.open_dataset(tmp_path / "0.nc") as dataset:
        assert dataset.sizes["time"] >= len(flight(1)["m_depth"]) - 1
    assert "dbdreader" in sys.modules


# Files that are not divided by profiles, as in docs/how-to/instrument.md


def test_a_summary_without_pieces_by_profile_is_printed():
    start = np.datetime64("2024-05-01T12:00", "ns")
    profiles = (ImportedProfile(1, (), start, 600.0, 601, 60.0, None),)
    plain = profile_table("m", "files", profiles)
    assert [column.header for column in plain.columns][:2] == ["profile", "start"]
    assert [column.header for column in profile_table("m", "dives", ()).columns][:2] == ["profile", "start"]
    several = profile_table("m", "cycles", (*profiles, ImportedProfile(2, (4, 5, 7), start, 600.0, 601, 60.0, "bad")))
    assert list(several.columns[1].cells) == ["", "4-7"]
    summary = ImportSummary(
        path=Path("out.nc"), vehicle="v", mission="m", pieces="files", profiles=profiles, without_profile={},
        rejected={"flight2.csv": "no depth"}, remarks=(), sample_interval=1.0, fixes=2, fixes_dropped=0, rows=601,
        ctd_samples=0, rows_dropped={},
    )  # fmt: skip
    assert summary_lines(summary)[-1] == "1 profile, 1 complete, written to out.nc; 1 file left out"


def test_a_name_of_another_format_is_refused_before_the_import(tmp_path):
    with pytest.raises(InputError, match=r"out.csv: is written as netCDF, which .csv is not; give a name that ends in"):
        import_og1([made.write_og1(tmp_path / "og1.nc")], tmp_path / "out.csv")
