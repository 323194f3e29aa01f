"""The disturbance-augmented extended Kalman filter of section 4.1, applied to several profiles at a time."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gliderhpc.errors import ProfileError
from gliderhpc.estimation.innovations import contradict_prior, departing_quantity, log_density
from gliderhpc.estimation.preparation import (
    PreparedProfile,
    describe_unexpected_density,
    fed_samples,
    feed_interval,
    steps_in,
)
from gliderhpc.estimation.priors import candidate_priors
from gliderhpc.estimation.self_motion import flight_guesses
from gliderhpc.estimation.sensor_noise import measurement_variance
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.kernels import filter as kernel
from gliderhpc.kernels.elementwise import LANES
from gliderhpc.kernels.filter_memory import ENDED, IDLE, Records, allocate, load_profile
from gliderhpc.observations.dive_phases import describe_rest
from gliderhpc.platform import DisturbancePrior

Array = NDArray[np.float64]

INITIAL_DEVIATION = np.array([0.01, 0.01, 0.01, 0.2, 0.1, 0.02, 0.03, 0.02, 0.02, 0.02])
"""Standard deviation of the initial sensed states: rad, m, m/s, rad/s."""

_PATH_ORDER = np.array([0, 1, 2, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 3, 4])
"""Indices of the kernel's sensed states, disturbances, X and Y among the twelve states and six disturbances."""

GUESS_INTERVAL = 1.0
"""Interval (s) of the velocities and rates that a restart uses; attitude and depth are those of its own sample."""


@dataclass(frozen=True, eq=False)
class FilterEstimate:
    """Results of the filter for one profile.

    Attributes
    ----------
    states : (n+1, 12)
        Filtered states (eq. 16), SI and rad; NaN after the row at which a run was abandoned.
    disturbances : (n+1, 6)
        Filtered disturbances, N and N m; NaN after the same row.
    gated, inflated, reset : int
        Numbers of samples with a rejected channel, of those with a widened variance inside the vibration set, and of
        restarts.
    fed : int
        Number of samples fed to the filter.
    events : (n+1,) uint8
        Events at each sample, as bits of `gliderhpc.kernels.filter`.
    innovations, innovation_variances : (m, 4)
        Innovations of the fed samples' roll, pitch, heading (rad, rad2) and depth (m, m2), including gated ones, and
        the variances that the filter expected. An innovation is NaN where nothing was measured, and where the estimate
        was no longer plausible; its variance is then meaningless. Both are NaN after the row at which a run was
        abandoned.
    prior_name, prior : str, DisturbancePrior
        Name of the disturbance prior used (`candidate_priors`), and the prior: ``usual``, or ``rough_water`` if the
        usual one could not follow the record, or is contradicted by its innovations and less likely.
    """

    states: Array
    disturbances: Array
    gated: int
    inflated: int
    reset: int
    fed: int
    events: NDArray[np.uint8]
    innovations: Array
    innovation_variances: Array
    prior_name: str
    prior: DisturbancePrior

    @property
    def rejected_fraction(self) -> float:
        """Ratio of gated, inflated and reset samples to fed ones."""
        return (self.gated + self.inflated + self.reset) / max(self.fed, 1)

    def describe(self) -> str:
        """Describe the counts in one clause, with the quantity that most often departs from the model."""
        counts = f"filter: {self.gated} gated, {self.inflated} inflated, {self.reset} reset of {self.fed} samples"
        affected = self.gated + self.inflated + self.reset > 0
        return f"{counts}, most of them in {self.departing}" if affected and self.departing else counts

    @cached_property
    def departing(self) -> str:
        """Quantity that most often departs from the model; empty if none does."""
        return departing_quantity(self.innovations, self.innovation_variances)


def run_filter(profile: PreparedProfile, settings: EstimationSettings) -> FilterEstimate:
    """Filter one profile as `run_filters` does.

    Raises
    ------
    ProfileError
        No sample of the profile could be fed, or the filter rejected more than the allowed share.
    """
    (filtered,) = run_filters([profile], settings)
    if isinstance(filtered, ProfileError):
        raise filtered
    return filtered


def run_filters(
    profiles: Iterable[PreparedProfile], settings: EstimationSettings
) -> list[FilterEstimate | ProfileError]:
    """Filter several profiles at a time (eqs. 19-27), each with its candidate priors until one can follow its record.

    A prior is abandoned as soon as it has rejected more than the allowed share of all the profile's samples. The last
    candidate runs to the end, and a refusal therefore has complete counts. If the innovations of a prior that can
    follow the record contradict it (`contradict_prior`), the next one is run too, and the more likely one is used.

    Parameters
    ----------
    profiles : iterable of PreparedProfile
        Any number of profiles. The result of one is identical bit for bit, whatever the others.
    settings : EstimationSettings
        Settings, of which ``step`` and ``filter`` are used.

    Returns
    -------
    list
        Estimate of each profile, or the error with the reason of its refusal.
    """
    results: dict[int, FilterEstimate | ProfileError] = {}
    running: dict[int, PreparedProfile] = {}

    def tasks() -> Iterator[_Task]:
        for i, profile in enumerate(profiles):
            running[i] = profile
            try:
                yield _Task(i, _inputs(profile, settings), tuple(_priors_of(profile).items()))
            except ProfileError as error:
                results[i] = error

    for i, estimate in _filter_in_lanes(tasks(), settings):
        profile = running.pop(i)
        results[i] = refusal(estimate, settings, profile) if _is_refused(estimate, settings) else estimate
    return [results[i] for i in range(len(results))]


def _priors_of(profile: PreparedProfile) -> dict[str, DisturbancePrior]:
    return candidate_priors(profile.glider.platform, profile.series.attitude_interval, profile.driving_weight)


def filter_with_priors(
    profiles: Iterable[PreparedProfile], priors: Iterable[DisturbancePrior], settings: EstimationSettings
) -> list[FilterEstimate]:
    """Filter several profiles at a time, each to its end with its own prior, whatever share of samples is rejected.

    Raises
    ------
    ProfileError
        No sample of a profile could be fed.
    """
    pairs = enumerate(zip(profiles, priors, strict=True))
    tasks = (_Task(i, _inputs(profile, settings), (("given", prior),)) for i, (profile, prior) in pairs)
    results = dict(_filter_in_lanes(tasks, settings))
    return [results[i] for i in range(len(results))]


class FilterTrials:
    """Profiles to be filtered with many disturbance priors in place of their platforms'.

    Parameters
    ----------
    profiles, settings : sequence of PreparedProfile, EstimationSettings
        Profiles and settings, as in `run_filters`.

    Raises
    ------
    ProfileError
        No sample of a profile could be fed.
    """

    def __init__(self, profiles: Sequence[PreparedProfile], settings: EstimationSettings) -> None:
        self._settings = settings
        self._profiles = [_inputs(profile, settings) for profile in profiles]

    def run(self, priors: Sequence[DisturbancePrior]) -> Iterator[tuple[int, int, FilterEstimate]]:
        """Filter every profile with every prior, several at a time; yield each when complete, with both indices.

        The results are identical to those of `filter_with_priors`, bit for bit.
        """
        tasks = (
            _Task(len(priors) * i + k, profile, (("given", prior),))
            for i, profile in enumerate(self._profiles)
            for k, prior in enumerate(priors)
        )
        for key, estimate in _filter_in_lanes(tasks, self._settings):
            yield key // len(priors), key % len(priors), estimate


def _is_refused(estimate: FilterEstimate, settings: EstimationSettings) -> bool:
    return estimate.rejected_fraction > settings.filter.max_rejected_fraction


def refusal(
    estimate: FilterEstimate, settings: EstimationSettings, profile: PreparedProfile | None = None
) -> ProfileError:
    """Return the error for an estimate that rejected too large a share of samples.

    If the profile is given, a rest of the glider at one depth is named in place of a general remedy, and an unexpected
    density is added.
    """
    rest, density = "", None
    if profile is not None:
        rest = describe_rest(profile.series)
        density = describe_unexpected_density(profile.glider.platform, profile.series)
    remedy = rest or (_IN_TURNS if estimate.departing in ("roll", "heading") else _IN_TRIM)
    return ProfileError(
        f"{estimate.describe()}, more than {settings.filter.max_rejected_fraction:.0%}: the hull's model does not "
        f"follow this record; {remedy}, or raise filter.max_rejected_fraction" + (f"; {density}" if density else "")
    )


_IN_TRIM = "check the platform (neutral volume, battery zero) and the signs of the battery"
_IN_TURNS = (
    "the water may turn the glider more than the disturbance prior expects, and `gliderhpc tune` estimates another one "
    "from other profiles; or check the signs of the battery's rotation and of the rudder"
)
"""Remedies, by the quantity that departs from the model."""


@dataclass(frozen=True, eq=False)
class _Inputs:
    """Inputs of the kernel for one profile: the filter's arrays (`Records`), initial state, variances and patience.

    Priors are not compared where the samples fed are interpolated, since their errors are not independent.
    """

    hull: Array
    bodies: Array
    measured: Array
    fed: NDArray[np.bool_]
    vibrating: NDArray[np.bool_]
    guesses: Array
    state0: Array
    variance: Array
    patience: int
    interpolated: bool

    def judged(self, estimate: FilterEstimate) -> tuple[Array, Array]:
        """Innovations ``(m, 4)`` by which a prior is judged, outside the vibration set, and their variances."""
        usual = ~self.vibrating[self.fed]
        return estimate.innovations[usual], estimate.innovation_variances[usual]


@dataclass(frozen=True, eq=False)
class _Task:
    """A profile with the priors that are still to be tried, and the estimate with one that is contradicted."""

    key: int
    profile: _Inputs
    priors: tuple[tuple[str, DisturbancePrior], ...]
    contradicted: FilterEstimate | None = None

    def next_task(self, estimate: FilterEstimate, settings: EstimationSettings) -> "_Task | None":
        """Return the task with the next prior, or None if no further prior has to be tried."""
        if not self.priors[1:]:
            return None
        if _is_refused(estimate, settings):
            return replace(self, priors=self.priors[1:])
        innovations, gate = self.profile.judged(estimate), settings.filter.gate
        if not self.profile.interpolated and contradict_prior(*innovations, gate):
            return replace(self, priors=self.priors[1:], contradicted=estimate)
        return None

    def more_likely(self, estimate: FilterEstimate, settings: EstimationSettings) -> FilterEstimate:
        """Return the estimate, or the contradicted one if that is more likely or the only one not refused."""
        if self.contradicted is None:
            return estimate
        if _is_refused(estimate, settings):
            return self.contradicted
        contradicted, latest = (
            np.nansum(log_density(*self.profile.judged(candidate), settings.filter.gate))
            for candidate in (self.contradicted, estimate)
        )
        return estimate if latest > contradicted else self.contradicted


class _FilterBatch:
    """`LANES` profiles filtered in step."""

    def __init__(self, settings: EstimationSettings) -> None:
        self._settings = settings
        self._memory, self._progress = allocate()
        row, flag, note = np.zeros((1, 12)), np.zeros(1, dtype=bool), np.zeros(1, dtype=np.uint8)
        unused = (
            row[:, :11].copy(), row[:, :4].copy(), flag, flag, row[:, :6].copy(), row, row[:, :6].copy(), note,
            np.zeros((0, 2, 4)),
        )  # fmt: skip
        self._records: list[tuple[NDArray[Any], ...]] = [unused] * LANES
        self._priors: dict[int, tuple[str, DisturbancePrior]] = {}

    def load(self, lane: int, task: _Task) -> None:
        """Load a profile into a lane with its first prior; the run is abandoned when it rejects too many samples."""
        profile, step = task.profile, self._settings.step
        rows = len(profile.measured)
        self._priors[lane] = _, prior = task.priors[0]
        self._records[lane] = (
            profile.bodies,
            profile.measured,
            profile.fed,
            profile.vibrating,
            profile.guesses,
            np.empty((rows, 12)),
            np.empty((rows, 6)),
            np.zeros(rows, dtype=np.uint8),
            np.full((int(profile.fed.sum()), 2, 4), np.nan),
        )
        deviation = np.array(prior.deviation)
        decay = np.exp(-step / np.array(prior.correlation_time))
        x0 = np.concatenate([profile.state0, np.zeros(6)])[_PATH_ORDER]
        load_profile(
            self._memory, self._progress, lane, profile.hull, decay, deviation**2 * (1.0 - decay**2), profile.variance,
            x0, np.concatenate([INITIAL_DEVIATION, deviation]), rows - 1, profile.patience,
            _max_rejected(task, self._settings),
        )  # fmt: skip

    def run(self) -> list[tuple[int, FilterEstimate]]:
        """Continue until a profile has ended; return finished lanes with their estimates, and leave them idle."""
        options, step = self._settings.filter, self._settings.step
        records = Records(*zip(*self._records, strict=True))
        kernel.run_until_done(
            records,
            self._memory,
            self._progress,
            step,
            options.gate,
            options.vibration_noise_factor,
            steps_in(GUESS_INTERVAL, step),
        )
        return [(int(lane), self._read(int(lane))) for lane in np.flatnonzero(self._progress.status == ENDED)]

    def _read(self, lane: int) -> FilterEstimate:
        _, _, fed, _, _, states, disturbances, events, innovations = self._records[lane]
        end = self._progress.row[lane] + 1
        states[end:], disturbances[end:] = np.nan, np.nan
        self._progress.status[lane] = IDLE
        gated, inflated, reset = (
            int((events & bit > 0).sum()) for bit in (kernel.GATED, kernel.INFLATED, kernel.RESET)
        )
        return FilterEstimate(
            states, disturbances, gated, inflated, reset, int(fed.sum()), events, innovations[:, 0], innovations[:, 1],
            *self._priors[lane],
        )  # fmt: skip


def _filter_in_lanes(tasks: Iterator[_Task], settings: EstimationSettings) -> Iterator[tuple[int, FilterEstimate]]:
    """Filter profiles, one in each lane; a lane takes the next profile as soon as it is free."""
    batch, active = _FilterBatch(settings), dict[int, _Task]()

    def start(lane: int, task: _Task | None) -> None:
        if task is not None:
            active[lane] = task
            batch.load(lane, task)

    for lane in range(LANES):
        start(lane, next(tasks, None))
    while active:
        for lane, estimate in batch.run():
            task = active.pop(lane)
            if next_task := task.next_task(estimate, settings):
                start(lane, next_task)
            else:
                yield task.key, task.more_likely(estimate, settings)
                start(lane, next(tasks, None))


def _max_rejected(task: _Task, settings: EstimationSettings) -> int:
    """Largest number of rejected samples with which a prior's run continues: unlimited if no other prior is left."""
    fed = int(task.profile.fed.sum())
    if not task.priors[1:]:
        return 3 * len(task.profile.fed)
    share = np.arange(fed + 1) / max(fed, 1)
    return int(np.count_nonzero(share <= settings.filter.max_rejected_fraction)) - 1


def _inputs(profile: PreparedProfile, settings: EstimationSettings) -> _Inputs:
    series, platform = profile.series, profile.glider.platform
    fed = fed_samples(series, settings)
    if not fed.any():
        raise ProfileError("no sample of roll, pitch, heading and depth together is left to filter")
    guesses = flight_guesses(platform, series, steps_in(GUESS_INTERVAL, settings.step))
    state0 = guesses[0] if profile.initial_error is None else guesses[0] + profile.initial_error
    patience = max(settings.filter.patience, 3.0 * series.sample_interval) / feed_interval(series, settings)
    return _Inputs(
        np.array(profile.glider.hull),
        _contiguous(profile.bodies, float),
        _contiguous(series.measurements, float),
        fed,
        _contiguous(profile.vibrating, bool),
        guesses[:, 6:].copy(),
        state0,
        measurement_variance(platform, series, settings),
        max(3, round(patience)),
        series.sample_interval > settings.filter.slow_feed,
    )


def _contiguous(values: Array | NDArray[np.bool_], dtype: type) -> NDArray[Any]:
    """Return an array in the layout for which the kernel is compiled."""
    return np.require(values, dtype, ["C", "W"])
