"""Constant and heading-dependent errors of the compass, from currents of legs on different headings and from turns."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from gliderhpc.distributions import f_quantile, student_quantile
from gliderhpc.estimation.current_errors import CurrentErrors
from gliderhpc.estimation.currents import depth_averaged_current, single_cycle, track_of
from gliderhpc.estimation.preparation import vibration_set
from gliderhpc.estimation.resample import HARMONICS, harmonics
from gliderhpc.estimation.self_motion import SelfMotion, glide_angle_motion
from gliderhpc.estimation.settings import RecordSettings
from gliderhpc.observations import ProfileRecord, ProfileSeries
from gliderhpc.observations.times import epoch_seconds
from gliderhpc.platform import Platform
from gliderhpc.record_checks.finding import (
    CheckSettings,
    CheckVerdict,
    Finding,
    judge_size,
    undetermined,
    undetermined_if_insensitive,
)
from gliderhpc.record_checks.rotary import CurrentModel, is_explained_by_rotation
from gliderhpc.record_checks.turns import TurnInformation
from gliderhpc.wording import counted

Array = NDArray[np.float64]

MIN_LENGTH = 1.0
"""Minimum displacement through the water (m) of a glide; below it there are only rounding errors."""


@dataclass(frozen=True, eq=False)
class Leg:
    """A profile's information on the compass: its current from the glide angle, and the current's sensitivities.

    Attributes
    ----------
    time : float
        Time of the first sample, s since 1970.
    current : (2,)
        Current, north and east, from the glide-angle track, m/s.
    by_error : (2, 5)
        Derivatives of the current by an error of the heading: constant, and times `harmonics`, m/s per rad.
    by_speed : (2,)
        Derivative of the current by a relative error of the speed, m/s.
    latitude : float
        Latitude of the fix before the profile, degree; NaN if not known.
    """

    time: float
    current: Array
    by_error: Array
    by_speed: Array
    latitude: float = float("nan")


def leg_of(platform: Platform, record: ProfileRecord, series: ProfileSeries, errors: CurrentErrors) -> Leg | None:
    """Convert a profile to a leg; None unless it has a fix on both sides and a displacement through the water."""
    motion = glide_angle_motion(platform, series, vibration_set(platform, series))
    still = SelfMotion(np.zeros_like(motion.steps), 0.0)
    tracks = (track_of(series, m, single_cycle(series)) for m in (still, motion))
    drift, current = (depth_averaged_current(record, track, errors) for track in tracks)
    length = float(np.linalg.norm(motion.total))
    if record.entry_fix is None or drift is None or current is None or not length > MIN_LENGTH:
        return None
    elapsed = length / float(np.linalg.norm(drift.velocity - current.velocity))
    starboard = np.column_stack([-motion.steps[:, 1], motion.steps[:, 0]])
    heading = series.measurements[:-1, 2]
    basis = np.column_stack([np.ones(len(heading)), harmonics(heading)])
    return Leg(
        time=epoch_seconds(series.epoch),
        current=current.velocity,
        by_error=-starboard.T @ basis / elapsed,
        by_speed=-motion.total / elapsed,
        latitude=record.entry_fix.latitude,
    )


CHECK, UNIT = "compass", "degree"
CONSTANT, DEVIATION = "constant error of the compass", "deviation of the compass with the heading"

SENSE = "mirrored part of the motion"
_CLOCKWISE = (
    "the heading increases counter-clockwise: give it clockwise from true north (360 less it, or 90 less it if it is "
    "counted from east)"
)

MIN_LEGS = 6
_SPEED_ERROR = 0.3
"""Standard deviation of the relative error of the speed through the water due to the hull's coefficients."""
_MEMORIES = np.geomspace(3e3, 1e6, 9)
"""Correlation times (s) tried for the current."""
_RATIOS = np.concatenate([[0.0], np.geomspace(0.1, 100.0, 9)])
"""Ratios tried of the variance of the current's lasting part to that of the part of each profile alone."""

_OPEN = {5: "separated from both harmonics", 3: "includes the second harmonic", 1: "includes both harmonics"}

MODELS = (np.eye(5), np.eye(5)[:, :3], np.eye(5)[:, :1])
"""Directions (5, k) that are estimated, tried in turn: all five; constant and first harmonic; the constant alone."""


@dataclass(frozen=True, eq=False)
class CompassFit:
    """Errors of the compass (5,), the factors of 1 and `HARMONICS`, rad, their covariance, and estimated directions."""

    values: Array
    covariance: Array
    directions: Array

    @property
    def unknowns(self) -> int:
        """Number of estimated directions."""
        return int(self.directions.shape[1])

    @property
    def largest_error(self) -> float:
        """Largest standard error of the estimated directions, rad."""
        return float(np.sqrt(np.diag(self.directions.T @ self.covariance @ self.directions).max()))

    def freedom(self, legs: int) -> int:
        """Degrees of freedom of the scatter of some legs."""
        return max(legs - self.unknowns - 1, 1)

    def quantile(self, legs: int, level: float) -> float:
        """Ratio of the threshold to the standard error at a rate of false alarms."""
        return student_quantile(1.0 - 0.5 * level, self.freedom(legs))

    def test(self, tested: NDArray[np.intp]) -> tuple[float, int]:
        """Wald's statistic of some of the five parameters, and the number of their directions that were estimated."""
        rank = int(np.linalg.matrix_rank(self.directions[tested]))
        inverse = np.linalg.pinv(self.covariance[np.ix_(tested, tested)], rcond=1e-9, hermitian=True)
        return float(self.values[tested] @ inverse @ self.values[tested]), rank


def compass_findings(
    legs: Sequence[Leg], turns: TurnInformation, checks: CheckSettings, records: RecordSettings | None = None
) -> list[Finding]:
    """Estimate the constant and the heading-dependent error of the compass.

    Parameters
    ----------
    legs : sequence of Leg
        Profiles with a current.
    turns : TurnInformation
        Information of the turns on the deviation.
    checks : CheckSettings
        Settings of the checks, with the thresholds of significance.
    records : RecordSettings, optional
        Corrections already made, to which those that the findings suggest are added.

    Notes
    -----
    A compass that reads ``delta(psi)`` too high turns the track through the water to starboard by that angle. The
    current that closes the track on the fixes then has an equal error to port: ``U' = U - sum delta(psi) n ds / T``
    with the normal n to starboard. The error therefore appears as a difference between the currents on different
    headings. The current is modelled as a constant, a part that decorrelates exponentially with time, and a part of
    each profile alone; the two variances and the time are estimated by restricted likelihood. The speed through the
    water is fitted as well. The errors to estimate are ``A + B sin + C cos + D sin 2 + E cos 2`` of the heading read.
    Harmonics that the headings flown do not separate are left out, the higher ones first. On two opposite legs the
    constant can be estimated, together with the even harmonics, since it moves the two currents apart. The first
    harmonic cannot, since it acts like a current there. Turns add the information of `turn_information`.

    Few legs leave few degrees of freedom, and a threshold of many standard errors. Each quantity is therefore taken
    from the fit of most harmonics whose threshold is at most the plausible error, and tested once: the choice depends
    on standard errors, not on estimates. If no fit has such a threshold, the simplest is tested; an error that is not
    found there is not determined. Neither is one that does not explain the currents clearly better than a current that
    rotates with the inertial or the tidal period (`is_explained_by_rotation`), as where each heading was flown in one
    block of time only.
    """
    if len(legs) < MIN_LEGS:
        reason = (
            f"{counted(len(legs), 'profile')} with a fix on either side in which this hull can glide as the records "
            f"show, but at least {MIN_LEGS} are needed"
        )
        return [undetermined(CHECK, name, UNIT, reason) for name in (CONSTANT, DEVIATION)]
    system = LegSystem(legs, turns, checks)
    fits = [
        fit for fit in map(system.fitted, MODELS) if fit.largest_error < 0.5 * np.radians(checks.plausible_deviation)
    ]
    if not fits:
        reason = "the currents differ too much from profile to profile"
        return [undetermined(CHECK, name, UNIT, reason) for name in (CONSTANT, DEVIATION)]
    made = records or RecordSettings()
    findings = [_constant(fits, len(legs), checks, made), _deviation(fits, len(legs), turns, checks, made)]
    tested = ([0], list(range(1, fits[0].unknowns)))
    return [
        undetermined_if_rotating(finding, system.model, fits[0].values, errors)
        for finding, errors in zip(findings, tested, strict=True)
    ]


def undetermined_if_rotating(finding: Finding, model: CurrentModel, values: Array, tested: Sequence[int]) -> Finding:
    """Return a finding, or "not determined" if a rotating current explains the legs nearly as well."""
    if not finding.found or not is_explained_by_rotation(model, values, tested):
        return finding
    why = (
        f"{finding.size:+.2g} ± {finding.error:.2g} {finding.unit} would explain these currents, and so would a "
        "current that rotates with the inertial or the tidal period; the same headings at other times are needed to "
        "decide which"
    )
    return undetermined(finding.check, finding.quantity, finding.unit, why)


_LEAST_MIRRORED, _PLAUSIBLE_MIRRORED = 0.5, 0.8
"""Mirrored part that is reported, and threshold beyond which one that is not found is not ruled out."""

_MAX_ALIGNMENT = 0.7
"""Alignment of the legs with one line, from 0 to 1, beyond which a mirrored heading is like a turned one."""


def sense_finding(legs: Sequence[Leg], checks: CheckSettings) -> Finding:
    """Estimate how much of the displacement through the water is mirrored, as with a heading of the wrong sense.

    Parameters
    ----------
    legs : sequence of Leg
        Profiles with a current.
    checks : CheckSettings
        Settings of the checks, with the level of significance.

    Notes
    -----
    With north as the real and east as the imaginary axis, the velocities over ground are fitted as ``c + a v + b v*``,
    with the current c, the velocity v through the water and its mirror image v*. A heading clockwise from north has
    ``b = 0``, also with errors of the speed and a constant error of the compass. One that is counted
    counter-clockwise, from whatever direction, has ``a = 0`` and b of magnitude one.
    """
    if len(legs) < MIN_LEGS:
        return undetermined(CHECK, SENSE, "1", f"{counted(len(legs), 'leg')}, but at least {MIN_LEGS} are needed")
    water, current = (np.array([each[0] + 1j * each[1] for each in values]) for values in _velocities(legs))
    alignment = float(np.abs(np.mean((water / np.abs(water)) ** 2)))
    if alignment > _MAX_ALIGNMENT:
        why = f"{counted(len(legs), 'leg')} that are nearly along one line"
        return undetermined(CHECK, SENSE, "1", why)
    design = np.column_stack([np.ones(len(legs)), water, water.conj()])
    values = np.linalg.lstsq(design, current + water, rcond=None)[0]
    left, freedom = current + water - design @ values, 2 * (len(legs) - 3)
    variance = float(np.sum(np.abs(left) ** 2)) / freedom
    error = float(np.sqrt(variance * np.linalg.inv(design.conj().T @ design)[2, 2].real))
    threshold = max(float(np.sqrt(2.0 * f_quantile(1.0 - checks.level, 2, freedom))) * error, _LEAST_MIRRORED)
    turned, mirrored = (float(np.abs(value)) for value in values[1:])
    verdict = CheckVerdict.FOUND if mirrored > max(threshold, turned) else CheckVerdict.NOTHING
    if verdict is CheckVerdict.NOTHING and turned < max(_LEAST_MIRRORED, mirrored):
        why = f"{counted(len(legs), 'leg')}, whose displacements over ground hardly follow those through the water"
        return undetermined(CHECK, SENSE, "1", why)
    finding = Finding(CHECK, SENSE, "1", mirrored, error, threshold, verdict, _CLOCKWISE, counted(len(legs), "leg"))
    return undetermined_if_insensitive(
        finding, _PLAUSIBLE_MIRRORED, f"{counted(len(legs), 'leg')}, but more are needed"
    )


def _velocities(legs: Sequence[Leg]) -> tuple[list[Array], list[Array]]:
    """Velocities through the water, and currents, of the legs."""
    return [-leg.by_speed for leg in legs], [leg.current for leg in legs]


def largest_threshold(checks: CheckSettings) -> float:
    """Threshold (degree) beyond which an error of the compass that is not found is not ruled out either."""
    return max(checks.plausible_deviation, checks.least_deviation)


def first_decisive(findings: Sequence[Finding], checks: CheckSettings) -> int:
    """Index of the first finding with a threshold of at most a plausible error; the last if there is none."""
    decisive = (index for index, finding in enumerate(findings) if finding.threshold <= largest_threshold(checks))
    return next(decisive, len(findings) - 1)


def _constant(fits: Sequence[CompassFit], legs: int, checks: CheckSettings, made: RecordSettings) -> Finding:
    findings = [_constant_of(fit, legs, checks, made) for fit in fits]
    chosen = first_decisive(findings, checks)
    return undetermined_if_insensitive(
        findings[chosen], largest_threshold(checks), _more_legs(fits[chosen], legs, checks)
    )


def _constant_of(fit: CompassFit, legs: int, checks: CheckSettings, made: RecordSettings) -> Finding:
    constant, error = np.degrees(fit.values[0]), np.degrees(np.sqrt(fit.covariance[0, 0]))
    threshold = max(fit.quantile(legs, checks.level) * error, checks.least_deviation)
    return Finding(
        CHECK,
        CONSTANT,
        UNIT,
        constant,
        error,
        threshold,
        judge_size(constant, threshold),
        f"`records.heading_offset={made.heading_offset + constant:.1f}`",
        f"{counted(legs, 'leg')}; {_OPEN[fit.unknowns]}",
    )


def _more_legs(fit: CompassFit, legs: int, checks: CheckSettings) -> str:
    """Describe how many legs the constant needs if its error decreases with the square root of their number."""
    error, largest = np.degrees(np.sqrt(fit.covariance[0, 0])), largest_threshold(checks)
    sufficient = (
        number
        for number in range(legs + 1, 10 * legs)
        if fit.quantile(number, checks.level) * error * np.sqrt(legs / number) <= largest
    )
    number = next(sufficient, None)
    return f"{counted(legs, 'leg')}, but " + (f"about {number} are needed" if number else "many more are needed")


def _deviation(
    fits: Sequence[CompassFit], legs: int, turns: TurnInformation, checks: CheckSettings, made: RecordSettings
) -> Finding:
    findings = [_deviation_of(fit, legs, turns, checks, made) for fit in fits if fit.unknowns > 1]
    if not findings:
        reason = f"{counted(legs, 'leg')}: too few headings, or currents that differ too much"
        return undetermined(CHECK, DEVIATION, UNIT, reason)
    remedy = f"{counted(legs, 'leg')} and {turns.count} stretches of turns, but more are needed"
    return undetermined_if_insensitive(findings[first_decisive(findings, checks)], largest_threshold(checks), remedy)


def _deviation_of(
    fit: CompassFit, legs: int, turns: TurnInformation, checks: CheckSettings, made: RecordSettings
) -> Finding:
    harmonic_indices = np.arange(1, 5)
    statistic, rank = fit.test(harmonic_indices)
    values = np.degrees(fit.values[harmonic_indices])
    amplitude = float(np.linalg.norm(values))
    error = amplitude / np.sqrt(statistic) if statistic > 0.0 else float("nan")
    limit = np.sqrt(rank * f_quantile(1.0 - checks.level, rank, fit.freedom(legs))) * error
    threshold = max(limit, checks.least_deviation)
    harmonics_found = (
        "both harmonics" if rank == len(harmonic_indices) else "first harmonic; the second cannot be separated from it"
    )
    remark = f"{harmonics_found}; {counted(legs, 'leg')}, {turns.count} stretches of turns"
    parts = ", ".join(f"{value:.1f}" for value in made.heading_deviation + values)
    return Finding(
        CHECK,
        DEVIATION,
        UNIT,
        amplitude,
        error,
        threshold,
        judge_size(amplitude, threshold),
        f"`records.heading_deviation=[{parts}]` (times {', '.join(HARMONICS)} of the heading)",
        remark,
    )


class LegSystem:
    """Linear model of the legs' currents in the errors to estimate."""

    def __init__(self, legs: Sequence[Leg], turns: TurnInformation, checks: CheckSettings) -> None:
        count = len(legs)
        self._time = np.array([leg.time for leg in legs])
        self._current = np.concatenate([[leg.current[axis] for leg in legs] for axis in (0, 1)])
        self._by_error = np.concatenate([[leg.by_error[axis] for leg in legs] for axis in (0, 1)])
        by_speed = np.concatenate([[leg.by_speed[axis] for leg in legs] for axis in (0, 1)])
        mean = np.kron(np.eye(2), np.ones((count, 1)))
        self._nuisance = np.column_stack([mean, by_speed])
        self._turns = turns
        self.model = CurrentModel(
            self._time,
            np.array([leg.latitude for leg in legs]),
            self._current,
            self._by_error,
            by_speed,
            turns.information,
            turns.vector,
            np.radians(checks.plausible_deviation),
        )
        self._prior = np.radians(checks.plausible_deviation) ** -2.0

    def fitted(self, directions: Array) -> CompassFit:
        """Estimate some directions of the errors, with the current of the greatest restricted likelihood."""
        design = np.column_stack([self._by_error @ directions, self._nuisance])
        width = directions.shape[1]
        prior = np.diag([*[self._prior] * width, 0.0, 0.0, _SPEED_ERROR**-2.0])
        prior[:width, :width] += directions.T @ self._turns.information @ directions
        turn_vector = np.zeros(design.shape[1])
        turn_vector[:width] = directions.T @ self._turns.vector
        best = min(
            (self._posterior(design, prior, turn_vector, memory, ratio) for memory in _MEMORIES for ratio in _RATIOS),
            key=lambda candidate: candidate[0],
        )
        values, covariance = best[1][:width], best[2][:width, :width]
        return CompassFit(directions @ values, directions @ covariance @ directions.T, directions)

    def _posterior(
        self, design: Array, prior: Array, turn_vector: Array, memory: float, ratio: float
    ) -> tuple[float, Array, Array]:
        """Minus twice the restricted log-likelihood with the best variance of the current, estimate and covariance."""
        separation = np.abs(self._time[:, None] - self._time[None, :])
        shape = np.kron(np.eye(2), np.eye(len(self._time)) + ratio * np.exp(-separation / memory))
        factor = scipy.linalg.cho_factor(shape, lower=True)
        whitened = scipy.linalg.cho_solve(factor, design)
        normal, score = design.T @ whitened, whitened.T @ self._current
        freedom = len(self._current) - design.shape[1]
        values = np.linalg.lstsq(normal, score, rcond=None)[0]
        residual = self._current - design @ values
        variance = float(residual @ scipy.linalg.cho_solve(factor, residual)) / freedom
        determinants = (
            2.0 * np.log(np.diag(factor[0])).sum() + np.linalg.slogdet(normal + 1e-12 * np.eye(len(normal)))[1]
        )
        inverse = np.linalg.inv(normal / variance + prior)
        return freedom * np.log(variance) + determinants, inverse @ (score / variance + turn_vector), inverse
