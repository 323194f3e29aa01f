"""Calibration on whole dives: rounds in which every dive is smoothed and the information on the hull is summed.

The rounds start from the trim fitted to the steady glides. In each round every dive is smoothed with the present hull,
which gives the score and the information on the errors of hull and records. Their sum over the mission
(`gliderhpc.tuning.mission_hull`) gives the next hull. The rounds end when the hull no longer changes.
"""

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from gliderhpc.errors import CalibrationError, ProfileError
from gliderhpc.estimation.current_errors import CurrentErrors
from gliderhpc.estimation.currents import current_from_displacement
from gliderhpc.estimation.filter import run_filter
from gliderhpc.estimation.preparation import prepare_profile
from gliderhpc.estimation.resample import on_steps
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.estimation.smoother.estimate import LastPass, SmoothedEstimate
from gliderhpc.estimation.smoother.information import smoothed_dive_information
from gliderhpc.estimation.smoother.iterate import smooth_dive
from gliderhpc.estimation.smoother.noise import spent_and_resolved
from gliderhpc.estimation.smoother.posterior import displacement_with
from gliderhpc.flight.glider import Glider
from gliderhpc.flight.hull_parameters import HullParameter, moved_platform
from gliderhpc.flight.steady_glide import glides_stably
from gliderhpc.mission.executors import Executor
from gliderhpc.observations import Observations, open_observations
from gliderhpc.observations.records import ProfileRecord
from gliderhpc.observations.series import ProfileSeries
from gliderhpc.observations.survey import Survey
from gliderhpc.platform import Platform
from gliderhpc.tuning.gaussian_chain import Array, Gaussian
from gliderhpc.tuning.mission_hull import DiveTerm, HullPrior, MissionHull, predicted_disagreement, solve_mission
from gliderhpc.tuning.rounds import RoundSettings, inflation_ratios, with_inflated_variance
from gliderhpc.tuning.turn_test import DiveCurrent, TurnTestSettings

log = logging.getLogger("gliderhpc.calibrate")

_MAX_STEP = 2.0
"""Maximum change of an error in a round, in plausible deviations, for which the linearisation is valid."""
_RECORD_INTERVAL = 60.0
"""Time (s) between records of the smoothed sensitivities, from which only the displacement's is used."""
_HALVINGS = 5
"""Maximum number of halvings of a step to reach a hull that glides stably."""
_PRIOR_WEIGHT = 1.0
"""Weight of the prior's noise in the pooled factor, as an equivalent number of resolved values."""
_NO_OTHER_ERRORS = CurrentErrors(axial_error=0.0, relative_error=0.0, heading_error=0.0, cross_track_error=0.0)
"""Error terms of a current, except the hull's and the compass's, which are unknowns of the sum."""


@dataclass(frozen=True)
class DiveJob:
    """One dive to be smoothed.

    Attributes
    ----------
    observations, survey : Path, Survey
        Path of the file, and its survey.
    platform : Platform
        Hull with which the dive is smoothed.
    number : int
        Number of the profile.
    keys : tuple of str
        Keys of the errors to estimate.
    settings : EstimationSettings
        Settings of the smoother.
    noise_factor : (6,)
        Factor on the noise of the disturbance prior, estimated from the mission's dives.
    """

    observations: Path
    survey: Survey
    platform: Platform
    number: int
    keys: tuple[str, ...]
    settings: EstimationSettings
    noise_factor: Array


@dataclass(frozen=True, eq=False)
class SmoothedDive:
    """Result of smoothing a dive.

    Attributes
    ----------
    number : int
        Number of the profile.
    time : numpy.datetime64
        Time at the middle of the dive.
    score, information : (p,), (p, p), optional
        Score and information, in plausible deviations of the hull used for the smoothing; None if there is no estimate.
    noise : (2, 6), optional
        Sums of the squared smoothed noise divided by the job's variances, and of the resolved values.
    current : DiveCurrent, optional
        Depth-averaged current, if there are fixes.
    message : str
        Reason why there is no information.
    """

    number: int
    time: np.datetime64
    score: Array | None = None
    information: Array | None = None
    noise: Array | None = None
    current: DiveCurrent | None = None
    message: str = ""


def smoothed_dive(job: DiveJob) -> SmoothedDive:
    """Smooth one dive, as the job of a worker."""
    never = np.datetime64("NaT", "ns")
    with threadpool_limits(limits=1), open_observations(job.observations, survey=job.survey) as observations:
        try:
            record = observations.profile(job.number)
            profile = prepare_profile(Glider(job.platform), on_steps(record, job.settings, job.platform))
            filtered = run_filter(profile, job.settings)
        except ProfileError as error:
            return SmoothedDive(job.number, never, message=str(error))
        smoothed = smooth_dive(profile, filtered, job.settings, job.noise_factor)
    time = record.epoch + np.timedelta64(round(500.0 * float(record.time[0] + record.time[-1])), "ms")
    if smoothed.last_pass is None or not smoothed.outcome.usable:
        why = smoothed.failure or f"the smoother ended as {smoothed.outcome.label}"
        return SmoothedDive(job.number, time, message=why)
    found = smoothed_dive_information(profile, smoothed, smoothed.last_pass, job.settings)
    if not found.is_sound:
        return SmoothedDive(job.number, time, message="its information on the hull is negative or not finite")
    chosen = [found.names.index(key) for key in job.keys]
    return SmoothedDive(
        job.number, time, found.score[chosen], found.information[np.ix_(chosen, chosen)],
        _noise(smoothed, smoothed.last_pass, ~profile.vibrating[:-1]),
        _current(record, profile.series, displacement_with(smoothed, found.record), found.displacement[:, chosen]),
    )  # fmt: skip


def _noise(smoothed: SmoothedEstimate, last: LastPass, steady: NDArray[np.bool_]) -> Array:
    """Sum, over steady steps, the squared smoothed noise divided by the job's variances, and the resolved values.

    Channels whose noise has no factor of the dive's own have sums of zero.
    """
    spent, resolved = spent_and_resolved(last, last.dive.noise, steady)
    sums = np.array([smoothed.noise_factor * spent, resolved])
    sums[:, list(smoothed.unscaled)] = 0.0
    return sums


def _current(
    record: ProfileRecord, series: ProfileSeries, displacement: tuple[Array, Array], by_hull: Array
) -> DiveCurrent | None:
    """Return the dive's current with its sensitivity (2, p) to the hull's errors; None unless both sides have a fix."""
    between = current_from_displacement(record, series.time, *displacement, _NO_OTHER_ERRORS)
    if between is None:
        return None
    return DiveCurrent(between.velocity, by_hull / between.drift.elapsed, between.covariance)


@dataclass(frozen=True, eq=False)
class HullRounds:
    """Result of the rounds.

    Attributes
    ----------
    base, platform : Platform
        Hull relative to which the errors are defined, and the hull found.
    parameters : tuple of HullParameter
        Parameters with the errors that were estimated.
    mission : MissionHull
        Sum over the dives fitted, with ``eta`` relative to the base.
    held_out : tuple of (int, float, int)
        Number, chi-square relative to the sum (times the divisor) and degrees of freedom of each dive held out.
    skipped : tuple of SmoothedDive
        Dives without information.
    moves : tuple of float
        Largest move of each round, in plausible deviations.
    eta, full_step : (p,), (p,)
        Errors of the hull found, relative to the base, and the full step of the last round, before it was shortened, in
        plausible deviations.
    divisor, turning_divisor : float
        Divisors of the dives' information, and of that on the terms of sway, roll and yaw (`DiveRounds`).
    """

    base: Platform
    platform: Platform
    parameters: tuple[HullParameter, ...]
    mission: MissionHull
    held_out: tuple[tuple[int, float, int], ...]
    skipped: tuple[SmoothedDive, ...]
    moves: tuple[float, ...]
    eta: Array
    full_step: Array
    divisor: float
    turning_divisor: float

    @property
    def errors(self) -> Gaussian:
        """Distribution of the errors over all dives, about the hull found, including the random walk.

        As in the smoother, the last move is added to the uncertainty; it is larger if the rounds ended unconverged.
        """
        return Gaussian(self.eta, self.mission.overall.covariance + np.outer(self.full_step, self.full_step))


class DiveRounds:
    """Rounds over the dives of an open file.

    Parameters
    ----------
    observations : Observations
        Open file.
    base : Platform
        Hull relative to which ``eta`` is defined; its plausible deviations are the prior.
    parameters : tuple of HullParameter
        Parameters with the errors to estimate.
    fitted, held_out : sequence of int
        Profiles that are summed, and those that are only compared with the sum.
    estimation, settings, turn_test : EstimationSettings, RoundSettings, TurnTestSettings
        Settings of the smoother, of the rounds and of the turn test.
    most : int
        Largest number of rounds.
    executor : Executor
        Executor of the dives.
    on_dive : callable
        Function called after every dive.

    Notes
    -----
    Errors of the model (rounding, lags that differ among the actuators, the assumed noise) change the scores of all
    dives in the same way. Let their variance be ``misfit`` times the stated variance of one dive. The sum of the
    scores of ``n`` dives then has ``1 + misfit n`` times its stated variance, and their information is divided by this
    factor; that on the terms of sway, roll and yaw by a larger one (`with_inflated_variance`). With any number of
    dives, the hull is determined no better than these errors allow.
    """

    def __init__(
        self, observations: Observations, base: Platform, parameters: tuple[HullParameter, ...],
        fitted: Sequence[int], held_out: Sequence[int], *, estimation: EstimationSettings, settings: RoundSettings,
        most: int, turn_test: TurnTestSettings, executor: Executor, on_dive: Callable[[], None] = lambda: None,
    ) -> None:  # fmt: skip
        self._observations, self._base, self._parameters = observations, base, parameters
        self._fitted, self._held_out = list(fitted), list(held_out)
        step = max(estimation.step, settings.step)
        self._estimation = estimation.model_copy(
            update={"step": step, "output_interval": step * round(_RECORD_INTERVAL / step)}
        )
        self._settings, self._most, self._turn_test = settings, most, turn_test
        self._executor, self._on_dive = executor, on_dive
        self._prior = HullPrior.plausible(np.array([p.walk(base) for p in parameters]))

    def run(self, start: Platform) -> HullRounds:
        """Repeat the rounds until the hull no longer changes.

        Raises
        ------
        CalibrationError
            No dive can be smoothed.
        """
        eta = np.array([p.steps(self._base, p.value(start)) for p in self._parameters])
        noise_factor = np.ones(6)
        moves: list[float] = []
        while True:
            platform = moved_platform(self._base, self._parameters, eta)
            dives = self._smooth_dives(platform, noise_factor)
            known = {each.number: each for each in dives if each.information is not None}
            ratios = inflation_ratios(self._parameters, sum(number in known for number in self._fitted), self._settings)
            terms = {number: self._term(each, platform, eta, ratios) for number, each in known.items()}
            mission = self._combine(terms, dives)
            noise_factor = noise_factor * pooled_factor([each for each in dives if each.number in self._fitted])
            full_step = mission.overall.mean - eta
            following = bounded_step(self._base, self._parameters, eta, eta + full_step)
            moves.append(float(np.abs(following - eta).max()))
            self._log_round(len(moves), following - eta, mission)
            blocked, eta = np.array_equal(following, eta), following
            # A step that was shortened to retain a stable glide does not count as convergence.
            converged = float(np.abs(full_step).max()) < self._settings.tolerance
            if converged or blocked or len(moves) >= self._most:
                break
        divisor = float(ratios.min())
        held_out = tuple(
            (number, divisor * value, freedom)
            for number in self._held_out
            if number in terms
            for value, freedom in [predicted_disagreement(mission, terms[number])]
        )
        skipped = tuple(each for each in dives if each.information is None)
        found = moved_platform(self._base, self._parameters, eta)
        return HullRounds(
            self._base,
            found,
            self._parameters,
            mission,
            held_out,
            skipped,
            tuple(moves),
            eta,
            full_step,
            divisor,
            float(ratios.max()),
        )

    def _log_round(self, number: int, move: Array, mission: MissionHull) -> None:
        farthest = int(np.abs(move).argmax())
        log.info(
            "round %d: %d dives, %s moved by %+.2f plausible deviations, inflation %.2f, log evidence %.1f",
            number, len(mission.numbers), self._parameters[farthest].key, move[farthest], mission.inflation,
            mission.log_evidence,
        )  # fmt: skip

    def _smooth_dives(self, platform: Platform, noise_factor: Array) -> list[SmoothedDive]:
        keys, file = tuple(p.key for p in self._parameters), self._observations
        jobs = [
            DiveJob(file.path, file.survey, platform, number, keys, self._estimation, noise_factor)
            for number in [*self._fitted, *self._held_out]
        ]
        dives = []
        for dive in self._executor.run(smoothed_dive, jobs):
            dives.append(dive)
            self._on_dive()
            if dive.information is None:
                log.warning("profile %d is left out: %s", dive.number, dive.message)
        return sorted(dives, key=lambda each: each.number)

    def _term(self, dive: SmoothedDive, platform: Platform, eta: Array, ratios: Array) -> DiveTerm:
        """Convert a dive's result from plausible deviations of the hull used for the smoothing to those of the base.

        All information is reduced by the errors that the dives have in common.
        """
        assert dive.score is not None
        assert dive.information is not None
        ratio = np.array(
            [p.slope(platform, 0.0) / p.slope(self._base, float(x)) for p, x in zip(self._parameters, eta, strict=True)]
        )
        current = dive.current
        if current is not None:
            current = replace(current, sensitivity=current.sensitivity / ratio)
        score, information = with_inflated_variance(
            dive.score / ratio, dive.information / np.outer(ratio, ratio), ratios
        )
        return DiveTerm(dive.number, dive.time, eta, score, information, current=current)

    def _combine(self, terms: dict[int, DiveTerm], dives: Sequence[SmoothedDive]) -> MissionHull:
        fitted = [terms[number] for number in self._fitted if number in terms]
        if not fitted:
            raise CalibrationError(
                f"calibration: no dive could be smoothed, the first because {dives[0].message}; check the records "
                "with `gliderhpc inspect`, or set rounds.most to 0 to fit the steady glides alone"
            )
        return solve_mission(fitted, self._prior, robust=self._settings.robust, turn_test=self._turn_test)


def pooled_factor(dives: Sequence[SmoothedDive]) -> Array:
    """Factors ``(6,)`` on the noise of each channel, estimated from all dives together.

    Notes
    -----
    A dive hardly resolves some of its disturbances, and the smoother then stays near the prior's noise
    (`gliderhpc.estimation.smoother.noise.NoiseScale`). The mission's dives have a common prior and together resolve
    more.
    """
    spent, resolved = np.sum([dive.noise for dive in dives if dive.noise is not None], axis=0)
    return np.asarray((spent + _PRIOR_WEIGHT) / (resolved + _PRIOR_WEIGHT))


def bounded_step(base: Platform, parameters: Sequence[HullParameter], eta: Array, target: Array) -> Array:
    """Step from ``eta`` towards the mean of the sum, no farther than the linearisation and a stable glide allow.

    The step is shortened as a whole. Combinations of the errors are known much better than single errors, and
    shortening only some components would lead away from the combinations that the dives determine.

    Parameters
    ----------
    base : Platform
        Hull relative to which ``eta`` is defined.
    parameters : sequence of HullParameter
        Parameters with the errors to estimate.
    eta, target : (p,), (p,)
        Errors with which the dives were smoothed, and the mean of their sum, in plausible deviations.

    Returns
    -------
    (p,) array
        The next ``eta``; unchanged if none of the fractions of the step that are tried leads to a stable glide.
    """
    step = target - eta
    step *= min(1.0, _MAX_STEP / max(float(np.abs(step).max()), _MAX_STEP))
    for _ in range(_HALVINGS):
        if glides_stably(Glider(moved_platform(base, parameters, eta + step))):
            return np.asarray(eta + step)
        step = 0.5 * step
    return eta
