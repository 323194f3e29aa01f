"""Accuracy table: it contains the planted errors, and no others."""

from io import StringIO

import numpy as np
import pytest
import xarray as xr
from rich.console import Console
from support.archives import STEP, STEPS, Content, true_disturbances, truth_of, write_archive, write_truth_file

from gliderhpc.archive.mission import open_mission
from gliderhpc.archive.profile import (
    done_profiles,
    on_branch_of,
    read_profile_data,
    truth_on_samples,
    unwrap,
    wrap,
)
from gliderhpc.errors import InputError
from gliderhpc.findings.formatting import markdown
from gliderhpc.observations.truth import read_profile_truth
from gliderhpc.report.accuracy import COLUMNS, accuracy_table, cells_of, profile_accuracy, render

YAW = 5


def table_of(tmp_path, *contents, truths=None):
    truths = truths or [truth_of(content.number, true_disturbances(content.number)) for content in contents]
    truth = write_truth_file(tmp_path / "twin.truth.nc", *truths)
    with open_mission(write_archive(tmp_path / "twin.zarr", *contents)) as archive:
        return {row.quantity: row for row in accuracy_table(archive, truth)}


def read(tmp_path, *contents, number=1):
    with open_mission(write_archive(tmp_path / "twin.zarr", *contents)) as archive:
        return read_profile_data(archive, number)


def test_errors_put_in_come_out(tmp_path):
    content = Content(1)
    content.adjoint[:, YAW] += 0.1
    content.prior[:, YAW] += np.where(np.arange(STEPS) % 2, 0.3, -0.3)
    content.measured += [0.01, 0.02, -0.03, 0.04]
    rows = table_of(tmp_path, content)
    assert rows["B_cr"].adjoint.rmse == pytest.approx(0.1, abs=1e-6)
    assert rows["B_cr"].adjoint.correlation == pytest.approx(1.0, abs=1e-6)
    assert rows["B_cr"].prior.rmse == pytest.approx(0.3, abs=1e-6)
    assert 0.5 < rows["B_cr"].prior.correlation < 0.95
    assert rows["B_cu"].adjoint.rmse == pytest.approx(0.0, abs=1e-6)
    tracking = [rows[name].adjoint.rmse for name in ("roll", "pitch", "heading", "depth")]
    assert tracking == pytest.approx([0.01, 0.02, 0.03, 0.04], abs=1e-4)
    assert rows["current"].adjoint.rmse == pytest.approx(0.005)
    assert [rows[name].unit for name in ("B_cw", "B_cp", "roll", "depth", "current")] == [
        "N",
        "N m",
        "degree",
        "m",
        "m/s",
    ]


@pytest.mark.long
def test_only_steady_glide_counts(tmp_path):
    counts = {0: True, 1: False, 2: False, 4: True, 8: True, 16: True, 32: True, 64: True, 65: False}
    contents = [Content(number) for number in range(1, len(counts) + 1)]
    for content, bits in zip(contents, counts, strict=True):
        content.adjoint[1000:1500] += 50.0
        content.measured[100:150] += 50.0
        content.quality[1000:1500] = bits
    truths = [truth_of(content.number, true_disturbances(content.number)) for content in contents]
    path = write_truth_file(tmp_path / "t.nc", *truths)
    with open_mission(write_archive(tmp_path / "twin.zarr", *contents)) as archive:
        for content, (bits, count) in zip(contents, counts.items(), strict=True):
            number = content.number
            accuracy = profile_accuracy(read_profile_data(archive, number), read_profile_truth(path, number))
            assert (accuracy.adjoint[YAW].rmse > 1.0) == count, bits
            assert (accuracy.tracking[3] > 1.0) == count, bits


def test_the_first_minute_does_not_count(tmp_path):
    content = Content(1)
    content.adjoint[: round(60.0 / STEP)] = 99.0
    content.measured[:60] = 99.0
    rows = table_of(tmp_path, content)
    assert rows["B_cr"].adjoint.rmse == pytest.approx(0.0, abs=1e-6)
    assert rows["roll"].adjoint.rmse == pytest.approx(0.0, abs=1e-6)
    content.adjoint[round(60.0 / STEP)] = 99.0
    assert table_of(tmp_path, content)["B_cr"].adjoint.rmse > 1.0


def test_medians_over_the_profiles_that_are_done(tmp_path):
    contents = [Content(number) for number in (1, 2, 3, 7)]
    for content, error in zip(contents, (0.1, 0.9, 0.2, 5.0), strict=True):
        content.adjoint[:, YAW] += error
    contents[1].table["dac_north"] = np.nan
    contents[3].table["status"] = "failed"
    rows = table_of(tmp_path, *contents)
    assert rows["B_cr"].adjoint.rmse == pytest.approx(0.2, abs=1e-6)
    assert rows["current"].adjoint.rmse == pytest.approx(0.005)


def test_a_disturbance_that_never_changes_has_no_correlation(tmp_path):
    true = true_disturbances(1)
    true[:, 1] = 0.0
    rows = table_of(tmp_path, Content(1), truths=[truth_of(1, true)])
    assert np.isnan(rows["B_cv"].adjoint.correlation)
    assert rows["B_cv"].adjoint.rmse > 0.5


def test_a_profile_all_vibration_has_no_scores(tmp_path):
    content = Content(1)
    content.quality[:] = 1
    rows = table_of(tmp_path, content)
    assert np.isnan(rows["B_cr"].adjoint.rmse)
    assert np.isnan(rows["roll"].adjoint.rmse)


def test_heading_residuals_are_wrapped(tmp_path):
    content = Content(1)
    content.measured[:, 2], content.reconstructed[:, 2] = 359.9, 0.1
    assert table_of(tmp_path, content)["heading"].adjoint.rmse == pytest.approx(0.2, abs=1e-4)


def test_truth_is_averaged_over_longer_steps(tmp_path):
    data = read(tmp_path, Content(1))
    truth = read_profile_truth(write_truth_file(tmp_path / "t.nc", truth_of(1, true_disturbances(1))), 1)
    same = truth_on_samples(data, truth)
    np.testing.assert_allclose(same[:-1], true_disturbances(1), atol=1e-5)
    assert np.isnan(same[-1]).all(), "the truth ends with the last step"
    halved = xr.Dataset(
        {name: ("truth_time", np.repeat(truth[name].values, 2)) for name in ("B_cu", "B_cv", "B_cw", "B_cp", "B_cq")},
        {"truth_time": truth["truth_time"].values[0] + np.arange(2 * STEPS) * np.timedelta64(50, "ms")},
    )
    ripple = np.tile([1.0, -1.0], STEPS)
    halved["B_cr"] = ("truth_time", np.repeat(truth["B_cr"].values, 2) + ripple)
    np.testing.assert_allclose(truth_on_samples(data, halved)[:-1], true_disturbances(1), atol=2e-5)


def test_the_truth_of_another_mission_is_refused(tmp_path):
    data = read(tmp_path, Content(1))
    other = read_profile_truth(write_truth_file(tmp_path / "t.nc", truth_of(2, true_disturbances(2))), 2)
    with pytest.raises(InputError, match=r"profile 1: the truth belongs to another mission"):
        profile_accuracy(data, other)


def test_an_archive_without_a_finished_profile_is_refused(tmp_path):
    with pytest.raises(InputError, match="no profile of the archive is done"):
        table_of(tmp_path, Content(1, table={"status": "pending"}))


def test_a_profile_is_found_by_its_number(tmp_path):
    contents = [Content(number) for number in (1, 3, 7)]
    contents[1].adjoint[:, 0] = 3.0
    contents[0].table["status"] = "failed"
    with open_mission(write_archive(tmp_path / "twin.zarr", *contents)) as archive:
        assert done_profiles(archive) == [3, 7]
        data = read_profile_data(archive, 3)
        np.testing.assert_array_equal(data.disturbances[:-1, 0], 3.0)
        assert len(data.time) == STEPS + 1, "filling is left out"
        with pytest.raises(InputError, match="the archive has no profile 2"):
            read_profile_data(archive, 2)
        with pytest.raises(InputError, match="profile 1 is failed"):
            read_profile_data(archive, 1)


def test_tables_show_the_rows_numbers(tmp_path):
    content = Content(1)
    content.adjoint[:, YAW] += 0.1234
    rows = list(table_of(tmp_path, content).values())
    console = Console(file=StringIO(), width=120)
    console.print(render(rows, "twin"))
    text = markdown(COLUMNS, map(cells_of, rows), COLUMNS[2:])
    for shown in (console.file.getvalue(), text):
        assert "0.123" in shown
        assert shown.count("–") == 3 * 5, "tracking and current have neither correlation nor a filter's estimate"
    assert [line.count("|") for line in text.splitlines()] == [7] * (2 + 11)
    assert "| B_cr yaw moment | N m | 0.123 | 1.000 | 0.000 | 1.000 |" in text


def test_angles_across_north():
    np.testing.assert_allclose(wrap(np.array([359.8, -359.8, 180.0, 12.0])), [-0.2, 0.2, -180.0, 12.0], atol=1e-9)
    np.testing.assert_allclose(unwrap(np.array([350.0, np.nan, 10.0, 30.0])), [350.0, np.nan, 370.0, 390.0])
    reference = np.array([350.0, np.nan, 370.0])
    np.testing.assert_allclose(on_branch_of(reference, np.array([349.0, 1.0, 11.0])), [349.0, 361.0, 371.0])
    np.testing.assert_allclose(on_branch_of(np.full(2, np.nan), np.array([350.0, 10.0])), [350.0, 370.0])
