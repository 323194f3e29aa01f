"""Calibration on whole profiles: rounds in which every profile is smoothed and the information on the hull is summed.

The rounds start from the trim fitted to the steady glides. In each round every profile is smoothed with the present
hull, which gives the score and the information on the errors of hull and records. Their sum over the mission
(`gliderhpc.mission_hull.estimate`) gives the next hull. The rounds end when the hull no longer changes.

Rounded angles, actuators that do not lag as in the model, and noise unlike the prior's change the scores of all
profiles in the same direction, and more profiles do not average them out. The information is therefore reduced by the
variance of such errors (`inflation_ratios`, `with_inflated_variance`).
"""

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from gliderhpc.calibration.glides.segment_errors import LATERAL
from gliderhpc.calibration.settings import CalibrateSettings, RoundSettings
from gliderhpc.errors import CalibrationError, ProfileError
from gliderhpc.estimation.current_errors import CurrentErrors
from gliderhpc.estimation.currents import current_from_displacement
from gliderhpc.estimation.preparation import prepare_profile
from gliderhpc.estimation.resample import on_steps
from gliderhpc.estimation.rests import run_filters_around_rests
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.estimation.smoother.estimate import LastPass, SmoothedEstimate
from gliderhpc.estimation.smoother.information import smoothed_hull_information
from gliderhpc.estimation.smoother.iterate import run_smoother
from gliderhpc.estimation.smoother.noise import noise_sums
from gliderhpc.estimation.smoother.posterior import displacement_with_errors
from gliderhpc.flight.glider import Glider
from gliderhpc.flight.hull_parameters import ACTUATOR_LAG, HullParameter, moved_platform
from gliderhpc.flight.steady_glide import glides_stably
from gliderhpc.mission.executors import Executor
from gliderhpc.mission_hull.estimate import HullPrior, MissionHull, ProfileTerm, predicted_disagreement, solve_mission
from gliderhpc.mission_hull.gaussian_chain import Array, Gaussian
from gliderhpc.mission_hull.turn_test import ProfileCurrent
from gliderhpc.observations import Observations, open_observations
from gliderhpc.observations.records import ProfileRecord
from gliderhpc.observations.series import ProfileSeries
from gliderhpc.observations.survey import Survey
from gliderhpc.platform import Platform
from gliderhpc.studies.hull import MissionTerms, in_order_of_time

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

TURNING_MOTION = (
    *LATERAL,
    "viscous.K_p",
    "viscous.K_delta",
    "added_mass.1",
    "added_inertia.0",
    "added_inertia.2",
    ACTUATOR_LAG,
)
"""Keys of the terms of sway, roll and yaw, and of the actuators' lag. Errors that all profiles have in common affect
them most: where the water turns the glider, their score is computed about the path of a filter (`information_path`)."""

_SINGULAR = 1e-12
"""Ratio to the largest eigenvalue below which a combination of the errors has no information."""


# One profile


@dataclass(frozen=True)
class SmoothingJob:
    """One profile to be smoothed.

    Attributes
    ----------
    observations, survey : Path, Survey
        Path of the file, and its survey.
    platform : Platform
        Hull with which the profile is smoothed.
    number : int
        Number of the profile.
    keys : tuple of str
        Keys of the errors to estimate.
    settings : EstimationSettings
        Settings of the smoother.
    noise_factor : (6,)
        Factor on the noise of the disturbance prior, estimated from the mission's profiles.
    """

    observations: Path
    survey: Survey
    platform: Platform
    number: int
    keys: tuple[str, ...]
    settings: EstimationSettings
    noise_factor: Array


@dataclass(frozen=True, eq=False)
class SmoothedProfile:
    """Result of smoothing a profile.

    Attributes
    ----------
    number : int
        Number of the profile.
    time : numpy.datetime64
        Time at the middle of the profile.
    score, information : (p,), (p, p), optional
        Score and information, in plausible deviations of the hull used for the smoothing; None if there is no estimate.
    noise : (2, 6), optional
        Sums of the squared smoothed noise divided by the job's variances, and of the resolved values.
    current : ProfileCurrent, optional
        Depth-averaged current, if there are fixes.
    message : str
        Reason why there is no information.
    """

    number: int
    time: np.datetime64
    score: Array | None = None
    information: Array | None = None
    noise: Array | None = None
    current: ProfileCurrent | None = None
    message: str = ""


def smoothed_profile(job: SmoothingJob) -> SmoothedProfile:
    """Smooth one profile, as the job of a worker."""
    unknown_time = np.datetime64("NaT", "ns")
    with threadpool_limits(limits=1), open_observations(job.observations, survey=job.survey) as observations:
        try:
            record = observations.profile(job.number)
            profile = prepare_profile(Glider(job.platform), on_steps(record, job.settings, job.platform))
            ((_, profile),), (filtered,) = run_filters_around_rests([(None, profile)], job.settings)
        except ProfileError as error:
            return SmoothedProfile(job.number, unknown_time, message=str(error))
        if isinstance(filtered, ProfileError):
            return SmoothedProfile(job.number, unknown_time, message=str(filtered))
        smoothed = run_smoother(profile, filtered, job.settings, job.noise_factor)
    time = record.epoch + np.timedelta64(round(500.0 * float(record.time[0] + record.time[-1])), "ms")
    if smoothed.last_pass is None or not smoothed.outcome.usable:
        reason = smoothed.failure or f"the smoother failed ({smoothed.outcome.label})"
        return SmoothedProfile(job.number, time, message=reason)
    hull = smoothed_hull_information(profile, smoothed, smoothed.last_pass, job.settings)
    if not hull.is_sound:
        return SmoothedProfile(job.number, time, message="its information on the hull is negative or not finite")
    columns = [hull.names.index(key) for key in job.keys]
    displacement = displacement_with_errors(smoothed, hull.record)
    return SmoothedProfile(
        job.number,
        time,
        hull.score[columns],
        hull.information[np.ix_(columns, columns)],
        _noise(smoothed, smoothed.last_pass, ~profile.vibrating[:-1]),
        _current(record, profile.series, displacement, hull.displacement[:, columns]),
    )


def _noise(smoothed: SmoothedEstimate, last: LastPass, steady: NDArray[np.bool_]) -> Array:
    """Sum, over steady steps, the squared smoothed noise divided by the job's variances, and the resolved values.

    The sums of channels whose noise is not scaled to the profile are zero.
    """
    squares, resolved = noise_sums(last, last.problem.noise, steady)
    sums = np.array([smoothed.noise_factor * squares, resolved])
    sums[:, list(smoothed.unscaled)] = 0.0
    return sums


def _current(
    record: ProfileRecord, series: ProfileSeries, displacement: tuple[Array, Array], sensitivity: Array
) -> ProfileCurrent | None:
    """Return the current with its sensitivity (2, p) to the hull's errors; None unless both sides have a fix."""
    current = current_from_displacement(record, series.time, *displacement, _NO_OTHER_ERRORS)
    if current is None:
        return None
    return ProfileCurrent(current.velocity, sensitivity / current.drift.elapsed, current.covariance)


# Errors that all profiles have in common


def inflation_ratios(parameters: Sequence[HullParameter], profiles: int, settings: RoundSettings) -> Array:
    """Ratio ``(p, p)`` of the variance of the summed score to the sum of the stated variances, by pairs of parameters.

    Notes
    -----
    Let the variance of the errors that all profiles have in common be ``misfit`` times the stated variance of one
    profile, and larger by ``turning_misfit`` times it among the terms of sway, roll, yaw and the actuators' lag. The
    sum of the scores of ``n`` profiles then has ``1 + n misfit`` times its stated variance. With any number of
    profiles, the hull is determined no better than these errors allow.
    """
    turning = np.isin([parameter.key for parameter in parameters], TURNING_MOTION)
    both_turning = np.outer(turning, turning)
    return np.asarray(1.0 + profiles * (settings.misfit + settings.turning_misfit * both_turning))


def with_inflated_variance(score: Array, information: Array, ratios: Array) -> tuple[Array, Array]:
    """Score and information of a profile, reduced by the variance of errors that all profiles have in common.

    Parameters
    ----------
    score, information : (p,), (p, p)
        Score ``g`` and information ``I`` of the profile.
    ratios : (p, p)
        Ratios of `inflation_ratios`.

    Notes
    -----
    Let ``V`` be the information times the ratios, entry by entry. A score ``g = I eta + e`` whose error has the
    variance ``V`` gives ``I V^-1 g`` and ``I V^-1 I``. For one ratio ``d`` these are ``g / d`` and ``I / d``.
    """
    gain = information @ np.linalg.pinv(information * ratios, rcond=_SINGULAR, hermitian=True)
    reduced = gain @ information
    return np.asarray(gain @ score), np.asarray(0.5 * (reduced + reduced.T))


# Rounds over the profiles


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
        Sum over the profiles fitted, with ``eta`` relative to the base.
    held_out : tuple of (int, float, int)
        Number, chi-square relative to the sum (times the divisor) and degrees of freedom of each profile held out.
    skipped : tuple of SmoothedProfile
        Profiles without information.
    moves : tuple of float
        Largest move of each round, in plausible deviations.
    eta, full_step : (p,), (p,)
        Errors of the hull found, relative to the base, and the full step of the last round, before it was shortened, in
        plausible deviations.
    divisor, turning_divisor : float
        Divisors of the profiles' information, and of that on the terms of sway, roll and yaw (`CalibrationRounds`).
    terms : tuple of ProfileTerm
        Undivided information of all profiles in the last round, also of those held out, in the order of their numbers.
    """

    base: Platform
    platform: Platform
    parameters: tuple[HullParameter, ...]
    mission: MissionHull
    held_out: tuple[tuple[int, float, int], ...]
    skipped: tuple[SmoothedProfile, ...]
    moves: tuple[float, ...]
    eta: Array
    full_step: Array
    divisor: float
    turning_divisor: float
    terms: tuple[ProfileTerm, ...]

    @property
    def errors(self) -> Gaussian:
        """Distribution of the errors over all profiles, about the hull found, including the random walk.

        As in the smoother, the last move is added to the uncertainty; it is larger if the rounds ended unconverged.
        """
        return Gaussian(self.eta, self.mission.overall.covariance + np.outer(self.full_step, self.full_step))

    @property
    def information(self) -> MissionTerms:
        """Undivided information of all profiles, in the order of time."""
        return MissionTerms(self.base, self.parameters, in_order_of_time(self.terms), without=())


class _Round(NamedTuple):
    """Results of a round.

    Attributes
    ----------
    undivided, terms : dict of int to ProfileTerm
        Terms of the profiles by number, as smoothed and as reduced by `ratios`.
    mission : MissionHull
        Sum of the reduced terms of the fitted profiles.
    ratios : (p, p)
        Ratios by which the variances of the scores were inflated.
    """

    undivided: dict[int, ProfileTerm]
    terms: dict[int, ProfileTerm]
    mission: MissionHull
    ratios: Array


class CalibrationRounds:
    """Rounds over the profiles of an open file.

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
    settings : CalibrateSettings
        Settings of the smoother, of the rounds and of the turn test.
    executor : Executor
        Executor that smooths the profiles.
    """

    def __init__(
        self,
        observations: Observations,
        base: Platform,
        parameters: tuple[HullParameter, ...],
        *,
        fitted: Sequence[int],
        held_out: Sequence[int],
        settings: CalibrateSettings,
        executor: Executor,
    ) -> None:
        self._observations, self._base, self._parameters = observations, base, parameters
        self._fitted, self._held_out = list(fitted), list(held_out)
        step = max(settings.step, settings.rounds.step)
        self._settings = settings.model_copy(
            update={"step": step, "output_interval": step * round(_RECORD_INTERVAL / step)}
        )
        self._executor = executor
        self._prior = HullPrior.plausible(np.array([p.walk(base) for p in parameters]))

    def run(self, start: Platform, max_rounds: int, on_profile: Callable[[], None] = lambda: None) -> HullRounds:
        """Repeat the rounds until the hull no longer changes.

        Parameters
        ----------
        start : Platform
            Hull of the first round.
        max_rounds : int
            Largest number of rounds.
        on_profile : callable
            Called after every profile.

        Raises
        ------
        CalibrationError
            No profile can be smoothed.
        """
        eta = np.array([p.steps(self._base, p.value(start)) for p in self._parameters])
        noise_factor = np.ones(6)
        moves: list[float] = []
        while True:
            platform = moved_platform(self._base, self._parameters, eta)
            profiles = self._smooth_profiles(platform, noise_factor, on_profile)
            results = self._combine(profiles, platform, eta)
            noise_factor = noise_factor * pooled_factor([p for p in profiles if p.number in self._fitted])
            full_step = results.mission.overall.mean - eta
            next_eta = bounded_step(self._base, self._parameters, eta, eta + full_step)
            moves.append(float(np.abs(next_eta - eta).max()))
            self._log_round(len(moves), next_eta - eta, results.mission)
            blocked, eta = np.array_equal(next_eta, eta), next_eta
            # A step that was shortened to retain a stable glide does not count as convergence.
            converged = float(np.abs(full_step).max()) < self._settings.rounds.tolerance
            if converged or blocked or len(moves) >= max_rounds:
                break
        return HullRounds(
            base=self._base,
            platform=moved_platform(self._base, self._parameters, eta),
            parameters=self._parameters,
            mission=results.mission,
            held_out=self._compare_held_out(results),
            skipped=tuple(profile for profile in profiles if profile.information is None),
            moves=tuple(moves),
            eta=eta,
            full_step=full_step,
            divisor=float(results.ratios.min()),
            turning_divisor=float(results.ratios.max()),
            terms=tuple(results.undivided.values()),
        )

    def _log_round(self, number: int, move: Array, mission: MissionHull) -> None:
        largest = int(np.abs(move).argmax())
        log.info(
            "round %d: %d profiles, %s changed by %+.2f plausible deviations, inflation %.2f, log evidence %.1f",
            number, len(mission.numbers), self._parameters[largest].key, move[largest], mission.inflation,
            mission.log_evidence,
        )  # fmt: skip

    def _smooth_profiles(
        self, platform: Platform, noise_factor: Array, on_profile: Callable[[], None]
    ) -> list[SmoothedProfile]:
        keys, file = tuple(p.key for p in self._parameters), self._observations
        jobs = [
            SmoothingJob(file.path, file.survey, platform, number, keys, self._settings, noise_factor)
            for number in [*self._fitted, *self._held_out]
        ]
        profiles = []
        for profile in self._executor.run(smoothed_profile, jobs):
            profiles.append(profile)
            on_profile()
            if profile.information is None:
                log.warning("profile %d is left out: %s", profile.number, profile.message)
        return sorted(profiles, key=lambda profile: profile.number)

    def _combine(self, profiles: Sequence[SmoothedProfile], platform: Platform, eta: Array) -> _Round:
        """Sum the information of the profiles to be fitted, which were smoothed with a hull of errors ``eta``.

        Raises
        ------
        CalibrationError
            None of them has information.
        """
        informative = [profile for profile in profiles if profile.information is not None]
        count = sum(profile.number in self._fitted for profile in informative)
        ratios = inflation_ratios(self._parameters, count, self._settings.rounds)
        undivided = {profile.number: self._term(profile, platform, eta) for profile in informative}
        terms = {number: _reduced(term, ratios) for number, term in undivided.items()}
        fitted = [terms[number] for number in self._fitted if number in terms]
        if not fitted:
            raise CalibrationError(
                f"calibration: no dive could be smoothed, the first because {profiles[0].message}; check the records "
                "with `gliderhpc inspect`, or set rounds.most to 0 to fit the steady glides alone"
            )
        settings = self._settings
        mission = solve_mission(fitted, self._prior, robust=settings.rounds.robust, turn_test=settings.turn_test)
        return _Round(undivided, terms, mission, ratios)

    def _term(self, profile: SmoothedProfile, platform: Platform, eta: Array) -> ProfileTerm:
        """Convert a profile's result from plausible deviations of the hull used for smoothing to those of the base."""
        assert profile.score is not None
        assert profile.information is not None
        ratio = np.array(
            [p.slope(platform, 0.0) / p.slope(self._base, float(x)) for p, x in zip(self._parameters, eta, strict=True)]
        )
        current = profile.current
        if current is not None:
            current = replace(current, sensitivity=current.sensitivity / ratio)
        score, information = profile.score / ratio, profile.information / np.outer(ratio, ratio)
        return ProfileTerm(profile.number, profile.time, eta, score, information, current=current)

    def _compare_held_out(self, results: _Round) -> tuple[tuple[int, float, int], ...]:
        """Return number, chi-square relative to the sum (times the divisor) and freedom of each profile held out."""
        compared = []
        for number in self._held_out:
            if number in results.terms:
                chi_square, freedom = predicted_disagreement(results.mission, results.terms[number])
                compared.append((number, float(results.ratios.min()) * chi_square, freedom))
        return tuple(compared)


def _reduced(term: ProfileTerm, ratios: Array) -> ProfileTerm:
    """Return a profile's term, reduced by the errors that all profiles have in common."""
    score, information = with_inflated_variance(term.score, term.information, ratios)
    return replace(term, score=score, information=information)


def pooled_factor(profiles: Sequence[SmoothedProfile]) -> Array:
    """Estimate factors ``(6,)`` on the noise of each channel from all profiles together.

    Notes
    -----
    A single profile hardly resolves some of its disturbances, whose noise then stays near that of the prior
    (`gliderhpc.estimation.smoother.noise.NoiseScale`). The profiles of a mission, which have a common prior, resolve
    more together.
    """
    squares, resolved = np.sum([profile.noise for profile in profiles if profile.noise is not None], axis=0)
    return np.asarray((squares + _PRIOR_WEIGHT) / (resolved + _PRIOR_WEIGHT))


def bounded_step(base: Platform, parameters: Sequence[HullParameter], eta: Array, target: Array) -> Array:
    """Return the next ``eta``: a step towards the mean of the sum, as long as linearisation and stable glide allow.

    The step is shortened as a whole. Combinations of the errors are known much better than single errors, and
    shortening only some components would lead away from the combinations that the profiles determine.

    Parameters
    ----------
    base : Platform
        Hull relative to which ``eta`` is defined.
    parameters : sequence of HullParameter
        Parameters with the errors to estimate.
    eta, target : (p,), (p,)
        Errors with which the profiles were smoothed, and the mean of their sum, in plausible deviations.

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
