"""Data of one profile of an archive as plain arrays, for figures and tables."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gliderhpc.angles import on_branch_of, unwrap, wrap
from gliderhpc.archive.reader import Archive
from gliderhpc.errors import InputError
from gliderhpc.observations.profile_numbers import describe_numbers
from gliderhpc.observations.series import averages_between
from gliderhpc.observations.times import SECOND
from gliderhpc.outcomes import Outcome
from gliderhpc.store_schema import BUOYANCY
from gliderhpc.store_schema.schema import CONTROLS, MOTION, SEAWATER
from gliderhpc.vocabulary import CHANNELS, OF_WINDOWS, QUALITY

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

TRACKED = {"roll": "degree", "pitch": "degree", "heading": "degree", "depth": "m"}
"""Observables that the inversion tracks, with their units in the archive."""

ADJOINT, SMOOTHED = "adjoint", "smoothed"
ESTIMATES = (ADJOINT, SMOOTHED)
"""Estimates of disturbances and motion: from the inversion's windows (the primary estimate), and from the smoother."""

SETTLING = 60.0
"""Time at the start of a profile that is excluded from statistics (s), while the first windows converge."""

NOT_STEADY = ("vibration", "gap_in_the_record")
"""Quality bits that exclude a sample from steady glide."""

_TIME_TOLERANCE = 1e-5

_READ_AT_ONCE = 24
"""Number of profiles whose rows are read together, which takes a fraction of the time of reading them one by one."""


@dataclass(frozen=True, eq=False, kw_only=True)
class RecordedProfile:
    """Records of one profile and the quality of its estimate, without fill values.

    Attributes
    ----------
    number : int
        Number of the profile.
    attributes : mapping
        The archive's root attributes.
    table : mapping
        The profile's row of the archive's table.
    epoch : numpy.datetime64
        Time of the first sample.
    time : (n,) array
        Times of the samples, s since the epoch.
    quality : (n,) array of uint8
        Flag masks of the samples.
    record_time : (m,) array
        Times of the records, s since the epoch.
    measured : (m, 4) array
        Roll, pitch, heading (degree, unwrapped) and depth (m) on the records; NaN where missing.
    sampled : (m,) array of bool
        Mask of the records nearest to samples; the others are interpolated. All false in archives without that
        variable.
    controls : (m, 4) array
        Recorded controls on the records, in the units of :data:`CONTROLS`.
    seawater : (m, 3) array or None
        Density, temperature and pressure of the water used for the buoyancy, in the units of :data:`SEAWATER`; None if
        the buoyancy used the depth slope.
    """

    number: int
    attributes: Mapping[str, Any]
    table: Mapping[str, Any]
    epoch: np.datetime64
    time: Array
    quality: NDArray[np.uint8]
    record_time: Array
    measured: Array
    sampled: Mask
    controls: Array
    seawater: Array | None = None

    @property
    def step(self) -> float:
        """Interval between samples, s."""
        return float(self.attributes["step"])

    @property
    def steady(self) -> Mask:
        """Mask ``(n,)`` of the samples in steady glide: no vibration, no gap, and after `SETTLING`."""
        return ~self.flagged(*NOT_STEADY) & (self.time >= SETTLING)

    @property
    def steady_records(self) -> Mask:
        """Mask ``(m,)`` of the records in steady glide."""
        return self.on_records(self.steady)

    def on_records(self, mask: Mask) -> Mask:
        """Convert a mask on the samples ``(n,)`` to a mask on the records ``(m,)``."""
        samples = np.searchsorted(self.time, self.record_time + _TIME_TOLERANCE, side="right") - 1
        return np.asarray(mask[samples], dtype=np.bool_)

    def flagged(self, *meanings: str) -> Mask:
        """Mask ``(n,)`` of the samples with any of the quality bits of the given meanings."""
        return np.asarray((self.quality & QUALITY.mask(*meanings)) != 0, dtype=np.bool_)


@dataclass(frozen=True, eq=False, kw_only=True)
class ProfileData(RecordedProfile):
    """Records of one profile and an estimate, without fill values.

    Attributes
    ----------
    estimate : str
        One of `ESTIMATES`: the source of `disturbances`, `reconstructed` and `motion`.
    disturbances, prior : (n, 6) arrays
        ``B_cu`` ... ``B_cr`` of the estimate and of the filter, N and N m; row k acts from sample k to k+1.
    disturbances_std : (n, 6) array
        Standard deviation of the disturbances; NaN if the estimate has none (the adjoint's in archives before version
        1.9, and where the smoother has no estimate).
    reconstructed : (m, 4) array
        Values of the estimate for `measured`, on the same branch of the heading.
    motion : (m, 8) array
        ``X`` ... ``r`` of the reconstruction on the records, in the units of :data:`MOTION`.
    """

    estimate: str
    disturbances: Array
    disturbances_std: Array
    prior: Array
    reconstructed: Array
    motion: Array

    @property
    def converged(self) -> Mask:
        """Mask ``(n,)`` of the samples whose window converged; all samples of an estimate without windows."""
        return np.asarray((self.own_quality & QUALITY.mask("window_not_converged")) == 0, dtype=np.bool_)

    @property
    def own_quality(self) -> NDArray[np.uint8]:
        """Quality ``(n,)`` of the estimate: the smoother's without the bits of the adjoint's windows."""
        return without_windows(self.quality) if self.estimate == SMOOTHED else self.quality

    @property
    def residuals(self) -> Array:
        """Measured minus reconstructed values ``(m, 4)``, degree (heading difference wrapped) and m."""
        difference = self.measured - self.reconstructed
        difference[:, 2] = wrap(difference[:, 2])
        return difference

    def disturbance(self, channel: str) -> Array:
        """One disturbance ``(n,)`` by its name in `CHANNELS`, N or N m."""
        return self.disturbances[:, list(CHANNELS).index(channel)]


def without_windows(quality: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return quality flags without the bits of the adjoint's windows."""
    return quality & np.uint8(~QUALITY.mask(*OF_WINDOWS) & 0xFF)


def done_profiles(archive: Archive) -> list[int]:
    """Numbers of the profiles of an archive that are done."""
    table = archive.to_dataset()
    statuses = zip(table["profile"].values, table["status"].values, strict=True)
    return [int(number) for number, status in statuses if str(status) == "done"]


def read_recorded_profiles(archive: Archive, numbers: Sequence[int]) -> list[RecordedProfile]:
    """Read the records of profiles, which takes a fraction of the time of `read_profile_data`.

    Parameters
    ----------
    archive : Archive
        The archive.
    numbers : sequence of int
        Numbers of the profiles.

    Raises
    ------
    InputError
        The archive has no such profile, or a profile failed or is not yet done.
    """
    tables = _rows(archive, numbers)
    found = []
    for first in range(0, len(numbers), _READ_AT_ONCE):
        part = slice(first, first + _READ_AT_ONCE)
        names = {"series": ("time", "quality"), "state": ("time",), "observed": ()}
        groups = [_group_rows(archive, group, list(numbers[part]), *names[group]) for group in names]
        for i, table in enumerate(tables[part]):
            found.append(_recorded(archive, table, *(group.isel(profile=i) for group in groups)))
    return found


def read_profile_data(archive: Archive, number: int, estimate: str = ADJOINT) -> ProfileData:
    """Read one profile of an open archive (see :func:`gliderhpc.archive.mission.open_mission`).

    Parameters
    ----------
    archive : Archive
        The archive.
    number : int
        Number of the profile.
    estimate : str
        One of `ESTIMATES`. The smoother's disturbances and all standard deviations, which the archive stores on the
        records, are interpolated to the samples; they change little from one record to the next.

    Raises
    ------
    InputError
        The archive has no such profile, the profile failed or is not yet done, or the archive has no such estimate.
    """
    (table,) = _rows(archive, [number])
    smoothed = estimate == SMOOTHED
    # Only these: every variable takes about a millisecond.
    series = _group_rows(archive, "series", number, "time", "quality", *(() if smoothed else CHANNELS))
    moving = ("time", *TRACKED, *MOTION, *_std_names(CHANNELS))
    state = _group_rows(archive, _group_of(archive, estimate), number, *moving, *(CHANNELS if smoothed else ()))
    observed, prior = _group_rows(archive, "observed", number), _group_rows(archive, "prior", number, *CHANNELS)
    recorded = _recorded(archive, table, series, state, observed)
    time, record_time = recorded.time, recorded.record_time
    samples, records = _filled_mask(series["time"]), _filled_mask(state["time"])
    if smoothed:
        disturbances = _interpolate_to_samples(time, record_time, _columns(state, CHANNELS)[records])
    else:
        disturbances = _columns(series, CHANNELS)[samples]
    deviation = _optional_columns(state, _std_names(CHANNELS))[records]
    reconstructed = _columns(state, TRACKED)[records]
    reconstructed[:, 2] = on_branch_of(recorded.measured[:, 2], reconstructed[:, 2])
    return ProfileData(
        **vars(recorded),
        estimate=estimate,
        disturbances=disturbances,
        disturbances_std=_interpolate_to_samples(time, record_time, deviation),
        prior=_columns(prior, CHANNELS)[samples],
        reconstructed=reconstructed,
        motion=_columns(state, MOTION)[records],
    )


def _recorded(
    archive: Archive, table: Mapping[str, Any], series: xr.Dataset, state: xr.Dataset, observed: xr.Dataset
) -> RecordedProfile:
    """Return the records of a profile from its rows."""
    number = int(series["profile"])
    samples, records = _filled_mask(series["time"]), _filled_mask(state["time"])
    instants = series["time"].values[samples]
    measured = _columns(observed, TRACKED)[records]
    measured[:, 2] = unwrap(measured[:, 2])
    return RecordedProfile(
        number=number,
        attributes={str(key): value for key, value in archive.attrs.items()},
        table=table,
        epoch=instants[0],
        time=_seconds(instants, instants[0]),
        quality=series["quality"].values[samples].astype(np.uint8),
        record_time=_seconds(state["time"].values[records], instants[0]),
        measured=measured,
        sampled=_sampled_mask(observed)[records],
        controls=_columns(observed, CONTROLS)[records],
        seawater=_columns(observed, SEAWATER)[records] if _is_density(table.get("buoyancy")) else None,
    )


def uses_measured_density(archive: Archive, number: int) -> bool:
    """Return whether a profile's buoyancy uses the measured density; always false in archives before version 1.3."""
    table = archive.to_dataset()
    return "buoyancy" in table and _is_density(table["buoyancy"].sel(profile=number))


def _is_density(buoyancy: Any) -> bool:
    return bool(buoyancy == BUOYANCY.meanings["density"])


def filter_fallbacks(archive: Archive, numbers: Iterable[int]) -> list[int]:
    """Return the profiles without a usable smoothed estimate, for which the filter's estimate is the fallback.

    Raises
    ------
    InputError
        The archive has no smoothed estimate.
    """
    outcomes = archive[_group_of(archive, SMOOTHED)].to_dataset()["outcome"]
    codes = {number: float(outcomes.sel(profile=number)) for number in numbers}
    return [number for number, code in codes.items() if not (np.isfinite(code) and Outcome(int(code)).usable)]


def truth_on_samples(data: ProfileData, truth: xr.Dataset) -> Array:
    """Average the true disturbances over the archive's steps.

    True and estimated disturbances are piecewise constant, each on its own steps, so the average is exact.

    Parameters
    ----------
    data : ProfileData
        The profile.
    truth : xarray.Dataset
        Truth of the profile, as returned by :func:`gliderhpc.observations.truth.read_profile_truth`.

    Returns
    -------
    (n, 6) array
        ``B_cu`` ... ``B_cr``, N and N m; NaN outside the time of the truth.

    Raises
    ------
    InputError
        The truth covers none of the profile's time, or names another mission.
    """
    named = [str(attributes.get("mission", "")) for attributes in (data.attributes, truth.attrs)]
    if all(named) and named[0] != named[1]:
        raise InputError(
            f"the truth is that of mission {named[1]!r}, not of {named[0]!r}; give the truth file that was written "
            "with the observations"
        )
    starts = _seconds(truth["truth_time"].values, data.epoch)
    if len(starts) < 2 or starts[0] > data.time[-1] or starts[-1] < data.time[0]:
        raise InputError(
            f"profile {data.number}: the truth belongs to another mission, as it does not overlap the profile's time; "
            "give the truth file that was written with the observations"
        )
    truth_edges = np.append(starts, 2.0 * starts[-1] - starts[-2])
    edges = np.append(data.time, data.time[-1] + data.step)
    average = averages_between(_columns(truth, CHANNELS), truth_edges, edges)
    covered = (edges[:-1] >= truth_edges[0] - _TIME_TOLERANCE) & (edges[1:] <= truth_edges[-1] + _TIME_TOLERANCE)
    average[~covered] = np.nan
    return average


def _rows(archive: Archive, numbers: Sequence[int]) -> list[dict[str, Any]]:
    """Read the rows of profiles in the archive's table, all of which must be done."""
    table = archive.to_dataset()
    known = table["profile"].values.tolist()
    for number in numbers:
        if number not in known:
            raise InputError(f"the archive has no profile {number}; the available ones are {describe_numbers(known)}")
    read = table.sel(profile=list(numbers)).load()
    columns = {str(name): variable.values for name, variable in read.data_vars.items()}
    rows = [{name: values[i] for name, values in columns.items()} for i in range(len(numbers))]
    for number, row in zip(numbers, rows, strict=True):
        if str(row["status"]) != "done":
            reason = f": {row['message']}" if row["message"] else ""
            raise InputError(f"profile {number} is {row['status']}, so there is nothing to show{reason}")
    return rows


def _group_rows(archive: Archive, group: str, profile: int | list[int], *names: str) -> xr.Dataset:
    """Read the row of a profile, or of several, of the named variables that a group has, or of all its variables."""
    dataset = archive[group].to_dataset()
    selected = [name for name in names if name in dataset] if names else list(dataset.data_vars)
    return dataset[selected].sel(profile=profile).load()


def _group_of(archive: Archive, estimate: str) -> str:
    """Return the group of an estimate's motion."""
    group = {ADJOINT: "state", SMOOTHED: "smoothed"}[estimate]
    if group not in archive.children:
        raise InputError(f"the archive has no group '{group}'; run the mission again to add it")
    return group


def _interpolate_to_samples(time: Array, record_time: Array, values: Array) -> Array:
    """Interpolate columns from the records to the samples; the last row, after which no disturbance acts, is NaN."""
    known = np.isfinite(values).all(axis=1)
    if not known.any():
        return np.full((len(time), values.shape[1]), np.nan)
    columns = np.column_stack([np.interp(time, record_time[known], column[known]) for column in values.T])
    columns[-1] = np.nan
    return columns


def _std_names(names: Iterable[str]) -> list[str]:
    return [f"{name}_std" for name in names]


def _filled_mask(time: xr.DataArray) -> Mask:
    """Return the mask of a row's entries that are not fill values."""
    return np.asarray(~np.isnat(time.values), dtype=np.bool_)


def _sampled_mask(observed: xr.Dataset) -> Mask:
    if "sampled" not in observed:
        return np.zeros(observed.sizes["record"], dtype=np.bool_)
    return np.asarray(observed["sampled"].values == 1, dtype=np.bool_)


def _columns(dataset: xr.Dataset, names: Iterable[str]) -> Array:
    return np.column_stack([dataset[name].values.astype(np.float64) for name in names])


def _optional_columns(dataset: xr.Dataset, names: list[str]) -> Array:
    """Return columns that archives of an earlier version lack; NaN there."""
    if names[0] not in dataset:
        return np.full((dataset.sizes["record"], len(names)), np.nan)
    return _columns(dataset, names)


def _seconds(instants: NDArray[Any], epoch: np.datetime64) -> Array:
    return np.asarray((instants - epoch) / SECOND, dtype=np.float64)
