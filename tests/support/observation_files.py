"""Small observation files of a synthetic mission, sample by sample."""

from pathlib import Path

import numpy as np
import xarray as xr

from gliderhpc.observations import write_observations

ATTRIBUTES = {"platform": "petrel-l", "mission": "test", "source": "made up"}
SAMPLES = 400
START = np.datetime64("2024-05-01T12:00:00", "ns")


def mission(profiles: int = 3) -> dict[str, np.ndarray]:
    """Profiles of 400 s to 50 m, ten minutes at the surface around each, two fixes a surface interval."""
    seconds, depth, number, ballast, fix_seconds = [], [], [], [], []
    for index in range(profiles):
        begin = 1000.0 * index
        t = np.arange(SAMPLES, dtype=float)
        seconds += [begin - 10.0 + np.arange(10), begin + t]
        depth += [np.zeros(10), 50.0 * np.sin(np.pi * t / SAMPLES)]
        number += [np.zeros(10, int), np.full(SAMPLES, index + 1)]
        ballast += [np.full(10, -250.0), np.where(t < SAMPLES / 2, -250.0, 250.0)]
        fix_seconds += [begin - 200.0, begin - 20.0]
    fix_seconds.append(1000.0 * profiles - 550.0)
    offsets = np.concatenate(seconds)
    return {
        "time": START + (offsets * 1e9).astype("timedelta64[ns]"),
        "depth": np.concatenate(depth),
        "profile": np.concatenate(number),
        "roll": np.full(len(offsets), 5.0),
        "pitch": np.full(len(offsets), -20.0),
        "heading": np.mod(350.0 + offsets / 10.0, 360.0),
        "battery_position": np.full(len(offsets), 0.01),
        "battery_rotation": np.full(len(offsets), 30.0),
        "ballast_volume": np.concatenate(ballast),
        "fix_time": START + (np.array(fix_seconds) * 1e9).astype("timedelta64[ns]"),
        "fix_latitude": 50.0 + 0.0010137 * np.arange(len(fix_seconds)),
        "fix_longitude": -128.0 + 0.0010137 * np.arange(len(fix_seconds)),
    }


def write(folder: Path, **changes: np.ndarray | None) -> Path:
    variables = mission() | changes
    present = {name: values for name, values in variables.items() if values is not None}
    return write_observations(present, folder / "mission.nc", attributes=ATTRIBUTES, overwrite=True)


def edited(folder: Path, edit) -> Path:
    """Write a mission after `edit` has had its way with the dataset."""
    with xr.open_dataset(write(folder), decode_times=False) as dataset:
        changed = dataset.load()
    changed = edit(changed) or changed
    path = folder / "edited.nc"
    changed.to_netcdf(path)
    return path


def first_sample(profile: int) -> int:
    return (profile - 1) * (SAMPLES + 10) + 10
