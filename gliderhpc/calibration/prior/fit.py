"""Maximum-likelihood disturbance prior: those of its numbers that the records determine."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from gliderhpc.calibration.prior.fisher_scoring import LONGEST_STEP, Expansion, Maximum, maximise
from gliderhpc.calibration.prior.likelihood import SENSORS, PriorEvaluation, PriorLikelihood, Whiteness, whiteness
from gliderhpc.estimation.preparation import PreparedProfile
from gliderhpc.estimation.priors import candidate_priors, default_prior, smoother_prior, with_yaw_of
from gliderhpc.estimation.settings import EstimationSettings, Settings
from gliderhpc.platform import DisturbancePrior, Platform

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

DEVIATION_LIMITS = (1e-4, 100.0)
"""Limits of the deviations, N and N m."""

TIME_LIMITS = (1.0, 1e6)
"""Limits of the correlation times, s."""

DIFFERENCE = 0.01
"""Step of the logarithms for finite differences."""

START_TIMES = (30.0, 300.0)
"""Correlation times (s) of all channels for additional starts of the search: there is more than one maximum."""

TOLERANCE = 0.2
"""Gain of log-likelihood below which the rounds end."""

COARSE_TOLERANCE = 5.0
"""The same for the first, rough fits from all starts."""

HELD_ERROR = 2.0
"""Standard error of the logarithm of a held number, assumed for the errors of the others: a factor of seven."""

LIKELY_LOSS = 1.92
"""Loss of log-likelihood at the ends of a parameter's 95 % interval (half of chi-squared's 3.84)."""

_DIGITS = 4


class TuningSettings(Settings):
    """Settings of tuning a disturbance prior."""

    profiles: int = Field(4, ge=1, description="number of profiles used, spread over the mission, if none are named")
    longest: float = Field(3600.0, gt=0, description="length of each profile that is used, from its start, s")
    recovery: float = Field(60.0, ge=0, description="time after the vibration set that is left out, s")
    error_factor: float = Field(2.0, gt=1, description="a number is held if it is not known to within this factor")
    least_noise: float = Field(
        1.0,
        ge=0,
        description="smallest noise of each channel, deviation^2 / correlation time, relative to the untuned prior's, "
        "which also represents the errors of the hull",
    )
    lags: int = Field(20, ge=1, description="number of lags of the whiteness test, samples")
    max_rounds: int = Field(40, ge=1, description="largest number of rounds of a maximisation")


class TuneSettings(EstimationSettings):
    """Settings of the filter and of its tuning."""

    tuning: TuningSettings = TuningSettings()


class TuningVerdict(Enum):
    """Verdict of the records on one number of the prior."""

    ESTIMATED = "estimated"
    HELD = "held at the platform's value: the records do not determine it"
    ONE_SIDED = "poorly known, but the platform's value is unlikely"
    TOO_TIGHT = "not tuned: with less noise, errors of the hull would be attributed to the speed"


@dataclass(frozen=True, eq=False)
class TunedPrior:
    """A tuned prior and the platform's prior.

    Attributes
    ----------
    before, after : DisturbancePrior
        The platform's prior and the tuned one.
    evaluation_before, evaluation_after : PriorEvaluation
        Log-likelihood and innovations of the records under each prior.
    errors : (12,)
        Standard errors of the natural logarithms of the deviations and the correlation times, with an uncertainty of
        `HELD_ERROR` for held numbers; NaN for the held numbers themselves.
    verdicts : tuple of 12 TuningVerdict
        Verdicts in the same order.
    settled : bool
        Whether the maximum was reached within the rounds allowed.
    whiteness_before, whiteness_after : dict of str to Whiteness
        Whiteness of the accepted innovations, by sensor.
    interpolated : bool
        Whether any record was interpolated for the filter, which correlates its innovations by construction.
    """

    before: DisturbancePrior
    after: DisturbancePrior
    evaluation_before: PriorEvaluation
    evaluation_after: PriorEvaluation
    errors: Array
    verdicts: tuple[TuningVerdict, ...]
    settled: bool
    whiteness_before: dict[str, Whiteness]
    whiteness_after: dict[str, Whiteness]
    interpolated: bool

    @property
    def gain(self) -> float:
        """Log-likelihood gained over the platform's prior."""
        return self.evaluation_after.log_likelihood - self.evaluation_before.log_likelihood


def tune_prior(
    platform: Platform,
    profiles: Sequence[PreparedProfile],
    settings: TuneSettings,
    on_round: Callable[[float], None] = lambda _: None,
) -> TunedPrior:
    """Maximise the innovations' likelihood over the twelve numbers of the disturbance prior.

    The method is Fisher scoring on the logarithms. It starts from each prior that the filter would use for the
    platform, and from the platform's deviations with the correlation times `START_TIMES`; the highest maximum is taken.
    Numbers that the records do not determine are then held at the platform's value, one by one, the least certain
    first, and the others are fitted again. A number stays free if holding it costs more than `LIKELY_LOSS`.

    The noise of a channel never becomes smaller than that of the untuned prior (`tuning.least_noise`): both its numbers
    are then held at the untuned ones, and the others are fitted again. The filter that predicts best has hardly any
    noise where the water is calm; but then even a small error in the coefficients is absorbed by the estimated speed.
    In simulated gusts and yaw impulses, the prior with the highest likelihood made the speed of a true hull wrong by
    0.05 m/s (root mean square).

    Parameters
    ----------
    platform : Platform
        The hull.
    profiles : sequence of PreparedProfile
        Profiles of that hull.
    settings : TuneSettings
        Settings of the filter and of the tuning.
    on_round : callable
        Called with the log-likelihood of every round.

    Raises
    ------
    ProfileError
        No sample of a profile could be fed to the filter.
    """
    likelihood = PriorLikelihood(profiles, settings, recovery=settings.tuning.recovery)
    interval = float(np.median([profile.series.attitude_interval for profile in profiles]))
    before = default_prior(platform, interval)
    search = _Search(likelihood, before, settings, on_round)
    search.climb([_logarithms(prior) for prior in _starts(platform, interval)])
    untuned = with_yaw_of(smoother_prior(platform, before, interval), before)
    search.hold_too_tight(untuned, settings.tuning.least_noise)
    search.hold_undetermined()
    # A number that was reset to the platform's value can leave its channel with too little noise.
    search.hold_too_tight(untuned, settings.tuning.least_noise)
    after = _round_prior(search.point, search.free, search.held)
    evaluation_before, evaluation_after = likelihood.evaluate([before, after])

    def whiteness_by_sensor(evaluation: PriorEvaluation) -> dict[str, Whiteness]:
        return _whiteness(evaluation, likelihood.lengths, settings)

    return TunedPrior(
        before,
        after,
        evaluation_before,
        evaluation_after,
        search.errors(),
        search.verdicts,
        search.settled,
        whiteness_by_sensor(evaluation_before),
        whiteness_by_sensor(evaluation_after),
        any(profile.series.sample_interval > settings.filter.slow_feed for profile in profiles),
    )


class _LogarithmicLikelihood:
    """The likelihood as a function of the prior's twelve logarithms."""

    def __init__(self, likelihood: PriorLikelihood) -> None:
        self._likelihood = likelihood

    def values(self, points: Sequence[Array]) -> list[float]:
        return [evaluation.log_likelihood for evaluation in self._likelihood.evaluate([_prior(p) for p in points])]

    def expanded(self, point: Array, free: Mask) -> Expansion:
        moves = DIFFERENCE * np.eye(len(point))[free]
        points = [point, *(point + move for move in moves), *(point - move for move in moves)]
        middle, *others = self._likelihood.evaluate([_prior(p) for p in points])
        above, below = others[: len(moves)], others[len(moves) :]
        gradient = np.array([a.log_likelihood - b.log_likelihood for a, b in zip(above, below, strict=True)])
        information = self._likelihood.information(middle, above, below, DIFFERENCE)
        return Expansion(middle.log_likelihood, gradient / (2.0 * DIFFERENCE), information)


class _Search:
    """Search for the maximum over the free numbers, and the choice of the free ones."""

    def __init__(
        self,
        likelihood: PriorLikelihood,
        before: DisturbancePrior,
        settings: TuneSettings,
        on_round: Callable[[float], None],
    ) -> None:
        self._function = _LogarithmicLikelihood(likelihood)
        self.held, self._on_round = np.array(before.numbers), on_round
        self._max_rounds = settings.tuning.max_rounds
        self._worst_error = math.log(settings.tuning.error_factor)
        limits = np.log(np.repeat([DEVIATION_LIMITS, TIME_LIMITS], 6, axis=0))
        platform = np.log(self.held)
        self._bounds = np.minimum(limits[:, 0], platform), np.maximum(limits[:, 1], platform)
        self._verdicts = [TuningVerdict.ESTIMATED] * len(platform)

    def climb(self, starts: Sequence[Array]) -> None:
        """Maximise over all numbers: roughly from several starts, then accurately from the highest of the maxima."""
        maxima = [self._maximise(np.clip(start, *self._bounds), self.free, COARSE_TOLERANCE) for start in starts]
        highest = max(maxima, key=lambda maximum: maximum.expansion.value)
        self._maximum = self._maximise(highest.point, self.free)

    def hold_too_tight(self, untuned: DisturbancePrior, least: float) -> None:
        """Hold the channels with less noise than in an untuned prior at its numbers, and fit the others again."""
        while tight := self._tight_channels(untuned, least):
            numbers, start = [*tight, *(channel + 6 for channel in tight)], self.point.copy()
            self.held[numbers] = np.array(untuned.numbers)[numbers]
            start[numbers] = np.log(self.held[numbers])
            for number in numbers:
                self._verdicts[number] = TuningVerdict.TOO_TIGHT
            self._maximum = self._maximise(start, self.free)

    def _tight_channels(self, untuned: DisturbancePrior, least: float) -> list[int]:
        # Numbers that are held already equal the untuned ones to rounding.
        tight = _noise(_prior(self.point)) < (1.0 - 1e-9) * least * _noise(untuned)
        return [i for i in np.flatnonzero(tight).tolist() if self._verdicts[i] is not TuningVerdict.TOO_TIGHT]

    def hold_undetermined(self) -> None:
        """Reset the numbers that the records do not determine to the platform's values, and fit the others again."""
        while (weakest := self._weakest()) is not None:
            free = self.free
            free[weakest] = False
            maximum = self._maximise(self._expected_maximum(weakest, free), free)
            if self._maximum.expansion.value - maximum.expansion.value > LIKELY_LOSS:
                self._verdicts[weakest] = TuningVerdict.ONE_SIDED
            else:
                self._verdicts[weakest] = TuningVerdict.HELD
                self._maximum = maximum

    @property
    def free(self) -> Mask:
        """Mask of the numbers that are not held."""
        return np.array([verdict in (TuningVerdict.ESTIMATED, TuningVerdict.ONE_SIDED) for verdict in self._verdicts])

    @property
    def point(self) -> Array:
        return self._maximum.point

    @property
    def settled(self) -> bool:
        return self._maximum.settled

    def errors(self) -> Array:
        """Standard errors of the free logarithms, with held ones uncertain by `HELD_ERROR`; NaN for held ones."""
        everything = np.ones(len(self.free), dtype=bool)
        information = self._function.expanded(self.point, everything).information
        errors = _errors(information + np.diag(np.where(self.free, 0.0, HELD_ERROR**-2)))
        return np.where(self.free, errors, np.nan)

    @property
    def verdicts(self) -> tuple[TuningVerdict, ...]:
        return tuple(self._verdicts)

    def _weakest(self) -> int | None:
        errors = np.zeros(len(self.free))
        errors[self.free] = _errors(self._maximum.expansion.information)
        errors[[verdict is TuningVerdict.ONE_SIDED for verdict in self._verdicts]] = 0.0
        weakest = int(np.argmax(errors))
        return weakest if errors[weakest] > self._worst_error else None

    def _expected_maximum(self, held: int, free: Mask) -> Array:
        """Expected point of the maximum when one number is reset to the platform's value."""
        information = self._maximum.expansion.information
        is_held = np.flatnonzero(self.free) == held
        remaining, cross = information[np.ix_(~is_held, ~is_held)], information[np.ix_(~is_held, is_held)][:, 0]
        reset = np.log(self.held[held]) - self._maximum.point[held]
        moves = -np.linalg.solve(remaining + 0.01 * np.eye(len(remaining)), cross * reset)
        point = self._maximum.point.copy()
        point[held] = np.log(self.held[held])
        point[free] += np.clip(moves, -LONGEST_STEP, LONGEST_STEP)
        return np.asarray(np.clip(point, *self._bounds))

    def _maximise(self, start: Array, free: Mask, tolerance: float = TOLERANCE) -> Maximum:
        return maximise(
            self._function,
            start,
            free,
            self._bounds,
            tolerance=tolerance,
            max_rounds=self._max_rounds,
            on_round=self._on_round,
        )


def _noise(prior: DisturbancePrior) -> Array:
    """Intensity of each channel's noise, deviation^2 / correlation time, N^2 / s and N^2 m^2 / s."""
    return np.asarray(np.square(prior.deviation) / np.asarray(prior.correlation_time))


def _errors(information: Array) -> Array:
    # A parameter on which the records have no information gets an error of a thousand, not an infinite one.
    return np.asarray(np.sqrt(np.diag(np.linalg.inv(information + 1e-6 * np.eye(len(information))))))


def _starts(platform: Platform, interval: float) -> list[DisturbancePrior]:
    usual = default_prior(platform, interval)
    faster = [usual.model_copy(update={"correlation_time": (seconds,) * 6}) for seconds in START_TIMES]
    return [*candidate_priors(platform, interval).values(), *faster]


def _logarithms(prior: DisturbancePrior) -> Array:
    return np.asarray(np.log(prior.numbers))


def _prior(logarithms: Array) -> DisturbancePrior:
    values = np.exp(logarithms).tolist()
    return DisturbancePrior(deviation=tuple(values[:6]), correlation_time=tuple(values[6:]))


def _round_prior(logarithms: Array, free: Mask, held: Array) -> DisturbancePrior:
    """Prior with the held numbers unchanged and the others rounded to four digits."""
    rounded = [float(f"{value:.{_DIGITS}g}") for value in np.exp(logarithms)]
    chosen = np.where(free, rounded, held).tolist()
    return DisturbancePrior.model_validate({"deviation": chosen[:6], "correlation_time": chosen[6:]})


def _whiteness(evaluation: PriorEvaluation, lengths: Sequence[int], settings: TuneSettings) -> dict[str, Whiteness]:
    normalised = evaluation.innovations / np.sqrt(evaluation.variances)
    normalised[np.abs(normalised) > settings.filter.gate] = np.nan
    profiles = np.split(normalised, np.cumsum(lengths)[:-1])
    return {
        sensor: whiteness([profile[:, i] for profile in profiles], settings.tuning.lags)
        for i, sensor in enumerate(SENSORS)
    }
