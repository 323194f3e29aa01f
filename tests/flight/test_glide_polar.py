"""Drag-to-lift ratio of a vehicle type."""

import math

import pytest

from gliderhpc.flight.glide_polar import polar_of_hull, polar_of_make
from gliderhpc.platform import read_platform


@pytest.mark.parametrize(
    ("text", "make"),
    [
        ("Teledyne Webb Slocum G3", "slocum"), ("ru29-20150623", "slocum"), ("SG249", "seaglider"),
        ("dfo-eva035 SeaExplorer", "seaexplorer"), ("Petrel-L", "petrel-l"),
        ("sea035_M12", "seaexplorer"), ("sg_579", "seaglider"), ("ru28_20230101", "slocum"),
        ("unit_595_2021", "slocum"),
    ],
)  # fmt: skip
def test_the_make_is_read_from_what_a_file_says(text, make):
    assert polar_of_make(text).make == make


def test_an_unknown_make_is_less_certain_and_a_given_hull_more():
    unknown, make, given = (
        polar_of_make("a new glider"),
        polar_of_make("slocum"),
        polar_of_hull(read_platform("slocum")),
    )
    assert unknown.deviation > make.deviation > given.deviation


def test_the_hulls_differ_by_the_deviation_in_drag_over_lift():
    polar = polar_of_make("seaglider")
    middle, more, less = (math.log(hull.viscous.K_D0 / hull.viscous.K_L) for hull in polar.hulls)
    assert more - middle == pytest.approx(polar.deviation)
    assert middle - less == pytest.approx(polar.deviation)
    assert pytest.approx(math.exp(polar.deviation)) == polar.hulls[1].viscous.K_D / polar.hulls[0].viscous.K_D
