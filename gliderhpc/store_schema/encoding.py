"""Values in the form in which an archive keeps them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gliderhpc.store_schema.schema import Variable


def encoded(variable: Variable, values: Any) -> Any:
    """Instants as seconds since 1970 (NaT as NaN); everything else as it is."""
    if not (variable.is_time and np.asarray(values).dtype.kind == "M"):
        return values
    instants = np.asarray(values).astype("datetime64[ns]")
    since = np.datetime64(0, "ns")
    return np.where(np.isnat(instants), np.nan, (instants - since) / np.timedelta64(1, "s"))


def padded_row(variable: Variable, label: str, row: ArrayLike, length: int) -> NDArray[Any]:
    """Fill a row up to its length, after holding it against its variable."""
    values = np.asarray(encoded(variable, row))
    if values.ndim != 1 or values.size > length:
        raise ValueError(f"{label}: a row of shape {values.shape} does not fit into {length} columns")
    if not variable.dtype.startswith("float") and values.dtype.kind not in "iub":
        raise ValueError(f"{label}: {values.dtype} values cannot go into {variable.dtype} without loss")
    padded = np.full(length, variable.fill_value, dtype=variable.dtype)
    padded[: values.size] = values
    return padded


def check_position(index: int, count: int) -> None:
    """Refuse a position outside the archive."""
    # zarr takes -1 for the last row, and a worker's slip would then damage another profile's data.
    if not 0 <= index < count:
        raise ValueError(f"position {index} is outside the archive's {count} profiles")
