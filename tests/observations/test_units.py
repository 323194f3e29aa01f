"""Unit conversion factors compared with the definitions of the units."""

import re

import netCDF4
import numpy as np
import pytest
from support import seaglider_files as made
from support.glides import Glide, mission
from support.observation_files import edited

from gliderhpc.api.currents import currents
from gliderhpc.errors import InputError
from gliderhpc.observations import open_observations
from gliderhpc.observations.files.columns import FACTORS, bare_unit
from gliderhpc.observations.format import VARIABLES
from gliderhpc.observations.instruments.og1 import import_og1
from gliderhpc.observations.instruments.slocum_files import conversion

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
    "degree": {
        "deg": 1.0,
        "degrees_true": 1.0,
        "degrees_north": 1.0,
        "rad": 180 / np.pi,
        "radians": 180 / np.pi,
        "gon": 360 / 400,
    },
    "degrees_north": {"degrees_north": 1.0, "degreen": 1.0, "rad": 180 / np.pi, "gon": 360 / 400},
    "degrees_east": {"degrees_east": 1.0, "degreee": 1.0, "rad": 180 / np.pi, "gon": 360 / 400},
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


@pytest.mark.parametrize(
    ("text", "unit"),
    [
        ("degrees clockwise from north", "degrees"),
        ("degree clockwise from true north", "degree"),
        ("degrees (clockwise from true north)", "degrees"),
        ("m (positive down)", "m"),
        ("m, positive downward", "m"),
        ("meters below sea surface", "meters"),
        ("degrees (nose up)", "degrees"),
        (" dbar ", "dbar"),
        ("degrees clockwise from magnetic north", "degrees clockwise from magnetic north"),
        ("m (positive up)", "m (positive up)"),
        ("positive down", "positive down"),
    ],
)
def test_a_sense_after_a_unit_is_dropped_if_it_is_the_usual_one(text, unit):
    assert bare_unit(text) == unit


@pytest.mark.parametrize(
    ("name", "unit", "accepted"),
    [
        ("heading", "degrees clockwise from north", True),
        ("heading", "degree_true", True),
        ("heading", "degree_T", True),
        ("heading", "degrees clockwise from magnetic north", False),
        ("depth", "m (positive down)", True),
        ("depth", "Meters", True),
        ("depth", "m (positive up)", False),
        ("depth", "decibar", False),
        ("pressure", "decibar", True),
        ("pressure", "dBar", True),
    ],
)
def test_spellings_of_units_in_observations_currents_and_og1(tmp_path, name, unit, accepted):
    """Each refusal is one line with the variable and its unit."""

    def declare(dataset):
        dataset[name].attrs["units"] = unit

    assert VARIABLES[name].accepts_unit(unit) == accepted
    if name == "pressure":
        assert unit.lower() in FACTORS["dbar"]
        return
    records = mission(Glide())
    declare(records)
    path = made.write_og1(tmp_path / "og1.nc")
    with netCDF4.Dataset(path, "a") as file:
        file[name.upper()].units = unit
    for outcome in (
        lambda: open_observations(edited(tmp_path, declare)).close(),
        lambda: currents(records),
        lambda: import_og1([path], tmp_path / "out.nc"),
    ):
        if accepted:
            outcome()
        else:
            with pytest.raises(InputError, match=f"{name} is in '{re.escape(unit)}'|{name.upper()} is in") as refused:
                outcome()
            assert "\n" not in str(refused.value)


def test_a_latitude_to_the_east_is_refused(tmp_path):
    records = mission(Glide())
    records["fix_latitude"].attrs["units"] = "degrees_east"
    with pytest.raises(InputError, match="fix_latitude is in 'degrees_east', which cannot be converted"):
        currents(records)
    path = made.write_og1(tmp_path / "og1.nc")
    with netCDF4.Dataset(path, "a") as file:
        file["LONGITUDE_GPS"].units = "degrees_north"
    with pytest.raises(InputError, match="LONGITUDE_GPS is in 'degrees_north', which cannot be converted"):
        import_og1([path], tmp_path / "out.nc")
