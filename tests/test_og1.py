"""OceanGliders OG1 trajectory files into the observation format."""

import numpy as np
import pytest
import seaglider_files as made
import xarray as xr
from missions import program

from gliderhpc.errors import InputError
from gliderhpc.observations import open_observations
from gliderhpc.observations.og1 import import_og1
from gliderhpc.observations.reference import read_reference


def imported(tmp_path, *, declination=None, **changes):
    """Summary and samples of a file of two dives with some variables changed."""
    path = made.write_og1(tmp_path / "sg099_delayed.nc", **changes)
    summary = import_og1([path], tmp_path / "out.nc", declination=declination)
    with xr.open_dataset(tmp_path / "out.nc") as dataset:
        return summary, dataset.load()


def test_dives_fixes_and_controls(tmp_path):
    summary, found = imported(tmp_path)
    assert [(p.number, p.parts, p.samples) for p in summary.complete] == [(n, (n,), 2 * made.HALF) for n in (1, 2)]
    assert (summary.vehicle, summary.fixes, summary.remarks, summary.without_profile) == ("SG099", 6, (), {})
    # Rows that only hold a fix are no samples.
    assert summary.rows == 2 * 2 * (made.AFLOAT + made.HALF)
    assert found.attrs["platform"] == "seaglider"
    assert found.attrs["controls_absent"] == "none"
    diving = (found["profile"].values > 0) & (found["pitch"].values < 0.0)
    assert found["battery_position"].values[diving] == pytest.approx(0.012)
    assert found["battery_rotation"].values == pytest.approx(40.0)
    assert found["ballast_volume"].values[diving] == pytest.approx(-100.0)
    assert np.isnan(found["temperature"].values).sum() == 2, "samples flagged bad are missing"
    with open_observations(tmp_path / "out.nc") as observations:
        assert observations.faults == {}
        assert len(observations.profile(2).surface_fixes_before) == 2


def test_the_declination_comes_from_the_files_own_dead_reckoning(tmp_path):
    _, found = imported(tmp_path)
    assert found["heading"].values == pytest.approx(350.0 + made.DECLINATION - 360.0)
    assert "15.50 degrees added (the file's dead reckoning" in found.attrs["heading_comment"]


def test_a_declination_given_goes_before_it(tmp_path):
    _, found = imported(tmp_path, declination=-2.0)
    assert found["heading"].values == pytest.approx(348.0)


def test_a_heading_that_is_not_called_magnetic_is_true(tmp_path):
    summary, found = imported(tmp_path, magnetic=False)
    assert found["heading"].values == pytest.approx(350.0)
    assert summary.remarks == ()


@pytest.mark.parametrize("wild", [True, False], ids=["contradictory", "absent"])
def test_a_magnetic_heading_without_declination_is_said(tmp_path, wild):
    count = 2 * (2 * (made.AFLOAT + made.HALF) + 3)
    north = np.random.default_rng(1).normal(size=count) * 5.0 if wild else None
    summary, found = imported(tmp_path, NORTH_DISPLACEMENT=north)
    assert found["heading"].values == pytest.approx(350.0)
    assert len(summary.remarks) == 1
    assert "give --declination" in summary.remarks[0]


@pytest.mark.parametrize(("variable", "control"), [("PITCH_CTL", "battery_position"), ("ROLL_CTL", "battery_rotation")])
def test_a_control_that_is_absent_is_zero_and_said(tmp_path, variable, control):
    summary, found = imported(tmp_path, **{variable: None})
    assert (found[control].values == 0.0).all()
    assert found.attrs["controls_absent"] == f"{control} (zero)"
    assert f"has no {control}: taken as zero" in summary.remarks[0]


def test_profiles_are_judged_from_depth_where_the_dives_are_not_numbered(tmp_path):
    summary, _ = imported(tmp_path, divenum=None)
    assert [profile.number for profile in summary.complete] == [1, 2]


def test_the_producers_solution_is_carried_along(tmp_path):
    imported(tmp_path)
    reference = read_reference(tmp_path / "out.nc")
    assert reference["reference_current_east"].values == pytest.approx([-0.1, -0.1])
    assert reference["reference_speed"].values == pytest.approx(0.25)


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        ({"PITCH": None}, r"has no pitch \(PITCH\)"),
        ({"HEADING": np.full(2 * (made.AFLOAT + made.HALF) + 3, np.nan)}, "has no heading, not one sample of it"),
        ({"VBD_CC": None}, "has no ballast volume.*there is nothing to invert"),
        ({"DEPTH": None}, "has no depth"),
        ({"TIME": np.full(2 * (made.AFLOAT + made.HALF) + 3, np.nan)}, "has no sample with both time and attitude"),
        (None, "cannot be read as netCDF, it may have been cut short"),
    ],
)
def test_a_bad_file_takes_one_line_and_the_rest_is_imported(tmp_path, spoil, words):
    folder = tmp_path / "m"
    folder.mkdir()
    made.write_og1(folder / "a.nc", (1,))
    bad = made.write_og1(folder / "b.nc", (2,), **(spoil or {}))
    if spoil is None:
        bad.write_bytes(bad.read_bytes()[:3000])
    made.write_og1(folder / "c.nc", (3,))
    summary = import_og1([folder], tmp_path / "out.nc")
    assert [profile.number for profile in summary.complete] == [1, 3]
    assert list(summary.rejected) == ["b.nc"]
    assert "\n" not in summary.rejected["b.nc"]
    with pytest.raises(InputError, match=words):
        import_og1([bad], tmp_path / "none.nc")
    assert not (tmp_path / "none.nc").exists()


def test_files_that_count_from_the_same_number_are_counted_through(tmp_path):
    made.write_og1(tmp_path / "b.nc", (4,))
    first = made.write_og1(tmp_path / "a.nc", (3,), divenum=np.full(2 * (made.AFLOAT + made.HALF) + 3, 4.0))
    summary = import_og1([tmp_path / "b.nc", first], tmp_path / "out.nc")
    assert [(profile.number, profile.parts) for profile in summary.complete] == [(1, (4,)), (2, (4,))]


def test_an_og1_file_is_never_written_over(tmp_path):
    first, second = (made.write_og1(tmp_path / name, (1,)) for name in ("a.nc", "b.nc"))
    with pytest.raises(InputError, match="the last argument is the netCDF file"):
        import_og1([first], second)


def test_command_prints_the_summary(tmp_path):
    path = made.write_og1(tmp_path / "sg099.nc", PITCH_CTL=None)
    answer = program("import", "og1", path, tmp_path / "out.nc")
    assert answer.status == 0
    assert "has no battery_position: taken as zero" in answer.out
    assert "2 profiles, 2 complete, written to" in answer.out


# A real mission -----------------------------------------------------------------------------------------------------


def test_sg033(shared_data, tmp_path):
    summary = import_og1([shared_data / "seaglider-sg033-og1-2010"], tmp_path / "out.nc")
    assert [profile.number for profile in summary.complete] == list(range(1, 20))
    assert (summary.without_profile, summary.remarks, summary.rows_dropped) == ({}, (), {})
    assert (summary.rows, summary.fixes, summary.fixes_dropped) == (10886, 43, 0)
    assert summary.sample_interval == pytest.approx(20.6, abs=0.1)
    assert max(profile.max_depth for profile in summary.profiles) == pytest.approx(1148.2, abs=0.1)
    reference = read_reference(tmp_path / "out.nc")
    assert reference["reference_declination"].values == pytest.approx(-12.7, abs=0.05)
    with open_observations(tmp_path / "out.nc") as observations:
        record = observations.profile(12)
    assert np.corrcoef(record.battery_rotation, record.roll)[0, 1] > 0.95
