"""Longitudes and regions, also across the date line."""

import numpy as np
import pytest

from gliderhpc.observations.files.discovery import discovery_attributes
from gliderhpc.observations.regions import bounding_polygon, longitude_range, wrapped_longitude
from gliderhpc.report.exports.og1_metadata import Extent


@pytest.mark.parametrize(
    ("longitude", "ends"),
    [
        ([10.0, np.nan, -20.0], (-20.0, 10.0)),
        ([179.5, -179.0, 179.9], (179.5, -179.0)),
        ([359.0, 2.0], (-1.0, 2.0)),
        ([45.0], (45.0, 45.0)),
        ([178.0, 180.0], (178.0, 180.0)),
        ([-90.0, 0.0, 95.0], (-90.0, 95.0)),
    ],
)
def test_the_shortest_arc_goes_from_west_to_east(longitude, ends):
    assert longitude_range(np.array(longitude)) == ends


def test_without_a_longitude_there_is_no_arc():
    assert longitude_range(np.array([np.nan])) is None


def test_longitudes_are_within_half_a_turn_of_the_centre():
    found = wrapped_longitude(np.array([-179.0, 179.0, 541.0]), 179.5)
    np.testing.assert_allclose(found, [181.0, 179.0, 181.0])
    assert wrapped_longitude(190.0) == -170.0


def test_a_region_across_the_date_line_has_a_polygon_on_either_side():
    both = bounding_polygon((-1.0, 2.0), (179.0, -178.0))
    west, east = (f"(({', '.join(f'{a:.5f} {b:.5f}' for a, b in corners)}))" for corners in (
        [(-1.0, 179.0), (-1.0, 180.0), (2.0, 180.0), (2.0, 179.0), (-1.0, 179.0)],
        [(-1.0, -180.0), (-1.0, -178.0), (2.0, -178.0), (2.0, -180.0), (-1.0, -180.0)],
    ))  # fmt: skip
    assert both == f"MULTIPOLYGON ({west}, {east})"


def test_attributes_of_a_mission_across_the_date_line():
    time = np.array(["2024-01-01", "2024-01-02"], dtype="datetime64[ns]")
    found = discovery_attributes("", time, np.array([50.0, 51.0]), np.array([179.0, -179.5]), np.array([0.0, 9.0]), "")
    assert (found["geospatial_lon_min"], found["geospatial_lon_max"]) == (179.0, -179.5)


def test_the_extent_of_a_mission_across_the_date_line_grows_by_profile():
    extent, nothing = Extent(), np.array([0.0, 1.0])
    for longitude in ([179.0, 179.9], [179.8, -179.9], [-179.8, -179.0], [np.nan, np.nan]):
        rows = {"TIME": nothing, "DEPTH": nothing, "LATITUDE": nothing, "LONGITUDE": np.array(longitude)}
        extent.update(rows)
    found = extent.attributes()
    assert (found["geospatial_lon_min"], found["geospatial_lon_max"]) == (179.0, -179.0)
    assert found["geospatial_bounds"].startswith("MULTIPOLYGON")
