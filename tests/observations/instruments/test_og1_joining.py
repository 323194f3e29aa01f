"""OG1 files that repeat the end of one another, or divide a dive between them."""

import netCDF4
import numpy as np
import pytest
import xarray as xr
from support import seaglider_files as made

from gliderhpc.observations.instruments.og1 import import_og1

ROWS = 2 * (made.AFLOAT + made.HALF) + 3
"""Rows of one dive of the synthetic file."""


def part(path, start, stop, **changes):
    """OG1 file of some rows of three dives."""
    made.write_og1(path, (1, 2, 3), **changes)
    with xr.open_dataset(path, decode_times=False) as dataset:
        stored = dataset.load()
    stored.isel(N_MEASUREMENTS=slice(start, stop)).to_netcdf(path)
    return path


def imported(tmp_path, spans, **changes):
    """Import of two parts, and that of all rows in one file."""
    paths = [part(tmp_path / name, *span, **changes) for name, span in zip(("a.nc", "b.nc"), spans, strict=True)]
    import_og1([made.write_og1(tmp_path / "whole.nc", (1, 2, 3), **changes)], tmp_path / "expected.nc")
    summary = import_og1(paths, tmp_path / "out.nc")
    with xr.open_dataset(tmp_path / "expected.nc") as expected, xr.open_dataset(tmp_path / "out.nc") as found:
        return summary, expected.load(), found.load()


@pytest.mark.parametrize("changes", [{}, {"divenum": None}], ids=["numbered", "from depth"])
@pytest.mark.parametrize(
    ("spans", "words"),
    [
        (((0, ROWS + 70), (ROWS + 40, None)), "b.nc: 30 samples also in a.nc, each taken once"),
        (((0, 2 * ROWS), (ROWS, None)), "b.nc: 132 samples also in a.nc, each taken once"),
        (((0, 2 * ROWS), (0, None)), "b.nc: 264 samples also in a.nc, each taken once"),
        (((0, None), (ROWS + 30, None)), "b.nc: 236 samples also in a.nc, each taken once"),
        (((0, ROWS + 70), (ROWS + 70, None)), "b.nc: begins within a dive of a.nc; the two files are joined"),
    ],
    ids=["within a dive", "a whole dive", "from the beginning", "at the end", "without overlap"],
)
def test_samples_of_two_files_are_taken_once(tmp_path, spans, words, changes):
    """Half a dive had been imported as a profile, and the rest of it lost."""
    summary, expected, found = imported(tmp_path, spans, **changes)
    assert (summary.remarks, summary.rejected, summary.rows_dropped) == ((words,), {}, {})
    assert [(p.number, p.samples, p.fault) for p in summary.profiles] == [(n, 2 * made.HALF, None) for n in (1, 2, 3)]
    assert set(found.variables) == set(expected.variables)
    for name in expected.variables:
        np.testing.assert_array_equal(found[name].values, expected[name].values)


def test_files_that_number_their_dives_differently_have_them_detected_from_depth(tmp_path):
    first = part(tmp_path / "a.nc", 0, ROWS + 70)
    second = part(tmp_path / "b.nc", ROWS + 40, None)
    with netCDF4.Dataset(second, "a") as file:
        file["divenum"][:] = file["divenum"][:] - 1.0
    summary = import_og1([first, second], tmp_path / "out.nc")
    assert [profile.number for profile in summary.complete] == [1, 2, 3]
    assert summary.rejected == {}


def test_single_precision_is_no_difference(tmp_path):
    first, second = part(tmp_path / "a.nc", 0, ROWS + 70), part(tmp_path / "b.nc", ROWS + 40, None)
    with xr.open_dataset(second, decode_times=False) as dataset:
        stored = dataset.load()
    stored.to_netcdf(second, encoding={name: {"dtype": "f4"} for name in ("DEPTH", "PITCH", "ROLL")})
    summary = import_og1([first, second], tmp_path / "out.nc")
    assert [profile.samples for profile in summary.complete] == [2 * made.HALF] * 3


def test_samples_that_differ_at_the_same_times_are_left_to_the_clock(tmp_path):
    first, second = part(tmp_path / "a.nc", 0, ROWS + 70), part(tmp_path / "b.nc", ROWS + 40, None)
    with netCDF4.Dataset(second, "a") as file:
        file["DEPTH"][:] = file["DEPTH"][:] + 0.5
    summary = import_og1([first, second], tmp_path / "out.nc")
    assert any("the clock was set back" in why for why in summary.rejected.values())
    assert not any("taken once" in remark for remark in summary.remarks)
