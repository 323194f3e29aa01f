"""One profile's currents beside a reference's: the means over the dive, and by depth."""

from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gliderhpc.archive.profile import ProfileData
from gliderhpc.studies.currents.reference import Reference, ReferenceCurrent, read_reference_currents
from gliderhpc.studies.currents.settings import DepthResolvedSettings
from gliderhpc.studies.library.current_difference import sigma_distance
from gliderhpc.studies.library.scores import correlation

Array = NDArray[np.float64]
Row = Mapping[str, Any]

LEAST_BINS = 5
"""With fewer bins of depth known to both there is no correlation."""


@lru_cache(maxsize=1)
def opened(path: Path) -> Reference:
    """Read a reference, once a worker."""
    return read_reference_currents(path)


def beside_reference(
    data: ProfileData, reference: Reference, row: Row, bins: Row, settings: DepthResolvedSettings, count: int
) -> tuple[Row, Row]:
    """Put a profile's row and bins of the study beside a reference.

    Returns
    -------
    row, bins : mapping
        What is added to the profile's row and to its bins.
    """
    found = reference.of(data, settings.bin, count)
    added = {
        "reference_north": float(found.velocity[0]),
        "reference_east": float(found.velocity[1]),
        "reference_error": found.error,
        "reference_covered": found.covered,
        **_apart(found, row),
        **_shear_beside(found.by_depth, bins, settings.bin),
    }
    by_depth = {
        "bin_depth": (np.arange(count) + 0.5) * settings.bin,
        "reference_count": found.count,
        "reference_by_depth_north": found.by_depth[:, 0],
        "reference_by_depth_east": found.by_depth[:, 1],
    }
    return added, by_depth


def _apart(found: ReferenceCurrent, row: Row) -> Row:
    """Vector difference of the depth-averaged currents, and in sigma of ours and the reference's error together."""
    apart = np.array([row["current_north"], row["current_east"]]) - found.velocity
    if not np.isfinite(apart).all():
        return {}
    across = row["current_covariance"]
    covariance = np.array([[row["current_north_std"] ** 2, across], [across, row["current_east_std"] ** 2]])
    both = covariance + np.nan_to_num(found.error) ** 2 * np.eye(2)
    return {
        "reference_difference": float(np.linalg.norm(apart)),
        "reference_distance": sigma_distance(apart, both),
    }


def _shear_beside(by_depth: Array, bins: Row, height: float) -> Row:
    """Correlate the shear-sensitive part with the reference less its mean, and with how it changes with depth."""
    if "both_shear_north" not in bins:
        return {}
    ours = np.column_stack([bins["both_shear_north"], bins["both_shear_east"]])
    gradient = np.gradient(by_depth, height, axis=0) if len(by_depth) > 1 else np.full_like(by_depth, np.nan)
    return {
        "reference_correlation": _correlation(ours, by_depth),
        "reference_gradient_correlation": _correlation(ours, gradient),
    }


def _correlation(ours: Array, theirs: Array) -> float:
    """Correlation of both components together, each less its own mean."""
    known = np.isfinite(ours).all(axis=1) & np.isfinite(theirs).all(axis=1)
    if known.sum() < LEAST_BINS:
        return float("nan")
    a, b = (part[known] - part[known].mean(axis=0) for part in (ours, theirs))
    return correlation(a.ravel(), b.ravel())
