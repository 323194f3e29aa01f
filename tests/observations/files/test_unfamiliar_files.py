"""Files of other programs: unusual types, attributes, spellings and orders."""

import gzip

import netCDF4
import numpy as np
import pytest
import xarray as xr
from support import observation_files
from support import seaglider_files as made
from support.glides import Glide, mission
from support.missions import program
from support.seaexplorer_files import NAVIGATION, edit, write_mission
from support.slocum_files import flight, joined, science, write_netcdf

from gliderhpc.api.currents import currents
from gliderhpc.errors import InputError
from gliderhpc.observations import open_observations
from gliderhpc.observations.files.foreign import ForeignFile
from gliderhpc.observations.files.tables import read_table
from gliderhpc.observations.in_memory import read_records as open_records
from gliderhpc.observations.instruments.og1 import import_og1
from gliderhpc.observations.instruments.seaexplorer import import_seaexplorer
from gliderhpc.observations.instruments.seaglider import import_seaglider
from gliderhpc.observations.instruments.slocum import import_slocum
from gliderhpc.watch.records import FileImport

GLIDE = Glide()


def rewritten(path, change):
    """A file after a change of its variables."""
    with netCDF4.Dataset(path, "a") as file:
        change(file)
    return path


def in_single_precision(path, *names):
    with xr.open_dataset(path, decode_times=False) as stored:
        dataset = stored.load()
    dataset.to_netcdf(path, encoding={name: {"dtype": "f4"} for name in names})
    return path


def test_times_in_single_precision_are_refused_by_every_importer(tmp_path):
    """Seconds since 1970 as float32 have 128 s."""
    out = tmp_path / "out.nc"
    slocum = in_single_precision(write_netcdf(tmp_path / "slocum.nc", flight()), "m_present_time")
    with pytest.raises(InputError, match=r"m_present_time is stored as float32, which resolves .* to 128 s only"):
        import_slocum([slocum], out)
    og1 = in_single_precision(made.write_og1(tmp_path / "og1.nc"), "TIME")
    with pytest.raises(InputError, match="TIME is stored as float32"):
        import_og1([og1], out)
    dive = in_single_precision(made.write_dive(tmp_path / "sg", 1, columns=True), "time")
    with pytest.raises(InputError, match="time is stored as float32"):
        import_seaglider([dive.parent], out)
    assert not out.exists()


def test_compressed_files_beside_others_are_named_once(tmp_path, caplog):
    for dive in (1, 2, 3):
        path = made.write_dive(tmp_path / "sg", dive, columns=True)
    packed = path.with_name(f"{path.name}.gz")
    packed.write_bytes(gzip.compress(path.read_bytes()))
    import_seaglider([path.parent], tmp_path / "whole.nc")
    assert not caplog.records, "an unpacked copy is there"
    path.unlink()
    for _ in range(2):
        summary = import_seaglider([path.parent], tmp_path / "out.nc", overwrite=True)
    assert len(summary.complete) == 2
    named = [one.getMessage() for one in caplog.records if str(packed) in one.getMessage()]
    assert named == [f"{packed}: is compressed and is left out; unpack it first"]


def test_compressed_files_that_are_read_are_not_called_left_out(tmp_path, caplog):
    """A SeaExplorer's are delivered so."""
    folder = write_mission(tmp_path / "se")
    for path in list(folder.iterdir()):
        path.with_name(f"{path.name}.gz").write_bytes(gzip.compress(path.read_bytes()))
        path.unlink()
    assert len(import_seaexplorer([folder], tmp_path / "out.nc").complete) == 3
    assert "left out" not in caplog.text


@pytest.mark.parametrize("name", ["b.NC", "b.nc4"])
def test_endings_of_netcdf_are_read_in_any_case(tmp_path, name):
    records = mission(GLIDE)
    half = records.sizes["time"] // 2
    records.isel(time=slice(0, half)).to_netcdf(tmp_path / "a.nc")
    records.isel(time=slice(half, None)).to_netcdf(tmp_path / name)
    assert currents(tmp_path).sizes["profile"] == currents(records).sizes["profile"]
    (tmp_path / "og1").mkdir()
    made.write_og1(tmp_path / "og1" / "A.NC")
    assert len(import_og1([tmp_path / "og1"], tmp_path / "out.nc").complete) == 2


@pytest.mark.parametrize("late", [0.0, 1.0])
def test_a_ctd_in_rows_of_its_own_is_put_on_the_nearest_samples(tmp_path, late):
    parts = [made.og1_rows(dive) for dive in (1, 2)]
    rows = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    flown = np.flatnonzero(np.isfinite(rows["PITCH"]))
    count = len(rows["TIME"])
    apart = {name: np.concatenate([values, np.full(len(flown), np.nan)]) for name, values in rows.items()}
    apart["TIME"][count:] = rows["TIME"][flown] + late
    apart["TEMP"][count:], apart["TEMP"][:count] = rows["TEMP"][flown], np.nan
    apart["TEMP_QC"][:] = 1.0
    apart["divenum"][count:] = rows["divenum"][flown]
    order = np.argsort(apart["TIME"], kind="stable")
    original = made.og1_rows
    try:
        made.og1_rows = lambda _: {name: values[order] for name, values in apart.items()}
        path = made.write_og1(tmp_path / "apart.nc", (1,))
    finally:
        made.og1_rows = original
    import_og1([path], tmp_path / "out.nc")
    with xr.open_dataset(tmp_path / "out.nc") as found:
        assert np.isfinite(found["temperature"].values).mean() > 0.95


def test_a_usual_fill_that_is_not_declared_is_no_position_and_no_volume(tmp_path):
    flown, sampled = flight(), science()
    (tmp_path / "as it was").mkdir()
    import_slocum([write_netcdf(tmp_path / "a.nc", flown, sampled)], tmp_path / "before.nc")
    for name in ("m_gps_lat", "m_gps_lon"):
        flown[name] = np.where(np.isfinite(flown[name]), flown[name], -999.0)
    flown["m_ballast_pumped"][::7] = -999.0
    import_slocum([write_netcdf(tmp_path / "b.nc", flown, sampled)], tmp_path / "after.nc")
    with xr.open_dataset(tmp_path / "before.nc") as before, xr.open_dataset(tmp_path / "after.nc") as after:
        np.testing.assert_array_equal(after["fix_time"].values, before["fix_time"].values)
        assert np.nanmin(after["ballast_volume"].values) > -900.0


def test_rows_of_one_time_are_read_together():
    """Concatenated tables of several sensors: depth and attitude are in separate rows with equal times."""
    records = mission(GLIDE)
    attitude, depth = (records.copy(deep=True) for _ in range(2))
    depth["pitch"].values[:] = depth["heading"].values[:] = np.nan
    attitude["depth"].values[:] = np.nan
    names = [name for name in records.data_vars if records[name].dims == ("time",)]
    together = records.drop_dims("time").merge(xr.concat([depth[names], attitude[names]], "time"))
    found, expected = currents(together), currents(records)
    np.testing.assert_allclose(found["dac_north"].values, expected["dac_north"].values, atol=1e-9)


@pytest.mark.parametrize("attribute", [{"missing_value": "NaN"}, {"valid_min": "-90"}])
def test_attributes_that_the_library_cannot_use_are_not_used(tmp_path, attribute):
    path = rewritten(made.write_og1(tmp_path / "og1.nc"), lambda file: file["PITCH"].setncatts(attribute))
    assert len(import_og1([path], tmp_path / "out.nc").complete) == 2


@pytest.mark.parametrize("kind", ["og1", "seaglider"])
def test_a_scale_factor_written_as_text_is_a_number_for_importers(tmp_path, kind):
    if kind == "og1":
        path, name, read = made.write_og1(tmp_path / "og1.nc"), "PITCH", import_og1
    else:
        path, name, read = made.write_dive(tmp_path, 1, columns=True), "eng_pitchAng", import_seaglider
    read([path], tmp_path / "expected.nc")
    rewritten(path, lambda file: file[name].setncatts({"scale_factor": "0.5", "add_offset": np.array([1.0])}))
    read([path], tmp_path / "out.nc")
    with xr.open_dataset(tmp_path / "expected.nc") as expected, xr.open_dataset(tmp_path / "out.nc") as found:
        np.testing.assert_allclose(found["pitch"], 0.5 * expected["pitch"] + 1.0)


@pytest.mark.parametrize("factor", ["x", [0.1, 0.2]])
def test_a_scale_factor_that_is_no_number_is_refused_by_importers(tmp_path, factor):
    path = made.write_og1(tmp_path / "og1.nc")
    rewritten(path, lambda file: file["PITCH"].setncattr("scale_factor", factor))
    with ForeignFile(path) as file, pytest.raises(InputError, match=r"PITCH has the scale_factor .*, which is not a"):
        file.numbers("PITCH")


@pytest.mark.parametrize(("unit", "known"), [("S m-1", True), ("mS cm-1", True), ("mhos/m", True), ("counts", False)])
def test_the_unit_of_conductivity_costs_no_more_than_the_salinity(tmp_path, caplog, unit, known):
    path = write_netcdf(tmp_path / "a.nc", flight(), science(), units={"sci_water_cond": unit})
    assert len(import_slocum([path], tmp_path / "out.nc").complete) == 1
    assert ("sci_water_cond is in 'counts'" in caplog.text) == (not known)


def test_a_seaexplorer_needs_no_column_of_the_declination_if_one_is_given(tmp_path):
    folder = write_mission(tmp_path / "se")
    import_seaexplorer([folder], tmp_path / "whole.nc", declination=16.0)
    place = NAVIGATION.split(";").index("Declination")

    def without(lines):
        return [";".join(field for at, field in enumerate(line.split(";")) if at != place) for line in lines]

    for cycle in (5, 6, 7, 8):
        edit(folder, cycle, without)
    import_seaexplorer([folder], tmp_path / "out.nc", declination=16.0)
    with xr.open_dataset(tmp_path / "whole.nc") as whole, xr.open_dataset(tmp_path / "out.nc") as found:
        np.testing.assert_array_equal(found["heading"].values, whole["heading"].values)
    with pytest.raises(InputError, match=r"has no column Declination; .*`declination`"):
        import_seaexplorer([folder], tmp_path / "other.nc")


def test_words_of_attributes_are_read_in_any_case(tmp_path):
    records = mission(GLIDE)
    upward = records.assign(depth=(-records["depth"]).assign_attrs(units="m", positive="Up"))
    np.testing.assert_allclose(currents(upward)["dac_east"].values, currents(records)["dac_east"].values)
    path = rewritten(
        made.write_og1(tmp_path / "og1.nc"), lambda file: file["TIME"].setncattr("units", "Seconds Since 1970-1-1")
    )
    assert len(import_og1([path], tmp_path / "out.nc").complete) == 2


@pytest.mark.parametrize(("separator", "word"), [(";", "semicolons"), ("\t", "tabs")])
def test_a_table_with_another_separator_is_called_so(tmp_path, separator, word):
    path = tmp_path / "table.csv"
    path.write_text(separator.join(["time", "depth"]) + "\n" + separator.join(["UTC", "m"]) + "\n")
    with pytest.raises(InputError, match=f"its columns are separated by {word}; separate them by commas"):
        read_table(path)


def test_a_table_of_native_sensors_is_refused_with_the_importer(tmp_path):
    path = tmp_path / "dbd.csv"
    path.write_text("m_present_time,m_depth,m_pitch\n1435190400.0,1.5,0.1\n")
    with pytest.raises(
        InputError, match="contains the sensors of a Slocum as text; give the glider's own files, or ne"
    ):
        read_table(path)


def test_positions_in_degrees_and_minutes_outside_the_declared_limits_are_called_so(tmp_path):
    path = made.write_og1(tmp_path / "og1.nc")
    with netCDF4.Dataset(path, "a") as file:
        file["LATITUDE_GPS"][:] = 100.0 * file["LATITUDE_GPS"][:]
        file["LATITUDE_GPS"].valid_min, file["LATITUDE_GPS"].valid_max = -90.0, 90.0
    remark = next(each for each in import_og1([path], tmp_path / "out.nc").remarks if "LATITUDE_GPS is outside" in each)
    assert remark.endswith("treated as missing: convert the positions from DDMM.mmm to decimal degrees")


def test_times_of_a_table_may_name_their_zone(tmp_path, recwarn):
    path = tmp_path / "table.csv"
    times = ("2024-05-01T02:00:00+02:00", "2024-05-01 00:00:01 UTC", "2024-05-01T00:00:02Z")
    path.write_text("\n".join(["time,depth", "UTC,m", *(f"{time},1" for time in times)]) + "\n")
    start = np.datetime64("2024-05-01", "ns")
    np.testing.assert_array_equal(read_table(path)["time"].values, start + np.arange(3) * np.timedelta64(1, "s"))
    assert not recwarn.list


@pytest.mark.parametrize("order", ["of their names", "backwards"])
def test_segments_that_were_joined_in_another_order_are_sorted(tmp_path, caplog, order):
    """A pattern of file names gives segment 10 before segment 2."""
    segments = [flight(number) for number in range(12)]
    import_slocum([write_netcdf(tmp_path / "sorted.nc", joined(segments))], tmp_path / "expected.nc")
    assert not caplog.text
    shuffled = joined([segments[place] for place in sorted(range(12), key=str)])
    if order == "backwards":
        shuffled = {name: values[::-1].copy() for name, values in joined(segments).items()}
    summary = import_slocum([write_netcdf(tmp_path / "shuffled.nc", shuffled)], tmp_path / "out.nc")
    assert len(summary.complete) == 12
    assert "its rows are not in time order" in caplog.text
    with xr.open_dataset(tmp_path / "expected.nc") as expected, xr.open_dataset(tmp_path / "out.nc") as found:
        for name in expected.variables:
            np.testing.assert_array_equal(found[name].values, expected[name].values)


def test_a_clock_that_was_wrong_for_a_day_is_not_sorted(tmp_path, caplog):
    segments = [flight(0), flight(1), flight(2)]
    segments[0]["m_present_time"] = segments[0]["m_present_time"] + 86_400.0
    import_slocum([write_netcdf(tmp_path / "a.nc", joined(segments))], tmp_path / "out.nc")
    assert "not in time order" not in caplog.text


def test_an_earlier_result_in_the_folder_is_not_read(tmp_path):
    mission(GLIDE).to_netcdf(tmp_path / "records.nc")
    out = tmp_path / "out.nc"
    for _ in range(2):
        done = program("currents", tmp_path, out, "--overwrite")
        assert done.status == 0, done.err


def test_a_foreign_file_among_instrument_files_is_named_and_left_out(tmp_path):
    made.write_og1(tmp_path / "og1.nc")
    mission(GLIDE).to_netcdf(tmp_path / "other.nc")
    (tmp_path / "made").mkdir()
    faults = FileImport(None, {}).import_files(sorted(tmp_path.glob("*.nc")), tmp_path / "made" / "records.nc")
    assert list(faults) == ["other.nc"]
    assert "is neither a record like the others nor in the observation format" in faults["other.nc"]


def test_a_dimension_of_one_is_dropped(tmp_path):
    """As (N_MEASUREMENTS, 1), and a scalar along a dimension of its own."""
    path = made.write_og1(tmp_path / "usual.nc")
    import_og1([path], tmp_path / "expected.nc")
    with xr.open_dataset(path, decode_times=False) as dataset:
        stored = dataset.load()
    for name in ("TIME", "PITCH", "DEPTH", "TEMP", "TEMP_QC", "divenum", "LATITUDE_GPS"):
        stored[name] = stored[name].expand_dims({"N_PARAM": 1}, axis=1)
    stored["PLATFORM_MODEL"] = stored["PLATFORM_MODEL"].expand_dims("N_PARAM")
    stored["MASS"] = ("N_PARAM", [52.0], {"units": "kg"})
    stored.to_netcdf(tmp_path / "squeezed.nc")
    summary = import_og1([tmp_path / "squeezed.nc"], tmp_path / "out.nc")
    assert (len(summary.complete), summary.remarks, summary.fixes) == (2, (), 6)
    with xr.open_dataset(tmp_path / "expected.nc") as expected, xr.open_dataset(tmp_path / "out.nc") as found:
        assert found.attrs["platform"] == "seaglider"
        for name in ("time", "depth", "pitch", "temperature", "fix_latitude", "profile"):
            np.testing.assert_array_equal(found[name].values, expected[name].values)


def test_variables_of_several_dimensions_are_refused(tmp_path):
    path = made.write_og1(tmp_path / "sg099.nc")
    with netCDF4.Dataset(path, "a") as file:
        file.createDimension("N_PARAM", 2)
        file.renameVariable("PITCH", "ORIGINAL_PITCH")
        file.createVariable("PITCH", "f8", ("N_MEASUREMENTS", "N_PARAM"))[:] = 1.0
    with pytest.raises(InputError, match="PITCH has 2 dimensions; it must have one"):
        import_og1([path], tmp_path / "out.nc")


def packed(path, records, name, factor):
    """Write records with one variable in tenths, whose scale factor is given."""
    stored = records.copy(deep=True)
    stored[name] = (10.0 * stored[name]).assign_attrs(stored[name].attrs)
    stored.to_netcdf(path)
    return rewritten(path, lambda file: file[name].setncattr("scale_factor", factor))


def test_a_scale_factor_written_as_text_is_a_number_for_currents(tmp_path):
    records = mission(GLIDE)
    found = currents(packed(tmp_path / "a.nc", records, "pitch", "0.1"))
    np.testing.assert_allclose(found["dac_north"].values, currents(records)["dac_north"].values, rtol=1e-9)


def test_a_scale_factor_that_is_no_number_is_refused_by_currents(tmp_path):
    path = packed(tmp_path / "a.nc", mission(GLIDE), "pitch", "a tenth")
    done = program("currents", path, tmp_path / "out.nc")
    assert done.status == 2
    assert f"{path}: pitch has the scale_factor 'a tenth', which is not a number; correct this attribute" in done.line
    with xr.open_dataset(path) as opened, pytest.raises(InputError, match=r"pitch cannot be unpacked .*scale_factor"):
        currents(opened)


def test_a_scale_factor_written_as_text_is_a_number_for_an_inversion(tmp_path):
    whole = observation_files.write(tmp_path)
    records = open_records(whole)
    path = packed(tmp_path / "a.nc", records, "pitch", "0.1")
    with open_observations(path) as found, open_observations(whole) as expected:
        np.testing.assert_allclose(found.profile(1).pitch, expected.profile(1).pitch, atol=1e-9)
    np.testing.assert_allclose(open_records(path)["pitch"].values, records["pitch"].values, atol=1e-9)
    rewritten(path, lambda file: file["pitch"].setncattr("scale_factor", "a tenth"))
    with pytest.raises(InputError, match="pitch has the scale_factor 'a tenth', which is not a number"):
        open_observations(path)


def test_a_scale_factor_written_as_text_is_a_number_for_a_slocum(tmp_path):
    path = write_netcdf(tmp_path / "a.nc", flight())
    import_slocum([path], tmp_path / "expected.nc")
    rewritten(path, lambda file: file["m_depth"].setncattr("scale_factor", "2.0"))
    import_slocum([path], tmp_path / "out.nc")
    with xr.open_dataset(tmp_path / "expected.nc") as expected, xr.open_dataset(tmp_path / "out.nc") as found:
        assert found["depth"].max() == pytest.approx(2.0 * float(expected["depth"].max()))
    rewritten(path, lambda file: file["m_depth"].setncattr("scale_factor", "two"))
    with pytest.raises(InputError, match="m_depth has the scale_factor 'two', which is not a number"):
        import_slocum([path], tmp_path / "other.nc")


def in_iso(times):
    """Times as texts in ISO 8601."""
    return np.array([f"{time}Z" for time in times.astype("datetime64[ms]")])


@pytest.mark.parametrize("characters", [False, True], ids=["strings", "characters"])
def test_times_of_og1_may_be_texts(tmp_path, characters):
    path = made.write_og1(tmp_path / "usual.nc")
    import_og1([path], tmp_path / "expected.nc")
    with xr.open_dataset(path) as dataset:
        stored = dataset.load()
    texts = in_iso(stored["TIME"].values)
    texts[5] = ""
    stored["TIME"] = ("N_MEASUREMENTS", texts.astype("S24") if characters else texts)
    stored["TIME_QC"] = ("N_MEASUREMENTS", np.where(np.arange(len(texts)) == 6, 4, 1))
    stored.to_netcdf(tmp_path / "texts.nc")
    summary = import_og1([tmp_path / "texts.nc"], tmp_path / "out.nc")
    assert (len(summary.complete), summary.rows_dropped) == (2, {"time not increasing": 2})
    assert summary.remarks == ("texts.nc: values flagged bad or missing are not used: 1 of TIME (TIME_QC)",)
    with xr.open_dataset(tmp_path / "expected.nc") as expected, xr.open_dataset(tmp_path / "out.nc") as found:
        assert set(found["time"].values) < set(expected["time"].values)


@pytest.mark.parametrize("stored", [False, True], ids=["Dataset", "file"])
def test_times_of_currents_may_be_texts(tmp_path, stored):
    records = mission(GLIDE)
    texts = records.drop_vars("time").assign(time=("time", in_iso(records["time"].values)))
    if stored:
        texts.to_netcdf(tmp_path / "a.nc")
    found = currents(tmp_path / "a.nc" if stored else texts)
    np.testing.assert_allclose(found["dac_north"].values, currents(records)["dac_north"].values, rtol=1e-9)


@pytest.mark.parametrize("characters", [False, True], ids=["strings", "characters"])
def test_times_of_an_observation_file_may_be_texts(tmp_path, characters):
    whole = observation_files.write(tmp_path)
    records = open_records(whole)
    texts = {name: in_iso(records[name].values) for name in ("time", "fix_time")}
    if characters:
        texts = {name: values.astype("S24") for name, values in texts.items()}
    written = records.drop_vars(list(texts)).assign(
        {name: (name.removesuffix("_time"), t) for name, t in texts.items()}
    )
    written.to_netcdf(tmp_path / "texts.nc")
    with open_observations(tmp_path / "texts.nc") as found, open_observations(whole) as expected:
        assert found.profile_digest(2) == expected.profile_digest(2)
        assert found.fix_digest(2) == expected.fix_digest(2)
    np.testing.assert_array_equal(open_records(tmp_path / "texts.nc")["time"].values, records["time"].values)
    texts["time"][5] = "noon"
    written.assign(time=("time", texts["time"])).to_netcdf(tmp_path / "odd.nc")
    with pytest.raises(InputError, match=r"odd.nc: time has a time that is not in ISO 8601 format \('noon'\)"):
        open_observations(tmp_path / "odd.nc")


@pytest.mark.parametrize("text", ["01/05/2024 12:00", "20240501", "noon"])
def test_texts_that_are_no_times_are_refused_in_one_line(tmp_path, text):
    path = made.write_og1(tmp_path / "a.nc")
    with xr.open_dataset(path) as dataset:
        stored = dataset.load()
    texts = in_iso(stored["TIME"].values).astype(object)
    texts[7] = text
    stored.assign(TIME=("N_MEASUREMENTS", texts)).to_netcdf(tmp_path / "texts.nc")
    words = rf"TIME has a time that is not in ISO 8601 format \('{text}'\); write it as 2024-05-01T12:00:00Z"
    with pytest.raises(InputError, match=words):
        import_og1([tmp_path / "texts.nc"], tmp_path / "out.nc")
    records = mission(GLIDE)
    texts = in_iso(records["time"].values).astype(object)
    texts[7] = text
    with pytest.raises(InputError, match=words.replace("TIME", "time")):
        currents(records.drop_vars("time").assign(time=("time", texts)))


def test_times_of_an_unusual_calendar_are_no_texts():
    records = mission(GLIDE)
    days = xr.date_range("2024-05-01", periods=records.sizes["time"], freq="s", calendar="noleap", use_cftime=True)
    with pytest.raises(InputError, match="time does not contain numbers"):
        currents(records.assign_coords(time=("time", days)))


def test_one_profile_is_no_several_profiles(tmp_path):
    mission(Glide(dives=1)).to_netcdf(tmp_path / "a.nc")
    done = program("currents", tmp_path / "a.nc", tmp_path / "out.nc")
    assert "1 of 1 profile has a current" in done.out
