"""Observations as an `xarray.Dataset`: read from a file, and written to a file for functions that read files."""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import numpy.typing as npt
import xarray as xr

from gliderhpc.errors import GliderhpcError, InputError
from gliderhpc.observations.dataset import Observations, open_observations, open_stored
from gliderhpc.observations.files.valid_limits import LIMITS
from gliderhpc.observations.format import REFERENCE, VARIABLES
from gliderhpc.observations.stored_variables import StoredVariables
from gliderhpc.observations.survey import Survey, survey_of
from gliderhpc.observations.writer import TIMES, seconds_since, times_since, variable_attributes, write_observations
from gliderhpc.wording import wanted_dataset

Records = xr.Dataset | str | Path
"""Observations as accepted by every function of the Python interface: a Dataset, or the path of a file."""

UNNAMED = "records"
"""Name of a Dataset that comes from no file, in messages and in an archive's attribute ``observations``."""

FIXES = ("fix_time", "fix_latitude", "fix_longitude")

_ATTRIBUTES = ("platform", "platform_id", "mission", "source")


def read_records(path: str | Path) -> xr.Dataset:
    """Check an observation file and open it as a Dataset; values are read when they are used.

    Parameters
    ----------
    path : str or Path
        A netCDF-4 file or a Zarr folder in the observation format.

    Returns
    -------
    xarray.Dataset
        Variables along ``time`` and ``fix``, with the units and CF attributes of the format; ``encoding["source"]`` of
        the Dataset is the path of the file.

    Raises
    ------
    InputError
        As for `gliderhpc.observations.open_observations`.
    """
    with open_observations(path):
        return _decoded(Path(path))


def _decoded(path: Path) -> xr.Dataset:
    # Without the cache, values changed in place would be read from the file again.
    dataset = as_in_file = open_stored(path, cache=True)
    stored = StoredVariables(dataset, path)
    for name in map(str, dataset.variables):
        array = dataset[name]
        if name in TIMES:
            decoded = stored.times(name, 0, stored.size(str(array.dims[0]))).time
            attributes = {key: value for key, value in array.attrs.items() if key not in ("units", "calendar", *LIMITS)}
            dataset = dataset.assign({name: (array.dims, decoded, {"standard_name": "time", **attributes})})
        elif name in VARIABLES or name in REFERENCE:
            if stored.loses_values(name):
                dataset[name] = array = array.copy(data=stored.numbers(name, 0, array.size))
            for limit in LIMITS:
                array.attrs.pop(limit, None)
            array.attrs |= variable_attributes(VARIABLES.get(name) or REFERENCE[name])
    dataset.encoding["source"] = str(path.resolve())
    dataset = dataset.set_coords([name for name in ("time", "fix_time") if name in dataset.variables])
    dataset.set_close(as_in_file.close)
    return dataset


@contextmanager
def opened_records(records: Records) -> Iterator[Observations]:
    """Open records of any kind as the observations that the estimation reads.

    A Dataset that still equals the content of its file is read from that file. Any other Dataset is written to a
    temporary file, which worker processes can open and whose digest depends on the values alone.

    Parameters
    ----------
    records : xarray.Dataset, str or Path
        Records in the observation format.

    Raises
    ------
    InputError
        As for `gliderhpc.observations.open_observations`; the message names a Dataset by the file that it came from,
        or as `UNNAMED`.
    """
    if not isinstance(records, xr.Dataset | str | Path):
        raise InputError(
            f"records: a {type(records).__name__} cannot be used; give {wanted_dataset(records)} in the observation "
            "format, or the path of a file"
        )
    if not isinstance(records, xr.Dataset):
        with open_observations(records) as observations:
            yield observations
        return
    survey = _survey(records)
    source = _unchanged_source(records)
    if source is not None:
        # The file is surveyed again, because its impossible times are merely missing in the Dataset.
        with open_observations(source) as observations:
            yield observations
        return
    with tempfile.TemporaryDirectory(prefix="gliderhpc-records-") as folder:
        written = write_records(_attributes_of_format(records), Path(folder) / _name(records))
        try:
            with open_observations(written, survey=survey) as observations:
                yield observations
        except GliderhpcError as error:
            error.args = (str(error).replace(str(written), _source(records) or UNNAMED),)
            raise


def _attributes_of_format(records: xr.Dataset) -> xr.Dataset:
    """Drop the global attributes that the estimation does not read; netCDF may be unable to store them."""
    read = {key: str(records.attrs[key]) for key in _ATTRIBUTES if records.attrs.get(key) is not None}
    records = records.copy(deep=False)
    records.attrs = read
    return records


def write_records(records: xr.Dataset, path: Path) -> Path:
    """Write a Dataset's variables of the observation format to a file; the same values give the same bytes."""
    stored = StoredVariables(_as_stored(records), path)
    names = [name for name in (*TIMES, *VARIABLES, *REFERENCE) if name in stored]
    if not all(name in names for name in FIXES):
        names = [name for name in names if name not in FIXES]
    # Reference quantities whose shape was changed, for example by `where` or `isel`, are no longer the source's.
    names = [name for name in names if name not in REFERENCE or records[name].dims == (REFERENCE[name].dimension,)]
    variables: dict[str, npt.NDArray[np.generic]] = {
        name: stored.times(name, 0, records[name].size).time
        if name in TIMES
        else stored.numbers(name, 0, records[name].size)
        for name in names
    }
    if "profile" in variables:
        variables["profile"] = np.nan_to_num(variables["profile"]).astype(np.int64)
    attributes = {str(key): value for key, value in records.attrs.items() if key != "Conventions"}
    for name in ("platform", "mission", "source"):
        attributes.setdefault(name, "")
    return write_observations(variables, path, attributes=attributes)


def _survey(records: xr.Dataset) -> Survey:
    """Check a Dataset in the same way as a file."""
    return survey_of(StoredVariables(_as_stored(records), Path(_source(records) or UNNAMED)))


def _as_stored(records: xr.Dataset) -> xr.Dataset:
    """Encode the times of a Dataset as numbers, as in a file."""
    for name in TIMES:
        if name in records.variables and getattr(records[name].dtype, "tz", None) is not None:
            raise InputError(f"{name}: has a time zone; give UTC without one, as in pandas.Series.dt.tz_convert(None)")
        if name in records.variables and np.issubdtype(records[name].dtype, np.datetime64):
            values, units = _numbers(records[name].values)
            records = records.assign({name: (records[name].dims, values, {"units": units})})
    return records


def _numbers(time: npt.NDArray[np.generic]) -> tuple[npt.NDArray[np.float64], str]:
    """Times as numbers and their unit, as the writer stores them."""
    instants = time.astype("datetime64[ns]")
    units = times_since(instants)
    return seconds_since(instants, units), units


def _source(records: xr.Dataset) -> str:
    return str(records.encoding.get("source") or "")


def _name(records: xr.Dataset) -> str:
    """Name of the file to which a Dataset is written: the name of its source if that was netCDF, else `UNNAMED`."""
    name = Path(_source(records)).name
    return name if name.endswith(".nc") else f"{UNNAMED}.nc"


def _unchanged_source(records: xr.Dataset) -> Path | None:
    """Find the file that a Dataset came from; None if there is none, or if the Dataset differs from its content."""
    source = _source(records)
    if not source or not Path(source).exists():
        return None
    try:
        with _decoded(Path(source)) as found:
            same = all(records.attrs.get(key) == found.attrs.get(key) for key in _ATTRIBUTES) and all(
                _same(records, found, name) for name in (*VARIABLES, *TIMES)
            )
    except (InputError, IndexError, ValueError, TypeError):
        # The file has the same name, but comes from another program.
        return None
    return Path(source) if same else None


def _same(one: xr.Dataset, other: xr.Dataset, name: str) -> bool:
    if name not in one.variables or name not in other.variables:
        return name not in one.variables and name not in other.variables
    return np.array_equal(one[name].values, other[name].values, equal_nan=True)
