"""Independent currents for the same dives, from a current profiler or the operator's own processing.

A profiler's velocities during the dive are used unchanged. Whether they are absolute, and how they were referenced,
depends on their file.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import scipy
import xarray as xr
from numpy.typing import NDArray

from gliderhpc.archive.profile import ProfileData
from gliderhpc.errors import InputError, first_line
from gliderhpc.observations.format import PROFILE, read_reference
from gliderhpc.studies.library.model_file import COMPONENTS, downward, factor_of, role_of, times_of, velocity_name
from gliderhpc.studies.library.retrieval import DepthResolvedSettings
from gliderhpc.studies.library.scores import MIN_COVERAGE, correlation, covariance_matrix, sigma_distance

Row = Mapping[str, Any]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_OWN = ("reference_current_north", "reference_current_east")

MIN_BINS = 5
"""Minimum number of common depth bins for a correlation."""


@dataclass(frozen=True, eq=False)
class Bins:
    """Assignment of records to depth bins.

    Attributes
    ----------
    weights : (bins, m) sparse
        Weights that average the records of each bin; the rows of empty bins are zero.
    count : (bins,)
        Number of records in each bin.
    """

    weights: scipy.sparse.csr_array
    count: NDArray[np.int64]

    def mean(self, values: Array) -> Array:
        """Mean of ``values (m, ...)`` in each bin, NaN if it is empty; missing values must not be assigned to a bin."""
        mean = np.asarray(self.weights @ np.nan_to_num(values))
        mean[self.count == 0] = np.nan
        return mean

    def spread(self, values: Array) -> Array:
        """Standard deviation of values ``(m, ...)`` within each bin."""
        return np.asarray(np.sqrt(np.maximum(self.mean(values**2) - self.mean(values) ** 2, 0.0)))


def bin_count(deepest: float, height: float) -> int:
    """Number of bins of a given height that reach from the surface to below a depth (m)."""
    return int(deepest // height) + 1


def bins_of(depth: Array, chosen: Mask, height: float, bins: int) -> Bins:
    """Sort the chosen records ``(m,)`` into bins.

    Parameters
    ----------
    depth : (m,)
        Depths, m; those above the surface fall into the first bin, those below the last bin into none.
    chosen : (m,) mask
        Records to use.
    height : float
        Height of a bin, m.
    bins : int
        Number of bins.
    """
    # NaN is below nothing, and so in no bin.
    rows = np.flatnonzero(chosen & (depth < bins * height))
    where = np.maximum((depth[rows] // height).astype(np.int64), 0)
    count = np.bincount(where, minlength=bins)
    weights = scipy.sparse.csr_array((1.0 / count[where], (where, rows)), shape=(bins, len(depth)))
    return Bins(weights, count)


@dataclass(frozen=True, eq=False)
class ReferenceCurrent:
    """A reference's currents for one profile.

    Attributes
    ----------
    velocity : (2,)
        Mean over the dive, north and east, m/s; NaN if the reference covers too little of the dive.
    error : float
        Standard deviation of each component of the mean, m/s; NaN if the reference does not give it.
    covered : float
        Share of the dive's time that the mean covers.
    by_depth : (bins, 2)
        North and east components by depth bin, m/s; NaN in bins without velocities.
    count : (bins,)
        Number of velocities in each bin.
    """

    velocity: Array
    error: float
    covered: float
    by_depth: Array
    count: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class VelocityRecord:
    """Water velocities ``(n, 2)`` (north and east, m/s) at times ``(n,)`` and depths ``(n,)`` (m), in time order."""

    time: NDArray[np.datetime64]
    depth: Array
    velocity: Array

    def for_dive(self, data: ProfileData, height: float, bins: int) -> ReferenceCurrent:
        """Average the velocities during a dive by depth bin, and the bins, weighted by the glider's time in each."""
        ends = data.epoch + np.round(data.record_time[[0, -1]] * 1e9).astype("timedelta64[ns]")
        first, last = np.searchsorted(self.time, ends[0]), np.searchsorted(self.time, ends[1], side="right")
        depth, velocity = self.depth[first:last], self.velocity[first:last]
        sorted_ = bins_of(depth, np.asarray(np.isfinite(velocity).all(axis=1)), height, bins)
        by_depth = np.asarray(sorted_.mean(velocity))
        there = np.isfinite(data.measured[:, 3])
        spent = np.where(sorted_.count > 0, bins_of(data.measured[:, 3], there, height, bins).count, 0)
        covered = float(spent.sum() / max(int(there.sum()), 1))
        enough = covered >= MIN_COVERAGE
        mean = spent @ np.nan_to_num(by_depth) / spent.sum() if enough else np.full(2, np.nan)
        return ReferenceCurrent(mean, float("nan"), covered, by_depth, sorted_.count)


@dataclass(frozen=True, eq=False)
class OperatorCurrents:
    """Depth-averaged currents by profile, from the operator's own processing, in an imported observation file."""

    table: xr.Dataset

    def for_dive(self, data: ProfileData, height: float, bins: int) -> ReferenceCurrent:
        """Return the profile's current; it has no values by depth."""
        nothing = np.full((bins, 2), np.nan), np.zeros(bins, dtype=np.int64)
        if data.number not in self.table[PROFILE].values:
            return ReferenceCurrent(np.full(2, np.nan), float("nan"), 0.0, *nothing)
        row = self.table.sel({PROFILE: data.number})
        error = float(row["reference_current_error"]) if "reference_current_error" in row else float("nan")
        return ReferenceCurrent(np.array([float(row[name]) for name in _OWN]), error, 1.0, *nothing)


Reference = VelocityRecord | OperatorCurrents


def read_reference_currents(path: Path) -> Reference:
    """Read a reference: velocities by time and depth, or an observation file with the operator's own currents.

    Velocities are recognised by their standard names, or by names such as ``u`` and ``v``. They have one or two
    dimensions, and times and depths lie along one or both of these.

    Raises
    ------
    InputError
        There is no such file, or it contains neither kind of currents.
    """
    if not path.exists():
        raise InputError(f"{path}: no such file")
    try:
        with xr.open_dataset(path, decode_times=False) as dataset:
            if not {PROFILE, *_OWN} <= set(dataset.variables):
                return _velocities(str(path), dataset)
        return OperatorCurrents(read_reference(path))
    except (OSError, RuntimeError, ValueError) as error:
        raise InputError(f"{path}: cannot be read as netCDF ({first_line(error)})") from error


def _velocities(label: str, dataset: xr.Dataset) -> VelocityRecord:
    names = [velocity_name(dataset, standard, (1, 2)) for standard in COMPONENTS]
    components = [dataset[name] * factor_of(label, dataset[name], "m s-1") for name in names if name is not None]
    if len(components) < len(COMPONENTS) or set(components[0].dims) != set(components[1].dims):
        raise InputError(
            f"{label}: holds neither {' and '.join(COMPONENTS)} by time and depth nor an operator's own currents "
            "(reference_current_north, reference_current_east)"
        )
    dims = components[0].dims
    time_name, depth_name = (_along(label, dataset, role, set(dims)) for role in ("time", "depth"))
    time = xr.DataArray(times_of(label, dataset[time_name].variable, time_name), dims=dataset[time_name].dims)
    depth = dataset[depth_name] * (downward(dataset[depth_name]) * factor_of(label, dataset[depth_name], "m"))
    wide = xr.broadcast(time, depth, *components)
    flat = [part.transpose(*dims).values.ravel() for part in wide]
    order = np.argsort(flat[0], kind="stable")
    return VelocityRecord(flat[0][order], flat[1][order].astype(np.float64), np.column_stack(flat[2:])[order])


def _along(label: str, dataset: xr.Dataset, role: str, dims: set[object]) -> str:
    """Variable of times or depths along some of the velocities' dimensions."""
    candidates = [
        str(name)
        for name, variable in dataset.variables.items()
        if variable.ndim and set(variable.dims) <= dims and role_of(dataset[name]) == role
    ]
    if not candidates:
        raise InputError(f"{label}: its velocities have no {role}")
    # A current profiler has its own depth, and the depth of each of its cells; the latter vary along more dimensions.
    return max(candidates, key=lambda name: (dataset[name].ndim, name in dataset.coords))


@dataclass(frozen=True)
class ReferenceFile:
    """A reference's file at the time when a study began.

    Attributes
    ----------
    path : Path
        Absolute path.
    size, changed : int
        Size (bytes) and time of the last change (ns).
    """

    path: Path
    size: int
    changed: int

    @classmethod
    def of(cls, path: Path) -> "ReferenceFile":
        """Look a file up; `InputError` if it is not there."""
        if not path.exists():
            raise InputError(f"{path}: no such file")
        state = path.stat()
        return cls(path.resolve(), state.st_size, state.st_mtime_ns)


@lru_cache(maxsize=1)
def open_reference(file: ReferenceFile) -> Reference:
    """Read a reference, once in each worker."""
    return read_reference_currents(file.path)


def compare_with_reference(
    data: ProfileData, reference: Reference, row: Row, settings: DepthResolvedSettings, count: int
) -> dict[str, Any]:
    """Compare a profile's values from study ``currents`` with a reference.

    Parameters
    ----------
    data : ProfileData
        The profile.
    reference : VelocityRecord or OperatorCurrents
        The reference.
    row : mapping
        Values of the profile from the study.
    settings : DepthResolvedSettings
        Settings with the height of a bin, m.
    count : int
        Number of depth bins.

    Returns
    -------
    dict of str to value
        Further values of the profile; values by bin have shape ``(count,)``.
    """
    current = reference.for_dive(data, settings.bin, count)
    return {
        "reference_north": float(current.velocity[0]),
        "reference_east": float(current.velocity[1]),
        "reference_error": current.error,
        "reference_covered": current.covered,
        **_difference(current, row),
        **_shear_correlations(current.by_depth, row, settings.bin),
        "bin_depth": (np.arange(count) + 0.5) * settings.bin,
        "reference_count": current.count,
        "reference_by_depth_north": current.by_depth[:, 0],
        "reference_by_depth_east": current.by_depth[:, 1],
    }


def _difference(current: ReferenceCurrent, row: Row) -> Row:
    """Vector difference of the depth-averaged currents, in m/s and in sigma of the two currents' combined errors."""
    apart = np.array([row["current_north"], row["current_east"]]) - current.velocity
    if not np.isfinite(apart).all():
        return {}
    covariance = covariance_matrix(row["current_north_std"], row["current_east_std"], row["current_covariance"])
    both = covariance + np.nan_to_num(current.error) ** 2 * np.eye(2)
    return {
        "reference_difference": float(np.linalg.norm(apart)),
        "reference_distance": sigma_distance(apart, both),
    }


def _shear_correlations(by_depth: Array, row: Row, height: float) -> Row:
    """Correlate the shear-sensitive part with the reference minus its mean, and with the reference's depth gradient."""
    if "both_shear_north" not in row:
        return {}
    ours = np.column_stack([row["both_shear_north"], row["both_shear_east"]])
    gradient = np.gradient(by_depth, height, axis=0) if len(by_depth) > 1 else np.full_like(by_depth, np.nan)
    return {
        "reference_correlation": _correlation(ours, by_depth),
        "reference_gradient_correlation": _correlation(ours, gradient),
    }


def _correlation(ours: Array, theirs: Array) -> float:
    """Correlation of both components together, after subtraction of each component's mean."""
    known = np.isfinite(ours).all(axis=1) & np.isfinite(theirs).all(axis=1)
    if known.sum() < MIN_BINS:
        return float("nan")
    a, b = (part[known] - part[known].mean(axis=0) for part in (ours, theirs))
    return correlation(a.ravel(), b.ravel())
