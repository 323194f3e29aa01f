"""Segments of steady flight in a mission's records, each averaged to one point of the balance."""

import itertools
import logging
from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from gliderhpc.errors import InputError, ProfileError
from gliderhpc.estimation.preparation import vibration_set
from gliderhpc.estimation.relative_velocity import RelativeVelocity, measured_velocity
from gliderhpc.estimation.resample import on_steps
from gliderhpc.estimation.self_motion import angle_of_attack
from gliderhpc.estimation.settings import EstimationSettings, Settings
from gliderhpc.estimation.steady_balance import SteadyMotion
from gliderhpc.flight.hull_parameters import hull_parameters, moved_platform
from gliderhpc.flight.steady_glide import least_glide_angle
from gliderhpc.observations import Observations, ProfileSeries
from gliderhpc.observations.nearest import nearest_rows
from gliderhpc.observations.profiles import stretches
from gliderhpc.observations.times import SECOND
from gliderhpc.platform import Platform
from gliderhpc.wording import counted, most_frequent_reason

log = logging.getLogger("gliderhpc.calibrate")

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_HALVES = 2


class SegmentSettings(Settings):
    """Criteria of steady flight."""

    length: float = Field(60.0, gt=0, description="length of a segment, s; at least six sample intervals")
    shortest: float = Field(20.0, gt=0, description="shortest segment, s; at least three sample intervals")
    settling: float = Field(20.0, ge=0, description="time after the vibration set that is left out, s")
    least_depth: float = Field(5.0, ge=0, description="shallower samples are left out, m")
    least_depth_rate: float = Field(0.03, gt=0, description="slower vertical motion counts as stalled, m/s")
    pitch_change: float = Field(2.0, gt=0, description="change of pitch beyond which a segment is not steady, degree")
    rate_change: float = Field(
        0.25, gt=0, description="relative change of the depth rate beyond which a segment is not steady"
    )
    least_pitch: float = Field(8.0, ge=0, description="smallest magnitude of the pitch in a glide, degree")
    steepness: float = Field(
        1.05,
        ge=1,
        description="smallest ratio of the path's angle (pitch less angle of attack) to the hull's minimum glide angle",
    )
    straight: float = Field(0.3, gt=0, description="rate of turn below which flight counts as straight, degree/s")


@dataclass(frozen=True, eq=False)
class SteadySegments:
    """Averages over n segments.

    Attributes
    ----------
    profile : (n,) int array
        Number of the profile.
    time : (n,) datetime64 array
        Middle of the segment (UTC).
    actuators : (n, 4)
        Battery position (m), battery rotation (rad), oil volume (m3), rudder (rad).
    roll, pitch, turn_rate, depth, depth_rate : (n,)
        Measurements as in `SteadyMotion`.
    straight : (n,) of bool
        Mask of the segments in straight flight.
    seawater : (n, 4)
        Depth (m), in-situ density (kg/m3) and temperature (degC) and pressure (dbar); NaN where they are not known.
    velocity : (n, 3)
        Measured velocity relative to the water in the body frame (m/s); NaN where it is not known.
    without_seawater : (n,) array of str
        Reason why the seawater is not known; empty where it is, and where the settings do not use it.
    """

    profile: NDArray[np.int64]
    time: NDArray[np.datetime64]
    actuators: Array
    roll: Array
    pitch: Array
    turn_rate: Array
    depth: Array
    depth_rate: Array
    straight: Mask
    seawater: Array
    velocity: Array
    without_seawater: NDArray[np.str_]

    def __len__(self) -> int:
        return len(self.profile)

    @property
    def motion(self) -> SteadyMotion:
        """Measurements that the balance is compared with."""
        return SteadyMotion(self.roll, self.pitch, self.turn_rate, self.depth, self.depth_rate)

    @property
    def in_known_water(self) -> Mask:
        """Mask (n,) of the segments with a known density."""
        return np.asarray(np.isfinite(self.seawater).all(axis=1))

    def empty(self) -> "SteadySegments":
        """Return an empty selection of the segments."""
        return self.select(np.zeros(len(self), dtype=bool))

    def select(self, chosen: Mask) -> "SteadySegments":
        """Return the chosen segments."""
        return SteadySegments(**{field.name: getattr(self, field.name)[chosen] for field in fields(self)})

    def shared_with(self, other: "SteadySegments", seconds: float) -> "SteadySegments":
        """Return the segments whose middle is within `seconds` of that of one of the other's, in the same profile."""
        shared = np.zeros(len(self), dtype=bool)
        for number in np.intersect1d(self.profile, other.profile).tolist():
            rows, other_times = self.profile == number, np.sort(other.time[other.profile == number])
            times = self.time[rows]
            distance = np.abs(times - other_times[nearest_rows(other_times, times)]) / SECOND
            shared[rows] = distance <= seconds
        return self.select(shared)


def steady_segments(
    observations: Observations,
    platform: Platform,
    numbers: Sequence[int],
    settings: EstimationSettings,
    steady: SegmentSettings,
    *,
    allow_flatter: bool = False,
) -> SteadySegments:
    """Find and average the steady segments of some profiles; one without any is left out with a warning in the log.

    Parameters
    ----------
    observations, platform : Observations, Platform
        Open file, and hull, which determines the vibration set and the minimum glide angle.
    numbers : sequence of int
        Profiles to read.
    settings, steady : EstimationSettings, SegmentSettings
        Settings of the records' preparation, and criteria of steady flight.
    allow_flatter : bool
        Whether the segments are selected with more lift and less drag if the platform gives none, or none on dives or
        on climbs. A hull that cannot glide as flat as the records show gives none, and that is the very error that a
        calibration has to correct; fitted to dives alone, a hull may be far off on climbs.

    Raises
    ------
    InputError
        No profile has a steady segment.
    """
    segments, reasons = _segments_of_all(observations, platform, numbers, settings, steady)
    if allow_flatter and (missing := _phases_without(segments)):
        parameters = [p for p in hull_parameters(platform) if p.key in _FLATTER]
        hull = moved_platform(platform, parameters, np.array([_FLATTER[p.key] for p in parameters]))
        flatter, other_reasons = _segments_of_all(observations, hull, numbers, settings, steady)
        if len(_phases_without(flatter)) < len(missing):
            segments, reasons = flatter, other_reasons
            phase = "" if len(missing) > 1 else f" on {missing[0]}"
            log.warning(
                "%s finds no steady flight%s; segments are selected with more lift and less drag", platform.name, phase
            )
    for number, reason in reasons.items():
        log.warning("profile %d is left out: %s", number, reason)
    if allow_flatter and segments and (missing := _phases_without(segments)):
        log.warning("no steady flight on %s: a hull fitted to the rest may be badly wrong there", missing[0])
    if not segments:
        reason = most_frequent_reason(reasons.values() or ["no profile was selected"])
        raise InputError(f"{observations.path}: no steady flight to calibrate on; {reason}")
    return join_segments(segments)


def _phases_without(segments: Sequence[SteadySegments]) -> tuple[str, ...]:
    """Return the names of the phases of flight without any segment."""
    rates = np.concatenate([np.zeros(0), *(each.depth_rate for each in segments)])
    return tuple(name for name, sign in (("dives", 1.0), ("climbs", -1.0)) if not (sign * rates > 0.0).any())


def _segments_of_all(
    observations: Observations,
    platform: Platform,
    numbers: Sequence[int],
    settings: EstimationSettings,
    steady: SegmentSettings,
) -> tuple[list[SteadySegments], dict[int, str]]:
    """Return the segments of every profile that has some, and the reason by number for every other."""
    segments, reasons = [], {}
    for number in numbers:
        try:
            segments.append(segments_of(on_steps(observations.profile(number), settings, platform), platform, steady))
        except ProfileError as error:
            reasons[number] = str(error)
    return segments, reasons


_FLATTER = {"viscous.K_L": 2.0, "viscous.K_D": -2.0, "viscous.K_D0": -2.0}
"""Changes of a hull, in plausible deviations, that make its glide about as flat as is plausible."""


def join_segments(parts: Sequence[SteadySegments]) -> SteadySegments:
    """Concatenate segments."""
    names = [field.name for field in fields(SteadySegments)]
    return SteadySegments(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})


def segments_of(series: ProfileSeries, platform: Platform, steady: SegmentSettings) -> SteadySegments:
    """Average the steady segments of one profile.

    A steady segment lies inside the record, outside the vibration set with time to settle after it, and below the
    surface layer. In it the glider moves vertically, on a path steeper than the hull's minimum glide angle, nose down
    while diving, with nearly constant pitch and depth rate. The path is used rather than the pitch, since a hull of
    little lift glides on a path much steeper than its pitch.

    Raises
    ------
    ProfileError
        The profile has no steady segment.
    """
    vibrating = vibration_set(platform, series)
    usable = _settled_mask(~vibrating, series, steady.settling)
    usable &= (series.weights > 0.0) & (series.measurements[:, 3] > steady.least_depth)
    bounds = _parts(usable, series, steady)
    if not bounds:
        raise ProfileError(f"profile {series.number}: no undisturbed stretch of at least {steady.shortest:g} s")
    velocity = measured_velocity(platform, series, ~vibrating)
    segments = _average(series, bounds, steady, velocity)
    is_steady = _is_steady(series, bounds, segments, platform, steady)
    if not is_steady.any():
        raise ProfileError(f"profile {series.number}: none of {counted(len(segments), 'segment')} is in steady flight")
    return segments.select(is_steady)


def _settled_mask(calm: Mask, series: ProfileSeries, settling: float) -> Mask:
    """Calm samples (n+1,) without the first `settling` seconds of every calm stretch."""
    settled = np.zeros_like(calm)
    for start, stop in stretches(calm):
        settled[start + round(settling / series.step) : stop] = True
    return settled


def _parts(usable: Mask, series: ProfileSeries, steady: SegmentSettings) -> list[tuple[int, int]]:
    """First sample, and the one after the last, of equal parts of about a segment's length."""
    interval = series.sample_interval / series.step
    length = max(steady.length / series.step, 6.0 * interval)
    shortest = max(steady.shortest / series.step, 3.0 * interval)
    parts: list[tuple[int, int]] = []
    for start, stop in stretches(usable):
        if stop - start >= shortest:
            edges = np.linspace(start, stop, max(1, round((stop - start) / length)) + 1).astype(int).tolist()
            parts += itertools.pairwise(edges)
    return parts


def _average(
    series: ProfileSeries, bounds: list[tuple[int, int]], steady: SegmentSettings, velocity: RelativeVelocity | None
) -> SteadySegments:
    means = np.array([series.measurements[a:b].mean(axis=0) for a, b in bounds])
    slopes = np.array([_slope(series.measurements[a:b], series.step) for a, b in bounds])
    middles = np.array([series.time[a:b].mean() for a, b in bounds])
    return SteadySegments(
        profile=np.full(len(bounds), series.number),
        time=series.epoch + (1e9 * middles).astype("timedelta64[ns]"),
        actuators=np.array([series.controls[a:b].mean(axis=0) for a, b in bounds]),
        roll=means[:, 0],
        pitch=means[:, 1],
        turn_rate=slopes[:, 2],
        depth=means[:, 3],
        depth_rate=slopes[:, 3],
        straight=np.abs(slopes[:, 2]) < np.radians(steady.straight),
        seawater=_mean_seawater(series, bounds),
        velocity=_mean_velocity(velocity, bounds),
        without_seawater=np.full(len(bounds), series.without_seawater),
    )


def _mean_velocity(velocity: RelativeVelocity | None, bounds: list[tuple[int, int]]) -> Array:
    """Means ``(k, 3)`` of the samples of each component in the segments; NaN without any."""
    if velocity is None:
        return np.full((len(bounds), 3), np.nan)
    parts = (velocity.values[a:b] for a, b in bounds)
    known = [(np.isfinite(part).sum(axis=0), np.nansum(part, axis=0)) for part in parts]
    return np.array([np.where(count > 0, total / np.maximum(count, 1), np.nan) for count, total in known])


def _mean_seawater(series: ProfileSeries, bounds: list[tuple[int, int]]) -> Array:
    if series.seawater is None:
        return np.full((len(bounds), 4), np.nan)
    return np.array([series.seawater[a:b].mean(axis=0) for a, b in bounds])


def _slope(values: Array, step: float) -> Array:
    """Slopes (k,), per second, of the straight lines through columns (n, k)."""
    lever = np.arange(len(values)) - 0.5 * (len(values) - 1)
    return np.asarray(lever @ values / (step * np.sum(lever**2)))


def _is_steady(
    series: ProfileSeries,
    bounds: list[tuple[int, int]],
    segments: SteadySegments,
    platform: Platform,
    steady: SegmentSettings,
) -> Mask:
    halves = np.array(
        [
            [_slope(half[:, 1::2], series.step) for half in np.array_split(series.measurements[a:b], _HALVES)]
            for a, b in bounds
        ]
    )
    lengths = np.array([(b - a) * series.step for a, b in bounds])
    pitch_change = np.abs(halves[:, :, 0]).max(axis=1) * lengths / _HALVES
    rate_change = np.abs(np.diff(halves[:, :, 1], axis=1))[:, 0]
    diving = segments.depth_rate > 0.0
    least_angle = np.where(diving, *(least_glide_angle(platform, heavy=heavy) for heavy in (True, False)))
    pitch_towards_path = np.where(diving, -1.0, 1.0) * segments.pitch
    path = np.abs(segments.pitch - angle_of_attack(platform, segments.pitch))
    return np.asarray(
        (np.abs(segments.depth_rate) > steady.least_depth_rate)
        & (pitch_change < np.radians(steady.pitch_change))
        & (rate_change < steady.rate_change * np.abs(segments.depth_rate))
        & (pitch_towards_path > np.radians(steady.least_pitch))
        & (path > steady.steepness * least_angle)
    )
