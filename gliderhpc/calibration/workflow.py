"""Steps of `calibrate` and `tune` on an open observation file, from the chosen profiles to the estimated hull."""

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from gliderhpc.calibration.changes import find_change
from gliderhpc.calibration.dives.fit import DiveCalibrationInputs, calibrate_on_dives
from gliderhpc.calibration.estimated_hulls import CalibratedHull, HullFromDives, HullFromGlides, TunedHull
from gliderhpc.calibration.glides.fit import calibrate_on_glides, fit_trim
from gliderhpc.calibration.glides.measured_polar import with_measured_polar
from gliderhpc.calibration.glides.segment_errors import MIN_PROFILES, choose_buoyancy, keys_of, steady_parameters
from gliderhpc.calibration.prior import text as prior_text
from gliderhpc.calibration.prior.fit import TuneSettings, tune_prior
from gliderhpc.calibration.prior.likelihood import tuning_profiles
from gliderhpc.calibration.settings import CalibrateSettings
from gliderhpc.errors import CalibrationError, InputError
from gliderhpc.estimation.steady_segments import SteadySegments, steady_segments
from gliderhpc.flight.hull_parameters import hull_parameters, with_deviations_of
from gliderhpc.mission.executors import OpenExecutor, Progress, no_progress
from gliderhpc.observations import Observations
from gliderhpc.observations.profile_numbers import evenly_spaced, select_profiles
from gliderhpc.platform import Platform
from gliderhpc.studies.hull import MissionTerms

log = logging.getLogger("gliderhpc.calibrate")

CALIBRATED_BEFORE = (
    "the given platform has been calibrated before: its stated errors are not used, and plausible deviations and "
    "bounds are centred on its values; calibrated again on the same records, the intervals become too narrow; start "
    "from the platform before its first calibration"
)
"""Caution about a calibration that starts from a calibrated platform."""

HELD_OUT = 4
"""Interval, in profiles, of those held out for the score if none are named."""


@dataclass(frozen=True, eq=False)
class CalibrationInputs:
    """Inputs of a calibration.

    Attributes
    ----------
    observations, platform, settings : Observations, Platform, CalibrateSettings
        The open file, the hull to start from, and the settings.
    profiles, hold_out : str, optional
        Choices of the profiles to use, and of those held out for the score, such as ``18:20,68``.
    assignments : sequence of str
        Settings given by the user, which are recorded in the platform's source.
    """

    observations: Observations
    platform: Platform
    settings: CalibrateSettings
    profiles: str | None = None
    hold_out: str | None = None
    assignments: Sequence[str] = ()


def calibrate_open(
    inputs: CalibrationInputs, executor: OpenExecutor, progress: Progress = no_progress
) -> CalibratedHull:
    """Calibrate on an open file, as `gliderhpc.calibrate` does.

    ``progress(total)`` opens a display of the number of finished dives, over all rounds.
    """
    with threadpool_limits(limits=1):
        platform, segments, held_out = _read_segments(inputs)
    calibrated = _calibrate_on_dives_or_glides(inputs, platform, segments, held_out, executor, progress)
    if platform.calibration is not None:
        calibrated = replace(calibrated, caution=CALIBRATED_BEFORE)
    observations = inputs.observations
    origin = calibrated.provenance(observations.path.name, observations.digest(), inputs.assignments)
    return _with_source(calibrated, f"{platform.source} {origin}")


def _read_segments(inputs: CalibrationInputs) -> tuple[Platform, SteadySegments, SteadySegments]:
    """Return the platform with the buoyancy that the segments allow, and the fitted and the held-out segments."""
    observations, settings = inputs.observations, inputs.settings
    chosen, named = profiles_to_read(observations, inputs.profiles, inputs.hold_out, settings)
    every = steady_segments(observations, inputs.platform, chosen, settings, settings.steady, allow_flatter=True)
    platform, segments, held_out = choose_buoyancy(
        inputs.platform, *split_segments(every, named), settings.seawater, log.info
    )
    log.info("calibrating on %d segments of steady flight; %d more are held out", len(segments), len(held_out))
    if observations.has_velocity and not _has_velocity(segments):
        log.warning("the measured velocity is not used: in no steady segment does it agree with the depth rate")
    return platform, segments, held_out


def _has_velocity(segments: SteadySegments) -> bool:
    return bool(np.isfinite(segments.velocity).any())


def _calibrate_on_dives_or_glides(
    inputs: CalibrationInputs,
    platform: Platform,
    segments: SteadySegments,
    held_out: SteadySegments,
    executor: OpenExecutor,
    progress: Progress,
) -> CalibratedHull:
    """Calibrate in rounds over the dives if any are requested; otherwise, or if these fail, on the steady glides."""
    settings = inputs.settings
    rounds = 0 if settings.calibration.trend else settings.rounds.largest_number(platform)
    base, failure = platform, ""
    try:
        if rounds > 0 or _has_velocity(segments):
            with threadpool_limits(limits=1):
                base, start = _before_rounds(platform, segments, settings)
        if rounds > 0:
            dives = calibrate_on_dives(
                DiveCalibrationInputs(inputs.observations, platform, base, start, segments, held_out, settings, rounds),
                executor,
                progress,
            )
            return _with_change(HullFromDives(platform=dives.platform, dives=dives), dives.rounds.information)
    except CalibrationError as error:
        failure = f"fit of the steady glides alone, since the dives did not give a better hull: {error}"
        log.warning(failure)
    with threadpool_limits(limits=1):
        steady = calibrate_on_glides(base, segments, held_out, settings.calibration, log.info)
    hull = with_deviations_of(platform, steady.platform)
    return _with_change(HullFromGlides(platform=hull, calibration=steady, failure=failure), steady.information)


def _with_change(calibrated: CalibratedHull, dives: MissionTerms) -> CalibratedHull:
    """Return a calibrated hull with a warning, and wider errors, if the hull has probably changed among the dives."""
    with threadpool_limits(limits=1):
        change = find_change(dives)
    if change is None:
        return calibrated
    widened = change.widened(calibrated.platform, dives.parameters)
    return replace(calibrated, platform=widened, change=change.warning)


def _with_source(calibrated: CalibratedHull, source: str) -> CalibratedHull:
    return replace(calibrated, platform=calibrated.platform.model_copy(update={"source": source}))


def calibrate_and_tune(
    inputs: CalibrationInputs, executor: OpenExecutor, progress: Progress = no_progress
) -> CalibratedHull:
    """Calibrate, tune the disturbance prior on the hull found, and calibrate again from the platform with that prior.

    Hull and prior depend on each other: on a hull whose trim is wrong the prior becomes wide enough to contain the
    error, and the prior decides how much of the records the hull has to explain. A prior with which a run would refuse
    one of the profiles is not used, nor one with which the dives no longer give a hull.
    """
    first = calibrate_open(inputs, executor, progress)
    tuning = TuneSettings(**{name: getattr(inputs.settings, name) for name in TuneSettings.model_fields})
    some = ",".join(map(str, evenly_spaced(list(first.fitted.profiles), tuning.tuning.profiles)))
    tuned = tune_open(inputs.observations, first.platform, tuning, some, inputs.assignments, log.info)
    log.info(tuned.notes[0])
    if refused := prior_text.refusal(tuned.tuned, tuning):
        return _without_prior(first, refused)
    with_prior = inputs.platform.model_copy(update={"prior": tuned.platform.prior})
    try:
        second = calibrate_open(replace(inputs, platform=with_prior), executor, progress)
    except CalibrationError as error:
        return _without_prior(first, f"no hull was found with it ({error})")
    if isinstance(first, HullFromDives) and not isinstance(second, HullFromDives):
        return _without_prior(first, f"the dives gave no hull with it ({second.failure})")
    used = prior_text.used_text(list(tuned.profiles), tuning)
    source = f"{second.platform.source} Disturbance prior tuned on {used} with the hull of a first calibration."
    return _with_source(second, source)


def _without_prior(first: CalibratedHull, reason: str) -> CalibratedHull:
    """Return the result of the first calibration with the reason why the tuned prior is not used."""
    caution = f"the prior was tuned but is not used, since {reason}; the hull is that of the first calibration"
    log.warning(caution)
    return replace(first, caution="; ".join(filter(None, (first.caution, caution))))


def _before_rounds(
    platform: Platform, segments: SteadySegments, settings: CalibrateSettings
) -> tuple[Platform, Platform]:
    """Return the hull on which the calibration's prior is centred, and the hull from which the rounds start.

    The former is the platform, with drag and lift from the measured velocity if there is one.
    """
    start = fit_trim(platform, segments, settings.calibration, log.info)
    held_keys = keys_of(settings.calibration.hold, (*hull_parameters(platform), *steady_parameters(platform, segments)))
    base = with_measured_polar(platform, start, segments, settings.smoother.velocity_error, held_keys, log.info)
    return base, start if base is platform else fit_trim(base, segments, settings.calibration, log.info)


def profiles_to_read(
    observations: Observations, profiles: str | None, hold_out: str | None, settings: CalibrateSettings
) -> tuple[list[int], list[int] | None]:
    """Return the profiles to read, and those of them to hold out for the score (None if none are named)."""
    chosen = _profiles_to_use(observations, profiles, settings.calibration.profiles)
    if hold_out is None:
        return chosen, None
    held_out = list(select_profiles(observations.profile_numbers, hold_out, "hold_out"))
    if set(chosen) <= set(held_out):
        raise InputError("`hold_out` leaves no profile for the fit; name fewer profiles")
    return sorted({*chosen, *held_out}), held_out


def _profiles_to_use(observations: Observations, profiles: str | None, count: int) -> list[int]:
    """Return the named profiles, or else at most `count` spread over the mission, usable ones if there are any."""
    available = observations.profile_numbers
    if profiles is not None:
        return list(select_profiles(available, profiles))
    usable = [number for number in available if number not in observations.faults]
    return evenly_spaced(usable or available, count)


def split_segments(segments: SteadySegments, held_out: Sequence[int] | None) -> tuple[SteadySegments, SteadySegments]:
    """Split the segments into fitted and held-out ones, the latter from the named profiles or every fourth flown."""
    if held_out is None:
        flown = np.unique(segments.profile).tolist()
        held_out = flown[HELD_OUT - 1 :: HELD_OUT] if len(flown) > MIN_PROFILES else []
    mask = np.isin(segments.profile, held_out)
    return segments.select(~mask), segments.select(mask)


def tune_open(
    observations: Observations,
    platform: Platform,
    settings: TuneSettings,
    profiles: str | None,
    assignments: Sequence[str],
    announce: Callable[[str], None],
) -> TunedHull:
    """Tune on an open file, as `gliderhpc.tune` does; `announce` is called with a line at each step."""
    with threadpool_limits(limits=1):
        numbers = _profiles_to_use(observations, profiles, settings.tuning.profiles)
        prepared = tuning_profiles(observations, platform, numbers, settings.tuning.longest, settings)
        used = [profile.series.number for profile in prepared]
        announce(f"tuning on {prior_text.used_text(used, settings)}")
        tuned = tune_prior(platform, prepared, settings, lambda value: announce(f"log-likelihood {value:.1f}"))
    origin = prior_text.provenance(tuned, observations.path.name, observations.digest(), used, settings, assignments)
    update = {"prior": tuned.after, "source": f"{platform.source} {origin}"}
    return TunedHull(platform.model_copy(update=update), tuned, tuple(used), settings)
