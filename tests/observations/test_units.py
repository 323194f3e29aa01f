"""Factors between units, against the definitions of the units."""

import numpy as np
import pytest

from gliderhpc.errors import InputError
from gliderhpc.observations.columns import FACTORS
from gliderhpc.observations.slocum_files import conversion

DEFINED = {
    "m": {
        "m": 1.0,
        "metres": 1.0,
        "cm": 1 / 100,
        "mm": 1 / 1000,
        "in": 127 / 5000,
        "inches": 127 / 5000,
        "ft": 381 / 1250,
    },
    "degree": {"deg": 1.0, "degrees_true": 1.0, "degrees_north": 1.0, "rad": 180 / np.pi, "radians": 180 / np.pi},
    "m s-1": {"m/s": 1.0, "m s-1": 1.0, "cm/s": 1 / 100},
    "dbar": {
        "dbar": 1.0,
        "psi": 0.45359237 * 9.80665 / 0.0254**2 / 1e4,
        "bar": 1e5 / 1e4,
        "mbar": 1e2 / 1e4,
        "hpa": 1e2 / 1e4,
        "kpa": 1e3 / 1e4,
        "pa": 1 / 1e4,
    },
    "degC": {"degc": 1.0, "degrees_celsius": 1.0},
    "mS/cm": {"ms/cm": 1.0, "s/m": 1e3 / 1e2, "s m-1": 1e3 / 1e2, "mhos/m": 1e3 / 1e2},
    "1": {"1": 1.0, "1e-3": 1.0, "psu": 1.0},
    "cm3": {"cm3": 1.0, "cc": 1.0, "ml": 1.0, "l": 1e3, "dm3": 1e3, "m3": 1e6},
    "s": {"s": 1.0, "seconds": 1.0},
    "kg": {"kg": 1.0, "g": 1 / 1000},
}
"""One unit in the unit wanted, from their definitions (inch 25.4 mm, decibar 10 kPa)."""


@pytest.mark.parametrize("wanted", DEFINED)
def test_factors_are_those_of_the_definitions(wanted):
    factors = FACTORS[wanted]
    for spelling, factor in DEFINED[wanted].items():
        assert factors[spelling] == pytest.approx(factor, rel=1e-12), spelling
    scales = sorted(set(DEFINED[wanted].values()))
    assert sorted(set(factors.values())) == pytest.approx(scales, rel=1e-12), "a scale without a definition"


def test_every_unit_that_is_wanted_is_defined_here():
    assert set(FACTORS) == set(DEFINED)


@pytest.mark.parametrize("unit", ["degrees_N", "degree_E", "degreesN", "degreeE"])
def test_degrees_have_every_spelling_of_the_cf_conventions(unit):
    assert FACTORS["degree"][unit.lower()] == 1.0


@pytest.mark.parametrize(
    ("quantity", "unit", "value", "converted"), [
    ("length in m", "in", 10.0, 0.254),
    ("angle in degree", "rad", np.pi, 180.0),
    ("volume in cm3", "cc", 250.0, 250.0),
    ("pressure in dbar", "bar", 20.0, 200.0),
    ("position in degree", "lat", 2730.0, 27.5),
    ("state", "enum", 3.0, 3.0),
    ("state", None, 3.0, 3.0),
])  # fmt: skip
def test_conversions_of_slocum_sensors(quantity, unit, value, converted):
    assert conversion(quantity, unit, "x")(np.array([value])) == pytest.approx([converted], rel=1e-12)


def test_a_unit_of_another_quantity_is_refused():
    with pytest.raises(InputError, match="x is in 'rad', which is not a unit of length; it must be in one of m,"):
        conversion("length in m", "rad", "x")
    with pytest.raises(InputError, match="x declares no unit"):
        conversion("length in m", None, "x")
