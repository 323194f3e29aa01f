"""Offset and scale of the pitch from the depth rates of steady dives and steady climbs."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gliderhpc.distributions import student_quantile
from gliderhpc.estimation.settings import RecordSettings
from gliderhpc.estimation.steady_segments import SteadySegments
from gliderhpc.platform import Platform
from gliderhpc.record_checks.depth_rate import (
    NEUTRAL_VOLUME,
    OFFSET,
    SCALE,
    DepthRateFit,
    Unknown,
    fit_depth_rates,
    hull_unknowns,
)
from gliderhpc.record_checks.finding import (
    CheckSettings,
    CheckVerdict,
    Finding,
    UndeterminedError,
    judge_size,
    undetermined,
    undetermined_if_insensitive,
)

CHECK, UNIT = "dive against climb", "degree"
PITCH, GAIN, VOLUME = "offset of the pitch", "scale of the pitch less one", "offset of the neutral volume"

MIN_PROFILES = 3

SEPARATED = np.radians(1.0)
"""Standard error (rad) beyond which the pitch offset is indistinguishable from errors of hull and water."""

MAX_UNDETECTED_OFFSET = 2.0
"""Threshold (degree) beyond which an offset of the pitch that is not found is not ruled out either."""

SCALE_SEPARATED = 0.05
"""Standard error beyond which the scale of the pitch is not determined."""

MAX_SEGMENTS = 60
"""Maximum number of segments of a dive or climb, spread over it; more would not reduce their common error."""

_ANY_SIDES = 0.25
"""Relative difference of the drag between dives and climbs that must be allowed for before any correction."""
_SCALE_ERROR = 0.05
"""Standard deviation of the pitch's scale while the offset is estimated."""
_FREE_SCALE = 0.3
"""Standard deviation of the pitch's scale while the scale is estimated, and its largest threshold of any use."""
_IMPLAUSIBLE = 3.0
"""Largest plausible error of the hull, in prior standard deviations."""
_MIN_VOLUME = 0.05
"""Minimum offset of the neutral volume that is reported, in plausible deviations."""


@dataclass(frozen=True, eq=False)
class _Glides:
    """Steady segments of a hull, form of its buoyancy, settings of the checks, and corrections already made."""

    platform: Platform
    segments: SteadySegments
    by_density: bool
    checks: CheckSettings
    records: RecordSettings

    def fitted(self, sides: float, scale: float) -> DepthRateFit:
        """Fit with prior deviations `sides` of the drag between dives and climbs and `scale` of the pitch's scale.

        Raises
        ------
        UndeterminedError
            The fit does not converge, or gives an implausible hull.
        """
        hull = hull_unknowns(self.platform, self.checks.coefficient_error, sides, by_density=self.by_density)
        sensor = [Unknown(OFFSET, np.radians(1.0), limited=False), Unknown(SCALE, scale)]
        fit = fit_depth_rates(self.platform, self.segments, [*sensor, *hull], by_density=self.by_density)
        if beyond := fit.implausible(_IMPLAUSIBLE):
            raise UndeterminedError(f"an implausible {', '.join(beyond)} would be needed; calibrate the hull")
        return fit

    def threshold(self, error: float, least: float, blocks: int) -> float:
        """Size above which an estimate with the standard error `error` is reported as found."""
        return max(student_quantile(1.0 - 0.5 * self.checks.level, blocks - 1) * error, least)

    def offset(self, fit: DepthRateFit) -> tuple[float, float, float]:
        """Offset, its standard error and its threshold, degree."""
        offset, error = np.degrees(fit.value(OFFSET)), np.degrees(fit.error(OFFSET))
        return offset, error, self.threshold(error, self.checks.least_pitch, fit.blocks)

    def offset_correction(self, offset: float) -> str:
        """Setting that removes an offset (degree), including the correction already made."""
        total = self.records.pitch_offset + offset / self.records.pitch_scale
        return self._correction(f"`records.pitch_offset={total:.2f}`")

    def scale_correction(self, scale: float) -> str:
        """Setting that removes an error of the scale, including the correction already made."""
        return self._correction(f"`records.pitch_scale={self.records.pitch_scale * scale:.3f}`")

    def _correction(self, setting: str) -> str:
        """Return the setting for a calibrated hull only; any other hull may be as wrong as the sensor."""
        return setting if self.platform.calibration is not None else "calibrate the hull, then inspect again"


def pitch_findings(
    platform: Platform, segments: SteadySegments | None, checks: CheckSettings, records: RecordSettings | None = None
) -> list[Finding]:
    """Estimate the offset and the scale of the pitch.

    Parameters
    ----------
    platform : Platform
        The hull.
    segments : SteadySegments, optional
        Steady flight of some profiles; None if there is none.
    checks : CheckSettings
        Settings of the checks, with the thresholds of significance.
    records : RecordSettings, optional
        Corrections already made to the segments' records.

    Notes
    -----
    If pitch is read too high, dives are faster than predicted and climbs slower. A hull heavier than assumed, a larger
    drag in climbs than in dives, and lighter water at depth have the same effect. These errors depend in different ways
    on the buoyancy, of which the depth rate is a square root, and on the cotangent of the path: only glides of
    different buoyancy and different steepness separate them. All are fitted together. Drag, lift, induced drag and the
    gain in buoyancy of water or hull have priors with plausible errors.

    Two fits decide. In the first, drag may differ between dives and climbs by as much as on a fouled hull. An offset
    that is significant there, and known to `SEPARATED`, is found. In the second, dives and climbs have nearly the same
    drag. An offset that is significant only in this fit is not determined; neither is an insignificant one with a
    threshold beyond `MAX_UNDETECTED_OFFSET`. The size reported is that of the second fit. If an error of the scale is
    found, the offset is taken from the fit that found it. A correction is suggested for a calibrated hull only.
    """
    try:
        glides = _glides(platform, segments, checks, RecordSettings() if records is None else records)
    except UndeterminedError as why:
        return [undetermined(CHECK, PITCH, UNIT, str(why)), undetermined(CHECK, GAIN, "1", str(why))]
    gain, scaled = _gain_finding(glides)
    if scaled is not None:
        return [_offset_with_free_drag(glides, scaled), gain]
    return [*_offset_findings(glides), gain]


def _glides(
    platform: Platform, segments: SteadySegments | None, checks: CheckSettings, records: RecordSettings
) -> _Glides:
    """Choose the segments to use; raise an error with the reason if there are none."""
    too_few = f"fewer than {MIN_PROFILES} profiles with steady straight flight"
    if segments is None:
        raise UndeterminedError(too_few)
    usable, by_density = segments.select(segments.straight), platform.buoyancy.compressibility is not None
    if by_density:
        known = usable.in_known_water
        if len(usable) and not known.any():
            raise UndeterminedError("the hull uses measured density, but the density in these profiles is not known")
        usable = usable.select(known)
    if len(np.unique(usable.profile)) < MIN_PROFILES:
        raise UndeterminedError(too_few)
    for side in (usable.depth_rate > 0.0, usable.depth_rate <= 0.0):
        if len(np.unique(usable.profile[side])) < MIN_PROFILES:
            raise UndeterminedError("steady dives or steady climbs are missing")
    return _Glides(platform, usable.select(_spread(usable)), by_density, checks, records)


def _spread(segments: SteadySegments) -> NDArray[np.bool_]:
    """At most `MAX_SEGMENTS` of every dive and climb, evenly spread."""
    chosen = np.zeros(len(segments), dtype=bool)
    leg = 2 * segments.profile + (segments.depth_rate > 0.0)
    for number in np.unique(leg):
        places = np.flatnonzero(leg == number)
        count = min(len(places), MAX_SEGMENTS)
        chosen[places[np.linspace(0, len(places) - 1, count).round().astype(int)]] = True
    return chosen


def _gain_finding(glides: _Glides) -> tuple[Finding, DepthRateFit | None]:
    """Finding on the pitch's scale, and the fit that includes it if it is found."""
    try:
        fit = glides.fitted(_ANY_SIDES, _FREE_SCALE)
    except UndeterminedError as why:
        return undetermined(CHECK, GAIN, "1", str(why)), None
    size, error = fit.value(SCALE), fit.error(SCALE)
    if error > SCALE_SEPARATED:
        return undetermined(
            CHECK, GAIN, "1", f"known only to {error:.2g}; more glides that differ more in steepness are needed"
        ), None
    threshold = glides.threshold(error, glides.checks.least_pitch_scale, fit.blocks)
    finding = Finding(
        CHECK,
        GAIN,
        "1",
        size,
        error,
        threshold,
        judge_size(size, threshold),
        glides.scale_correction(1.0 + size),
        "drag, lift and neutral volume fitted with it",
    )
    remedy = "more glides that differ more in steepness are needed"
    return undetermined_if_insensitive(finding, _FREE_SCALE, remedy), fit if finding.found else None


def _offset_findings(glides: _Glides) -> list[Finding]:
    try:
        wary, usual = (glides.fitted(sides, _SCALE_ERROR) for sides in (_ANY_SIDES, glides.checks.drag_difference))
    except UndeterminedError as why:
        return [undetermined(CHECK, PITCH, UNIT, str(why))]
    finding = (
        _offset_with_free_drag(glides, usual)
        if _offset_with_free_drag(glides, wary).found
        else _offset_with_equal_drag(glides, usual)
    )
    return [finding] if finding.verdict is CheckVerdict.UNDETERMINED else [finding, _volume_finding(glides, usual)]


def _offset_with_free_drag(glides: _Glides, fit: DepthRateFit) -> Finding:
    """Finding on the offset from a fit of all errors that act like it; not determined unless known to `SEPARATED`."""
    if fit.error(OFFSET) > SEPARATED:
        return _describe_uncertainty(fit)
    offset, error, threshold = glides.offset(fit)
    finding = Finding(
        CHECK,
        PITCH,
        UNIT,
        offset,
        error,
        threshold,
        judge_size(offset, threshold),
        glides.offset_correction(offset),
        "drag of dives and of climbs, lift and neutral volume fitted with it",
    )
    return undetermined_if_insensitive(finding, MAX_UNDETECTED_OFFSET, "more glides are needed")


def _offset_with_equal_drag(glides: _Glides, fit: DepthRateFit) -> Finding:
    """Finding on the offset if drag hardly differs between dives and climbs: nothing found, or not determined."""
    offset, error, threshold = glides.offset(fit)
    if abs(offset) <= threshold and threshold > MAX_UNDETECTED_OFFSET:
        return _describe_uncertainty(fit)
    if abs(offset) > threshold:
        return undetermined(
            CHECK,
            PITCH,
            UNIT,
            f"{offset:+.1f} +- {error:.1f} degree would explain these glides, and so would a drag "
            "that differs between dives and climbs; more glides, or glides that differ more in steepness, "
            "are needed to decide which",
        )
    return Finding(
        CHECK,
        PITCH,
        UNIT,
        offset,
        error,
        threshold,
        CheckVerdict.NOTHING,
        remark=f"drag assumed to differ by about {2.0 * glides.checks.drag_difference:.0%} at most between dives and "
        "climbs, neutral volume fitted with it",
    )


def _describe_uncertainty(fit: DepthRateFit) -> Finding:
    error = np.degrees(fit.error(OFFSET))
    why = (
        f"known only to {error:.1f} degree; more glides, or glides that differ more in steepness or ballast, are needed"
    )
    return undetermined(CHECK, PITCH, UNIT, why)


def _volume_finding(glides: _Glides, fit: DepthRateFit) -> Finding:
    volume, error = fit.value(NEUTRAL_VOLUME), fit.error(NEUTRAL_VOLUME)
    threshold = glides.threshold(error, _MIN_VOLUME * fit.size(NEUTRAL_VOLUME), fit.blocks)
    finding = Finding(
        CHECK,
        VOLUME,
        "cm3",
        volume,
        error,
        threshold,
        judge_size(volume, threshold),
        "calibrate the hull",
        "belongs to the hull, not to the records",
    )
    return undetermined_if_insensitive(finding, fit.size(NEUTRAL_VOLUME), "more glides are needed")
