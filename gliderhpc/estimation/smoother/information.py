"""Information of a profile on the errors of its hull and records, and the sensitivity of the smoothed estimate to them.

The errors ``eta`` are those of `gliderhpc.flight.hull_parameters`, in plausible deviations. Information and score come
from a filter about a run of the model, or about its own path where no run follows the glider (`steered_run`).
The sensitivities of the smoothed estimate come from a filter and a smoother about the smoothed path (docs/smoother.md).
Both use the smoother's final variances and noise.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gliderhpc.estimation.preparation import PreparedProfile
from gliderhpc.estimation.settings import EstimationSettings, RecordSettings
from gliderhpc.estimation.smoother.estimate import LastPass, SmoothedEstimate
from gliderhpc.estimation.smoother.forcing import (
    fed_sample_slopes,
    hull_forcing,
    velocity_offsets,
    vertical_motion_slopes,
    with_sample_errors,
)
from gliderhpc.estimation.smoother.hull_errors import HullErrors, stated_errors
from gliderhpc.estimation.smoother.information_sweeps import (
    moved,
    sensitivity_sweeps,
    sum_information,
    without_far_rows,
)
from gliderhpc.estimation.smoother.local_noise import other_assumptions, with_local_noise
from gliderhpc.estimation.smoother.problem import Trajectory, segment_rows
from gliderhpc.estimation.smoother.steered_run import information_path
from gliderhpc.estimation.smoother.vertical_motion import (
    STILL,
    MotionPrior,
    displacements,
    is_probable,
    motion_prior,
)
from gliderhpc.flight.glider import SENSED
from gliderhpc.flight.hull_parameters import HullParameter, hull_parameters
from gliderhpc.kernels.sensitivity_memory import (
    ErrorInformation,
    Forcing,
    SmoothedSensitivity,
)
from gliderhpc.kernels.smoother_memory import SmootherProblem

Array = NDArray[np.float64]
Rows = NDArray[np.int64]

MEASURED = np.array([0, 1, 2, 5])
"""Indices of the measured states among the twelve of eq. 16."""
_TURNING = [0, 2]
"""Columns of roll and heading among the measurements."""

_ROUNDING = 1e-9
"""Largest negative eigenvalue of an information, relative to the largest one, that is attributed to rounding."""


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """Change of the smoothed estimate with ``p`` errors, in plausible deviations.

    Attributes
    ----------
    displacement, states, disturbances : (2, p), (m, 12, p), (k, 6, p)
        As in `HullInformation`.
    """

    displacement: Array
    states: Array
    disturbances: Array

    def first(self, count: int) -> "Sensitivity":
        """Return the sensitivity to the first errors alone."""
        columns = (self.displacement, self.states, self.disturbances)
        return Sensitivity(*(np.ascontiguousarray(column[..., :count]) for column in columns))


@dataclass(frozen=True, eq=False)
class RecordErrors:
    """Errors of a profile's record other than the hull's: of a measured velocity, and by the water's vertical motion.

    Attributes
    ----------
    mean, covariance : (k,), (k, k)
        Mean of the errors after the profile, in plausible deviations, and their covariance marginalised over the hull's
        errors (`split_sensitivity`). First those of the forward, lateral and normal velocity if they were measured,
        then those of the water's vertical motion if there is any (`gliderhpc.estimation.smoother.vertical_motion`).
    sensitivity : Sensitivity
        Change of the smoothed estimate with these errors.
    """

    mean: Array
    covariance: Array
    sensitivity: Sensitivity


@dataclass(frozen=True, eq=False)
class HullInformation:
    """Information of one profile on ``p`` errors of its hull and records, in plausible deviations from the platform.

    Attributes
    ----------
    parameters : tuple of HullParameter
        Parameters with these errors.
    value, plausible_deviation : (p,), (p,)
        The platform's values in the units of its file, and plausible deviations in the same units, or relative ones for
        numbers that vary by factors.
    score, information : (p,), (p, p)
        Gradient of the record's log-likelihood at the platform's values, and its expected curvature.
    others : tuple of (score, information)
        Score and information under the assumptions of `gliderhpc.vocabulary.NOISE_ASSUMPTIONS`.
    displacement : (2, p)
        Change of the smoothed displacement to the north and the east, m.
    states, disturbances : (m, 12, p), (k, 6, p)
        Change of the smoothed states (SI and rad) and disturbances (N, N m) at the records.
    record : RecordErrors, optional
        Errors of a measured velocity relative to the water, and of the depth by the water's vertical motion, if there
        are any. Score and information are marginalised over these errors, and the sensitivities those of the estimate
        that is moved to their mean (`gliderhpc.estimation.smoother.posterior.with_record_errors`).
    vertical_motion : float
        Standard deviation of the water's vertical velocity among these errors, m/s; zero without motion.
    """

    parameters: tuple[HullParameter, ...]
    value: Array
    plausible_deviation: Array
    score: Array
    information: Array
    others: tuple[tuple[Array, Array], ...]
    displacement: Array
    states: Array
    disturbances: Array
    record: RecordErrors | None = None
    vertical_motion: float = 0.0

    @property
    def names(self) -> tuple[str, ...]:
        """Keys of the parameters in the platform file."""
        return tuple(parameter.key for parameter in self.parameters)

    @property
    def is_sound(self) -> bool:
        """Return whether everything is finite and no information is negative, as it may be on a wrong hull."""
        return self.narrows_errors and all(_is_sound(*other) for other in self.others)

    @property
    def narrows_errors(self) -> bool:
        """Return whether the same holds for the profile's own noise, regardless of the other assumptions."""
        return self.has_sensitivities and _is_sound(self.score, self.information)

    def without_information(self) -> "HullInformation":
        """Return the same with NaN in place of score and information."""
        others = tuple((np.full_like(score, np.nan), np.full_like(matrix, np.nan)) for score, matrix in self.others)
        score, information = np.full_like(self.score, np.nan), np.full_like(self.information, np.nan)
        return replace(self, score=score, information=information, others=others)

    def without_records(self) -> "HullInformation":
        """Return the same without the sensitivities at the records, which take most of the memory."""
        return replace(self, states=self.states[:0].copy(), disturbances=self.disturbances[:0].copy(), record=None)

    @property
    def has_sensitivities(self) -> bool:
        """Return whether all sensitivities of the estimate are finite."""
        return all(np.isfinite(values).all() for values in (self.states, self.disturbances, self.displacement))


def smoothed_hull_information(
    profile: PreparedProfile, smoothed: SmoothedEstimate, last: LastPass, settings: EstimationSettings
) -> HullInformation:
    """Compute the information of a smoothed profile on its hull (`hull_information`), at the records of the settings.

    Parameters
    ----------
    profile, smoothed : PreparedProfile, SmoothedEstimate
        Profile, and its estimate on all ``n`` steps.
    last : LastPass
        Last pass of the smoother.
    settings : EstimationSettings
        Settings of the run.
    """
    return hull_information(
        profile, last, settings.records, smoothed.path(last.problem.decay), every=settings.steps_per_record,
        velocity_error=settings.smoother.velocity_error, motion=_motion_prior(profile, settings),
    )  # fmt: skip


def _motion_prior(profile: PreparedProfile, settings: EstimationSettings) -> MotionPrior:
    """Vertical motion of the water from the settings, or by default from the record."""
    deviation = settings.smoother.vertical_motion
    return motion_prior(profile) if deviation is None else MotionPrior(deviation)


def hull_information(
    profile: PreparedProfile, last: LastPass, records: RecordSettings, smoothed: Trajectory, *, every: int,
    velocity_error: float, motion: MotionPrior = STILL,
) -> HullInformation:  # fmt: skip
    """Compute the information of a smoothed profile on its hull.

    Parameters
    ----------
    profile, last : PreparedProfile, LastPass
        Profile on its ``n`` steps, and the smoother's problem after the last pass.
    records : RecordSettings
        Corrections of the records, made after those of the hull's sensors.
    smoothed : Trajectory
        Smoothed path.
    every : int
        Number of steps from record to record.
    velocity_error : float
        Plausible deviation of a constant error of the measured velocity relative to the water, m/s.
    motion : MotionPrior
        Vertical motion of the water.

    Notes
    -----
    At the true ``eta`` an innovation has zero expectation given the past. The score ``sum h' e / S`` is therefore
    unbiased if ``h`` depends on the past only. It would be biased about the smoothed path, which contains the noise of
    the sample itself, and with derivatives at the measured values. Score and information are therefore computed about
    a run of the model; the score is then nearly unbiased whatever noise is assumed. Where no run follows the glider,
    the path of a filter that is linearised about the smoothed one takes its place
    (`gliderhpc.estimation.smoother.steered_run.information_path`).

    Roll and heading of a slow record are left out. Gusts and impulses roll and turn a glider within seconds; such a
    record does not resolve this motion, and the smoother's slow moments do not describe it. On twins of true hulls the
    damping in roll would be in error by ten of its deviations, and drag and pitch offset with it.
    """
    platform, problem = profile.glider.platform, last.problem
    parameters = hull_parameters(platform)
    rows = np.arange(0, len(problem.fed), every)
    displacement = displacements(profile.series.time, motion.deviation)
    sample_errors = (
        _velocity_offsets(problem, velocity_error),
        vertical_motion_slopes(displacement[problem.fed], problem.measured.shape[1]),
    )
    informations, sensitivity = _information_and_sensitivity(
        profile, last, records, smoothed, rows, parameters=parameters, sample_errors=sample_errors
    )
    covariance = stated_errors(platform, parameters).covariance
    without_motion = len(informations[0].score) - displacement.shape[1]
    # Where the water has moved downwards, the glider is deeper than in water at rest by the same amount.
    sensitivity.states[:, MEASURED[3], without_motion:] += displacement[rows]
    if not _has_motion(informations[0], covariance, without_motion, motion.log_odds):
        motion, informations = STILL, _first(informations, without_motion)
        sensitivity = sensitivity.first(without_motion)
    (score, matrix), *others = (marginal_information(each, len(parameters)) for each in informations)
    record = None
    if len(informations[0].score) > len(parameters):
        sensitivity, record = split_sensitivity(sensitivity, informations[0], covariance)
    return HullInformation(
        parameters=tuple(parameters),
        value=np.array([p.value(platform) for p in parameters]),
        plausible_deviation=np.array([p.deviation(platform) for p in parameters]),
        score=score,
        information=matrix,
        others=tuple(others),
        displacement=sensitivity.displacement,
        states=sensitivity.states,
        disturbances=sensitivity.disturbances,
        record=record,
        vertical_motion=motion.deviation,
    )


def _information_and_sensitivity(
    profile: PreparedProfile,
    last: LastPass,
    records: RecordSettings,
    smoothed: Trajectory,
    rows: Rows,
    *,
    parameters: Sequence[HullParameter],
    sample_errors: Sequence[Array],
) -> tuple[tuple[ErrorInformation, ...], Sensitivity]:
    """Return the information under each assumption of the noise, and the sensitivity of the estimate at some rows.

    They concern the errors of the hull and then those of the samples, whose derivatives are `sample_errors`.
    """
    hull, problem = profile.glider.hull, last.problem

    def with_all_errors(forcing: Forcing) -> Forcing:
        for slopes in sample_errors:
            forcing = with_sample_errors(forcing, slopes)
        return forcing

    forcing = hull_forcing(profile, problem, records, parameters, smoothed.states[:, MEASURED])
    between = segment_rows(problem, rows.tolist())
    about_smoothed, sensitivity = sensitivity_sweeps(hull, problem, with_all_errors(forcing), smoothed, between, rows)

    def filtered() -> Trajectory:
        return moved(hull, problem, smoothed, between, without_far_rows(about_smoothed.filtered))

    path = information_path(profile, smoothed, filtered)
    at_predicted = _predicted(path.states)[:, MEASURED]
    forcing = forcing._replace(samples=fed_sample_slopes(profile, problem, records, parameters, at_predicted))
    local = with_local_noise(last, profile.series.sample_interval, ~profile.vibrating[:-1])
    assumed = (local, *other_assumptions(last, local, profile.vibrating))
    if profile.is_slow:
        assumed = tuple(_without_turning(each) for each in assumed)
    informations = sum_information(hull, assumed, with_all_errors(forcing), path, between)
    return informations, _at_records(sensitivity, rows < len(problem.bodies))


def _without_turning(problem: SmootherProblem) -> SmootherProblem:
    """Return a problem without the measured roll and heading."""
    measured = problem.measured.copy()
    measured[:, _TURNING] = np.nan
    return problem._replace(measured=measured)


def _velocity_offsets(problem: SmootherProblem, deviation: float) -> Array:
    """Derivatives of the samples by constant errors of the velocity; without columns if it is not measured."""
    samples, channels = int(np.count_nonzero(problem.fed)), problem.measured.shape[1]
    return velocity_offsets(samples, deviation) if channels > len(MEASURED) else np.zeros((samples, channels, 0))


def _first(informations: Sequence[ErrorInformation], count: int) -> tuple[ErrorInformation, ...]:
    """Return the information on the first errors alone."""
    return tuple(each._replace(matrix=each.matrix[:count, :count], score=each.score[:count]) for each in informations)


def _has_motion(information: ErrorInformation, hull_covariance: Array, others: int, log_odds: float) -> bool:
    """Return whether vertical motion, whose errors follow the `others`, is probable (`is_probable`)."""
    score, matrix = information.score, symmetric(information.matrix)
    if len(score) == others or not _is_sound(score, matrix):
        return False
    prior_covariance = np.eye(others)
    prior_covariance[: len(hull_covariance), : len(hull_covariance)] = hull_covariance
    return is_probable(score, matrix, prior_covariance, log_odds)


def marginal_information(information: ErrorInformation, parameters: int) -> tuple[Array, Array]:
    """Score and information on the first parameters, marginalised over the errors after them, with unit deviations."""
    score, matrix, first = information.score, symmetric(information.matrix), slice(parameters)
    if len(score) == parameters:
        return score, matrix
    others = slice(parameters, len(score))
    posterior_precision = matrix[others, others] + np.eye(len(score) - parameters)
    gain = np.linalg.solve(posterior_precision, matrix[others, first]).T
    marginal = matrix[first, first] - gain @ matrix[others, first]
    return score[first] - gain @ score[others], 0.5 * (marginal + marginal.T)


def _at_records(smoothed: SmoothedSensitivity, with_step: NDArray[np.bool_]) -> Sensitivity:
    """Sensitivities at the records; no step follows the last row."""
    states = np.empty((len(smoothed.states), 12, smoothed.states.shape[2]))
    states[:, SENSED] = smoothed.states[:, :10]
    states[:, 3:5] = smoothed.track
    disturbances = smoothed.states[with_step, 10:]
    return Sensitivity(np.ascontiguousarray(smoothed.displacement), states, np.ascontiguousarray(disturbances))


def split_sensitivity(
    sensitivity: Sensitivity, information: ErrorInformation, hull_covariance: Array
) -> tuple[Sensitivity, RecordErrors]:
    """Separate the errors of the record from those of the hull.

    Parameters
    ----------
    sensitivity, information : Sensitivity, ErrorInformation
        Sensitivities to, and information on, the hull's ``p`` errors and the others after them, which have unit
        deviations.
    hull_covariance : (p, p)
        Covariance ``P`` of the hull's errors before the profile.

    Returns
    -------
    Sensitivity
        Sensitivity to the hull's errors of the estimate that is corrected to the mean of the other errors.
    RecordErrors
        The other errors after the profile.

    Notes
    -----
    With the information ``M``, the covariance of all errors after the profile is ``C = (M + diag(P, 1)^-1)^-1``. The
    mean of the others is the part ``o`` of ``C g``, which follows the hull's errors ``h`` by ``-K h``, ``K = (C
    M)_oh``. The estimate's sensitivity to the hull is therefore ``V_h - V_o K``, and what is left of the others has the
    covariance ``C_oo - K P K'``. Information that is negative or not finite, as a wrong hull may give, is not used.
    """
    matrix, score = symmetric(information.matrix), information.score
    hull, others = slice(len(hull_covariance)), slice(len(hull_covariance), None)
    if not _is_sound(score, matrix):
        matrix, score = np.zeros_like(matrix), np.zeros_like(score)
    prior_covariance = np.eye(len(matrix))
    prior_covariance[hull, hull] = hull_covariance
    posterior = HullErrors(np.zeros(len(matrix)), prior_covariance).updated(score, matrix)
    gain = (posterior.covariance @ matrix)[others, hull]
    remaining = posterior.covariance[others, others] - gain @ hull_covariance @ gain.T
    columns = (sensitivity.displacement, sensitivity.states, sensitivity.disturbances)
    to_others = Sensitivity(*(np.ascontiguousarray(column[..., others]) for column in columns))
    to_hull = Sensitivity(*(column[..., hull] - column[..., others] @ gain for column in columns))
    return to_hull, RecordErrors(posterior.mean[others], 0.5 * (remaining + remaining.T), to_others)


def _predicted(states: Array) -> Array:
    """Filtered states extrapolated from the two previous rows, which makes each row independent of its own sample."""
    predicted = states.copy()
    predicted[2:] = 2.0 * states[1:-1] - states[:-2]
    return predicted


def _is_sound(score: Array, matrix: Array) -> bool:
    return bool(np.isfinite(score).all()) and semidefinite(matrix)


def semidefinite(matrix: Array) -> bool:
    """Return whether a symmetric matrix is finite and has no negative eigenvalue except by rounding."""
    if not np.isfinite(matrix).all():
        return False
    eigenvalues = np.linalg.eigvalsh(matrix)
    return bool(eigenvalues[0] >= -_ROUNDING * max(eigenvalues[-1], 0.0))


def symmetric(lower: Array) -> Array:
    """Complete a symmetric matrix from its lower triangle."""
    return np.asarray(np.tril(lower) + np.tril(lower, -1).T)
