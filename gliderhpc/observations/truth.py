"""Reader of a synthetic mission's truth, which is stored in a file next to its observations."""

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
import xarray as xr

from gliderhpc.errors import InputError

OF_PROFILE = {"truth_time": "truth_profile", "time": "profile", "impulse": "impulse_profile", "dive": "dive"}
"""Variable with the profile number of each row, by axis."""


def truth_path(path: str | Path) -> Path:
    """Path of the truth of an observation file: ``OUT.truth.nc`` next to ``OUT.nc``."""
    return Path(path).with_suffix(".truth.nc")


def read_profile_truth(path: str | Path, number: int) -> xr.Dataset:
    """Read the truth of one profile in the units of the file.

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
        The file cannot be read, or does not contain the profile.
    """
    (truth,) = read_profile_truths(path, [number])
    return truth


def read_profile_truths(path: str | Path, numbers: Iterable[int]) -> Iterator[xr.Dataset]:
    """Yield the truth of some profiles of a file; content and errors as those of `read_profile_truth`."""
    with _opened(path) as dataset:
        profiles = {axis: dataset[of].values for axis, of in OF_PROFILE.items()}
        for number in numbers:
            rows = {axis: np.flatnonzero(profile == number) for axis, profile in profiles.items()}
            if len(rows["dive"]) != 1:
                raise InputError(
                    f"{path}: has no truth for profile {number}; give the truth file that was written with the "
                    "observations"
                )
            yield dataset.isel(rows).isel(dive=0).load()


def read_currents(path: str | Path) -> xr.Dataset:
    """Read the true currents of all profiles, with their times and places, along ``dive`` and ``level`` (depth).

    Raises
    ------
    InputError
        The file cannot be read.
    """
    with _opened(path) as dataset:
        along = [str(name) for name, variable in dataset.variables.items() if set(variable.dims) <= {"dive", "level"}]
        return dataset[along].load()


def most_impulses(path: str | Path) -> int:
    """Return the greatest number of impulses in one profile.

    Raises
    ------
    InputError
        The file cannot be read.
    """
    with _opened(path) as dataset:
        _, counts = np.unique(dataset[OF_PROFILE["impulse"]].values, return_counts=True)
    return int(counts.max(initial=0))


def _opened(path: str | Path) -> xr.Dataset:
    try:
        dataset = xr.open_dataset(path, engine="netcdf4")
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read as the truth of a synthetic mission ({error})") from error
    missing = [name for name in OF_PROFILE.values() if name not in dataset]
    if missing:
        dataset.close()
        raise InputError(
            f"{path}: is not the truth of a synthetic mission, as it has no variable {missing[0]}; give the file "
            "OUT.truth.nc that was written with the observations"
        )
    return dataset
