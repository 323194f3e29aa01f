"""`gliderhpc.currents` on faulty records: units, dropouts, clocks, declinations, and rejected fixes."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from support import observation_files, seaglider_files, slocum_files
from support.glides import Glide, mission

from gliderhpc.api.currents import currents, navigation_of
from gliderhpc.errors import InputError

GLIDE = Glide()


def _messages(found: xr.Dataset) -> list[str]:
    return [str(message) for message in found["message"].values]


def _check_current(found: xr.Dataset, atol: float = 5e-3) -> None:
    np.testing.assert_allclose(found["dac_north"], GLIDE.current[0], atol=atol)
    np.testing.assert_allclose(found["dac_east"], GLIDE.current[1], atol=atol)


def _without_units(values: xr.DataArray) -> xr.DataArray:
    return values.assign_attrs(units="")


def _pressure(records: xr.Dataset, factor: float, unit: str) -> xr.Dataset:
    """Replace the depth by a pressure, which is the depth times a factor."""
    attributes = {"units": unit} if unit else {}
    return records.drop_vars("depth").assign(pressure=("time", factor * records["depth"].values, attributes))


# Files


def test_files_of_two_gliders_at_one_time_are_refused_and_of_one_are_joined(tmp_path):
    records = mission(Glide(dives=2, depth=300.0, interval=8.0))
    half = records.sizes["time"] // 2
    records.to_netcdf(tmp_path / "a.nc")
    other = records.assign(depth=records["depth"].roll(time=half // 2))
    other = other.assign_coords(time=records["time"] + np.timedelta64(3, "s"))
    other.to_netcdf(tmp_path / "b.nc")
    records.assign(depth=records["depth"].roll(time=half // 2)).to_netcdf(tmp_path / "same-clock.nc")
    for name in ("b.nc", "same-clock.nc"):
        with pytest.raises(InputError, match=rf"a.nc and .*{name}: overlap in time, and their depths differ"):
            currents([tmp_path / "a.nc", tmp_path / name])
    near = records.assign(depth=records["depth"].round(2)).assign_coords(time=records["time"] + np.timedelta64(1, "ms"))
    near.to_netcdf(tmp_path / "near.nc")
    assert currents([tmp_path / "a.nc", tmp_path / "near.nc"]).sizes["profile"] == 2
    records.isel(time=slice(None, None, 2)).to_netcdf(tmp_path / "even.nc")
    records.isel(time=slice(1, None, 2)).to_netcdf(tmp_path / "odd.nc")
    whole, joined = currents(tmp_path / "a.nc"), currents([tmp_path / "even.nc", tmp_path / "odd.nc"])
    np.testing.assert_allclose(joined["dac_north"], whole["dac_north"], atol=1e-9)


def test_a_missions_faults_are_searched_once_for_all_its_dives(monkeypatch):
    calls = []
    monkeypatch.setattr(
        "gliderhpc.observations.navigation.records.frozen_profiles", lambda *_: calls.append(None) or {}
    )
    currents(mission(Glide(dives=3, interval=8.0)))
    assert len(calls) == 1


def test_times_in_another_unit_than_declared_are_named_with_it(tmp_path):
    records = mission(Glide(dives=1, interval=8.0))
    milliseconds = records["time"].values.astype("datetime64[ms]").astype(np.float64)
    unit = {"units": "seconds since 1970-01-01"}
    records.drop_vars("time").assign(time=("time", milliseconds, unit)).to_netcdf(tmp_path / "a.nc")
    with pytest.raises(InputError, match="too few for a current; time is in 'seconds since 1970-01-01': correct its u"):
        currents(tmp_path / "a.nc")


def test_profile_numbers_in_halves_are_refused(tmp_path):
    """As pyglider counts: rounded down, two profiles would become one."""
    path = observation_files.edited(tmp_path, lambda dataset: dataset.assign(profile=dataset["profile"] / 2.0))
    with pytest.raises(InputError, match=r"profile is 0.5 at sample \d+; it must be a whole number"):
        currents(path)


# Units


@pytest.mark.parametrize(
    ("corrupt", "names"),
    [
        (lambda d: d.assign(heading=np.radians(d["heading"]).assign_attrs(units="degree")), ("heading", "radians")),
        (lambda d: d.assign(heading=_without_units(np.radians(d["heading"]))), ("heading", "radians")),
        (
            lambda d: d.assign(
                pitch=("time", 10.0 * d["pitch"].values + np.arange(d.sizes["time"]) % 40, {"units": "degree"})
            ),
            ("pitch is outside",),
        ),
        (lambda d: d.assign(depth=(100.0 * d["depth"]).assign_attrs(units="m")), ("typically", "11000 m")),
        (lambda d: d.assign(depth=(3.2808 * d["depth"]).assign_attrs(units="m")), ("speed through the water of 1.",)),
        (lambda d: _pressure(d, 0.101, ""), ("profile 1", "slow", "unit of depth")),
        (lambda d: _pressure(d, 10.1, ""), ("faster than any glider",)),
        (lambda d: _pressure(d, 10_100.0, ""), ("11500 dbar", "'Pa'")),
        (
            lambda d: d.assign(
                depth=(3.2808 * d["depth"]).assign_attrs(units="m"), pressure=1.01 * _without_units(d["depth"])
            ),
            ("in feet",),
        ),
        (
            lambda d: d.assign(
                depth=(d["depth"] / 1.8288).assign_attrs(units="m"), pressure=1.01 * _without_units(d["depth"])
            ),
            ("in fathoms",),
        ),
    ],
    ids=["radians", "radians, no unit", "tenths of a degree", "cm", "feet", "bar", "kPa", "Pa", "feet and dbar",
         "fathoms and dbar"],
)  # fmt: skip
def test_a_quantity_in_another_unit_is_refused(corrupt, names):
    # Headings all round, at 0.36 m/s.
    records = mission(Glide(dives=9, depth=300.0, interval=8.0))
    with pytest.raises(InputError) as refused:
        currents(corrupt(records))
    assert "\n" not in str(refused.value)
    assert all(name in str(refused.value) for name in names), str(refused.value)


def test_quantities_without_a_unit_are_named():
    records = mission(GLIDE)
    found = currents(_pressure(records, 1.0065, ""))
    assert "no units are declared for pressure (taken as dbar)" in found.attrs["comment"]
    _check_current(found)
    assert currents(_pressure(records, 1.0065, "dbar")).attrs["comment"] == "none"


def test_a_pressure_in_an_unknown_unit_is_not_compared_with_the_depth():
    records = mission(GLIDE)
    found = currents(records.assign(pressure=(17.0 * records["depth"]).assign_attrs(units="counts")))
    assert "pressure is in 'counts', which cannot be converted to 'dbar', so the depth is not" in found.attrs["comment"]
    np.testing.assert_array_equal(found["dac_north"].values, currents(records)["dac_north"].values)


def test_a_pressure_that_contradicts_the_depth_is_named():
    records = mission(GLIDE)
    absolute = records.assign(pressure=(1.01 * records["depth"] + 10.1).assign_attrs(units="dbar"))
    found = currents(absolute)
    assert "-10.0 m off that by pressure" in found.attrs["comment"]
    _check_current(found)
    agreeing = records.assign(pressure=(1.01 * records["depth"]).assign_attrs(units="dbar"))
    assert currents(agreeing).attrs["comment"] == "none"


def test_an_unusual_speed_is_named():
    records = mission(GLIDE)
    found = currents(records.assign(depth=(2.0 * records["depth"]).assign_attrs(units="m")))
    assert "which is unusual for a glider" in found.attrs["comment"]


# Depth


@pytest.mark.parametrize(("share", "offset"), [(0.003, None), (0.01, None), (0.01, 100.0)])
def test_dropouts_and_spikes_of_the_depth_do_not_change_the_current(share, offset):
    records = mission(GLIDE)
    clean = currents(records)
    bad = np.random.default_rng(0).random(records.sizes["time"]) < share
    depth = records["depth"].values.copy()
    depth[bad] = 0.0 if offset is None else depth[bad] + offset
    found = currents(records.assign(depth=("time", depth, {"units": "m"})))
    assert (np.abs(found["dac_north"] - clean["dac_north"]) < 0.3 * clean["dac_north_std"]).all()
    assert (np.abs(found["dac_east"] - clean["dac_east"]) < 0.3 * clean["dac_east_std"]).all()
    assert all("left out" in message for message in _messages(found))
    assert "depths that no glider can have reached" in found.attrs["comment"]
    assert clean.attrs["comment"] == "none"


def test_a_noisy_depth_does_not_make_the_glider_faster():
    """At 1 Hz, noise of 2 m used to add its magnitude to the vertical speed."""
    glide = Glide(dives=1, depth=200.0, interval=1.0)
    records = mission(glide)
    clean = currents(records)
    noise = 2.0 * np.random.default_rng(2).standard_normal(records.sizes["time"])
    found = currents(records.assign(depth=("time", records["depth"].values + noise, {"units": "m"})))
    assert (np.abs(found["dac_north"] - clean["dac_north"]) < clean["dac_north_std"]).all()
    assert "noisy and is smoothed over" in _messages(found)[0]
    assert _messages(clean) == [""]


# Fixes


@pytest.mark.parametrize("late", [600, 3600, -3600])
def test_fixes_by_another_clock_are_not_used(late):
    records = mission(Glide(dives=6))
    found = currents(records.assign_coords(fix_time=records["fix_time"] + np.timedelta64(late, "s")))
    assert np.isnan(found["dac_north"].values).all()
    assert sum("clocks of fixes and samples disagree" in message for message in _messages(found)) >= 5


def _gps_in_every_row(records: xr.Dataset) -> xr.Dataset:
    at, samples = records["fix_time"].values.astype(float), records["time"].values.astype(float)
    return records.drop_dims("fix").assign(
        LATITUDE_GPS=("time", np.interp(samples, at, records["fix_latitude"].values), {"units": "degrees_north"}),
        LONGITUDE_GPS=("time", np.interp(samples, at, records["fix_longitude"].values), {"units": "degrees_east"}),
    )


def test_positions_of_the_receiver_under_water_are_not_used():
    """Filled in between the fixes, they had been taken as fixes right before and after the dive, and inside it."""
    records = mission(GLIDE)
    found = currents(_gps_in_every_row(records))
    _check_current(found, atol=0.02)
    assert "positions under water, which no GPS receiver gives" in found.attrs["comment"]
    assert found.attrs["error_fix"] == 50.0


def test_the_reason_for_a_fix_that_is_left_out_is_given():
    records = mission(GLIDE)
    # The second surfacing repeats the position of the first.
    for name in ("fix_latitude", "fix_longitude"):
        records[name][2:4] = records[name][1]
    messages = _messages(currents(records))
    assert "repeats the position of" in messages[0]
    assert "repeats the position of" in messages[1]
    assert "no GPS fix before the profile" in messages[1]


def test_fixes_that_are_not_on_the_globe_are_named():
    records = mission(GLIDE)
    found = currents(records.assign(fix_latitude=100.0 * records["fix_latitude"]))
    assert np.isnan(found["dac_north"].values).all()
    assert "fix_latitude is 5800 degree at fix 0, outside -90 to 90" in found.attrs["comment"]
    assert "convert them from DDMM.mmm to decimal degrees" in found.attrs["comment"]


def test_positions_at_the_surface_of_a_sensor_with_an_offset():
    """Three metres too deep, no sample lies above 2 m."""
    records = _gps_in_every_row(mission(GLIDE)).rename(LATITUDE_GPS="latitude", LONGITUDE_GPS="longitude")
    found = currents(records)
    deeper = currents(records.assign(depth=(records["depth"] + 3.0).assign_attrs(units="m")))
    np.testing.assert_allclose(deeper["dac_north"], found["dac_north"], atol=2e-3)
    np.testing.assert_allclose(deeper["dac_east"], found["dac_east"], atol=2e-3)
    assert "the depth is nowhere less than 3" in deeper.attrs["comment"]


# Declination


def _turned(**attributes: str) -> xr.Dataset:
    """Records whose heading lacks a declination of 16 degrees."""
    records = mission(Glide(heading_offset=-16.0))
    records["heading"].attrs |= attributes
    return records


@pytest.mark.parametrize("text", ["true heading, corrected for magnetic declination", "not magnetic"])
@pytest.mark.parametrize("given", [None, 16.0])
def test_nothing_is_added_to_a_true_heading(text, given):
    records = mission(GLIDE).assign(magnetic_variation=((), 16.0))
    records["heading"].attrs["comment"] = text
    found = currents(records, declination=given)
    _check_current(found)
    assert found.attrs["declination_added"] == 0.0
    assert ("16 degrees, is not added" in found.attrs["comment"]) == (given is not None)


def test_a_given_declination_is_not_added_to_a_heading_that_an_importer_has_corrected():
    records = mission(GLIDE).assign_attrs(
        heading_comment="magnetic heading plus the declination in the same row of the file"
    )
    found = currents(records, declination=16.0)
    _check_current(found)
    assert "not added" in found.attrs["comment"]


@pytest.mark.parametrize(
    ("name", "value", "units"),
    [
        ("magnetic_variation", 16.0, "degree"),
        ("magnetic_variation", np.radians(16.0), "rad"),
        ("m_gps_mag_var", np.radians(-16.0), "rad"),
    ],
)
def test_the_declination_in_the_file_is_added_in_its_unit_and_sign(name, value, units):
    found = currents(_turned(comment="magnetic").assign({name: ((), value, {"units": units})}))
    _check_current(found)
    assert found.attrs["declination_added"] == pytest.approx(16.0)


def test_a_given_declination_replaces_the_one_in_the_file_and_no_other_is_asked_for():
    for records in (_turned(comment="magnetic"), _turned(comment="magnetic").assign(declination=((), 3.0))):
        found = currents(records, declination=16.0)
        _check_current(found)
        assert found.attrs["declination_added"] == 16.0
        assert "give declination" not in found.attrs["comment"].replace("--", "")


def test_a_magnetic_heading_without_a_declination_has_a_remark():
    for attributes in ({"comment": "magnetic"}, {"source": "Heading"}, {"source": "m_heading"}):
        found = currents(_turned(**attributes))
        assert "the file has no declination: give declination" in str(found.attrs["comment"]).replace("`", "")
    assert currents(_turned(source="Compass")).attrs["comment"] == "none"


def _heading(path: Path, given: float | None) -> np.ndarray:
    heading = np.degrees(navigation_of([path], given).heading)
    return heading[np.isfinite(heading)]


def test_a_given_declination_replaces_the_one_in_a_slocums_own_files(tmp_path):
    flown = slocum_files.flight()
    path = slocum_files.write_netcdf(tmp_path / "unit.nc", flown)
    measured, turned, recorded = _heading(path, 0.0), _heading(path, 3.0), _heading(path, None)
    assert np.mod(turned - measured, 360.0) == pytest.approx(3.0)
    assert np.mod(recorded - measured, 360.0) == pytest.approx(
        np.mod(-np.degrees(np.nanmedian(flown["m_gps_mag_var"])), 360.0)
    )


def test_a_given_declination_replaces_the_one_in_a_seagliders_own_files(tmp_path):
    path = seaglider_files.write_dive(tmp_path, 1, columns=True)
    turned = _heading(path, None) - _heading(path, 3.0)
    assert np.mod(turned, 360.0) == pytest.approx(seaglider_files.DECLINATION - 3.0)
    assert not any("is not added" in remark for remark in navigation_of([path], 3.0).remarks)
