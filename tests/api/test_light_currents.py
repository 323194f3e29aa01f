"""`gliderhpc.currents`: currents from pitch, heading, depth and fixes alone, of glides made without the package."""

import itertools
import subprocess
import sys

import numpy as np
import pytest
import xarray as xr
from support.glides import Glide, angle_of_attack, mission

import gliderhpc as gh
from gliderhpc.api.currents import currents
from gliderhpc.errors import InputError


def _pyglider(dataset: xr.Dataset) -> xr.Dataset:
    """The same records as pyglider writes them: no fixes, but a position at every sample."""
    at, samples = dataset["fix_time"].values.astype(float), dataset["time"].values.astype(float)
    return dataset.drop_dims("fix").assign(
        latitude=("time", np.interp(samples, at, dataset["fix_latitude"].values), {"units": "degrees_north"}),
        longitude=("time", np.interp(samples, at, dataset["fix_longitude"].values), {"units": "degrees_east"}),
        profile_index=("time", np.ones(len(samples))),
    )


def _og1(dataset: xr.Dataset) -> xr.Dataset:
    """The same records by the names of OG1, the fixes on the dimension of the samples."""
    samples = dataset.drop_dims("fix").rename({"time": "N_MEASUREMENTS"})
    count = samples.sizes["N_MEASUREMENTS"]
    padded = {name: np.full(count, np.nan) for name in ("LATITUDE_GPS", "LONGITUDE_GPS")}
    time = np.full(count, np.datetime64("NaT", "ns"), dtype="datetime64[ns]")
    fixes = dataset.sizes["fix"]
    padded["LATITUDE_GPS"][:fixes], padded["LONGITUDE_GPS"][:fixes] = dataset["fix_latitude"], dataset["fix_longitude"]
    time[:fixes] = dataset["fix_time"]
    return xr.Dataset(
        {
            "TIME": ("N_MEASUREMENTS", samples["N_MEASUREMENTS"].values),
            "PRES": ("N_MEASUREMENTS", samples["depth"].values * 1.0065, {"units": "dbar"}),
            "GLIDER_PITCH": ("N_MEASUREMENTS", np.radians(samples["pitch"].values), {"units": "rad"}),
            "HEADING": ("N_MEASUREMENTS", samples["heading"].values, {"units": "degrees"}),
            "TIME_GPS": ("N_MEASUREMENTS", time),
            **{name: ("N_MEASUREMENTS", column) for name, column in padded.items()},
            "PLATFORM_MODEL": ((), "Teledyne Slocum G2"),
        }
    )


@pytest.mark.parametrize("as_written", [lambda records: records, _og1], ids=["observations", "og1"])
def test_the_current_of_a_steady_glide_is_found(as_written):
    # Eqs. 15, 39 and 40.
    glide = Glide()
    found = currents(as_written(mission(glide)))
    np.testing.assert_allclose(found["dac_north"], glide.current[0], atol=4e-3)
    np.testing.assert_allclose(found["dac_east"], glide.current[1], atol=4e-3)
    assert (found["dac_north_std"] < 0.03).all()
    assert found["dac_north"].attrs["standard_name"] == "northward_sea_water_velocity"
    assert found["dac_north"].attrs["units"] == "m s-1"


def test_positions_without_a_receiver_are_taken_at_the_surface_with_a_larger_error():
    glide = Glide()
    found, exact = currents(_pyglider(mission(glide))), currents(mission(glide))
    np.testing.assert_allclose(found["dac_north"], glide.current[0], atol=0.02)
    assert (found["dac_north_std"] > exact["dac_north_std"]).all()
    assert "no variables of the GPS receiver" in found.attrs["comment"]


def test_speed_and_angle_of_attack_are_those_of_the_glide():
    records = mission(Glide())
    found = currents(records)
    steady = found.isel(time=(found["depth"] > 30.0) & (found["depth"] < 370.0))
    np.testing.assert_allclose(steady["speed_through_water"], records.attrs["speed"], rtol=0.01)
    np.testing.assert_allclose(np.abs(steady["angle_of_attack"]), records.attrs["angle_of_attack"], rtol=0.01)


def test_the_track_under_water_leads_from_fix_to_fix():
    found = currents(mission(Glide()))
    for number in found["profile"].values:
        row = found.sel(profile=number)
        track = found.isel(time=found["profile_number"] == number)
        # The first and the last sample lie a few seconds of drift from the fixes.
        assert float(track["latitude"][-1]) == pytest.approx(float(row["exit_latitude"]), abs=1e-4)
        assert float(track["longitude"][0]) == pytest.approx(float(row["entry_longitude"]), abs=1e-4)


def test_the_stated_ellipse_holds_what_it_says_where_hull_compass_and_fixes_are_off():
    """39 % of the currents within the 1-sigma ellipse, 86 % within that of 2 sigma: chi-square of two dimensions."""
    rng = np.random.default_rng(5)
    distances = []
    for seed in range(60):
        glide = Glide(
            dives=1, interval=10.0, pitch=float(rng.uniform(26.0, 34.0)),
            drag=float(np.exp(0.35 * rng.standard_normal())),
            pitch_offset=0.7 * rng.standard_normal(), heading_offset=3.0 * rng.standard_normal(), fix_error=5.0,
            current=tuple(0.15 * rng.standard_normal(2)), seed=seed,
        )  # fmt: skip
        row = currents(mission(glide)).isel(profile=0)
        error = np.array([float(row["dac_north"]), float(row["dac_east"])]) - glide.current
        a, b, c = (float(row[name]) for name in ("dac_north_std", "dac_covariance", "dac_east_std"))
        distances.append(error @ np.linalg.solve([[a * a, b], [b, c * c]], error))
    # Binomial deviations of 60 draws: 0.063 and 0.045; the water's vertical velocity, which is budgeted, is absent.
    assert 0.25 < np.mean(np.array(distances) < 1.0) < 0.65
    assert np.mean(np.array(distances) < 4.0) > 0.75


def test_a_parked_glider_does_not_move_by_itself():
    glide = Glide(depth=100.0, park=3600.0)
    found = currents(mission(glide))
    np.testing.assert_allclose(found["dac_north"], glide.current[0], atol=5e-3)
    np.testing.assert_allclose(found["dac_east"], glide.current[1], atol=5e-3)
    messages = [str(message) for message in found["message"].values]
    assert all("at 100 m (parked, on the bottom, under ice or at a density step" in message for message in messages)


@pytest.mark.parametrize("missing", [0.2, 0.4, 0.7])
def test_the_unrecorded_part_of_a_dive_is_in_the_error(missing):
    """Without the last part of a dive the current is wrong, by up to a decimetre per second."""
    glide = Glide(depth=100.0)
    records = mission(glide)
    whole = currents(records)
    records["profile"] = whole["profile_number"].reindex(time=records["time"], fill_value=0)
    rows = np.flatnonzero((records["profile"] == 2).values)
    cut = currents(records.drop_isel(time=rows[int((1.0 - missing) * len(rows)) :])).sel(profile=2)
    error = np.array([float(cut["dac_north"]), float(cut["dac_east"])]) - glide.current
    assert np.linalg.norm(error) > 0.03
    assert (np.abs(error) < 2.0 * np.array([float(cut["dac_north_std"]), float(cut["dac_east_std"])])).all()
    assert float(cut["dac_north_std"]) > 2.0 * float(whole["dac_north_std"].sel(profile=2))
    assert "the record ends at" in str(cut["message"].values)


def test_a_gap_about_the_deepest_point_is_bridged():
    """Its ends are equally deep, but the glider was not stationary."""
    glide = Glide()
    records = mission(glide)
    whole = currents(records)
    records["profile"] = whole["profile_number"].reindex(time=records["time"], fill_value=0)
    turns = [
        whole["time"].values[rows][np.argmax(whole["depth"].values[rows])]
        for rows in (whole["profile_number"].values == number for number in (1, 2, 3))
    ]
    near = np.min([np.abs(records["time"].values - turn) for turn in turns], axis=0) < np.timedelta64(600, "s")
    found = currents(records.isel(time=~near))
    np.testing.assert_allclose(found["dac_north"], glide.current[0], atol=0.02)
    np.testing.assert_allclose(found["dac_east"], glide.current[1], atol=0.02)
    assert not any("stationary" in str(message) for message in found["message"].values)


def test_a_dive_whose_attitude_ends_before_its_depth():
    glide = Glide(depth=100.0)
    records = mission(glide)
    whole = currents(records)
    numbers = whole["profile_number"].reindex(time=records["time"], fill_value=0)
    rows = np.flatnonzero((numbers == 2).values)
    records["pitch"][rows[int(0.7 * len(rows)) :]] = np.nan
    row = currents(records).sel(profile=2)
    error = np.array([float(row["dac_north"]), float(row["dac_east"])]) - glide.current
    assert (np.abs(error) < 2.0 * np.array([float(row["dac_north_std"]), float(row["dac_east_std"])])).all()
    assert "the record of the attitude ends at" in str(row["message"].values)


def test_a_current_as_strong_as_wrong_fixes_make_it_is_in_doubt():
    records = mission(Glide())
    between = slice(2, 4)
    records["fix_latitude"][between] += 0.1
    messages = [str(message) for message in currents(records)["message"].values]
    assert all("check the fixes before and after the dive" in message for message in messages[:2])
    assert messages[2] == ""


def test_a_declination_turns_the_heading():
    records = mission(Glide(heading_offset=-12.0))
    found = currents(records, declination=12.0)
    np.testing.assert_allclose(found["dac_east"], -0.07, atol=4e-3)


def test_a_hull_is_taken_as_it_is():
    found = currents(mission(Glide()), platform="slocum")
    assert found.attrs["drag_over_lift_hull"] == "slocum"
    assert found.attrs["drag_over_lift"] == pytest.approx(7.7 / 386.0)
    np.testing.assert_allclose(found["dac_north"], 0.12, atol=4e-3)


@pytest.mark.parametrize(
    ("corrupt", "names"),
    [
        (lambda d: d.drop_vars(["heading", "pitch"]), ("pitch, heading",)),
        (lambda d: d.drop_dims("fix"), ("GPS fixes",)),
        (lambda d: d.assign(pitch=d["pitch"] * np.pi / 180.0), ("radians", "units")),
        (lambda d: d.assign(depth=d["depth"].assign_attrs(units="furlong")), ("furlong", "'m'")),
        (lambda d: d.assign(depth=-d["depth"]), ("positive down",)),
        (lambda d: d.isel(time=slice(0, 5)), ("5 samples",)),
        (lambda d: d.assign(depth=d["depth"] * np.nan), ("no value",)),
        (lambda d: d.assign(depth=d["depth"] * 0.01), ("no dive",)),
    ],
)
def test_missing_variables_are_named_in_one_line(corrupt, names):
    records = mission(Glide(dives=1))
    with pytest.raises(InputError) as refused:
        currents(corrupt(records))
    assert "\n" not in str(refused.value)
    assert all(name in str(refused.value) for name in names)


def test_a_depth_declared_positive_up_and_fill_values_are_understood():
    records = mission(Glide(dives=1, interval=20.0))
    upwards = records.assign(depth=(-records["depth"]).assign_attrs(units="m", positive="up"))
    xr.testing.assert_allclose(currents(upwards)["dac_north"], currents(records)["dac_north"])
    filled = records.assign(depth=xr.where(np.arange(records.sizes["time"]) % 7 == 3, -9999.0, records["depth"]))
    np.testing.assert_allclose(currents(filled)["dac_north"], 0.12, atol=0.01)


def test_a_dive_without_a_fix_has_a_track_and_no_current():
    records = mission(Glide(dives=2))
    found = currents(records.isel(fix=slice(0, 4)))
    assert np.isfinite(found["dac_north"].values[0])
    assert np.isnan(found["dac_north"].values[1])
    assert "no GPS fix after" in str(found["message"].values[1])


def test_shuffled_and_repeated_samples_change_nothing():
    records = mission(Glide(dives=1))
    order = np.random.default_rng(3).permutation(records.sizes["time"])
    found = currents(records.isel(time=np.concatenate([order, order[:20]])))
    xr.testing.assert_allclose(found["dac_north"], currents(records)["dac_north"])


def test_the_command_writes_what_the_function_gives_and_compiles_nothing(tmp_path):
    records = mission(Glide(dives=2))
    source, out = tmp_path / "records.nc", tmp_path / "out.nc"
    records.to_netcdf(source)
    script = (
        "import sys\nfrom numba.core import event\nfrom numba.core.event import RecordingListener\n"
        "listener = RecordingListener()\nevent.register('numba:compile', listener)\n"
        "from gliderhpc.cli.main import main\n"
        "try:\n    main(sys.argv[1:])\nexcept SystemExit as end:\n    print('status', end.code)\n"
        "print('compiled', len(listener.buffer))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script, "currents", str(source), str(out)], capture_output=True, text=True, check=True
    )
    assert "status 0" in done.stdout
    assert "compiled 0" in done.stdout
    with xr.open_dataset(out) as written:
        np.testing.assert_allclose(written["dac_north"], currents(records)["dac_north"])
        assert written["entry_time"].dtype.kind == "M"


def test_the_public_name_is_the_function():
    assert gh.currents is currents


@pytest.mark.parametrize(
    ("folder", "pattern", "usable"),
    [
        ("pyglider-l0", "*.nc", True),
        ("seaglider-sg033-og1-2010", "*.nc", True),
        ("og1-examples", "*.nc", False),
        ("ioos-ngdac", "*.nc", False),
        ("voto-nrt", "*.nc", False),
    ],
)
def test_every_real_file_gives_a_current_or_one_line(shared_data, folder, pattern, usable):
    for path in sorted((shared_data / folder).glob(pattern)):
        if usable:
            found = currents(path)
            fast = np.hypot(found["dac_north"], found["dac_east"])
            assert float(np.isfinite(fast).mean()) > 0.9
            assert float(fast.max()) < 1.0
        else:
            with pytest.raises(InputError, match="a depth-averaged current needs"):
                currents(path)


def _with_velocity(records: xr.Dataset, glide: Glide, **offsets: float) -> xr.Dataset:
    """Add the true velocity relative to the water to the records of a steady glide, with offsets by component."""
    diving = np.gradient(records["depth"].values) > 0.0
    climbing = np.gradient(records["depth"].values) < 0.0
    sign = diving.astype(float) - climbing
    alpha = sign * angle_of_attack(-np.radians(glide.pitch), glide.drag)
    rate = np.gradient(records["depth"].values, glide.interval)
    path = np.radians(records["pitch"].values) - alpha
    with np.errstate(divide="ignore", invalid="ignore"):
        speed = np.where(sign == 0.0, np.nan, -rate / np.sin(path))
    units = {"units": "m s-1"}
    return records.assign(
        relative_velocity_u=("time", speed * np.cos(alpha) + offsets.get("u", 0.0), units),
        relative_velocity_v=("time", np.zeros_like(speed), units),
        relative_velocity_w=("time", speed * np.sin(alpha) + offsets.get("w", 0.0), units),
    )


def test_a_measured_velocity_gives_drag_over_lift():
    """With twice the drag of the make; a constant error of the sensor's axis is the same on dive and climb."""
    glide = Glide(drag=2.0)
    records = mission(glide)
    plain, exact = currents(records), currents(_with_velocity(records, glide))
    shifted = currents(_with_velocity(records, glide, w=0.004))
    usual = plain.attrs["drag_over_lift"]
    assert exact.attrs["drag_over_lift"] / usual == pytest.approx(2.0, rel=0.05)
    assert shifted.attrs["drag_over_lift"] / usual == pytest.approx(2.0, rel=0.05)
    assert exact.attrs["drag_over_lift_relative_std"] < 0.1 < plain.attrs["drag_over_lift_relative_std"]
    assert "in 3 profiles" in exact.attrs["comment"]
    off, right = (np.abs(found["dac_north"] - glide.current[0]).max() for found in (plain, exact))
    assert right < 8e-3 < 0.5 * off
    assert (exact["dac_north_std"] < plain["dac_north_std"]).all()


def test_a_velocity_that_contradicts_the_depth_rate_is_not_used():
    glide = Glide(drag=2.0)
    records = _with_velocity(mission(glide), glide)
    records["relative_velocity_w"] = -records["relative_velocity_w"]
    found = currents(records)
    assert "contradicts the depth rate" in found.attrs["comment"]
    assert found.attrs["drag_over_lift"] == currents(mission(glide)).attrs["drag_over_lift"]


def test_a_log_filled_with_zeros_is_not_used():
    glide = Glide()
    records = _with_velocity(mission(glide), glide)
    records["relative_velocity_w"] = 0.0 * records["relative_velocity_w"]
    found = currents(records)
    assert "is not used" in found.attrs["comment"]
    np.testing.assert_array_equal(found["dac_north"], currents(mission(glide))["dac_north"])


def test_a_velocity_that_cannot_be_read_is_named_and_costs_nothing():
    glide = Glide()
    records = _with_velocity(mission(glide), glide)
    records["relative_velocity_u"].attrs["units"] = "knot"
    elsewhere = records.drop_vars("relative_velocity_u").assign(
        relative_velocity_u=("ping", np.full(7, 0.3), {"units": "m s-1"})
    )
    for given, why in ((records, "in 'knot'"), (elsewhere, "does not lie along time")):
        found = currents(given)
        assert why in found.attrs["comment"]
        np.testing.assert_array_equal(found["dac_north"], currents(mission(glide))["dac_north"])


def test_centimetres_per_second_are_converted():
    glide = Glide(drag=2.0)
    records = _with_velocity(mission(glide), glide)
    exact = currents(records).attrs["drag_over_lift"]
    for name in ("relative_velocity_u", "relative_velocity_v", "relative_velocity_w"):
        records[name] = 100.0 * records[name]
        records[name].attrs["units"] = "cm/s"
    assert currents(records).attrs["drag_over_lift"] == pytest.approx(exact)


def test_fixes_beyond_a_dive_without_heading_are_those_of_another_surfacing():
    """Dive 2 lacks its heading; its fixes, of both surfacings, had become those of the dives next to it."""
    records = mission(Glide())
    whole = currents(records)
    at = records["time"].values
    second = (at > whole["entry_time"].values[1]) & (at < whole["exit_time"].values[1])
    broken = records.assign(heading=("time", np.where(second, np.nan, records["heading"]), {"units": "degree"}))
    found = currents(broken)
    assert list(found["profile"].values) == [1, 3]
    for name in ("surface_drift_north", "surface_drift_east", "dac_north"):
        np.testing.assert_allclose(found[name], whole[name].sel(profile=[1, 3]))
    # Without the fixes between dives 1 and 2 the current of dive 1 is not known.
    unknown = currents(broken.isel(fix=[0, 1, 4, 5, 6, 7]))
    assert np.isnan(unknown["dac_north"].sel(profile=1))
    assert np.isfinite(unknown["dac_north"].sel(profile=3))


def test_fixes_after_a_pause_that_a_missing_dive_leaves_are_not_used():
    records = mission(Glide())
    whole = currents(records)
    at = records["time"].values
    gone = (at > whole["exit_time"].values[0] + np.timedelta64(200, "s")) & (at < whole["entry_time"].values[2])
    found = currents(records.isel(time=np.flatnonzero(~gone)))
    assert len(whole["profile"]) == 3
    assert len(found["profile"]) == 2
    for name in ("surface_drift_north", "surface_drift_east"):
        np.testing.assert_allclose(found[name].values[0], whole[name].values[0])


def test_times_are_those_of_the_records():
    """To the nanosecond: xarray would align any other time to NaN."""
    records = mission(Glide())
    uneven = np.random.default_rng(4).integers(0, 10**9, records.sizes["time"]).astype("timedelta64[ns]")
    records = records.assign_coords(time=("time", records["time"].values + uneven, records["time"].attrs))
    assert np.isin(currents(records)["time"].values, records["time"].values).all()


def test_a_file_of_a_surfacing_alone_gives_its_fixes(tmp_path):
    records = mission(Glide())
    whole = currents(records)
    at_surface = np.flatnonzero(records["depth"].values == 0.5)
    middle = np.split(at_surface, np.flatnonzero(np.diff(at_surface) > 1) + 1)[1]
    cuts = [0, middle[0], middle[-1] + 1, records.sizes["time"]]
    paths = []
    for part, (start, stop) in enumerate(itertools.pairwise(cuts)):
        cut = records.isel(time=slice(start, stop))
        begin, end = cut["time"].values[[0, -1]]
        inside = (records["fix_time"].values >= begin) & (records["fix_time"].values <= end)
        paths.append(tmp_path / f"part{part}.nc")
        cut.isel(fix=np.flatnonzero(inside)).to_netcdf(paths[-1])
    found = currents(paths)
    np.testing.assert_allclose(found["dac_north"], whole["dac_north"], atol=1e-4)
    with pytest.raises(InputError, match="no dive below 10 m"):
        currents([paths[1]])
