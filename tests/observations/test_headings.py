"""Reference of a heading by the words of its file, and the declination that the file gives."""

import numpy as np
import pytest
import xarray as xr

from gliderhpc.errors import InputError
from gliderhpc.observations.headings import North, file_declination, north_of
from gliderhpc.observations.navigation_columns import NavigationColumns


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
