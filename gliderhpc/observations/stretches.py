"""The unbroken stretches of a mask over samples."""

import numpy as np
import numpy.typing as npt


def stretches(mask: npt.NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First sample, and sample after the last, of every unbroken stretch of True in a mask ``(n,)``."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))
