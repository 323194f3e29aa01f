"""Measured velocity relative to the water in the records of a current; a current needs none."""

from collections.abc import Sequence

import numpy as np

from gliderhpc.errors import InputError
from gliderhpc.observations.format import VELOCITY
from gliderhpc.observations.navigation_columns import NavigationColumns
from gliderhpc.observations.profiles import IntArray
from gliderhpc.observations.records import FloatArray


def read_velocity(columns: NavigationColumns, order: IntArray) -> tuple[FloatArray | None, list[str]]:
    """Measured velocity ``(n, 3)`` of rows in an order, and remarks on the components that cannot be used.

    These components are NaN; without any usable one there is no velocity (None).
    """
    found: dict[str, FloatArray] = {}
    remarks: list[str] = []
    for name in (name for name in VELOCITY if columns.find(name)):
        if not columns.lies_along_samples(name):
            remarks.append(
                f"{name} is not used: it does not lie along {columns.dimension}, the dimension of the samples"
            )
            continue
        try:
            found[name] = columns.quantity(name)[order]
        except InputError as error:
            remarks.append(f"{name} is not used: {error}")
    missing = np.full(len(order), np.nan)
    return (np.column_stack([found.get(name, missing) for name in VELOCITY]) if found else None), remarks


def join_velocity(velocities: Sequence[FloatArray | None], counts: Sequence[int], order: IntArray) -> FloatArray | None:
    """Join the velocities of several files, with these numbers of samples, in an order; NaN for files without any."""
    if all(velocity is None for velocity in velocities):
        return None
    parts = zip(velocities, counts, strict=True)
    return np.concatenate([np.full((count, 3), np.nan) if velocity is None else velocity for velocity, count in parts])[
        order
    ]
