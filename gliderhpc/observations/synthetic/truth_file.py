"""The truth of a synthetic mission on disk, beside its observations.

Four kinds of rows, each on an axis of its own: the estimator's steps (``truth_time``), the samples (``time``), the
impulses (``impulse``) and the profiles (``dive``, named so because ``profile`` is a variable along ``time``).
"""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
import xarray as xr

from gliderhpc.errors import InputError
from gliderhpc.observations.format import VARIABLES
from gliderhpc.observations.synthetic.profile import ProfileTruth

CHANNELS = ("B_cu", "B_cv", "B_cw", "B_cp", "B_cq", "B_cr")

_OF_PROFILE = {"truth_time": "truth_profile", "time": "profile", "impulse": "impulse_profile", "dive": "dive"}
"""On each axis, the variable that says which profile a row belongs to."""

_DISTURBANCES = {
    "B_cu": ("N", "axial disturbance force"),
    "B_cv": ("N", "lateral disturbance force"),
    "B_cw": ("N", "normal disturbance force"),
    "B_cp": ("N m", "disturbance roll moment"),
    "B_cq": ("N m", "disturbance pitch moment"),
    "B_cr": ("N m", "disturbance yaw moment"),
}
_MOTION = {
    "X": ("m", "displacement through the water to the north, from the start of the profile"),
    "Y": ("m", "displacement through the water to the east, from the start of the profile"),
    "u": ("m s-1", "velocity relative to the water, forward"),
    "v": ("m s-1", "velocity relative to the water, starboard"),
    "w": ("m s-1", "velocity relative to the water, downward in the body frame"),
    "p": ("degree s-1", "angular rate about the roll axis"),
    "q": ("degree s-1", "angular rate about the pitch axis"),
    "r": ("degree s-1", "angular rate about the yaw axis"),
}
_IMPULSES = {
    "impulse_amplitude": ("N m", "peak of an impulse of the yaw moment"),
    "impulse_width": ("s", "standard deviation of its Gaussian shape"),
}
_DIVES = {
    "current_north": ("m s-1", "current to the north, uniform over the profile and its time at the surface"),
    "current_east": ("m s-1", "current to the east, uniform over the profile and its time at the surface"),
    "entry_latitude": ("degrees_north", "true latitude at the start of the dive"),
    "entry_longitude": ("degrees_east", "true longitude at the start of the dive"),
    "exit_latitude": ("degrees_north", "true latitude at the end of the dive"),
    "exit_longitude": ("degrees_east", "true longitude at the end of the dive"),
}
_TIMES = {
    "time": "time of the sample",
    "truth_time": "start of the step over which the disturbance is averaged",
    "impulse_time": "time of the impulse's peak",
    "entry_time": "start of the dive",
    "exit_time": "end of the dive",
}
_RECORDED = {
    name: (VARIABLES[name].unit, f"true {VARIABLES[name].long_name}")
    for name in ("depth", "roll", "pitch", "heading", "battery_position", "battery_rotation", "ballast_volume")
}
_DESCRIPTIONS = {**_DISTURBANCES, **_MOTION, **_IMPULSES, **_DIVES, **_RECORDED}

Columns = dict[str, tuple[str, npt.NDArray[np.generic]]]


def truth_path(path: str | Path) -> Path:
    """Where the truth of an observation file lies: ``OUT.truth.nc`` beside ``OUT.nc``."""
    return Path(path).with_suffix(".truth.nc")


def write_truth(truths: Sequence[ProfileTruth], path: str | Path, attributes: Mapping[str, str | int | float]) -> Path:
    """Write the truth of a mission, the same bytes for the same input.

    Parameters
    ----------
    truths : sequence of ProfileTruth
        In the order of the mission, at least one.
    path : str or Path
        The file to write; one of that name is replaced.
    attributes : mapping
        Global attributes.

    Raises
    ------
    InputError
        The file cannot be written.
    """
    path = Path(path)
    parts = [_columns(truth) for truth in truths]
    dataset = xr.Dataset(
        {
            name: (dimension, np.concatenate([part[name][1] for part in parts]), _attributes(name))
            for name, (dimension, _) in parts[0].items()
        },
        attrs={"Conventions": "CF-1.11", **attributes},
    )
    aside = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        dataset.to_netcdf(aside, engine="netcdf4", format="NETCDF4", encoding=_encoding(dataset))
        aside.replace(path)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror or error}") from error
    finally:
        aside.unlink(missing_ok=True)
    return path


def read_profile_truth(path: str | Path, number: int) -> xr.Dataset:
    """Read the truth of one profile, in the units of the file.

    Parameters
    ----------
    path : str or Path
        A truth file.
    number : int
        Number of the profile.

    Returns
    -------
    xarray.Dataset
        ``B_cu`` ... ``B_cr`` along ``truth_time``, motion and actuators along ``time``, the impulses along ``impulse``,
        and current and positions as scalars.

    Raises
    ------
    InputError
        The file cannot be read, or holds no such profile.
    """
    try:
        dataset = xr.open_dataset(path, engine="netcdf4")
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read as the truth of a synthetic mission ({error})") from error
    with dataset:
        rows = {axis: np.flatnonzero(dataset[of].values == number) for axis, of in _OF_PROFILE.items()}
        if len(rows["dive"]) != 1:
            raise InputError(f"{path}: holds no truth for profile {number}")
        return dataset.isel(rows).isel(dive=0).load()


def _columns(truth: ProfileTruth) -> Columns:
    """Lay out one profile's rows, by name with their axis."""
    columns: Columns = {}
    for axis, values in (
        ("truth_time", _step_rows(truth)),
        ("time", _sample_rows(truth)),
        ("impulse", _impulse_rows(truth)),
        ("dive", _dive_row(truth)),
    ):
        columns |= {name: (axis, column) for name, column in values.items()}
    return columns


def _step_rows(truth: ProfileTruth) -> dict[str, npt.NDArray[np.generic]]:
    steps = len(truth.disturbances)
    # Single precision lies a million times below what anybody can tell of a disturbance, and halves the file.
    channels = truth.disturbances.T.astype(np.float32)
    return {
        "truth_time": _instants(truth, np.arange(steps, dtype=np.float64) * truth.step),
        "truth_profile": np.full(steps, truth.number, dtype=np.int32),
        **dict(zip(CHANNELS, channels, strict=True)),
    }


def _sample_rows(truth: ProfileTruth) -> dict[str, npt.NDArray[np.generic]]:
    phi, theta, psi, north, east, depth, u, v, w, p, q, r = truth.states.T
    position, rotation, volume = truth.actuators.T
    return {
        "time": _instants(truth, truth.time),
        "profile": np.full(len(truth.time), truth.number, dtype=np.int32),
        "roll": np.degrees(phi),
        "pitch": np.degrees(theta),
        "heading": np.mod(np.degrees(psi), 360.0),
        "depth": depth,
        "X": north,
        "Y": east,
        "u": u,
        "v": v,
        "w": w,
        "p": np.degrees(p),
        "q": np.degrees(q),
        "r": np.degrees(r),
        "battery_position": position,
        "battery_rotation": np.degrees(rotation),
        "ballast_volume": volume * 1e6,
    }


def _impulse_rows(truth: ProfileTruth) -> dict[str, npt.NDArray[np.generic]]:
    return {
        "impulse_time": _instants(truth, np.array([impulse.time for impulse in truth.impulses])),
        "impulse_profile": np.full(len(truth.impulses), truth.number, dtype=np.int32),
        "impulse_amplitude": np.array([impulse.amplitude for impulse in truth.impulses]),
        "impulse_width": np.array([impulse.width for impulse in truth.impulses]),
    }


def _dive_row(truth: ProfileTruth) -> dict[str, npt.NDArray[np.generic]]:
    scalars = {
        "current_north": truth.current[0],
        "current_east": truth.current[1],
        "entry_latitude": truth.entry[0],
        "entry_longitude": truth.entry[1],
        "exit_latitude": truth.exit[0],
        "exit_longitude": truth.exit[1],
    }
    return {
        "dive": np.array([truth.number], dtype=np.int32),
        "entry_time": _instants(truth, np.zeros(1)),
        "exit_time": _instants(truth, np.array([truth.duration])),
        **{name: np.array([value], dtype=np.float64) for name, value in scalars.items()},
    }


def _instants(truth: ProfileTruth, seconds: npt.NDArray[np.float64]) -> npt.NDArray[np.generic]:
    return truth.epoch + np.rint(seconds * 1e9).astype("timedelta64[ns]")


def _attributes(name: str) -> dict[str, str]:
    if name in _TIMES:
        return {"long_name": _TIMES[name], "standard_name": "time"}
    if name in _OF_PROFILE.values():
        return {"units": "1", "long_name": "number of the profile"}
    unit, long_name = _DESCRIPTIONS[name]
    return {"units": unit, "long_name": long_name}


def _encoding(dataset: xr.Dataset) -> dict[str, dict[str, object]]:
    since = f"seconds since {np.datetime64(dataset['time'].values[0], 'D')}T00:00:00"
    encoding: dict[str, dict[str, object]] = {}
    for name in map(str, dataset.variables):
        encoding[name] = {"zlib": True, "complevel": 4, "shuffle": True, "_FillValue": None}
        if name in _TIMES:
            encoding[name] |= {"units": since, "calendar": "standard", "dtype": "float64"}
    return encoding
