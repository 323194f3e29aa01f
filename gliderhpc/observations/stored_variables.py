"""Variables of an open observation file as arrays, without the values that its attributes or its clock rule out."""

from pathlib import Path

import numpy as np
import numpy.typing as npt
import xarray as xr

from gliderhpc.errors import InputError
from gliderhpc.observations.checks.validation import outside_range
from gliderhpc.observations.files.columns import describe_fills, usual_fills
from gliderhpc.observations.files.valid_limits import declared_limits, describe_outside, outside
from gliderhpc.observations.format import VARIABLES
from gliderhpc.observations.profiles import IntArray
from gliderhpc.observations.records import FloatArray
from gliderhpc.observations.times import DecodedTimes, decode_texts, decode_times, texts_in
from gliderhpc.observations.untimed_samples import with_interpolated_times


class StoredVariables:
    """Variables of an open file, read whole or in slices.

    Times that have been read as a whole stay in memory, since decoding slices takes about a millisecond each. So do the
    other variables of a file in memory, since slicing a variable takes a hundred times as long as slicing its values.

    Parameters
    ----------
    dataset : xarray.Dataset
        The open file, with undecoded times.
    path : Path
        Its path in messages.
    in_memory : bool
        Whether the values of the file are in memory.
    """

    def __init__(self, dataset: xr.Dataset, path: Path, *, in_memory: bool = False) -> None:
        self.dataset = dataset
        self.path = path
        self._in_memory = in_memory
        self._whole: dict[str, DecodedTimes] = {}
        self._whole_numbers: dict[str, FloatArray] = {}
        self._untimed: IntArray = np.zeros(0, dtype=np.int64)

    def __contains__(self, name: str) -> bool:
        return name in self.dataset.variables

    def leave_out(self, rows: IntArray) -> None:
        """Leave out samples without a usable time: their values are missing, and their times interpolated.

        The times increase, and the numbers of the samples remain.
        """
        if np.array_equal(rows, self._untimed):
            return
        self._untimed = rows
        self._whole_numbers.clear()
        if "time" in self._whole:
            self._whole["time"] = with_interpolated_times(self._whole["time"], rows)

    def size(self, dimension: str) -> int:
        """Length of a dimension, 0 if the file does not have it."""
        return int(self.dataset.sizes.get(dimension, 0))

    def numbers(self, name: str, start: int, stop: int) -> FloatArray:
        """Read a slice of one variable as doubles; zeros if the variable is absent.

        Values outside the limits that the file declares, and usual fill values of depth and ballast volume, are missing
        (NaN).
        """
        if name not in self:
            return np.zeros(stop - start)
        if not self._in_memory:
            return self._numbers(name, start, stop)
        if name not in self._whole_numbers:
            self._whole_numbers[name] = self._numbers(name, 0, self.dataset.variables[name].size)
        return self._whole_numbers[name][start:stop]

    def _numbers(self, name: str, start: int, stop: int) -> FloatArray:
        values = np.asarray(self._read(name, start, stop), dtype=np.float64)
        lost = self._lost(name, values) if self._may_lose(name) else np.zeros(len(values), dtype=bool)
        if name != "profile" and "time" in self.dataset.variables[name].dims:
            lost[self._untimed_within(start, stop)] = True
        return np.where(lost, np.nan, values) if lost.any() else values

    def _untimed_within(self, start: int, stop: int) -> IntArray:
        first, last = np.searchsorted(self._untimed, (start, stop))
        return np.asarray(self._untimed[first:last] - start)

    def loses_values(self, name: str) -> bool:
        """Return whether values of a variable are missing although they are in the file."""
        return self._may_lose(name) and bool(self._lost(name, self._whole_variable(name)).any())

    def _may_lose(self, name: str) -> bool:
        return name in _FILLED or declared_limits(self.dataset.variables[name]) is not None

    def _lost(self, name: str, values: FloatArray) -> npt.NDArray[np.bool_]:
        return outside(values, declared_limits(self.dataset.variables[name])) | _plausible_fills(name, values)

    def _whole_variable(self, name: str) -> FloatArray:
        return np.asarray(self._read(name, 0, self.dataset.variables[name].size), dtype=np.float64)

    def describe_missing(self) -> list[str]:
        """Remarks on the values outside the limits that the file declares, and on undeclared fill values.

        Raises
        ------
        InputError
            Most values of a required variable are outside.
        """
        remarks = []
        for name in (each for each in VARIABLES if each in self and self._may_lose(each)):
            values, limits = self._whole_variable(name), declared_limits(self.dataset.variables[name])
            refuse_in = str(self.path) if VARIABLES[name].required else ""
            what = "sample" if VARIABLES[name].dimension == "time" else "fix"
            remarks.append(describe_outside(name, values, limits, refuse_in=refuse_in, what=what))
            fills = _plausible_fills(name, values) & ~outside(values, limits)
            remarks += [describe_fills(name, values, fills)] if fills.any() else []
        remarks += [self._describe_times(name) for name in ("time", "fix_time") if name in self]
        return [remark for remark in remarks if remark]

    def _describe_times(self, name: str) -> str:
        """Remark on the times outside the limits that the file declares; empty without any."""
        values, limits = self._read(name, 0, self.dataset[name].size), declared_limits(self.dataset.variables[name])
        if limits is None or values.dtype.kind not in "fiu":
            return ""
        refuse_in, what = (str(self.path), "sample") if name == "time" else ("", "fix")
        return describe_outside(name, values.astype(np.float64), limits, refuse_in=refuse_in, what=what)

    def times(self, name: str, start: int, stop: int) -> DecodedTimes:
        """Read a slice of one of the time variables.

        Times outside the limits that the file declares are missing; those of samples that are left out (`leave_out`)
        are interpolated.
        """
        if name in self._whole:
            return self._whole[name].part(start, stop)
        attributes, where = self.dataset[name].attrs, f"{self.path}: {name}"
        units, calendar = (str(attributes.get(key, "")) for key in ("units", "calendar"))
        values = self._read(name, start, stop)
        texts, limits = texts_in(values), declared_limits(self.dataset.variables[name])
        if limits is not None and values.dtype.kind in "fiu":
            lost = outside(values.astype(np.float64), limits)
            values = np.where(lost, np.nan, values) if lost.any() else values
        decoded = decode_times(values, units, calendar, where) if texts is None else decode_texts(texts, where)
        if name == "time":
            decoded = with_interpolated_times(decoded, self._untimed_within(start, start + len(decoded.time)))
        if start == 0 and stop == self.dataset[name].size:
            self._whole[name] = decoded
        return decoded

    def _read(self, name: str, start: int, stop: int) -> npt.NDArray[np.generic]:
        try:
            # Slicing the variable takes a fifth of the time of slicing it with its coordinates.
            return np.asarray(self.dataset.variables[name][start:stop].values)
        except (OSError, RuntimeError, ValueError, KeyError) as error:
            reason = str(error).splitlines()[0] if str(error) else type(error).__name__
            raise InputError(
                f"{self.path}: {name} cannot be read, the file is damaged ({reason}); copy it again"
            ) from error


_FILLED = ("depth", "ballast_volume")
"""Variables in whose plausible ranges there are usual fill values; in those of the water, they are implausible."""


def _plausible_fills(name: str, values: FloatArray) -> npt.NDArray[np.bool_]:
    """Mask ``(n,)`` of the usual fill values within the plausible range; those outside are faults of their profiles."""
    if name not in _FILLED:
        return np.zeros(len(values), dtype=bool)
    return usual_fills(values) & ~outside_range(VARIABLES[name], values)
