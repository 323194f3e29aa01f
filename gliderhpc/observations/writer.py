"""Writer of the observation format: one netCDF-4 file, with the same bytes for the same input."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt
import xarray as xr

from gliderhpc.observations.format import CONVENTIONS, REFERENCE, REQUIRED, VARIABLES, Variable
from gliderhpc.observations.times import SECOND
from gliderhpc.output_files import output_file

Attribute = str | int | float

TIMES = ("time", "fix_time", "reference_time")
"""Variables that hold times."""


def write_observations(
    variables: Mapping[str, npt.NDArray[np.generic]],
    path: str | Path,
    *,
    attributes: Mapping[str, Attribute],
    overwrite: bool = False,
) -> Path:
    """Write an observation file.

    The file is written under a temporary name and renamed when complete. It contains no time of writing, so the same
    input gives the same bytes.

    Parameters
    ----------
    variables : mapping of str to array
        ``time`` (datetime64, n) and the variables of the observation format by name, (n,) each, in the units of the
        format (angles in degrees, ballast in cm3). If there are fixes, also ``fix_time`` (datetime64, m),
        ``fix_latitude`` and ``fix_longitude``, (m,) each. Reference quantities are optional. NaN where missing.
    path : str or Path
        The file to write.
    attributes : mapping
        Global attributes: at least ``platform``, ``mission`` and ``source``.
    overwrite : bool
        Replace an existing file.

    Returns
    -------
    Path
        The written file.

    Raises
    ------
    InputError
        The file exists and may not be replaced, is not a regular file, or its folder cannot be written to.
    ValueError
        A required variable or attribute is absent, a name does not belong to the format, or lengths differ.
    """
    path = Path(path)
    dataset = _dataset(variables, attributes)
    with output_file(path, overwrite=overwrite) as aside:
        dataset.to_netcdf(aside, engine="netcdf4", format="NETCDF4", encoding=_encoding(dataset))
    return path


def _dataset(variables: Mapping[str, npt.NDArray[np.generic]], attributes: Mapping[str, Attribute]) -> xr.Dataset:
    absent = [name for name in ("time", *REQUIRED) if name not in variables]
    absent += [name for name in ("platform", "mission", "source") if name not in attributes]
    unknown = set(variables) - set(VARIABLES) - set(REFERENCE) - {"time", "fix_time"}
    faults = [f"absent: {', '.join(absent)}"] if absent else []
    if unknown:
        faults.append(f"not in the observation format: {', '.join(sorted(unknown))}")
    if faults:
        raise ValueError("; ".join(faults))
    since = times_since(_nanoseconds(variables["time"]))
    about = {"standard_name": "time", "long_name": "time", "axis": "T"}
    data: dict[str, tuple[str, npt.NDArray[np.generic], dict[str, str]]] = {
        "time": _column_of_times("time", variables["time"], since, about)
    }
    for name, variable in VARIABLES.items():
        if name in variables and (variable.dimension == "time" or len(variables[name])):
            data[name] = (variable.dimension, np.asarray(variables[name]), variable_attributes(variable))
    if "fix_latitude" in data:
        about = {"standard_name": "time", "long_name": "time of the GPS fix"}
        data["fix_time"] = _column_of_times("fix", variables["fix_time"], since, about)
    for name, variable in REFERENCE.items():
        if name in variables and len(variables[name]):
            about = variable_attributes(variable)
            data[name] = (
                _column_of_times(variable.dimension, variables[name], since, about)
                if name in TIMES
                else (variable.dimension, np.asarray(variables[name]), about)
            )
    return xr.Dataset(data, attrs={"Conventions": CONVENTIONS, **attributes})


def _column_of_times(
    dimension: str, times: npt.NDArray[np.generic], since: str, attributes: dict[str, str]
) -> tuple[str, npt.NDArray[np.generic], dict[str, str]]:
    """Return times as numbers of seconds with their unit; xarray itself cannot store times that are all missing."""
    return dimension, seconds_since(_nanoseconds(times), since), attributes | {"units": since, "calendar": "standard"}


def _nanoseconds(time: npt.NDArray[np.generic]) -> npt.NDArray[np.datetime64]:
    return time.astype("datetime64[ns]")


def variable_attributes(variable: Variable) -> dict[str, str]:
    """CF attributes of a variable of the format."""
    attributes = {"units": variable.unit} if variable.unit else {}
    attributes["long_name"] = variable.long_name
    if variable.standard_name:
        attributes["standard_name"] = variable.standard_name
    if variable.name == "depth":
        attributes |= {"positive": "down", "axis": "Z"}
    return attributes


def times_since(time: npt.NDArray[np.datetime64]) -> str:
    """Return the CF unit of a mission's times, from the times of its samples ``(n,)``.

    Seconds since midnight of the first day are exact in doubles to a few nanoseconds over a mission of a year.
    """
    known = time[~np.isnat(time)]
    return f"seconds since {np.datetime64(known[0] if len(known) else 0, 'D')}"


def seconds_since(time: npt.NDArray[np.datetime64], unit: str) -> npt.NDArray[np.float64]:
    """Return times as numbers in a unit of `times_since`, NaN where missing.

    Readers truncate the product with 1e9 to whole nanoseconds. Where it lies just below the time, the next number is
    returned, so that a time that is read and written again remains the same.
    """
    elapsed = time - np.datetime64(unit.removeprefix("seconds since "), "ns")
    seconds = np.asarray(elapsed / SECOND)
    known, wanted = ~np.isnat(elapsed), elapsed.astype(np.int64)
    above = np.nextafter(seconds, np.inf)
    exact = known & (_whole_nanoseconds(seconds, known) < wanted) & (_whole_nanoseconds(above, known) == wanted)
    return np.where(exact, above, seconds)


def _whole_nanoseconds(seconds: npt.NDArray[np.float64], known: npt.NDArray[np.bool_]) -> npt.NDArray[np.int64]:
    return (np.where(known, seconds, 0.0) * 1e9).astype(np.int64)


def _encoding(dataset: xr.Dataset) -> dict[str, dict[str, object]]:
    """Compressed encoding of each variable: integers for profile numbers, doubles for all others."""
    compressed = {"zlib": True, "complevel": 4, "shuffle": True}
    encoding: dict[str, dict[str, object]] = {}
    for name in map(str, dataset.variables):
        encoding[name] = {**compressed}
        if name in TIMES:
            encoding[name] |= {"dtype": "float64", "_FillValue": None}
        elif name in ("profile", "reference_profile"):
            encoding[name] |= {"dtype": "int32", "_FillValue": None}
        else:
            encoding[name] |= {"dtype": "float64", "_FillValue": np.nan}
    return encoding
