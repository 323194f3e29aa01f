"""The disturbance-augmented extended Kalman filter of section 4.1: the prior, of several profiles side by side."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gliderhpc.errors import ProfileError
from gliderhpc.estimation.glide_angle import flight_guesses
from gliderhpc.estimation.measurements import (
    _feed_interval,
    _rows,
    fed_samples,
    measurement_variance,
)
from gliderhpc.estimation.settings import EstimationSettings, candidate_priors, default_prior
from gliderhpc.flight.glider import Glider
from gliderhpc.kernels import filter as kernel
from gliderhpc.kernels.elementwise import LANES
from gliderhpc.kernels.filter_memory import ENDED, IDLE, Records, allocate, load_profile
from gliderhpc.observations.resample import ProfileSeries
from gliderhpc.platform import DisturbancePrior

Array = NDArray[np.float64]

INITIAL_DEVIATION = np.array([0.01, 0.01, 0.01, 0.2, 0.1, 0.02, 0.03, 0.02, 0.02, 0.02])
"""Standard deviation of the initial sensed states: rad, m, m/s, rad/s."""

_PATH_ORDER = np.array([0, 1, 2, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 3, 4])
"""Indices of the kernel's sensed states, disturbances, X and Y among the twelve states and six disturbances."""

GUESS_INTERVAL = 1.0
"""Seconds between the velocities and rates that a restart may take; attitude and depth are those of its own sample."""


@dataclass(frozen=True, eq=False)
class FilterEstimate:
    """Results of the filter for one profile.

    Attributes
    ----------
    states : (n+1, 12)
        Filtered states (eq. 16), SI and rad; NaN behind the row at which a run was given up.
    disturbances : (n+1, 6)
        Filtered disturbances, N and N m; likewise.
    gated, inflated, reset : int
        Samples with a rejected channel, with a widened variance inside the vibration set, and restarts.
    fed : int
        Samples the filter was fed.
    events : (n+1,) uint8
        What happened to each sample, as bits of `gliderhpc.kernels.filter`.
    innovations, innovation_variances : (m, 4)
        Of the fed samples' roll, pitch, heading (rad, rad2) and depth (m, m2): measured less predicted, gated ones too,
        and the variance the filter expected of it. An innovation is NaN where nothing was measured and where the
        estimate was no longer plausible, its variance then meaningless; both are behind the row at which a run was
        given up.
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

    @property
    def rejected_fraction(self) -> float:
        """Gated, inflated and reset samples over fed ones."""
        return (self.gated + self.inflated + self.reset) / max(self.fed, 1)

    def describe(self) -> str:
        """One clause with the counts."""
        return f"filter: {self.gated} gated, {self.inflated} inflated, {self.reset} reset of {self.fed} samples"


@dataclass(frozen=True, eq=False)
class FilterRequest:
    """One profile to be filtered.

    Attributes
    ----------
    glider, series : Glider, ProfileSeries
        The hull and the resampled record, ``n`` steps.
    bodies : (n, 11)
        Mass properties from `Glider.bodies`.
    vibrating : (n+1,)
        The vibration set.
    initial_error : (12,) array, optional
        Added to the first guess of the state.
    """

    glider: Glider
    series: ProfileSeries
    bodies: Array
    vibrating: NDArray[np.bool_]
    initial_error: Array | None = None


Candidate = tuple[str, DisturbancePrior]
"""A disturbance prior with the archive's name for it (`DISTURBANCE_PRIOR`)."""

Filtered = tuple[FilterEstimate, Candidate]
"""The filter's estimate of a profile, and the disturbance prior that it used."""


def run_filter(
    glider: Glider,
    series: ProfileSeries,
    bodies: Array,
    vibrating: NDArray[np.bool_],
    settings: EstimationSettings,
    *,
    initial_error: Array | None = None,
) -> FilterEstimate:
    """Filter one profile as `run_filters` does; the arguments are those of `FilterRequest`."""
    return run_filters([FilterRequest(glider, series, bodies, vibrating, initial_error)], settings)[0]


def run_filters(requests: Iterable[FilterRequest], settings: EstimationSettings) -> list[FilterEstimate]:
    """Filter profiles side by side (eqs. 19-27), each with its platform's disturbance prior.

    Parameters
    ----------
    requests : iterable of FilterRequest
        Any number of profiles. What one gives does not depend on the others, to the bit.
    settings : EstimationSettings
        Uses ``step`` and ``filter``.

    Raises
    ------
    ProfileError
        When nothing of a profile could be fed.
    """
    tasks = (
        _Task(i, _prepare(r, settings), (("usual", default_prior(r.glider.platform)),)) for i, r in enumerate(requests)
    )
    filtered = dict(_side_by_side(tasks, settings))
    return [filtered[i][0] for i in range(len(filtered))]


def filter_with_candidates(
    requests: Iterable[FilterRequest], settings: EstimationSettings
) -> list[Filtered | ProfileError]:
    """Filter profiles side by side, each with its candidate priors in turn until one can follow its record.

    A prior that has rejected more than the allowed share of all the profile's samples is given up there and then; the
    last candidate runs to the end, so that a refusal tells all its counts.

    Parameters
    ----------
    requests, settings : iterable of FilterRequest, EstimationSettings
        As in `run_filters`.

    Returns
    -------
    list
        For each profile the estimate that is valid, or the error that refuses it.
    """
    answers: dict[int, Filtered | ProfileError] = {}

    def tasks() -> Iterator[_Task]:
        for i, request in enumerate(requests):
            try:
                yield _Task(i, _prepare(request, settings), tuple(candidate_priors(request.glider.platform).items()))
            except ProfileError as error:
                answers[i] = error

    for i, (estimate, prior) in _side_by_side(tasks(), settings):
        refused = estimate.rejected_fraction > settings.filter.max_rejected_fraction
        answers[i] = refusal(estimate, settings) if refused else (estimate, prior)
    return [answers[i] for i in range(len(answers))]


class FilterTrials:
    """Profiles made ready once, to be filtered with many disturbance priors in place of their platforms'.

    Parameters
    ----------
    requests, settings : sequence of FilterRequest, EstimationSettings
        As in `run_filters`.

    Raises
    ------
    ProfileError
        When nothing of a profile could be fed.
    """

    def __init__(self, requests: Sequence[FilterRequest], settings: EstimationSettings) -> None:
        self._settings = settings
        self._profiles = [_prepare(request, settings) for request in requests]

    def run(self, priors: Sequence[DisturbancePrior]) -> Iterator[tuple[int, int, FilterEstimate]]:
        """Filter every profile with every prior, side by side; each as it is done, with both its numbers.

        What one gives is what `run_filters` gives with that prior, to the bit.
        """
        tasks = (
            _Task(len(priors) * i + k, profile, (("trial", prior),))
            for i, profile in enumerate(self._profiles)
            for k, prior in enumerate(priors)
        )
        for key, (estimate, _) in _side_by_side(tasks, self._settings):
            yield key // len(priors), key % len(priors), estimate


def refusal(estimate: FilterEstimate, settings: EstimationSettings) -> ProfileError:
    """Error for an estimate that rejected more than the allowed share of its samples."""
    return ProfileError(
        f"{estimate.describe()}, more than {settings.filter.max_rejected_fraction:.0%}: the hull's model does not "
        "follow this record; check the platform (neutral volume, battery zero), or raise filter.max_rejected_fraction"
    )


@dataclass(frozen=True, eq=False)
class _Prepared:
    """A profile as the kernel takes it: the filter's arrays (`Records`), first state, variances and patience."""

    hull: Array
    bodies: Array
    measured: Array
    fed: NDArray[np.bool_]
    vibrating: NDArray[np.bool_]
    guesses: Array
    state0: Array
    variance: Array
    patience: int


@dataclass(frozen=True, eq=False)
class _Task:
    """A profile with the priors that are still to be tried."""

    key: int
    profile: _Prepared
    priors: tuple[Candidate, ...]


class _FilterBatch:
    """`LANES` profiles being filtered in step."""

    def __init__(self, settings: EstimationSettings) -> None:
        self._settings = settings
        self._memory, self._progress = allocate()
        row, flag, note = np.zeros((1, 12)), np.zeros(1, dtype=bool), np.zeros(1, dtype=np.uint8)
        none = np.zeros((0, 2, 4))
        nobody = (
            row[:, :11].copy(),
            row[:, :4].copy(),
            flag,
            flag,
            row[:, :6].copy(),
            row,
            row[:, :6].copy(),
            note,
            none,
        )
        self._records: list[tuple[NDArray[Any], ...]] = [nobody] * LANES

    def put(self, lane: int, profile: _Prepared, prior: DisturbancePrior, allowed: int) -> None:
        """Put a profile into a lane; it is given up when more than ``allowed`` of its samples are in trouble."""
        rows, step = len(profile.measured), self._settings.step
        self._records[lane] = (
            profile.bodies, profile.measured, profile.fed, profile.vibrating, profile.guesses,
            np.empty((rows, 12)), np.empty((rows, 6)), np.zeros(rows, dtype=np.uint8),
            np.full((int(profile.fed.sum()), 2, 4), np.nan),
        )  # fmt: skip
        deviation = np.array(prior.deviation)
        decay = np.exp(-step / np.array(prior.correlation_time))
        x0 = np.concatenate([profile.state0, np.zeros(6)])[_PATH_ORDER]
        load_profile(
            self._memory, self._progress, lane, profile.hull, decay, deviation**2 * (1.0 - decay**2), profile.variance,
            x0, np.concatenate([INITIAL_DEVIATION, deviation]), rows - 1, profile.patience, allowed,
        )  # fmt: skip

    def run(self) -> list[tuple[int, FilterEstimate]]:
        """Go on until a profile has ended; give the lanes that are done with their estimates, and leave those idle."""
        options, step = self._settings.filter, self._settings.step
        records = Records(*zip(*self._records, strict=True))
        kernel.run_until_done(
            records, self._memory, self._progress, step, options.gate, options.vibration_noise_factor,
            _rows(GUESS_INTERVAL, step),
        )  # fmt: skip
        return [(int(lane), self._take(int(lane))) for lane in np.flatnonzero(self._progress.status == ENDED)]

    def _take(self, lane: int) -> FilterEstimate:
        _, _, fed, _, _, states, disturbances, events, innovations = self._records[lane]
        given_up = self._progress.row[lane] + 1
        states[given_up:], disturbances[given_up:] = np.nan, np.nan
        self._progress.status[lane] = IDLE
        gated, inflated, reset = (
            int((events & bit > 0).sum()) for bit in (kernel.GATED, kernel.INFLATED, kernel.RESET)
        )
        return FilterEstimate(
            states, disturbances, gated, inflated, reset, int(fed.sum()), events, innovations[:, 0], innovations[:, 1]
        )


def _side_by_side(tasks: Iterator[_Task], settings: EstimationSettings) -> Iterator[tuple[int, Filtered]]:
    """Filter profiles, a lane each; a lane takes the next as soon as it falls free."""
    batch, at_work = _FilterBatch(settings), dict[int, _Task]()

    def start(lane: int, task: _Task | None) -> None:
        if task is not None:
            at_work[lane] = task
            batch.put(lane, task.profile, task.priors[0][1], _allowed(task, settings))

    for lane in range(LANES):
        start(lane, next(tasks, None))
    while at_work:
        for lane, estimate in batch.run():
            task = at_work.pop(lane)
            if task.priors[1:] and estimate.rejected_fraction > settings.filter.max_rejected_fraction:
                start(lane, _Task(task.key, task.profile, task.priors[1:]))
            else:
                yield task.key, (estimate, task.priors[0])
                start(lane, next(tasks, None))


def _allowed(task: _Task, settings: EstimationSettings) -> int:
    """Most samples in trouble with which a prior's run goes on: any number where no other prior is left."""
    fed = int(task.profile.fed.sum())
    if not task.priors[1:]:
        return 3 * len(task.profile.fed)
    share = np.arange(fed + 1) / max(fed, 1)
    return int(np.count_nonzero(share <= settings.filter.max_rejected_fraction)) - 1


def _prepare(request: FilterRequest, settings: EstimationSettings) -> _Prepared:
    series, platform = request.series, request.glider.platform
    fed = fed_samples(series, settings)
    if not fed.any():
        raise ProfileError("no sample of roll, pitch, heading and depth together is left to filter")
    guesses = flight_guesses(platform, series, _rows(GUESS_INTERVAL, settings.step))
    state0 = guesses[0] if request.initial_error is None else guesses[0] + request.initial_error
    patience = max(settings.filter.patience, 3.0 * series.sample_interval) / _feed_interval(series, settings)
    return _Prepared(
        np.array(request.glider.hull), _plain(request.bodies, float), _plain(series.measurements, float), fed,
        _plain(request.vibrating, bool), guesses[:, 6:].copy(), state0,
        measurement_variance(platform, series, settings), max(3, round(patience)),
    )  # fmt: skip


def _plain(values: Array | NDArray[np.bool_], kind: type) -> NDArray[Any]:
    """Array of the one layout that the kernel is compiled for."""
    return np.require(values, kind, ["C", "W"])
