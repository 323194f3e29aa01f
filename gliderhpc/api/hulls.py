"""Calibration of a hull on a mission's own glides, and tuning of its disturbance prior."""

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from gliderhpc.api.arguments import (
    HullArgument,
    Profiles,
    assignments_of,
    platform_of,
    profiles_text,
    settings_of,
)
from gliderhpc.api.estimated_hulls import CalibratedHull, HullFromDives, HullFromGlides, TunedHull
from gliderhpc.api.workers import executor_of
from gliderhpc.errors import CalibrationError, InputError
from gliderhpc.flight.hull_parameters import hull_parameters, with_deviations_of
from gliderhpc.mission.profile_calibration import (
    OpenExecutor,
    ProfileCalibrationInputs,
    Progress,
    calibrate_on_profiles,
    no_progress,
)
from gliderhpc.observations import Observations
from gliderhpc.observations.in_memory import Records, opened_records
from gliderhpc.observations.profile_numbers import evenly_spaced, select_profiles
from gliderhpc.platform import Platform
from gliderhpc.report import tuning as tuning_report
from gliderhpc.tuning.calibration import CalibrateSettings, fit_trim
from gliderhpc.tuning.calibration import calibrate as fit
from gliderhpc.tuning.disturbance_prior import TuneSettings, tune_prior
from gliderhpc.tuning.likelihood import tuning_profiles
from gliderhpc.tuning.measured_polar import with_measured_polar
from gliderhpc.tuning.segment_errors import MIN_PROFILES, choose_buoyancy, keys_of, steady_parameters
from gliderhpc.tuning.steady_segments import SteadySegments, steady_segments

log = logging.getLogger("gliderhpc.calibrate")

CALIBRATED_BEFORE = (
    "the given platform has been calibrated before: its stated errors are not used, and plausible deviations and "
    "bounds are centred on its values; calibrated again on the same records, the intervals become too narrow; start "
    "from the platform before its first calibration"
)
"""Caution about a calibration that starts from a calibrated platform."""

HELD_OUT = 4
"""Interval, in profiles, of those held out for the score if none are named."""


def calibrate(
    records: Records,
    hull: HullArgument,
    *,
    profiles: Profiles = None,
    hold_out: Profiles = None,
    tune: bool = False,
    settings: CalibrateSettings | None = None,
    workers: int | None = None,
    **named: Any,
) -> CalibratedHull:
    """Fit the trim, drag and lateral terms that a mission's steady glides determine.

    With ``rounds={"most": 8}`` the hull and the errors of the records are estimated in rounds over whole dives. In each
    round all dives are smoothed with the present hull. The rounds start from the fitted trim. If they find a better
    hull, it replaces the fit.

    Parameters
    ----------
    records : xarray.Dataset, str or Path
        Observations.
    hull : Platform, str or Path
        The hull to start from.
    profiles : int, iterable of int, or str, optional
        Profiles to use; by default a selection spread over the mission.
    hold_out : int, iterable of int, or str, optional
        Profiles held out of the fit and used only for the score; by default every fourth.
    tune : bool
        Whether to tune the disturbance prior on the calibrated hull, and to calibrate again with that prior.
    settings : CalibrateSettings, optional
        Settings of the fit.
    workers : int, optional
        Number of worker processes, 0 to compute in this process; by default one per core.
    **named
        Settings by name, which override those of `settings`: ``calibration={"trend": True}``.

    Returns
    -------
    CalibratedHull
        The hull, with ``.platform``, ``.table``, ``.history``, ``.scores``, ``.notes``, ``.warnings`` and
        ``.save(path)``: a `HullFromDives` if there were rounds and they found a better hull, and otherwise a
        `HullFromGlides`.

    Raises
    ------
    InputError
        An argument cannot be used, or the profiles contain too little steady flight.
    CalibrationError
        No hull better than the starting one was found.
    """
    chosen, platform = settings_of(CalibrateSettings, settings, named), platform_of(hull)
    executor = executor_of(workers)
    calibration = calibrate_and_tune if tune else calibrate_open
    with opened_records(records) as observations:
        texts = profiles_text(profiles), profiles_text(hold_out)
        return calibration(CalibrationInputs(observations, platform, chosen, *texts, assignments_of(named)), executor)


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
    """Calibrate on an open file, as `calibrate` does.

    ``progress(total)`` opens a display of the number of finished dives, over all rounds.
    """
    with threadpool_limits(limits=1):
        platform, segments, held_out = _read_segments(inputs)
    calibrated = _calibrated(inputs, platform, segments, held_out, executor, progress)
    if platform.calibration is not None:
        calibrated = replace(calibrated, caution=CALIBRATED_BEFORE)
    observations = inputs.observations
    made = calibrated.provenance(observations.path.name, observations.digest(), inputs.assignments)
    return _with_source(calibrated, f"{platform.source} {made}")


def _read_segments(inputs: CalibrationInputs) -> tuple[Platform, SteadySegments, SteadySegments]:
    """Return the platform with the buoyancy that the segments allow, and the fitted and the held-out segments."""
    observations, settings = inputs.observations, inputs.settings
    chosen, named = chosen_profiles(observations, inputs.profiles, inputs.hold_out, settings)
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


def _calibrated(
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
            dives = calibrate_on_profiles(
                ProfileCalibrationInputs(
                    inputs.observations, platform, base, start, segments, held_out, settings, rounds
                ),
                executor,
                progress,
            )
            return HullFromDives(platform=dives.platform, dives=dives)
    except CalibrationError as error:
        failure = f"fit of the steady glides alone, since the dives did not give a better hull: {error}"
        log.warning(failure)
    with threadpool_limits(limits=1):
        steady = fit(base, segments, held_out, settings.calibration, log.info)
    return HullFromGlides(platform=with_deviations_of(platform, steady.platform), calibration=steady, failure=failure)


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
    if refused := tuning_report.refusal(tuned.tuned, tuning):
        return _without_prior(first, refused)
    with_prior = inputs.platform.model_copy(update={"prior": tuned.platform.prior})
    try:
        second = calibrate_open(replace(inputs, platform=with_prior), executor, progress)
    except CalibrationError as error:
        return _without_prior(first, f"with it no hull was found ({error})")
    if isinstance(first, HullFromDives) and not isinstance(second, HullFromDives):
        return _without_prior(first, f"with it the dives gave no hull ({second.failure})")
    used = tuning_report.used_text(list(tuned.profiles), tuning)
    source = f"{second.platform.source} Disturbance prior tuned on {used} with the hull of a first calibration."
    return _with_source(second, source)


def _without_prior(first: CalibratedHull, reason: str) -> CalibratedHull:
    """Return the result of the first calibration with the reason why the tuned prior is not used."""
    doubt = f"the prior was tuned but is not used, since {reason}; the hull is that of the first calibration"
    log.warning(doubt)
    return replace(first, caution="; ".join(filter(None, (first.caution, doubt))))


def _before_rounds(
    platform: Platform, segments: SteadySegments, settings: CalibrateSettings
) -> tuple[Platform, Platform]:
    """Return the hull on which the calibration's prior is centred, and the hull from which the rounds start.

    The former is the platform, with drag and lift from the measured velocity if there is one.
    """
    start = fit_trim(platform, segments, settings.calibration, log.info)
    held = keys_of(settings.calibration.hold, (*hull_parameters(platform), *steady_parameters(platform, segments)))
    base = with_measured_polar(platform, start, segments, settings.smoother.velocity_error, held, log.info)
    return base, start if base is platform else fit_trim(base, segments, settings.calibration, log.info)


def chosen_profiles(
    observations: Observations, profiles: str | None, hold_out: str | None, settings: CalibrateSettings
) -> tuple[list[int], list[int] | None]:
    """Return the profiles to read, and those of them to hold out for the score (None if none are named)."""
    taken = _profiles_to_use(observations, profiles, settings.calibration.profiles)
    if hold_out is None:
        return taken, None
    held_out = list(select_profiles(observations.profile_numbers, hold_out, "hold_out"))
    if set(taken) <= set(held_out):
        raise InputError("`hold_out` leaves no profile for the fit; name fewer profiles")
    return sorted({*taken, *held_out}), held_out


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


def tune(
    records: Records,
    hull: HullArgument,
    *,
    profiles: Profiles = None,
    settings: TuneSettings | None = None,
    **named: Any,
) -> TunedHull:
    """Estimate the disturbance prior of filter and smoother that maximises the likelihood of the records.

    Parameters
    ----------
    records : xarray.Dataset, str or Path
        Observations.
    hull : Platform, str or Path
        The hull, whose prior is the starting point.
    profiles : int, iterable of int, or str, optional
        Profiles to tune on; by default a selection spread over the mission.
    settings : TuneSettings, optional
        Settings of the filter and of its tuning.
    **named
        Settings by name, which override those of `settings`: ``tuning={"longest": 1800.0}``.

    Returns
    -------
    TunedHull
        The hull, with ``.platform``, ``.table``, ``.notes``, ``.warnings`` and ``.save(path)``.

    Raises
    ------
    InputError
        An argument cannot be used, or no profile can be tuned on.
    """
    chosen, platform = settings_of(TuneSettings, settings, named), platform_of(hull)
    with opened_records(records) as observations:
        return tune_open(observations, platform, chosen, profiles_text(profiles), assignments_of(named), log.info)


def tune_open(
    observations: Observations,
    platform: Platform,
    settings: TuneSettings,
    profiles: str | None,
    assignments: Sequence[str],
    announce: Callable[[str], None],
) -> TunedHull:
    """Tune on an open file, as `tune` does; `announce` is called with a line at each step."""
    with threadpool_limits(limits=1):
        numbers = _profiles_to_use(observations, profiles, settings.tuning.profiles)
        prepared = tuning_profiles(observations, platform, numbers, settings.tuning.longest, settings)
        used = [profile.series.number for profile in prepared]
        announce(f"tuning on {tuning_report.used_text(used, settings)}")
        tuned = tune_prior(platform, prepared, settings, lambda value: announce(f"log-likelihood {value:.1f}"))
    made = tuning_report.provenance(tuned, observations.path.name, observations.digest(), used, settings, assignments)
    update = {"prior": tuned.after, "source": f"{platform.source} {made}"}
    return TunedHull(platform.model_copy(update=update), tuned, tuple(used), settings)
