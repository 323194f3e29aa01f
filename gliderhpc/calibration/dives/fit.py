"""Calibration of a hull on whole profiles, starting from the fit of its trim to the steady glides."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from gliderhpc.calibration.dives.rounds import CalibrationRounds, HullRounds
from gliderhpc.calibration.glides.score import NO_ERRORS, Score, check_errors, score_of
from gliderhpc.calibration.glides.segment_errors import keys_of
from gliderhpc.calibration.settings import CalibrateSettings
from gliderhpc.errors import CalibrationError, InputError
from gliderhpc.estimation.steady_segments import SteadySegments, steady_segments
from gliderhpc.flight.glider import Glider
from gliderhpc.flight.hull_parameters import (
    PARAMETERS,
    PARAMETERS_BY_DENSITY,
    errors_in_units,
    hull_parameters,
    with_covariance,
    with_deviations_of,
    with_values,
)
from gliderhpc.flight.steady_glide import glides_stably
from gliderhpc.mission.executors import OpenExecutor, Progress, no_progress
from gliderhpc.mission_hull.estimate import prior_predictive_test
from gliderhpc.mission_hull.gaussian_chain import Gaussian
from gliderhpc.observations import Observations
from gliderhpc.platform import Platform

_JUDGED_QUANTITIES = 2
"""Number of quantities of the steady balance by which the hull found in the rounds is judged: depth rate and pitch.
Roll and rate of turn also respond to moments exerted by the moving water. The profiles separate these from errors in
the hull's own moments; the steady balance does not."""

_MIN_PROBABILITY = 0.01
"""Minimum prior probability of a distance from the base as large as the hull's; a less probable hull is refused."""


@dataclass(frozen=True, eq=False)
class DiveCalibration:
    """Calibration on whole profiles.

    Attributes
    ----------
    platform : Platform
        Hull with the estimates and their errors.
    rounds : HullRounds
        Rounds that led to this hull.
    fitted, held_out : Score
        Errors of the steady balance before and after, on the fitted and on the held-out profiles.
    tolerance : float
        Change of the parameters below which the rounds ended.
    """

    platform: Platform
    rounds: HullRounds
    fitted: Score
    held_out: Score
    tolerance: float


@dataclass(frozen=True, eq=False)
class DiveCalibrationInputs:
    """Inputs of a calibration on whole profiles.

    Attributes
    ----------
    observations : Observations
        The observation file.
    platform, base, start : Platform
        Hull that the result is compared with, hull from which plausible deviations are measured (the same, or with drag
        and lift of a measured velocity), and hull found from the steady glides.
    segments, held_out : SteadySegments
        Steady segments of the fitted and of the held-out profiles.
    settings : CalibrateSettings
        Settings of the calibration.
    rounds : int
        Largest number of rounds.
    """

    observations: Observations
    platform: Platform
    base: Platform
    start: Platform
    segments: SteadySegments
    held_out: SteadySegments
    settings: CalibrateSettings
    rounds: int

    @property
    def numbers(self) -> tuple[list[int], list[int]]:
        """Numbers of the fitted and of the held-out profiles."""
        return np.unique(self.segments.profile).tolist(), np.unique(self.held_out.profile).tolist()


def calibrate_on_dives(
    inputs: DiveCalibrationInputs, executor: OpenExecutor, progress: Progress = no_progress
) -> DiveCalibration:
    """Calibrate on the profiles that have steady segments.

    Parameters
    ----------
    inputs : DiveCalibrationInputs
        Records, hulls and settings.
    executor, progress : callable
        Functions that open the executor for the profiles and the progress display.

    Raises
    ------
    CalibrationError
        No profile can be smoothed, or the hull found has no stable glide, is farther from the platform than its
        plausible deviations allow, or is worse than the platform.
    """
    rounds = _run_rounds(inputs, executor, progress)
    _check_plausible(rounds)
    if not glides_stably(Glider(rounds.platform)):
        raise CalibrationError(
            "calibration: the hull that fits the profiles best has no stable glide; start from another platform, "
            "or choose other `profiles`"
        )
    errors = errors_in_units(rounds.base, rounds.parameters, rounds.errors.mean, rounds.errors.covariance)
    hull = with_deviations_of(inputs.platform, with_covariance(rounds.platform, errors))
    fitted, held_out = _score_on_glides(inputs, hull)
    return DiveCalibration(hull, rounds, fitted, held_out, inputs.settings.rounds.tolerance)


def _run_rounds(inputs: DiveCalibrationInputs, executor: OpenExecutor, progress: Progress) -> HullRounds:
    """Estimate the hull in rounds over the profiles."""
    base, settings = inputs.base, inputs.settings
    # If the rudder moved, its coefficient is stated explicitly, which makes it one of the hull's parameters.
    if inputs.segments.actuators[:, 3].any() or inputs.held_out.actuators[:, 3].any():
        base = with_values(base, {"viscous.K_delta": base.viscous.K_delta})
    all_parameters = hull_parameters(base)
    held_keys = keys_of(settings.calibration.hold, (*all_parameters, *PARAMETERS, *PARAMETERS_BY_DENSITY))
    parameters = tuple(p for p in all_parameters if p.key not in held_keys)
    fitted, held_out = inputs.numbers
    with executor() as opened, progress(inputs.rounds * (len(fitted) + len(held_out))) as advance:
        rounds = CalibrationRounds(
            inputs.observations,
            base,
            parameters,
            fitted=fitted,
            held_out=held_out,
            settings=settings,
            executor=opened,
        )
        return rounds.run(inputs.start, inputs.rounds, advance)


def _score_on_glides(inputs: DiveCalibrationInputs, hull: Platform) -> tuple[Score, Score]:
    """Score a hull on the steady glides of the fitted and of the held-out profiles.

    Raises
    ------
    CalibrationError
        The hull has no steady glides there, or is worse on them than the platform or than the fit of its trim alone.
    """
    segments = (inputs.segments, inputs.held_out)
    with threadpool_limits(limits=1):
        try:
            shared = [_shared_segments(inputs.observations, hull, each, inputs.settings) for each in segments]
        except InputError as error:
            raise CalibrationError(
                f"calibration: steady glides of the hull that fits the profiles best: {error}"
            ) from error
        numbered = list(zip(inputs.numbers, shared, strict=True))
        fitted, held_out = (_score(inputs.platform, hull, *each) for each in numbered)
        fitted_from_trim, held_out_from_trim = (_score(inputs.start, hull, *each) for each in numbered)
    check_errors(fitted, held_out, _JUDGED_QUANTITIES)
    # In water that turns the glider, the rounds can end at a hull that the steady glides contradict.
    check_errors(fitted_from_trim, held_out_from_trim, _JUDGED_QUANTITIES, before="the fit of its trim alone")
    return fitted, held_out


def _check_plausible(rounds: HullRounds) -> None:
    """Refuse a hull that is farther from the base than its plausible deviations allow.

    Strong yaw impulses and gusts can be mistaken for errors of the hull.

    Raises
    ------
    CalibrationError
        The distance is so large that chance would produce it in fewer than one mission in a hundred.
    """
    distance, expected, probability = prior_predictive_test(Gaussian(rounds.eta, rounds.errors.covariance))
    if probability < _MIN_PROBABILITY:
        largest = int(np.abs(rounds.eta).argmax())
        raise CalibrationError(
            f"calibration: the hull that fits the profiles best is farther from {rounds.base.name} than its plausible "
            f"deviations allow ({rounds.parameters[largest].key} by {rounds.eta[largest]:+.1f} of them; chi-square "
            f"{distance:.0f}, expected {expected:.0f}): motion of the water can act like errors of the hull; if the "
            "hull does differ that much, give larger uncertainty.deviation in the platform file (with a measured "
            "velocity, the deviations of drag and lift are those that it leaves)"
        )


def _shared_segments(
    observations: Observations, after: Platform, segments: SteadySegments, settings: CalibrateSettings
) -> tuple[SteadySegments, SteadySegments]:
    """Return the segments that are steady both with the first hull and with the calibrated one, as found with each.

    Which segments are steady depends on the hull, and so do the corrections of the records for sensor errors. If no
    segment is steady with both hulls, all segments of each are returned.
    """
    numbers = np.unique(segments.profile).tolist()
    if not numbers:
        return segments, segments
    calibrated = steady_segments(observations, after, numbers, settings, settings.steady)
    if np.isfinite(segments.seawater).all():
        calibrated = calibrated.select(calibrated.in_known_water)
    else:
        calibrated = replace(calibrated, seawater=np.full_like(calibrated.seawater, np.nan))
    reach = 0.5 * settings.steady.length
    shared, shared_calibrated = segments.shared_with(calibrated, reach), calibrated.shared_with(segments, reach)
    return (shared, shared_calibrated) if len(shared) else (segments, calibrated)


def _score(
    before: Platform, after: Platform, numbers: Sequence[int], segments: tuple[SteadySegments, SteadySegments]
) -> Score:
    """Compute the errors of the balance for two hulls, each on the segments as found with it (`_shared_segments`)."""
    if not numbers:
        return Score((), 0, NO_ERRORS, NO_ERRORS)
    first, calibrated = segments
    errors_after = score_of(after, calibrated) if len(calibrated) else NO_ERRORS
    return Score(tuple(numbers), len(calibrated), score_of(before, first), errors_after)
