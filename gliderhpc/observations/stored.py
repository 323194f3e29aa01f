"""Variables of an open observation file as arrays: numbers as doubles, times decoded, damage in one line."""

from pathlib import Path

import numpy as np
import numpy.typing as npt
import xarray as xr

from gliderhpc.errors import InputError
from gliderhpc.observations.records import FloatArray
from gliderhpc.observations.times import DecodedTimes, decode_times


class StoredVariables:
    """The variables of an open file, or slices of them.

    Parameters
    ----------
    dataset : xarray.Dataset
        Opened without decoding its times.
    path : Path
        Its place, for messages.
    """

    def __init__(self, dataset: xr.Dataset, path: Path) -> None:
        self.dataset = dataset
        self.path = path

    def __contains__(self, name: str) -> bool:
        return name in self.dataset.variables

    def size(self, dimension: str) -> int:
        """Length of a dimension, 0 where the file does not have it."""
        return int(self.dataset.sizes.get(dimension, 0))

    def numbers(self, name: str, start: int, stop: int) -> FloatArray:
        """Read one variable's slice as doubles; zeros for an optional one that is absent."""
        if name not in self:
            return np.zeros(stop - start)
        return np.asarray(self._read(name, start, stop), dtype=np.float64)

    def times(self, name: str, start: int, stop: int) -> DecodedTimes:
        """Read a slice of one of the variables of time."""
        attributes = self.dataset[name].attrs
        units, calendar = (str(attributes.get(key, "")) for key in ("units", "calendar"))
        return decode_times(self._read(name, start, stop), units, calendar, f"{self.path}: {name}")

    def _read(self, name: str, start: int, stop: int) -> npt.NDArray[np.generic]:
        try:
            return np.asarray(self.dataset[name][start:stop].values)
        except (OSError, RuntimeError, ValueError, KeyError) as error:
            reason = str(error).splitlines()[0] if str(error) else type(error).__name__
            raise InputError(
                f"{self.path}: {name} cannot be read, the file is damaged ({reason}); copy it again"
            ) from error
