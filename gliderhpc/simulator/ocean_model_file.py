"""An ocean model's file of a synthetic mission: its true currents on a coarse grid, with errors drawn by chance.

It lets the comparison with models be gone through where no model can know the mission.
"""

from pathlib import Path

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gliderhpc.errors import InputError
from gliderhpc.observations.truth import read_currents

Array = NDArray[np.float64]

INTERVAL = np.timedelta64(6, "h")
"""Between the fields."""

ERROR = 0.05
"""Standard deviation of either component, alike over a dive's depths and another at the next dive, m/s."""

_MARGIN = 0.5
"""The grid reaches beyond the dives by so much, degree."""

_NAMES = {
    "vo": ("northward_sea_water_velocity", "profile_current_north"),
    "uo": ("eastward_sea_water_velocity", "profile_current_east"),
}


def write_ocean_model(truth: str | Path, out: Path, seed: int) -> Path:
    """Write the file of an ocean model that errs by chance.

    Fields are uniform in the horizontal and every six hours; each is the true current of the dive nearest in time, of
    the depths that the truth has.

    Parameters
    ----------
    truth : str or Path
        Truth of a synthetic mission.
    out : Path
        The file to write; one of that name is replaced.
    seed : int
        Of the errors.

    Raises
    ------
    InputError
        The truth cannot be read, or the file cannot be written.
    """
    currents = read_currents(truth)
    times, dives = _fields(currents["entry_time"].values)
    errors = ERROR * np.random.default_rng(seed).standard_normal((2, len(currents["dive"])))
    corners = {axis: _corners(currents, axis) for axis in ("latitude", "longitude")}
    shape = (len(times), len(currents["level"]), 2, 2)
    dataset = xr.Dataset(
        {
            name: (
                ("time", "depth", "latitude", "longitude"),
                np.broadcast_to((currents[column].values + error[:, None])[dives][:, :, None, None], shape),
                {"standard_name": standard, "units": "m s-1"},
            )
            for error, (name, (standard, column)) in zip(errors, _NAMES.items(), strict=True)
        },
        coords={
            "time": ("time", times, {"standard_name": "time", "axis": "T"}),
            "depth": ("depth", currents["level"].values, {"units": "m", "positive": "down", "axis": "Z"}),
            "latitude": ("latitude", corners["latitude"], {"units": "degrees_north", "axis": "Y"}),
            "longitude": ("longitude", corners["longitude"], {"units": "degrees_east", "axis": "X"}),
        },
        attrs={
            "Conventions": "CF-1.11",
            "title": "true currents of a synthetic mission with errors drawn by chance; no ocean model was run",
            "seed": seed,
        },
    )
    try:
        dataset.to_netcdf(out, engine="netcdf4")
    except OSError as error:
        raise InputError(f"{out}: cannot be written ({error.strerror or error})") from None
    return out


def _fields(entries: NDArray[np.datetime64]) -> tuple[NDArray[np.datetime64], NDArray[np.int64]]:
    """Times of the fields, and the dive whose current each has."""
    times = np.arange(entries[0] - 4 * INTERVAL, entries[-1] + 4 * INTERVAL, INTERVAL)
    return times, np.abs(times[:, None] - entries).argmin(axis=1)


def _corners(currents: xr.Dataset, axis: str) -> Array:
    """Ends of an axis of the grid, around all dives."""
    places = np.concatenate([currents[f"{end}_{axis}"].values for end in ("entry", "exit")])
    return np.array([places.min() - _MARGIN, places.max() + _MARGIN])
