"""Calibration of the trim, drag and lateral terms that a hull's own steady glides determine.

`calibrate_on_glides` fits all of them; `fit_trim` fits buoyancy, drag and trim in pitch, from which the rounds over
whole dives start.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gliderhpc.calibration.glides.covariance import (
    HELD_REASONS,
    LEVEL,
    Fit,
    few_profiles_factor,
    is_better_held,
    reason_to_hold,
)
from gliderhpc.calibration.glides.disagreeing_profiles import DisagreeingProfile, disagreeing_profiles
from gliderhpc.calibration.glides.score import REMEDY, Score, check_errors, score
from gliderhpc.calibration.glides.search import (
    COARSE_TOLERANCE,
    DEFAULT_TOLERANCE,
    RESCALINGS,
    START_RESCALINGS,
    CalibrationSearch,
    CalibrationVerdict,
    best_start,
)
from gliderhpc.calibration.glides.segment_errors import LATERAL, MIN_PROFILES, SegmentErrors, keys_of, steady_parameters
from gliderhpc.calibration.settings import CalibrationSettings
from gliderhpc.distributions import normal_quantile
from gliderhpc.errors import CalibrationError, InputError
from gliderhpc.estimation.least_squares import Direction, directions
from gliderhpc.estimation.steady_segments import SteadySegments
from gliderhpc.flight.glider import Glider
from gliderhpc.flight.hull_parameters import (
    TREND,
    HullParameter,
    errors_in_units,
    hull_parameters,
    round_number,
    with_covariance,
    with_values,
)
from gliderhpc.flight.steady_glide import glides_stably
from gliderhpc.platform import Platform
from gliderhpc.platform_sections import CalibrationErrors
from gliderhpc.studies.hull import MissionTerms
from gliderhpc.wording import counted

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

MAX_START_SEGMENTS = 200
"""Maximum number of segments, spread over the mission, used to find the starting point."""

_MAX_COST_INCREASE = 1.02


@dataclass(frozen=True, eq=False)
class CalibratedParameter:
    """One parameter before and after the calibration.

    Attributes
    ----------
    parameter : HullParameter
        The parameter.
    before, after : float
        Values in the unit of the platform file.
    steps : float
        Change in plausible deviations.
    interval : (float, float)
        95 % interval; NaN where held.
    scatter_share : float
        Fraction of the interval's variance due to scatter between profiles; the rest is due to errors of the held
        parameters, of the measured attitude, and of its rounding.
    verdict : CalibrationVerdict
        Outcome.
    confounded_with : tuple of str
        Keys of the other parameters in the weak direction, for a parameter that is not determined.
    """

    parameter: HullParameter
    before: float
    after: float
    steps: float
    interval: tuple[float, float]
    scatter_share: float
    verdict: CalibrationVerdict
    confounded_with: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class GlideCalibration:
    """A calibrated hull.

    Attributes
    ----------
    platform : Platform
        The hull with the estimates and their errors.
    parameters : tuple of CalibratedParameter
        All parameters considered.
    directions : tuple of Direction
        Directions of the estimated parameters, in plausible deviations, the best determined first.
    scales : (4,)
        Scales of the errors, SI, correlation within a leg included.
    fitted, held_out : Score
        Scores on the profiles used and on those held out (without segments if there were none).
    reference_time : numpy.datetime64
        Time to which the neutral volume belongs if it has a trend.
    information : MissionTerms
        Information of each fitted profile on the errors of the hull and the attitude.
    left_out : tuple of DisagreeingProfile
        Profiles that were left out of the fit, because they do not fit the hull of the others.
    """

    platform: Platform
    parameters: tuple[CalibratedParameter, ...]
    directions: tuple[Direction, ...]
    scales: Array
    fitted: Score
    held_out: Score
    reference_time: np.datetime64
    information: MissionTerms
    left_out: tuple[DisagreeingProfile, ...] = ()


def calibrate_on_glides(
    platform: Platform,
    segments: SteadySegments,
    held_out: SteadySegments,
    settings: CalibrationSettings,
    report: Callable[[str], None] = lambda _: None,
) -> GlideCalibration:
    """Fit a hull's parameters to the balance of its steady glides.

    The method is nonlinear least squares with the robust loss ``2 (sqrt(1 + z) - 1)`` on the errors of
    `steady_balances`, each divided by its own scale. At first all parameters are free, with their plausible deviations
    as a prior, and the fit starts from several points. Profiles that do not fit the hull of the others are left
    out (`disagreeing_profiles`). Then the glides are checked for directions that they do not determine, the weakest
    singular direction first. The largest parameter of such a direction is held at the platform's value, or at the most
    probable one if the glides refute the platform's. When every direction is determined, the remaining parameters are
    fitted without the prior. A parameter that runs to its bound is held in the same way. A hull without stable glides
    is fitted again with the lateral terms held, and so is one with a parameter whose interval is wider than its
    plausible deviation, if fewer parameters remain undetermined and the turns fit about as well: near neutral stability
    in yaw, real disturbances are mistaken for small errors of the balance, and the fit follows them. The result is
    compared with the start, on the profiles fitted and on those held out.

    Parameters
    ----------
    platform : Platform
        The hull to start from.
    segments, held_out : SteadySegments
        Segments to fit and segments to score; the latter may be empty.
    settings : CalibrationSettings
        Settings of the calibration.
    report : callable
        Called with a line of text at every step.

    Raises
    ------
    InputError
        Fewer profiles than `MIN_PROFILES`, or an unknown parameter to hold.
    CalibrationError
        The best hull found has no stable glide, or is worse than the hull at the start.
    """
    check_profiles(segments)
    candidates = steady_parameters(platform, segments)
    if settings.trend:
        candidates = (*candidates, TREND)
    all_parameters = (*candidates, *(p for p in hull_parameters(platform) if p not in candidates))
    free = ~np.isin([p.key for p in candidates], keys_of(settings.hold, all_parameters))
    lateral = np.isin([p.key for p in candidates], LATERAL)
    every = SegmentErrors(platform, candidates, segments)
    start = best_start(start_subset(every), free, report)
    left_out = _disagreeing(every, free, start, report)
    if left_out:
        every = every.without_profiles([profile.number for profile in left_out])
        start = best_start(start_subset(every), free, report)
    fit, lateral_verdict = _fit(every, free, lateral, start, settings, report)
    errors, search, covariance = fit.errors, fit.search, fit.covariance
    reasons = _reasons(search, free, free & lateral, lateral_verdict)
    parameters, estimated = _judge_parameters(errors, search, covariance, reasons)
    hull = with_values(
        platform, {p.parameter.key: p.after for p in parameters if p.after != p.before and p.parameter is not TREND}
    )
    steps = np.array([p.steps for p in parameters])
    hull = with_covariance(hull, _errors_in_file(errors, steps, covariance))
    calibration = GlideCalibration(
        hull,
        parameters,
        estimated,
        search.scales,
        score(errors, steps),
        score(SegmentErrors(platform, candidates, held_out, errors.reference), steps),
        errors.reference,
        fit.information(),
        left_out,
    )
    _check_glides(hull)
    _check_improved(calibration, search)
    return calibration


def _disagreeing(
    errors: SegmentErrors, free: Mask, start: Array, report: Callable[[str], None]
) -> tuple[DisagreeingProfile, ...]:
    """Return the profiles that do not fit the hull of the others, and report each of them."""
    search = CalibrationSearch(errors, free, 1.0, lambda _: None)
    search.steps = start
    search.fit_everything(START_RESCALINGS, COARSE_TOLERANCE)
    profiles = disagreeing_profiles(errors, search.steps)
    for profile in profiles:
        report(f"profile {profile.number} is left out: {profile.reason}")
    return profiles


def _fit(
    errors: SegmentErrors,
    free: Mask,
    lateral: Mask,
    start: Array,
    settings: CalibrationSettings,
    report: Callable[[str], None],
) -> tuple[Fit, CalibrationVerdict | None]:
    """Fit the free parameters, or again with the lateral terms held, and return the reason for the latter fit."""
    fit = Fit(errors, _search_from_best_start(errors, free, start, settings, report), start)
    reason = reason_to_hold(fit, lateral, stable=is_stable(errors, fit.search))
    if reason is None:
        return fit, None
    report(f"fitting again with the lateral terms held ({HELD_REASONS[reason]})")
    separate = errors.with_separate_turns()
    rest = free & ~lateral
    start = best_start(start_subset(separate), rest, report)
    held = Fit(separate, _search_from_best_start(separate, rest, start, settings, report), start)
    if is_better_held(reason, fit, held):
        return held, reason
    report("with the lateral terms held, the turns fit worse or fewer parameters are determined: the first fit is used")
    return fit, None


def start_subset(errors: SegmentErrors) -> SegmentErrors:
    """Return the errors over a subset of the segments, evenly spread, for the search of a starting point."""
    stride = -(-len(errors.segments) // MAX_START_SEGMENTS)
    subset = errors.segments.select(np.arange(len(errors.segments)) % stride == 0)
    return SegmentErrors(
        errors.platform, errors.parameters, subset, errors.reference, separate_turns=errors.separate_turns
    )


def _search_from_best_start(
    errors: SegmentErrors, free: Mask, start: Array, settings: CalibrationSettings, report: Callable[[str], None]
) -> CalibrationSearch:
    """Fit from the best starting point; from the platform's hull if that fit is worse than the platform."""
    search = _search_from(start, errors, free, settings, report)
    if not _is_worse(search):
        return search
    report("the fit is worse than the platform: fitting again from the platform's values")
    from_platform = _search_from(np.zeros(len(free)), errors, free, settings, report)
    return search if _is_worse(from_platform) else from_platform


def _search_from(
    start: Array, errors: SegmentErrors, free: Mask, settings: CalibrationSettings, report: Callable[[str], None]
) -> CalibrationSearch:
    search = CalibrationSearch(errors, free, settings.undetermined, report)
    search.run(start)
    return search


def _is_worse(search: CalibrationSearch) -> bool:
    """Return whether the cost of a fit is higher than that of the original platform."""
    before, after = _costs(search)
    return after > _MAX_COST_INCREASE * before + 1.0


def _costs(search: CalibrationSearch) -> tuple[float, float]:
    """Cost of the original platform, and of the fit."""
    return search.cost_of(np.zeros(len(search.steps))), search.cost_of(search.steps)


def is_stable(errors: SegmentErrors, search: CalibrationSearch) -> bool:
    """Return whether the hull at the end of a search has a stable dive and climb."""
    return glides_stably(Glider(errors.hull(search.steps)))


def check_profiles(segments: SteadySegments) -> None:
    """Refuse segments of too few profiles.

    Raises
    ------
    InputError
        Fewer than `MIN_PROFILES`.
    """
    count = len(np.unique(segments.profile))
    if count < MIN_PROFILES:
        raise InputError(
            f"calibration: steady flight in {counted(count, 'profile')} apart from those held out, but at least "
            f"{MIN_PROFILES} are needed; give records of more profiles, name more `profiles`, or hold fewer out"
        )


def _check_glides(hull: Platform) -> None:
    if not glides_stably(Glider(hull)):
        raise CalibrationError(
            "calibration: the hull that fits best has no stable dive and climb, even with the lateral terms held; "
            "start from another platform, or choose other `profiles`"
        )


def _check_improved(calibration: GlideCalibration, search: CalibrationSearch) -> None:
    """Refuse a fit whose cost increased, or whose errors are clearly larger than those of the original platform."""
    if _is_worse(search):
        before, after = _costs(search)
        raise CalibrationError(
            f"calibration: no fit is better than the platform (cost {after:.1f}, of the platform {before:.1f}); "
            f"if the platform was calibrated on these profiles, use it as it is; otherwise {REMEDY}"
        )
    check_errors(calibration.fitted, calibration.held_out)


def _reasons(
    search: CalibrationSearch, free: Mask, lateral: Mask, lateral_verdict: CalibrationVerdict | None
) -> dict[int, tuple[CalibrationVerdict, tuple[int, ...]]]:
    """Return the reason why each held parameter was held, and the other parameters in its direction.

    Parameters were held as requested (not `free`), in the second fit (`lateral`, if it has a verdict), or during the
    search.
    """
    reasons: dict[int, tuple[CalibrationVerdict, tuple[int, ...]]] = {
        int(i): (CalibrationVerdict.ASKED, ()) for i in np.flatnonzero(~free)
    }
    if lateral_verdict is not None:
        reasons |= {int(i): (lateral_verdict, ()) for i in np.flatnonzero(lateral)}
    return reasons | {held.index: (held.verdict, held.confounded_with) for held in search.held}


def _judge_parameters(
    errors: SegmentErrors,
    search: CalibrationSearch,
    covariance: Array,
    reasons: dict[int, tuple[CalibrationVerdict, tuple[int, ...]]],
) -> tuple[tuple[CalibratedParameter, ...], tuple[Direction, ...]]:
    """Return all parameters with their intervals or the reasons for holding them, and the estimated directions."""
    jacobian = search.weighted()[0][:, search.free]
    scatter = np.full(len(search.free), np.nan)
    scatter[search.free] = np.diag(search.scatter_covariance()) * few_profiles_factor(errors)
    variance = np.where(search.free, np.diag(covariance)[: len(search.free)], np.nan)
    quantile = normal_quantile(0.5 + 0.5 * LEVEL)
    parameters = []
    for i, parameter in enumerate(errors.parameters):
        step, half_width = float(search.steps[i]), quantile * math.sqrt(variance[i])
        after = parameter.moved(errors.platform, step)
        ends = [parameter.moved(errors.platform, step + sign * half_width) for sign in (-1.0, 1.0)]
        verdict, confounded_with = reasons.get(i, (CalibrationVerdict.ESTIMATED, ()))
        parameters.append(
            CalibratedParameter(
                parameter,
                parameter.value(errors.platform),
                after if step == 0.0 else round_number(after),
                step,
                (min(ends), max(ends)),
                float(scatter[i] / variance[i]),
                verdict,
                tuple(errors.parameters[j].key for j in confounded_with),
            )
        )
    return tuple(parameters), directions(jacobian)


def _errors_in_file(errors: SegmentErrors, steps: Array, covariance: Array) -> CalibrationErrors:
    """Return the errors of the parameters that the platform file contains, in its units."""
    parameters = (*errors.parameters, *errors.unfitted)
    all_steps = np.concatenate([steps, np.zeros(len(errors.unfitted))])
    listed = [i for i, parameter in enumerate(parameters) if parameter is not TREND]
    return errors_in_units(
        errors.platform, [parameters[i] for i in listed], all_steps[listed], covariance[np.ix_(listed, listed)]
    )


# Trim in pitch, buoyancy and drag alone: the start of the rounds over the profiles

TRIM = (
    "buoyancy.neutral_volume", "buoyancy.depth_slope", "buoyancy.compressibility", "viscous.K_D0", "position.hull.2",
    "position.battery",
)  # fmt: skip
"""Buoyancy, drag and trim in pitch, which decide whether the filter can follow the records at all."""


def fit_trim(
    platform: Platform,
    segments: SteadySegments,
    settings: CalibrationSettings,
    report: Callable[[str], None] = lambda _: None,
) -> Platform:
    """Fit the buoyancy, the drag and the trim in pitch to the steady glides, with plausible deviations as a prior.

    The result is the start of the rounds over the profiles. With these few numbers near the truth, the filter can
    follow the records. The other numbers, mainly lift and lateral terms, are left unchanged: in steady flight they have
    the same effect as an offset of the pitch or the roll, and a fit without these offsets would take them far from the
    truth.

    Parameters
    ----------
    platform : Platform
        The hull to start from.
    segments : SteadySegments
        Segments to fit.
    settings : CalibrationSettings
        Settings of the calibration; parameters that they hold stay unchanged.
    report : callable
        Called with a line of text at every step.

    Returns
    -------
    Platform
        Fitted hull; the hull given if the fitted one has no stable glide.

    Raises
    ------
    InputError
        Fewer profiles than `MIN_PROFILES`.
    """
    check_profiles(segments)
    candidates = steady_parameters(platform, segments)
    keys = [p.key for p in candidates]
    free = np.isin(keys, TRIM) & ~np.isin(keys, keys_of(settings.hold, (*candidates, *hull_parameters(platform))))
    errors = SegmentErrors(platform, candidates, segments)
    search = CalibrationSearch(errors, free, settings.undetermined, report)
    search.steps = best_start(start_subset(errors), free, report)
    search.fit_everything(RESCALINGS, DEFAULT_TOLERANCE)
    return errors.hull(search.steps) if is_stable(errors, search) else platform
