"""SeaExplorer records into the observation format."""

import gzip
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from click.testing import CliRunner
from support.seaexplorer_files import DIVE, NAVIGATION, PAYLOAD, START, SURFACE, edit, row, stamp, write_mission

from gliderhpc.cli.records import import_
from gliderhpc.errors import InputError
from gliderhpc.observations import open_observations
from gliderhpc.observations.fixes import decimal_degrees
from gliderhpc.observations.importing.rows import Rows
from gliderhpc.observations.instruments.seaexplorer import find_fixes, import_seaexplorer
from gliderhpc.observations.instruments.seaexplorer_legs import TRANSMITTING
from gliderhpc.observations.nearest import onto_nearest


def test_profiles_run_from_leaving_the_surface_to_the_surfacing_manoeuvre(tmp_path):
    summary = import_seaexplorer([write_mission(tmp_path / "m")], tmp_path / "out.nc")
    assert (summary.vehicle, summary.mission) == ("SEA099", "SEA099-M3")
    assert [profile.number for profile in summary.complete] == [5, 6, 7]
    assert summary.without_profile == {"cycle 8": "only a surface record"}
    assert summary.remarks == ("cycles 5-8: no payload file, so no CTD data",)
    assert summary.sample_interval == 20.0
    assert summary.rows_dropped == {}
    assert [round(profile.max_depth) for profile in summary.profiles] == [100, 101, 102]
    with open_observations(tmp_path / "out.nc") as observations:
        assert observations.faults == {}
        record = observations.profile(6)
    # One submerged row of leaving the surface, dive, climb, and the row of climb at the beginning of the next file.
    assert len(record.depth) == 1 + 2 * DIVE + 1
    assert record.depth[0] == pytest.approx(4.0)
    assert record.depth[-1] == pytest.approx(9.5)


def test_the_surfacing_manoeuvre_on_request(tmp_path):
    import_seaexplorer([write_mission(tmp_path / "m")], tmp_path / "out.nc", include_surfacing=True)
    with open_observations(tmp_path / "out.nc") as observations:
        assert observations.sample_count(6) == 1 + 2 * DIVE + 1 + 3


def test_a_yo_below_the_surface_continues_its_profile(tmp_path):
    folder = write_mission(tmp_path / "m", surfaces=(True, False, True))
    summary = import_seaexplorer([folder], tmp_path / "out.nc")
    assert [(profile.number, profile.parts) for profile in summary.profiles] == [(5, (5, 6)), (7, (7,))]
    assert summary.without_profile == {"cycle 8": "only a surface record"}


def test_units_and_signs(tmp_path):
    import_seaexplorer([write_mission(tmp_path / "m")], tmp_path / "out.nc", linear_scale=1e-3, linear_zero=63.0)
    with open_observations(tmp_path / "out.nc") as observations:
        record = observations.profile(6)
    np.testing.assert_allclose(np.degrees(record.heading), 6.0)
    np.testing.assert_allclose(record.battery_position, 0.010)
    np.testing.assert_allclose(np.degrees(record.battery_rotation), -3.6)
    np.testing.assert_allclose(record.ballast_volume, -250.5e-6)
    with xr.open_dataset(tmp_path / "out.nc") as dataset:
        assert dataset.attrs["battery_position_scale"] == 1e-3
        assert dataset.attrs["battery_position_zero"] == 63.0
        assert "declination" in dataset.attrs["heading_comment"]
        assert dataset.attrs["ctd_comment"] == "none"
        assert dataset.attrs["mission"] == "SEA099-M3"
        assert dataset["time"].values[0] == START.astype("datetime64[ns]")


def test_fixes_are_the_refreshed_positions(tmp_path):
    summary = import_seaexplorer([write_mission(tmp_path / "m")], tmp_path / "out.nc")
    assert summary.fixes == 4 * (SURFACE - 1)
    with open_observations(tmp_path / "out.nc") as observations:
        record = observations.profile(6)
    assert len(record.surface_fixes_before) == len(record.surface_fixes_after) == SURFACE - 1
    assert record.exit_fix.latitude == pytest.approx(48.0 + 32.001 / 60.0)
    assert record.exit_fix.longitude == pytest.approx(-123.5)
    # Climb's last row, three of the manoeuvre and the stale one stand before the first refreshed position.
    assert record.exit_fix.time - (record.epoch + np.timedelta64(int(record.time[-1]), "s")) == np.timedelta64(100, "s")


def test_a_position_logged_before_a_pause_has_the_time_of_its_end(tmp_path):
    folder = write_mission(tmp_path / "m")
    last_fix = 1 + 1 + 3 + SURFACE - 1

    def pause(lines):
        for index in range(last_fix + 1, len(lines)):
            fields = lines[index].split(";")
            lines[index] = ";".join([stamp(START + np.timedelta64(20 * (index - 1) + 300, "s")), *fields[1:]])

    edit(folder, 5, pause)
    for cycle in (6, 7, 8):
        (folder / f"sea099.3.gli.sub.{cycle}").unlink()
    import_seaexplorer([folder], tmp_path / "out.nc")
    with open_observations(tmp_path / "out.nc") as observations:
        entry = observations.profile(5).entry_fix
    assert entry.time == START + np.timedelta64(20 * last_fix + 300, "s")


def navigation(seconds, latitudes, longitudes, state=TRANSMITTING):
    """Navigation rows at some seconds, their positions in degrees and minutes (DDMM.mmm)."""
    count = len(seconds)
    columns = {"NavState": np.full(count, float(state)), "Lat": np.array(latitudes), "Lon": np.array(longitudes)}
    return Rows(START + np.array(seconds) * np.timedelta64(1, "s"), np.zeros(count, np.int64), columns)


def test_a_fix_may_lie_on_the_equator_but_not_at_null_island():
    """Both zero means that the receiver has no position; one missing means the same."""
    latitudes = [0.03, 0.0, 0.0, 0.02, np.nan, 0.02, 0.03]
    longitudes = [0.03, 0.0, 0.02, 0.0, 0.01, np.nan, 0.01]
    found = find_fixes(navigation(20 * np.arange(7), latitudes, longitudes))
    np.testing.assert_array_equal(60.0 * found.latitude, [0.0, 0.02, 0.03])
    np.testing.assert_array_equal(60.0 * found.longitude, [0.02, 0.0, 0.01])


@pytest.mark.parametrize(("pause", "taken"), [(30, [20, 40, 70, 90]), (31, [20, 71, 91])])
def test_a_position_before_a_pause_is_of_its_end(pause, taken):
    """The row after the pause has its own fix at that time, which is retained."""
    seconds = np.cumsum([0, 20, 20, pause, 20])
    found = find_fixes(navigation(seconds, [4830.0, 4830.01, 4830.02, 4830.03, 4830.04], np.full(5, -12330.0)))
    np.testing.assert_array_equal((found.time - START) / np.timedelta64(1, "s"), taken)
    own = {20: 30.01, 40: 30.02, 70: 30.03, 71: 30.03, 90: 30.04, 91: 30.04}
    np.testing.assert_allclose(60.0 * (found.latitude - 48.0), [own[second] for second in taken])


def test_no_fix_under_way_or_of_no_rows():
    assert len(find_fixes(navigation([0, 20], [4830.0, 4830.01], [-12330.0, -12330.0], state=117)).time) == 0
    assert len(find_fixes(navigation([], [], [])).time) == 0


def test_a_position_kilometres_off_is_no_fix(tmp_path):
    folder = write_mission(tmp_path / "m")

    def jump(lines):
        first_fix = 1 + 1 + 3 + 1
        lines[first_fix] = lines[first_fix].replace("4832.001", "4834.001")

    edit(folder, 7, jump)
    summary = import_seaexplorer([folder], tmp_path / "out.nc")
    assert summary.fixes_dropped == 1
    with open_observations(tmp_path / "out.nc") as observations:
        assert observations.profile(6).exit_fix.latitude == pytest.approx(48.0 + 32.002 / 60.0)


def test_junk_rows_are_dropped_and_counted(tmp_path):
    folder = write_mission(tmp_path / "m")

    def corrupt(lines):
        reset = START - np.timedelta64(365, "D")
        lines[1:1] = [row(reset, 116, 1.0), row(reset + np.timedelta64(20, "s"), 116, 1.0)]
        lines[40] = lines[40].rsplit(";", 4)[0]
        lines[45] = lines[45].replace(";350.0;", ";abc;")
        lines[46] = lines[46].replace(";350.0;", ";720;")
        lines[47] = lines[46].replace(";720;", ";10;")
        lines[50] = lines[49]
        lines[52] = lines[52].replace("05/07/2023", "05.07.2023")

    edit(folder, 5, corrupt)
    summary = import_seaexplorer([folder], tmp_path / "out.nc")
    assert summary.rows_dropped == {
        "Heading out of range": 1,
        "clock not set": 2,
        "time not increasing": 1,
        "unreadable value": 2,
        "wrong number of fields": 1,
    }
    with open_observations(tmp_path / "out.nc") as observations:
        assert observations.faults == {}


@pytest.mark.parametrize(
    ("column", "taken", "dropped"),
    [
        ("Heading", "0", "-0.001"), ("Heading", "360", "360.001"), ("Declination", "179.9", "180"),
        ("Pitch", "-89.9", "-90"), ("Roll", "180", "180.001"), ("Roll", "-180", "-180.001"), ("Depth", "-9.9", "-10"),
        ("Lat", "9000.0", "9000.2"), ("Lon", "-18000.0", "-18000.2"), ("BallastPos", "1999", "2000"),
        ("LinPos", "-999", "-1000"), ("AngPos", "179.9", "180"), ("NavState", "999", "1000"),
    ],
)  # fmt: skip
def test_a_row_with_a_value_that_no_sensor_gives_is_dropped(tmp_path, column, taken, dropped):
    folder = write_mission(tmp_path / "m")

    def put(lines):
        for index, value in ((45, taken), (50, dropped)):
            fields = lines[index].split(";")
            fields[NAVIGATION.split(";").index(column)] = value
            lines[index] = ";".join(fields)

    edit(folder, 5, put)
    assert import_seaexplorer([folder], tmp_path / "out.nc").rows_dropped == {f"{column} out of range": 1}


def test_the_battery_s_scale_is_half_a_millimetre_a_unit_unless_given(tmp_path):
    import_seaexplorer([write_mission(tmp_path / "m")], tmp_path / "out.nc")
    with open_observations(tmp_path / "out.nc") as observations:
        np.testing.assert_allclose(observations.profile(6).battery_position, 0.5e-3 * (73.0 - 60.0))


def test_cycles_say_why_they_give_no_profile(tmp_path):
    folder = write_mission(tmp_path / "m")
    (folder / "sea099.3.gli.sub.6").unlink()
    # A pause of a quarter of an hour below the surface breaks the record: what is left of the dive is too short.
    edit(folder, 7, lambda lines: [line for index, line in enumerate(lines) if index < 30 or index > 110])
    summary = import_seaexplorer([folder], tmp_path / "out.nc")
    assert summary.without_profile == {"cycle 6": "its navigation file is missing", "cycle 8": "only a surface record"}
    assert [(profile.number, profile.fault) for profile in summary.profiles] == [
        (5, None),
        (7, "profile 7: only 14 samples, but at least 30 are needed"),
    ]


def test_a_shallow_dive_is_no_profile(tmp_path):
    folder = write_mission(tmp_path / "m")
    states = [(116, 1.0)] * SURFACE + [(110, 3.0), (100, 5.0), (100, 7.0), (117, 5.0)] + [(116, 1.0)] * SURFACE
    begin = START + np.timedelta64(1, "D")
    rows = [row(begin + np.timedelta64(20 * i, "s"), state, depth) for i, (state, depth) in enumerate(states)]
    (folder / "sea099.3.gli.sub.9").write_text("\n".join([NAVIGATION, *rows]) + "\n")
    summary = import_seaexplorer([folder], tmp_path / "out.nc")
    assert summary.without_profile["cycle 9"] == "too shallow: dives 4 m, but at least 10 m are needed"


def test_ctd_goes_to_the_nearest_row_and_is_not_interpolated(tmp_path):
    folder = write_mission(tmp_path / "m")
    sampled = START + np.timedelta64(400, "s")
    lines = [
        f"{stamp(sampled)}.400;20.0;3.5;9.5;20.2;9999.00;",
        f"{stamp(sampled + np.timedelta64(60, 's'))}.000;;;;;9999.00;",
        "broken",
    ]
    (folder / "sea099.3.pld1.sub.5").write_text("\n".join([PAYLOAD, *lines]) + "\n")
    summary = import_seaexplorer([folder], tmp_path / "out.nc")
    assert summary.ctd_samples == 1
    assert summary.rows_dropped == {"payload: wrong number of fields": 1}
    with xr.open_dataset(tmp_path / "out.nc") as dataset:
        assert dataset["temperature"].sel(time=sampled.astype("datetime64[ns]")) == 9.5
        assert (
            "GPCTD: temperature, pressure and practical salinity by PSS-78 from conductivity in S/m"
            in (dataset.attrs["ctd_comment"])
        )
        assert dataset["pressure"].sel(time=sampled.astype("datetime64[ns]")) == 20.2
        # PSS-78: 3.5 S/m, a ratio of 0.81558 to 42.914 mS/cm, at 9.5 degC and 20.2 dbar.
        salinity = dataset["practical_salinity"].sel(time=sampled.astype("datetime64[ns]"))
        assert salinity == pytest.approx(32.2929, abs=1e-4)
        assert np.isfinite(dataset["practical_salinity"]).sum() == 1


LEGATO = "PLD_REALTIMECLOCK;NAV_DEPTH;AROD_FT_TEMP;LEGATO_CONDUCTIVITY;LEGATO_TEMPERATURE;LEGATO_PRESSURE"
SAMPLED = START + np.timedelta64(400, "s")
"""Time of a navigation row of cycle 5."""


def write_payload(folder: Path, name: str, header: str, values: dict[int, str]) -> Path:
    """Write a payload file of rows at seconds after SAMPLED."""
    lines = [f"{stamp(SAMPLED + np.timedelta64(late, 's'))}.000;{text};" for late, text in values.items()]
    (folder / name).write_text("\n".join([header + ";", *lines]) + "\n")
    return folder / name


def ctd_of(folder: Path, out: Path):
    """Import a mission; its summary and the variables of its CTD at SAMPLED."""
    summary = import_seaexplorer([folder], out)
    with xr.open_dataset(out) as dataset:
        return summary, dataset.load().sel(time=SAMPLED.astype("datetime64[ns]"))


@pytest.mark.parametrize(
    ("header", "values", "salinity"),
    [
        (LEGATO + ";LEGATO_SALINITY", "20.0;9.0;35.0;9.5;20.2;32.29", 32.2929),
        (LEGATO, "20.0;9.0;35.0;9.5;20.2", 32.2929),
        # A Legato's salinity in the file decides where the usual unit would be plausible too.
        (LEGATO + ";LEGATO_SALINITY", "20.0;9.0;3.5;9.5;20.2;32.3", 32.2929),
        # The Baltic by either sensor.
        (LEGATO, "20.0;9.0;10.6428;16.8378;2.47", 7.2680),
        (PAYLOAD.removesuffix(";"), "20.0;1.06428;16.8378;2.47;9999.00", 7.2680),
        ("PLD_REALTIMECLOCK;SBD_CONDUCTIVITY;SBD_TEMP;SBD_PRESSURE", "3.5;9.5;20.2", 32.2929),
        ("PLD_REALTIMECLOCK;SBD_CONDUCTIVITY;SBD_TEMP;SBD_PRESSURE", "35.0;9.5;20.2", 32.2929),
        ("PLD_REALTIMECLOCK;CTD_SALINITY;CTD_TEMPERATURE;CTD_PRESSURE", "32.2929;9.5;20.2", 32.2929),
    ],
)
def test_any_ctd_in_either_unit_of_conductivity(tmp_path, header, values, salinity):
    folder = write_mission(tmp_path / "m")
    write_payload(folder, "sea099.3.pld1.sub.5", header, {0: values})
    summary, found = ctd_of(folder, tmp_path / "out.nc")
    assert summary.ctd_samples == 1
    assert found["practical_salinity"] == pytest.approx(salinity, abs=1e-3)
    assert summary.remarks == ("cycles 6-8: no payload file, so no CTD data",)


def test_a_pressure_that_is_absent_is_made_from_depth(tmp_path):
    folder = write_mission(tmp_path / "m")
    write_payload(
        folder, "sea099.3.pld1.sub.5", "PLD_REALTIMECLOCK;GPCTD_CONDUCTIVITY;GPCTD_TEMPERATURE", {0: "3.5;9.5"}
    )
    _, found = ctd_of(folder, tmp_path / "out.nc")
    assert found["practical_salinity"] == pytest.approx(32.293, abs=0.02)
    assert found["pressure"] == pytest.approx(float(found["depth"]), rel=0.02)


def test_the_full_record_of_the_payload_goes_before_the_sub_sampled(tmp_path):
    """Delayed mode: rows of other sensors between the CTD's; values missing in the full record come from the other."""
    folder = write_mission(tmp_path / "m")
    full = {-4: "20.0;9.1;;;", -1: "20.0;;35.0;9.5;20.2", 1: "20.0;9.1;;;", 4: "20.0;;35.0;9.6;20.3"}
    raw = write_payload(folder, "sea099.3.pld1.raw.5", LEGATO, full)
    write_payload(folder, "sea099.3.pld1.sub.5", LEGATO, {4: "20.0;9.1;35.0;9.7;20.3", 40: "20.0;9.1;35.0;9.8;20.4"})
    write_payload(folder, "sea099.3.pld1.raw.6", LEGATO, {})
    raw.with_name(raw.name + ".gz").write_bytes(gzip.compress(raw.read_bytes()))
    raw.unlink()
    summary, found = ctd_of(folder, tmp_path / "out.nc")
    assert found["temperature"] == 9.5
    assert summary.ctd_samples == 2
    assert summary.remarks == (
        "cycle 6: no sample of a CTD in the payload file, so no CTD data",
        "cycles 7-8: no payload file, so no CTD data",
    )
    (folder / "sea099.3.pld1.sub.5").unlink()
    assert ctd_of(folder, tmp_path / "raw.nc")[0].ctd_samples == 1


def test_a_payload_without_ctd_or_not_readable_is_a_remark(tmp_path):
    folder = write_mission(tmp_path / "m")
    write_payload(folder, "sea099.3.pld1.sub.5", "PLD_REALTIMECLOCK;NAV_DEPTH;FLBBCD_CHL_COUNT", {0: "20.0;81"})
    cut = gzip.compress(b"PLD_REALTIMECLOCK;" + bytes(range(256)) * 40)
    (folder / "sea099.3.pld1.raw.6.gz").write_bytes(cut[: len(cut) // 2])
    write_payload(folder, "sea099.3.pld1.sub.7", "GPCTD_TEMPERATURE;GPCTD_CONDUCTIVITY", {0: "9.5"})
    summary = import_seaexplorer([folder], tmp_path / "out.nc")
    assert [profile.number for profile in summary.complete] == [5, 6, 7]
    assert (summary.ctd_samples, summary.rejected) == (0, {})
    assert "sea099.3.pld1.raw.6.gz: cannot be read" in summary.remarks[0]
    assert "sea099.3.pld1.sub.7: has no column PLD_REALTIMECLOCK" in summary.remarks[1]
    assert summary.remarks[2:] == (
        "cycles 5-7: no sample of a CTD in the payload file, so no CTD data",
        "cycle 8: no payload file, so no CTD data",
    )


def test_the_ctd_with_more_samples_is_used(tmp_path):
    folder = write_mission(tmp_path / "m")
    both = f"{LEGATO};GPCTD_CONDUCTIVITY;GPCTD_TEMPERATURE;GPCTD_PRESSURE"
    write_payload(folder, "sea099.3.pld1.sub.5", both, {0: "20;9;35;9.5;20;3.5;9.6;20", 20: "20;9;35;9.5;20;;;"})
    summary, found = ctd_of(folder, tmp_path / "out.nc")
    assert (summary.ctd_samples, float(found["temperature"])) == (2, 9.5)
    assert summary.remarks[-1] == "CTD LEGATO is used; it has more samples than GPCTD"


def test_a_conductivity_that_no_unit_explains_is_a_remark(tmp_path):
    folder = write_mission(tmp_path / "m")
    write_payload(folder, "sea099.3.pld1.sub.5", LEGATO, {0: "20.0;9.0;0.0;9.5;20.2"})
    summary, found = ctd_of(folder, tmp_path / "out.nc")
    assert np.isnan(found["practical_salinity"])
    assert summary.remarks[-1] == (
        "CTD LEGATO: its conductivity gives no plausible salinity, neither in S/m nor in mS/cm"
    )


def test_a_navigation_file_that_cannot_be_read_costs_its_cycle(tmp_path):
    folder = write_mission(tmp_path / "m")
    (folder / "sea099.3.gli.sub.6").write_text("")
    summary = import_seaexplorer([folder], tmp_path / "out.nc")
    assert [profile.number for profile in summary.complete] == [5, 7]
    assert list(summary.rejected) == ["cycle 6"]
    assert "is empty; copy it again" in summary.rejected["cycle 6"]
    assert "cycle 6" not in summary.without_profile


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("05/07/2023 ", "2023-07-05 ", r"Timestamp is '2023-07-05 10:00:00'; it must be DD/MM/YYYY hh:mm:ss"),
        ("05/07/2023 ", "07/25/2023 ", r"Timestamp is '07/25/2023 10:00:00'; it must be DD/MM/YYYY hh:mm:ss"),
        ("350.0", "350,0", r"Heading is '350,0'; decimals must have a point"),
        ("4.5", "none", r"Roll is 'none'; it must be a number"),
    ],
    ids=["ISO date", "US date", "comma", "word"],
)
def test_values_that_cannot_be_read_are_named(tmp_path, old, new, words):
    folder = write_mission(tmp_path / "m")
    for cycle in (5, 6, 7, 8):
        edit(folder, cycle, lambda lines: [line.replace(old, new) for line in lines])
    with pytest.raises(InputError, match=rf"gli\.sub\.5: no row can be read; row 1: {words}"):
        import_seaexplorer([folder], tmp_path / "out.nc")


def test_a_profile_with_a_pause_is_no_cycle_without_profile(tmp_path):
    folder = write_mission(tmp_path / "m")

    def later(lines, start):
        return [line if i < start else moved(line) for i, line in enumerate(lines)]

    def moved(line):
        clock, rest = line.split(";", 1)
        date, hours = clock.split(" ")
        return f"{date} {int(hours[:2]) + 1:02}{hours[2:]};{rest}"

    edit(folder, 6, lambda lines: later(lines, 60))
    for cycle in (7, 8):
        edit(folder, cycle, lambda lines: later(lines, 1))
    summary = import_seaexplorer([folder], tmp_path / "out.nc")
    assert [profile.number for profile in summary.profiles] == [5, 6, 7]
    assert summary.without_profile == {"cycle 8": "only a surface record"}
    assert any(remark.startswith("cycle 6: the record pauses for 60 min") for remark in summary.remarks)


def test_the_same_file_twice_counts_once(tmp_path):
    folder = write_mission(tmp_path / "m")
    copy = tmp_path / "sea099.3.gli.sub.5.gz"
    copy.write_bytes(gzip.compress((folder / "sea099.3.gli.sub.5").read_bytes()))
    assert len(import_seaexplorer([folder, copy], tmp_path / "out.nc").profiles) == 3


def test_the_nearer_of_two_samples_stays():
    time = START + np.array([0, 20, 40], "timedelta64[s]")
    sampled = START + np.array([17, 21, 90], "timedelta64[s]")
    placed = onto_nearest(time, sampled, np.array([1.0, 2.0, 3.0]), np.timedelta64(10, "s"))
    np.testing.assert_array_equal(placed, [np.nan, 2.0, np.nan])


def test_degrees_and_minutes():
    np.testing.assert_allclose(decimal_degrees(np.array([5137.888, -12820.217, -30.0])), [51.6314667, -128.33695, -0.5])


def test_gzipped_files_read_the_same(tmp_path):
    folder = write_mission(tmp_path / "m")
    import_seaexplorer([folder], tmp_path / "plain.nc")
    for path in sorted(folder.iterdir()):
        path.with_name(path.name + ".gz").write_bytes(gzip.compress(path.read_bytes()))
        path.unlink()
    import_seaexplorer([folder], tmp_path / "packed.nc")
    assert (tmp_path / "plain.nc").read_bytes() == (tmp_path / "packed.nc").read_bytes()


def test_bad_sources_are_refused_in_one_line(tmp_path):
    folder = write_mission(tmp_path / "m")
    out = tmp_path / "out.nc"
    record = folder / "sea099.3.gli.sub.5"
    stray = tmp_path / "stray.txt"
    stray.write_text("")
    empty = tmp_path / "empty"
    empty.mkdir()
    other = tmp_path / "sea100.3.gli.sub.9"
    other.write_bytes(record.read_bytes())
    second = tmp_path / "sea099.3.gli.sub.5.gz"
    second.write_bytes(gzip.compress(b"of other content"))
    headless = tmp_path / "sea099.3.gli.sub.9"
    headless.write_text("a;b;\n1;2;\n")
    junk = tmp_path / "sea099.3.gli.sub.10"
    junk.write_text(NAVIGATION + "\nnothing\n")
    for sources, words in (
        ([tmp_path / "absent"], "no such file or folder"),
        ([stray], "is not named like a SeaExplorer record"),
        ([empty], r"no \*.gli.sub.\* file found"),
        ([record, other], "belongs to another mission"),
        ([folder, second], "cycle 5 is already given as"),
        ([headless], "has no column Timestamp"),
        ([junk], r"no usable navigation row \(wrong number of fields: 1\)"),
    ):
        with pytest.raises(InputError, match=words) as refused:
            import_seaexplorer(sources, out)
        assert "\n" not in str(refused.value)
    assert not out.exists()


def test_a_missing_output_argument_does_not_destroy_a_record(tmp_path):
    folder = write_mission(tmp_path / "m")
    record = folder / "sea099.3.gli.sub.6"
    before = record.read_bytes()
    with pytest.raises(InputError, match="the last argument must be the netCDF file"):
        import_seaexplorer([folder / "sea099.3.gli.sub.5"], record)
    assert record.read_bytes() == before


def test_command_prints_the_summary(tmp_path):
    folder = write_mission(tmp_path / "m")
    arguments = ["seaexplorer", str(folder), str(tmp_path / "out.nc"), "--linear-zero", "63"]
    result = CliRunner().invoke(import_, arguments, catch_exceptions=False)
    assert result.exit_code == 0
    assert "SEA099-M3" in result.output
    assert "cycle 8: no profile: only a surface record" in result.output
    assert "3 profiles, 3 complete, written to" in result.output


@pytest.mark.parametrize("arguments", [["--help"], ["seaexplorer", "--help"]])
def test_help_shows_an_example(arguments):
    assert "gliderhpc import seaexplorer M010/ mission.nc" in CliRunner().invoke(import_, arguments).output


# Real missions -------------------------------------------------------------------------------------------------------


def test_mission_10(shared_data, tmp_path):
    summary = import_seaexplorer([shared_data / "seaexplorer-sea035-M010"], tmp_path / "out.nc")
    assert len(summary.profiles) == 61
    assert len(summary.complete) == 59
    assert {profile.number for profile in summary.profiles if profile.fault} == {1, 2}
    assert summary.without_profile == {"cycle 97": "only a surface record"}
    assert summary.remarks == ("cycle 8: no payload file, so no CTD data",)
    assert summary.rows_dropped == {"clock not set": 4}
    assert summary.sample_interval == 20.0
    by_number = {profile.number: profile for profile in summary.profiles}
    assert by_number[41].parts == (41, 42, 43, 44)
    assert sum(len(profile.parts) for profile in summary.profiles) == 96
    with open_observations(tmp_path / "out.nc") as observations:
        assert set(observations.faults) == {1, 2}
        records = [observations.profile(profile.number) for profile in summary.complete]
    for record in records:
        assert np.abs(np.diff(record.depth) / np.diff(record.time)).max() < 0.5
        assert record.entry_fix is not None
        assert record.exit_fix is not None


def test_mission_12(shared_data, tmp_path):
    summary = import_seaexplorer([shared_data / "seaexplorer-sea035-M012"], tmp_path / "out.nc")
    assert [profile.number for profile in summary.complete] == list(range(37, 48))
    assert [profile.number for profile in summary.profiles if profile.fault] == [36]
    assert set(summary.without_profile) == {"cycle 48", "cycle 49"}
    assert summary.rows_dropped == {}
    assert max(profile.max_depth for profile in summary.profiles) == pytest.approx(702.3)
    with open_observations(tmp_path / "out.nc") as observations:
        record = observations.profile(40)
    assert record.entry_fix.latitude == pytest.approx(48.9, abs=0.1)
    assert record.entry_fix.longitude == pytest.approx(-130.6, abs=0.1)
    # Roll follows the battery's rotation: starboard down where gamma is positive.
    assert np.corrcoef(record.battery_rotation, record.roll)[0, 1] > 0.8


def test_a_legato_in_the_baltic(shared_data, tmp_path):
    """Conductivity in mS/cm, read as such: the salinity is that which the instrument itself computed."""
    summary = import_seaexplorer([shared_data / "seaexplorer-sea063-legato"], tmp_path / "out.nc")
    assert [(profile.number, profile.samples) for profile in summary.complete] == [(120, 543)]
    assert (summary.ctd_samples, summary.remarks, summary.rows_dropped) == (328, (), {})
    with xr.open_dataset(tmp_path / "out.nc") as dataset:
        found = dataset["practical_salinity"].values
        sampled = np.isfinite(found)
        assert found[sampled][0] == pytest.approx(7.2681, abs=1e-3)
        assert np.quantile(found[sampled], [0.0, 1.0]) == pytest.approx([7.04, 15.38], abs=0.01)
