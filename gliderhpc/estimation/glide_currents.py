"""Currents without a flight model: displacement from the glide angle, drift from the fixes, and the errors of both.

An implausible speed through the water indicates a depth or a time in a wrong unit.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gliderhpc.errors import InputError, ProfileError
from gliderhpc.estimation.current_errors import CurrentErrors
from gliderhpc.estimation.currents import DepthAveragedCurrent, current_from_displacement
from gliderhpc.estimation.record_screening import jointly_sampled, without_false_samples
from gliderhpc.estimation.resample import resample, sampling_intervals
from gliderhpc.estimation.self_motion import SelfMotion, angle_of_attack, depth_rate, glide_angle_motion
from gliderhpc.observations.checks.depth_screening import noise_window, smoothed_depth
from gliderhpc.observations.checks.profile_checks import fault_of_pace
from gliderhpc.observations.checks.sign_checks import fault_of_depth_rate
from gliderhpc.observations.dive_phases import stationary_points
from gliderhpc.observations.fixes import moved
from gliderhpc.observations.intervals import longest_bridged
from gliderhpc.observations.records import Fix, ProfileRecord
from gliderhpc.observations.regions import wrapped_longitude
from gliderhpc.observations.series import ProfileSeries
from gliderhpc.platform import Platform

Array = NDArray[np.float64]

STEP = 5.0
"""Largest interval of the points (s) of a track; it is shortened to end on the last sample."""

_EQUATOR, _ECCENTRICITY = 6_378_137.0, 6.694379990141e-3
"""Semi-major axis (m) and squared eccentricity of WGS84."""


@dataclass(frozen=True)
class GlideErrors:
    """Errors of the records and of the glide, standard deviations.

    Attributes
    ----------
    pitch_offset : float
        Constant error of the pitch, common to dive and climb, rad.
    course : float
        Error of the compass, including the declination, degree.
    vertical : float
        Vertical velocity of the water, averaged over a dive or a climb, m/s.
    bridged : float
        Relative error of the displacement across turns and gaps.
    stationary : float
        Speed through the water of a glider that is parked, on the bottom or under ice, north and east each, m/s.
    fix : float
        Error of a fix, north and east each, m.
    surface_shear : float
        Difference between the drift at the surface and the current below, m/s.
    """

    pitch_offset: float = float(np.radians(0.7))
    course: float = 3.0
    vertical: float = 0.003
    bridged: float = 0.2
    stationary: float = 0.02
    fix: float = 5.0
    surface_shear: float = 0.2

    @property
    def of_current(self) -> CurrentErrors:
        """Terms for the budget of the depth-averaged current."""
        return CurrentErrors(
            axial_error=0.0, relative_error=0.0, heading_error=self.course, fix_error=self.fix,
            surface_shear=self.surface_shear,
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class DisplacementErrors:
    """Errors of a displacement through the water, without that of the course.

    Attributes
    ----------
    common : (k, 2)
        Displacements north and east by errors of one standard deviation that all dives have in common, m.
    independent : (2, 2)
        Covariance by errors that differ from dive to dive, m2.
    """

    common: Array
    independent: Array

    @property
    def covariance(self) -> Array:
        """Covariance ``(2, 2)`` of the displacement, m2."""
        return np.asarray(self.common.T @ self.common + self.independent)

    def __add__(self, other: "DisplacementErrors") -> "DisplacementErrors":
        return DisplacementErrors(self.common + other.common, self.independent + other.independent)


@dataclass(frozen=True, eq=False)
class Origin:
    """Position from which the track of a dive is reckoned.

    Attributes
    ----------
    fix : Fix
        Fix before the dive, or before the first of several.
    displacement : (2,)
        Displacement north and east from the fix to the start of the dive, without that by the current of the dive, m.
    adrift : float
        Time before the start of the dive for which that current acted, s.
    """

    fix: Fix
    displacement: Array
    adrift: float


@dataclass(frozen=True, eq=False)
class GlideTrack:
    """Flight of one profile from the glide angle, on ``n + 1`` points about `STEP` apart.

    Attributes
    ----------
    series : ProfileSeries
        Record at the points.
    motion : SelfMotion
        Displacement through the water.
    angle_of_attack, speed : (n + 1,) arrays
        Angle of attack (rad) and speed (m/s); NaN where the path is flatter than the hull can glide.
    errors : DisplacementErrors
        Errors of the displacement.
    current : DepthAveragedCurrent or None
        Depth-averaged current, of the dive or of several (`dives`); None without fixes before and after.
    fixes : tuple of two Fixes or None
        Fixes before and after the dive, or before the first and after the last of several.
    origin : Origin or None
        Position from which the track is reckoned; None without a current.
    dives : tuple of int
        Numbers of the profiles over which the current is a mean; empty if it is that of this profile alone.
    """

    series: ProfileSeries
    motion: SelfMotion
    angle_of_attack: Array
    speed: Array
    errors: DisplacementErrors
    current: DepthAveragedCurrent | None
    fixes: tuple[Fix | None, Fix | None]
    origin: Origin | None
    dives: tuple[int, ...] = ()


def glide_track(record: ProfileRecord, hulls: tuple[Platform, Platform, Platform], errors: GlideErrors) -> GlideTrack:
    """Reconstruct one profile's flight and its depth-averaged current.

    Parameters
    ----------
    record : ProfileRecord
        Depth, pitch, heading and fixes.
    hulls : tuple of three Platforms
        Hull with the estimated drag and lift, and hulls with more and less drag by one standard deviation.
    errors : GlideErrors
        Errors of the records and of the glide.

    Raises
    ------
    ProfileError
        Depth, pitch and heading have no time in common, or no sample is steep enough for a glide.
    """
    series = on_points(record)
    motion = _motion(hulls[0], series)
    if not np.isfinite(motion.total).all() or motion.masked_fraction >= 1.0:
        raise ProfileError(f"profile {record.number}: no part is steep enough for a glide")
    displaced = _displacement_errors(hulls, series, motion, errors)
    current = current_from_displacement(record, series.time, motion.total, displaced.covariance, errors.of_current)
    entry, origin = record.entry_fix, None
    if current is not None and entry is not None:
        drifting = current.entry.duration - current.entry.drift_removed
        origin = Origin(entry, current.entry.displacement, drifting)
    alpha = angle_of_attack(hulls[0], series.measurements[:, 1])
    with np.errstate(invalid="ignore", divide="ignore"):
        speed = np.abs(depth_rate(series) / np.sin(series.measurements[:, 1] - alpha))
    return GlideTrack(series, motion, alpha, speed, displaced, current, (entry, record.exit_fix), origin)


def on_points(record: ProfileRecord) -> ProfileSeries:
    """Interpolate a record to the points of a track.

    Isolated false samples are left out first, and a noisy depth is smoothed (`noise_window`).

    Raises
    ------
    ProfileError
        Depth, pitch and heading have no time in common.
    """
    record, false_samples = without_false_samples(jointly_sampled(record))
    window = noise_window(record.time, record.depth)
    if window > 0.0:
        record = replace(record, depth=smoothed_depth(record.time, record.depth, window))
    duration = float(record.time[-1])
    step = duration / math.ceil(duration / STEP)
    series = resample(record, step, longest_bridged(sampling_intervals(record)))
    return replace(series, false_samples=false_samples)


def _motion(platform: Platform, series: ProfileSeries, pitch_offset: float = 0.0) -> SelfMotion:
    shifted = series.measurements - np.array([0.0, pitch_offset, 0.0, 0.0])
    return glide_angle_motion(platform, replace(series, measurements=shifted), series.weights == 0.0)


def _displacement_errors(
    hulls: tuple[Platform, Platform, Platform], series: ProfileSeries, motion: SelfMotion, errors: GlideErrors
) -> DisplacementErrors:
    """Errors of the displacement through the water.

    The drag and a constant error of the pitch act on all profiles, and the water's vertical velocity on dive and climb
    separately. The bridged displacement has an error relative to its length, and the displacement in stationary time
    one in proportion to that time. The same applies to time at the surface between two dives, where the drift differs
    from the current below.
    """
    by_drag = 0.5 * (_motion(hulls[1], series).total - _motion(hulls[2], series).total)
    by_pitch = 0.5 * (
        _motion(hulls[0], series, errors.pitch_offset).total - _motion(hulls[0], series, -errors.pitch_offset).total
    )
    covariance = np.zeros((2, 2))
    rate = np.where(stationary_points(series)[:-1], 0.0, np.diff(series.measurements[:, 3]) / series.step)
    for phase in (rate > 0.0, rate < 0.0):
        length, climbed = motion.steps[phase].sum(axis=0), float(np.abs(rate[phase]).sum()) * series.step
        relative = errors.vertical * float(phase.sum()) * series.step / climbed if climbed > 0.0 else 0.0
        covariance += relative**2 * np.outer(length, length)
    in_any_direction = (errors.bridged * motion.bridged) ** 2 + (errors.stationary * motion.stationary) ** 2
    in_any_direction += (errors.surface_shear * motion.floating) ** 2
    return DisplacementErrors(np.array([by_drag, by_pitch]), covariance + in_any_direction * np.eye(2))


def positions(track: GlideTrack) -> tuple[Array, Array]:
    """Latitude and longitude ``(n + 1,)`` under water (degree), from the glide and the current, between the fixes.

    They are NaN if there is no current.
    """
    current, origin = track.current, track.origin
    if current is None or origin is None:
        missing = np.full(len(track.series.time), np.nan)
        return missing, missing.copy()
    displacement = np.concatenate([np.zeros((1, 2)), np.cumsum(track.motion.steps, axis=0)])
    elapsed = track.series.time - track.series.time[0] + origin.adrift
    return _positions_at(origin.fix, origin.displacement + displacement + elapsed[:, None] * current.velocity)


def _positions_at(origin: Fix, displacement: Array) -> tuple[Array, Array]:
    """Positions at displacements ``(m, 2)`` (m, north and east) from a fix, with the ellipsoid's radii half-way."""
    end = moved((origin.latitude, origin.longitude), displacement[-1])
    middle = np.radians(0.5 * (origin.latitude + end[0]))
    stretched = 1.0 - _ECCENTRICITY * np.sin(middle) ** 2
    meridian = _EQUATOR * (1.0 - _ECCENTRICITY) / stretched**1.5
    parallel = _EQUATOR / np.sqrt(stretched) * np.cos(middle)
    latitude = origin.latitude + np.degrees(displacement[:, 0] / meridian)
    longitude = origin.longitude + np.degrees(displacement[:, 1] / parallel)
    return latitude, wrapped_longitude(longitude)


# Speed through the water: an implausible one indicates a depth or a time in a wrong unit

MAX_SPEED = 1.0
"""Speed through the water (m/s) that no glider exceeds over a mission, not even with a thruster."""

USUAL_SPEEDS = (0.1, 0.6)
"""Speeds (m/s) between which that of buoyancy-driven gliders lies; on the real missions tested it is 0.17 to 0.36."""

RATE_INTERVAL = 60.0
"""Time (s) over which the depth rate is taken; over a minute, the noise of the sensor does not matter."""

MIN_RATE = 0.005
"""Vertical speed (m/s) above which a glider moves up or down."""


def check_depth_rate(record: ProfileRecord) -> None:
    """Refuse a profile whose depth changes faster or slower than any glider's.

    Raises
    ------
    ProfileError
        Time or depth is in a wrong unit.
    """
    time = record.instants
    fault = fault_of_pace(record.number, time, record.depth) or fault_of_depth_rate(
        record.number, time, record.depth, np.degrees(record.pitch)
    )
    if fault is not None:
        raise ProfileError(fault)


def check_speed(source: str, tracks: Sequence[GlideTrack]) -> list[str]:
    """Check the usual speed through the water of a mission, and return a remark where it is unusual.

    Raises
    ------
    InputError
        No glider has such a speed: depth, pitch or time is in a wrong unit.
    """
    speed = usual_speed(tracks)
    if np.isnan(speed) or USUAL_SPEEDS[0] <= speed <= USUAL_SPEEDS[1]:
        return []
    text = f"pitch and depth rate give a speed through the water of {speed:.2g} m/s"
    if speed > MAX_SPEED:
        raise InputError(
            f"{source}: {text}, faster than any glider; check the units of depth (or pressure), pitch and time"
        )
    return [f"{text}, which is unusual for a glider: check the units of depth (or pressure), pitch and time"]


def usual_speed(tracks: Sequence[GlideTrack]) -> float:
    """Weighted median of the speed through the water (m/s) by vertical distance, over all profiles; NaN without any.

    Time in which a glider is stationary has no weight.
    """
    parts = [_speeds(track) for track in tracks]
    speed, distance = (np.concatenate([np.zeros(0), *(part[k] for part in parts)]) for k in (0, 1))
    if not len(speed):
        return float("nan")
    order = np.argsort(speed)
    passed = np.cumsum(distance[order])
    return float(speed[order][np.searchsorted(passed, 0.5 * passed[-1])])


def _speeds(track: GlideTrack) -> tuple[Array, Array]:
    """Speeds (m/s) and vertical distances (m) of the minutes of one profile."""
    series = track.series
    points = max(1, round(RATE_INTERVAL / series.step))
    minutes = np.arange(0, len(series.time), points)
    descent = np.diff(series.measurements[minutes, 3])
    path = (series.measurements[:, 1] - track.angle_of_attack)[minutes[:-1] + points // 2]
    with np.errstate(invalid="ignore", divide="ignore"):
        speed = np.abs(descent / (points * series.step * np.sin(path)))
        moving = np.isfinite(speed) & (np.abs(descent) > MIN_RATE * points * series.step)
    # A glider sinks with its nose up only at inflections.
    moving &= np.sign(descent) == -np.sign(path)
    return speed[moving], np.abs(descent[moving])
