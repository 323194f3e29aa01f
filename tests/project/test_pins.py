"""Pins for changes of structure: differences that they detect, and differences that they ignore."""

import json

import numpy as np
import xarray as xr
import zarr

from benchmarks import pins


def write(folder, speed=1.0, seconds=3.0, finding=0.5):
    root = zarr.create_group(folder / "a.zarr", overwrite=True, attributes={"step": 0.1, "software_version": "1"})
    root.create_array("series/speed", data=np.array([speed, np.nan]))
    root.create_array("run_seconds", data=np.array([seconds]))
    xr.Dataset({"u": ("x", [speed])}, attrs={"history": f"{seconds}"}).to_netcdf(folder / "out.nc")
    (folder / "found.json").write_text(json.dumps({"slope": {"value": finding}, "seconds": seconds}))
    return dict(pins._digests(folder))


def test_differences_are_listed_by_name(tmp_path):
    before = write(tmp_path)
    assert write(tmp_path, seconds=4.0) == before
    assert pins.differences(before, write(tmp_path, speed=1.0 + 1e-16 * 8)) == [
        "differs: a.zarr/series/speed",
        "differs: out.nc/u",
    ]
    assert pins.differences(before, write(tmp_path, finding=0.6)) == ["differs: found.json.slope.value"]


def test_removed_and_added_entries_are_listed(tmp_path):
    before = write(tmp_path)
    (tmp_path / "found.json").unlink()
    after = dict(pins._digests(tmp_path)) | {"more": "1"}
    assert pins.differences(before, after) == ["gone: found.json.slope.value", "new: more"]
