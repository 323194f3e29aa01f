"""Reference of a heading from the text in its file, and the declination in the file."""

import numpy as np
import pytest
import xarray as xr
from support import observation_files
from support import seaglider_files as made
from support.glides import Glide, mission
from support.slocum_files import flight, write_netcdf

from gliderhpc.api.currents import currents
from gliderhpc.errors import InputError
from gliderhpc.observations import open_observations
from gliderhpc.observations.checks.heading_values import check_circle, remove_turns
from gliderhpc.observations.files.headings import North, file_declination, north_of
from gliderhpc.observations.instruments.og1 import import_og1
from gliderhpc.observations.instruments.seaglider import import_seaglider
from gliderhpc.observations.instruments.slocum import import_slocum
from gliderhpc.observations.navigation.columns import NavigationColumns


@pytest.mark.parametrize(
    "text",
    [
        "true heading, corrected for magnetic declination",
        "not magnetic",
        "Heading, not magnetic",
        "non-magnetic",
        "true heading: magnetic heading corrected for magnetic declination",
        "magnetic heading plus the declination in the same row of the file",
        "magnetic heading (m_heading) less m_gps_mag_var, interpolated between surfacings",
        "magnetic heading plus the file's declination, 15.6 to 15.6 degrees",
        "-12.70 degrees added (the file's dead reckoning: its true course less the magnetic heading)",
        "0.00 degrees added (none: the file describes its heading as true)",
        "clockwise from true north",
        "true heading; magnetic variation removed",
    ],
)
def test_a_true_heading(text):
    assert north_of(text) is North.TRUE


@pytest.mark.parametrize(
    "text",
    [
        "Vehicle heading (magnetic)",
        "platform_magnetic_heading",
        "heading from magnetic compass",
        "magnetic heading, not corrected for magnetic declination",
        "heading uncorrected for magnetic variation",
        "magnetic heading; add the declination for true heading",
        "heading relative to magnetic north",
        "Heading is magnetic; magnetic variation in variable MAGNETIC_VARIATION",
        "magnetic heading; declination must be added",
        "0.00 degrees added (unknown: the heading is left magnetic)",
    ],
)
def test_a_magnetic_heading(text):
    assert north_of(text) is North.MAGNETIC


@pytest.mark.parametrize(
    "texts",
    [
        (),
        ("glider heading angle", "platform_orientation"),
        ("0.00 degrees added (none: the file does not describe its heading as magnetic, so it is taken as true)",),
    ],
)
def test_a_heading_of_which_nothing_is_stated(texts):
    assert north_of(*texts) is North.UNSTATED


@pytest.mark.parametrize(
    ("name", "value", "units", "expected"),
    [
        ("magnetic_variation", 16.0, "degree", 16.0),
        ("MAGNETIC_VARIATION", np.radians(16.0), "rad", 16.0),
        ("declination", 16.0, "", 16.0),
        # A Slocum's is the magnetic less the true heading, in radians.
        ("m_gps_mag_var", np.radians(-16.0), "rad", 16.0),
        ("m_gps_mag_var", np.radians(-16.0), "", 16.0),
        ("m_gps_mag_var", -16.0, "degree", 16.0),
    ],
)
@pytest.mark.parametrize("dimensions", [(), ("time",)], ids=["scalar", "samples"])
def test_the_declination_of_a_file_in_degrees_east(name, value, units, expected, dimensions):
    values = value if dimensions == () else np.array([value, np.nan, -9999.0, value])
    dataset = xr.Dataset({name: (dimensions, values, {"units": units} if units else {})})
    found = file_declination(NavigationColumns(dataset, "made"), [name])
    assert found is not None
    assert found.angle == pytest.approx(expected)
    assert found.name == name


def test_a_declination_in_an_unknown_unit_is_refused():
    dataset = xr.Dataset({"declination": ((), 16.0, {"units": "furlong"})})
    with pytest.raises(InputError, match="'furlong'"):
        file_declination(NavigationColumns(dataset, "made"), ["declination"])


def unwrapped(count):
    return np.linspace(300.0, -1860.0, count)


def heading_file(tmp_path, kind, heading):
    """A file of a kind of records with headings by their number, and the name of the variable."""
    if kind == "og1":
        count = 2 * len(made.og1_rows(1)["TIME"])
        return made.write_og1(tmp_path / "a.nc", magnetic=False, HEADING=heading(count)), import_og1
    if kind == "seaglider":
        values = heading(len(made.clock(1)))
        return made.write_dive(tmp_path, 1, columns=True, magnetic_variation=0.0, eng_head=values), import_seaglider
    flown = flight()
    flown["m_heading"] = np.radians(heading(len(flown["m_heading"])))
    flown["m_gps_mag_var"] = 0.0 * flown["m_gps_mag_var"]
    return write_netcdf(tmp_path / "a.nc", flown), import_slocum


KINDS = pytest.mark.parametrize("kind", ["og1", "seaglider", "slocum"])


@KINDS
def test_an_unwrapped_heading_is_an_angle(tmp_path, kind):
    path, read = heading_file(tmp_path, kind, unwrapped)
    summary = read([path], tmp_path / "out.nc")
    assert all(profile.fault is None for profile in summary.profiles)
    with xr.open_dataset(tmp_path / "out.nc") as found:
        heading = found["heading"].values
    steps = np.mod(np.diff(heading[np.isfinite(heading)]) + 180.0, 360.0) - 180.0
    assert not np.isnan(heading).any()
    np.testing.assert_allclose(steps.sum(), -2160.0, atol=20.0)


@KINDS
def test_a_heading_in_tenths_of_a_degree_is_refused(tmp_path, kind):
    path, read = heading_file(tmp_path, kind, lambda count: 10.0 * np.mod(unwrapped(count), 360.0))
    with pytest.raises(InputError, match=r"(HEADING|eng_head|m_heading) is outside -181 to 361 degree in .*convert it"):
        read([path], tmp_path / "out.nc")


@KINDS
def test_a_heading_that_may_be_unwrapped_or_in_tenths_of_a_degree_is_refused(tmp_path, kind):
    path, read = heading_file(tmp_path, kind, lambda count: np.linspace(100.0, 900.0, count))
    with pytest.raises(InputError, match=r"a heading over several turns must be written modulo 360"):
        read([path], tmp_path / "out.nc")


@KINDS
def test_a_heading_in_gon_without_its_unit_is_refused(tmp_path, kind):
    path, read = heading_file(tmp_path, kind, lambda count: np.mod(unwrapped(count), 360.0) / 0.9)
    with pytest.raises(
        InputError, match=r"(HEADING|eng_head|m_heading) covers .* it is in gon, not in degree; set its"
    ):
        read([path], tmp_path / "out.nc")


@KINDS
def test_hundredths_of_a_degree_that_overflowed_two_bytes_are_refused(tmp_path, kind):
    def overflowed(count):
        return np.round(100.0 * np.mod(unwrapped(count), 360.0)).astype(np.int64).astype(np.int16) / 100.0

    path, read = heading_file(tmp_path, kind, overflowed)
    with pytest.raises(InputError, match=r"(HEADING|eng_head|m_heading) is between -32.* add 655.36 to the negative"):
        read([path], tmp_path / "out.nc")


def test_a_heading_in_gon_gives_the_same_current_if_its_unit_says_so():
    records, turned = mission(Glide()), mission(Glide())
    turned["heading"] = (records["heading"] + 0.7 * np.arange(records.sizes["time"])) % 360.0
    in_gon = turned.assign(heading=(turned["heading"] / 0.9).assign_attrs(units="gon"))
    np.testing.assert_allclose(currents(in_gon)["dac_north"], currents(turned)["dac_north"], atol=1e-9)
    in_gon["heading"].attrs["units"] = "degree"
    with pytest.raises(InputError, match=r"heading covers .* it is in gon"):
        currents(in_gon)


def test_a_heading_in_gon_in_an_observation_file_is_refused(tmp_path):
    heading = np.mod(observation_files.mission()["heading"] * 20.0, 400.0)
    with pytest.raises(InputError, match=r"mission.nc: heading covers .* it is in gon"):
        open_observations(observation_files.write(tmp_path, heading=heading))


@pytest.mark.parametrize("shift", [16.0, -20.0])
def test_a_declination_added_to_a_heading_does_not_make_it_gon(shift):
    heading = np.mod(np.arange(0.0, 3600.0, 3.7), 360.0) + shift
    check_circle(heading, "made")
    assert np.abs(remove_turns(heading)[0] - heading).max() in (0.0, 360.0)


def test_few_headings_beyond_a_turn_are_angles_and_fill_values_are_none():
    heading = np.array([10.0, 365.0, -190.0, -999.0, np.nan, 99999.0])
    found, text = remove_turns(heading)
    np.testing.assert_array_equal(found, [10.0, 5.0, 170.0, -999.0, np.nan, 99999.0])
    assert text == "is beyond -180 to 360 degree in 2 samples, the first 365 at sample 1; whole turns are removed"
    assert remove_turns(np.array([0.0, 360.0, -180.0]))[1] == ""


def test_an_unwrapped_heading_gives_the_same_current():
    records = mission(Glide())
    turned = records.copy(deep=True)
    wobble = 0.01 * np.sin(np.arange(records.sizes["time"]))
    turned["heading"] = records["heading"] - 2160.0 + wobble
    turned["heading"].attrs = records["heading"].attrs
    found, expected = currents(turned), currents(records)
    np.testing.assert_allclose(found["dac_north"], expected["dac_north"], atol=1e-4)
    assert "whole turns are removed" in found.attrs["comment"]


def test_impossible_headings_of_a_seaglider_are_missing_with_a_remark(tmp_path):
    heading = np.full(len(made.clock(1)), 350.0)
    heading[60:64] = -999.0
    summary = import_seaglider([made.write_dive(tmp_path, 1, columns=True, eng_head=heading)], tmp_path / "out.nc")
    assert summary.remarks == ("dive 1: values of eng_head outside -181 to 361 degree are treated as missing",)
    with xr.open_dataset(tmp_path / "out.nc") as found:
        assert int(np.isnan(found["heading"]).sum()) == 4
