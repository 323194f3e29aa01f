"""Importers and wrong units: headings in radians, positions in an undeclared form, depth positive up."""

import netCDF4
import numpy as np
import pytest
import xarray as xr
from support import seaglider_files as made
from support.missions import program
from support.seaexplorer_files import edit, write_mission
from support.slocum_files import AFLOAT, DIVE, flight, write_netcdf

from gliderhpc.errors import InputError
from gliderhpc.observations.checks.profile_checks import check_heading_unit
from gliderhpc.observations.importing.position_form import are_not_decimal, are_not_minutes, may_be_decimal
from gliderhpc.observations.instruments.og1 import import_og1
from gliderhpc.observations.instruments.seaexplorer import import_seaexplorer
from gliderhpc.observations.instruments.seaglider import import_seaglider
from gliderhpc.observations.instruments.slocum import import_slocum

# Headings in radians

WHOLE = {1: (0, 200)}


@pytest.mark.parametrize(
    "heading",
    [
        np.linspace(0.0, 6.2832, 200),
        np.linspace(-3.1416, 3.1416, 200),
        np.linspace(2.0, 3.1, 200),
        np.linspace(-0.7, 0.7, 200),
    ],
    ids=["circle, rounded up", "half circles, rounded up", "60 degrees", "80 degrees about north"],
)
def test_a_heading_in_radians_is_refused(heading):
    with pytest.raises(InputError, match=r"m\.nc: compass lies between .* so it is in radians"):
        check_heading_unit(heading, WHOLE, "m.nc", "compass")


@pytest.mark.parametrize(
    "heading",
    [
        np.mod(3.0 + 8.0 * np.sin(np.linspace(0.0, 60.0, 200)), 360.0),
        -1.0 + 4.0 * np.sin(np.linspace(0.0, 60.0, 200)),
        np.linspace(1.0, 7.0, 200),
        np.full(200, np.nan),
    ],
    ids=["0 to 360", "-180 to 180", "steady and rising", "missing"],
)
def test_a_northward_heading_in_degrees_is_accepted(heading):
    assert check_heading_unit(heading, WHOLE, "m.nc") is None
    assert check_heading_unit(heading, {}, "m.nc") is None


@pytest.mark.parametrize("turn", [0.0, 0.9])
def test_a_heading_that_hardly_changes_is_a_remark(turn):
    remark = check_heading_unit(np.linspace(3.0, 3.0 + turn, 200), WHOLE, "m.nc")
    assert remark.startswith(f"heading lies between 3.000 and {3.0 + turn:.3f} degree")


SLOCUM_ROWS = 2 * (AFLOAT + DIVE)
RADIANS = 3.0


def slocum_heading(tmp_path, turn):
    flown = flight() | {"m_heading": np.linspace(3.0, 3.0 + turn, SLOCUM_ROWS)}
    source = write_netcdf(tmp_path / "glider.nc", flown, units={"m_heading": "degree"})
    return import_slocum([source], tmp_path / "out.nc", declination=20.0)


def seaexplorer_heading(tmp_path, turn):
    folder = write_mission(tmp_path / "m")
    for cycle in (5, 6, 7, 8):
        edit(folder, cycle, lambda lines: [turned(line, turn * i / len(lines)) for i, line in enumerate(lines)])
    return import_seaexplorer([folder], tmp_path / "out.nc")


def turned(line, change):
    """Row with another heading; the header stays."""
    fields = line.split(";")
    return line if fields[3] == "Heading" else ";".join([*fields[:3], f"{3.0 + change:.4f}", *fields[4:]])


def seaglider_heading(tmp_path, turn):
    for dive in (1, 2):
        heading = 3.0 + turn * (np.linspace(0.0, 0.5, len(made.clock(dive))) + 0.5 * (dive - 1))
        made.write_dive(tmp_path / "m", dive, columns=True, eng_head=heading)
    return import_seaglider([tmp_path / "m"], tmp_path / "out.nc")


def og1_heading(tmp_path, turn):
    path = made.write_og1(tmp_path / "sg099.nc", HEADING=np.linspace(3.0, 3.0 + turn, 2 * OG1_ROWS))
    return import_og1([path], tmp_path / "out.nc", declination=20.0)


OG1_ROWS = 2 * (made.AFLOAT + made.HALF) + 3
IMPORTS = {
    "m_heading": slocum_heading, "Heading": seaexplorer_heading, "eng_head": seaglider_heading, "HEADING": og1_heading,
}  # fmt: skip


@pytest.mark.parametrize(("name", "imports"), IMPORTS.items(), ids=IMPORTS)
def test_importers_check_the_heading_before_the_declination_is_added(tmp_path, name, imports):
    """The declination moves radians out of their circle, where they cannot be recognised any more."""
    with pytest.raises(InputError, match=rf"{name} lies between \S+ and \d\.\d+ degree .* so it is in radians"):
        imports(tmp_path, RADIANS)
    assert not (tmp_path / "out.nc").exists()
    assert any(f"{name} lies between 3.0" in remark for remark in imports(tmp_path, 0.2).remarks)


# Positions


def position_units(unit):
    return {"m_gps_lat": unit, "m_gps_lon": unit}


def placed(latitude, longitude):
    """One segment with constant positions at the surface, and without a fix in the first rows, which report zeros."""
    flown = flight()
    for name, value in (("m_gps_lat", latitude), ("m_gps_lon", longitude)):
        flown[name] = np.where(np.isfinite(flown[name]), value, np.nan)
        flown[name][:3] = 0.0
    return flown


@pytest.mark.parametrize(
    ("latitude", "longitude", "unit", "words"),
    [
        (27.5, -90.5, "lat", "lie within 2 degrees of 0 N, 0 E; if they are decimal degrees"),
        (-33.9, 151.2, "ddmm.mmmm", "lie within 2 degrees of 0 N, 0 E; if they are decimal degrees"),
        (2730.0, -9030.0, "degree", "lie off the globe; if they are DDMM.mmmm"),
        (30.0, -9030.0, "degrees", "lie off the globe; if they are DDMM.mmmm"),
    ],
)
def test_positions_in_another_form_than_declared_are_refused(tmp_path, latitude, longitude, unit, words):
    source = write_netcdf(tmp_path / "glider.nc", placed(latitude, longitude), units=position_units(unit))
    with pytest.raises(InputError, match=words) as refused:
        import_slocum([source], tmp_path / "out.nc")
    assert f"({abs(latitude):g} and {abs(longitude):g} in magnitude)" in str(refused.value)


@pytest.mark.parametrize(
    ("latitude", "longitude", "unit", "expected"),
    [
        (30.0, -9030.0, "lat", (0.5, -90.5)),
        (4830.0, -30.0, "lat", (48.5, -0.5)),
        (0.5, 0.25, "degree", (0.5, 0.25)),
        (np.nan, np.nan, "lat", None),
    ],
    ids=["equator", "Greenwich", "both, in decimal degrees", "no fix"],
)
def test_positions_in_the_declared_form_are_accepted(tmp_path, latitude, longitude, unit, expected):
    source = write_netcdf(tmp_path / "glider.nc", placed(latitude, longitude), units=position_units(unit))
    import_slocum([source], tmp_path / "out.nc")
    with xr.open_dataset(tmp_path / "out.nc") as dataset:
        found = {(float(a), float(b)) for a, b in zip(dataset.fix_latitude, dataset.fix_longitude, strict=True)}
    assert found - {(0.0, 0.0)} == ({expected} if expected else set())


def test_junk_among_positions_does_not_count():
    latitude, longitude = np.array([2730.1, 2730.2, 69_696_969.0, 0.0]), np.array([9030.1, 9030.2, 69_696_969.0, 0.0])
    assert not may_be_decimal(latitude, longitude)
    assert not are_not_minutes(latitude, longitude)
    assert are_not_decimal(latitude, longitude)
    assert not may_be_decimal(latitude[2:], longitude[2:])
    assert not are_not_decimal(latitude[2:], longitude[2:])


def relocated(folder, latitude, longitude):
    for cycle in (5, 6, 7, 8):
        edit(folder, cycle, lambda lines: [lines[0], *(replaced(line, latitude, longitude) for line in lines[1:])])
    return folder


def replaced(line, latitude, longitude):
    fields = line.split(";")
    return ";".join([*fields[:10], latitude, longitude, *fields[12:]])


@pytest.mark.parametrize(
    ("latitude", "longitude"), [("48.612345", "-123.5"), ("80.5", "-123.5")], ids=["six decimals", "80 minutes"]
)
def test_seaexplorer_positions_in_decimal_degrees_are_refused(tmp_path, latitude, longitude):
    folder = relocated(write_mission(tmp_path / "m"), latitude, longitude)
    with pytest.raises(InputError, match=r"Lat and Lon, read as DDMM\.mmm, .* so they are decimal degrees"):
        import_seaexplorer([folder], tmp_path / "out.nc")


def test_seaexplorer_positions_that_may_be_decimal_degrees_are_a_remark(tmp_path):
    folder = relocated(write_mission(tmp_path / "m"), "30.123", "-130.500")
    summary = import_seaexplorer([folder], tmp_path / "out.nc")
    assert sum("if they are decimal degrees" in remark for remark in summary.remarks) == 1


# Declination


def test_a_seaexplorer_without_declination_is_reported(tmp_path):
    folder = write_mission(tmp_path / "m")
    for cycle in (5, 6, 7, 8):
        edit(folder, cycle, lambda lines: [line.replace(";350.0;16;", ";350.0;0;") for line in lines])
    summary = import_seaexplorer([folder], tmp_path / "out.nc")
    assert any("left magnetic: give `declination`" in remark for remark in summary.remarks)
    with xr.open_dataset(tmp_path / "out.nc") as dataset:
        assert dataset.heading_comment == "magnetic heading: Declination is 0 in every row, so none is added"
        np.testing.assert_array_equal(dataset["heading"], 350.0)
    done = program("import", "seaexplorer", folder, tmp_path / "out.nc", "--declination", "16", "--overwrite")
    assert done.status == 0
    assert "magnetic" not in done.out
    with xr.open_dataset(tmp_path / "out.nc") as dataset:
        assert dataset.heading_comment == "magnetic heading plus the given declination, 16 degree"
        np.testing.assert_allclose(dataset["heading"], 6.0)


# Depth and fixes of OG1 files


def og1_file(tmp_path, change, **changes):
    path = made.write_og1(tmp_path / "sg099.nc", **changes)
    with netCDF4.Dataset(path, "a") as file:
        change(file.variables)
    return path


def lift_depth(limits, **attributes):
    def change(variables):
        depth = variables["DEPTH"]
        depth[...] = -depth[...]
        depth.setncatts({**({"valid_min": 0.0, "valid_max": 2000.0} if limits else {}), **attributes})

    return change


@pytest.mark.parametrize("limits", [True, False], ids=["valid_min 0", "no limits"])
def test_a_depth_that_is_negative_under_water_is_refused(tmp_path, limits):
    with pytest.raises(InputError, match=r"DEPTH is negative under water \(-100 m\); make it positive down"):
        import_og1([og1_file(tmp_path, lift_depth(limits))], tmp_path / "out.nc")


def test_a_depth_that_is_declared_positive_up_is_reversed(tmp_path):
    summary = import_og1([og1_file(tmp_path, lift_depth(False, positive="up"))], tmp_path / "out.nc")
    assert [round(profile.max_depth) for profile in summary.complete] == [100, 100]


def test_a_positive_depth_that_is_declared_positive_up_is_refused(tmp_path):
    path = og1_file(tmp_path, lambda variables: variables["DEPTH"].setncatts({"positive": "up"}))
    with pytest.raises(InputError, match=r"positive under water, but declared positive up \(100 m\); correct its"):
        import_og1([path], tmp_path / "out.nc")


def test_an_og1_file_without_gps_is_reported(tmp_path):
    path = made.write_og1(tmp_path / "sg099.nc", LATITUDE_GPS=None, LONGITUDE_GPS=None)
    summary = import_og1([path], tmp_path / "out.nc")
    assert summary.fixes == 0
    (remark,) = summary.remarks
    assert remark.endswith("has no LATITUDE_GPS or LONGITUDE_GPS, so there are no GPS fixes and no currents")

    def add_positions(variables):
        for name in ("LATITUDE", "LONGITUDE"):
            variables["DEPTH"].group().createVariable(name, "f8", ("N_MEASUREMENTS",))[...] = 45.0

    empty = np.full(2 * OG1_ROWS, np.nan)
    path = og1_file(tmp_path, add_positions, LATITUDE_GPS=empty, LONGITUDE_GPS=empty)
    (remark,) = import_og1([path], tmp_path / "out.nc", overwrite=True).remarks
    assert "has no position in LATITUDE_GPS and LONGITUDE_GPS" in remark
    assert remark.endswith("`gliderhpc currents` uses LATITUDE and LONGITUDE at the surface")


def test_the_message_for_pressure_in_place_of_depth_names_the_remedy(tmp_path):
    path = og1_file(tmp_path, lambda variables: variables["DEPTH"].group().renameVariable("DEPTH", "PRES"))
    with pytest.raises(InputError, match=r"has no depth .*; compute DEPTH \(m, positive down\) from PRES"):
        import_og1([path], tmp_path / "out.nc")


# Exit status


def test_an_import_without_any_complete_profile_has_exit_status_1(tmp_path):
    flown = flight()
    flown["m_pitch"] = np.degrees(flown["m_pitch"])
    done = program("import", "slocum", write_netcdf(tmp_path / "glider.nc", flown), tmp_path / "out.nc")
    assert done.status == 1
    assert done.out.rstrip().endswith(f"1 profile, 0 complete, written to {tmp_path / 'out.nc'}")
