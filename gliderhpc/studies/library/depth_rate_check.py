"""Comparison of a mission's hull with the depth rate of its steady glides, which reveals vertical motion of the water.

In the smoother's model the water acts on a glider by forces. Water that moves vertically also carries it, which is not
a force. The smoother explains some of this motion by a hull with less drag and lift, which forces move more, and it
does so in every profile. The mean depth rate of steady glides contradicts such a hull: over many glides, the water's
motion averages out. Where the two disagree, the profiles' information is divided by a number that makes them agree.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from gliderhpc.archive.profile import RecordedProfile, read_recorded_profiles
from gliderhpc.archive.reader import Archive
from gliderhpc.distributions import chi_square_quantile
from gliderhpc.estimation.preparation import model_controls
from gliderhpc.estimation.smoother.vertical_motion import MIN_DEPTH
from gliderhpc.estimation.steady_balance import MeasuredAttitude
from gliderhpc.estimation.still_water_glide import StillWaterGlide, still_water_glide
from gliderhpc.flight.glider import Glider
from gliderhpc.flight.hull_parameters import HullParameter, moved_platform
from gliderhpc.mission_hull.estimate import MIN_COMPARED, MissionHull, ProfileTerm, solve_mission
from gliderhpc.mission_hull.gaussian_chain import Gaussian
from gliderhpc.platform import Platform
from gliderhpc.studies.archived import CONTROLS_SI
from gliderhpc.studies.library.vertical_velocity import (
    KEYS,
    depth_rate_filter,
    undisturbed,
)

Array = NDArray[np.float64]

MAX_PROFILES = 24
"""Largest number of profiles that are compared, evenly distributed over the mission."""

MODEL_ERROR = 0.002
"""Standard deviation of the mean depth rate of the still-water glide due to its simplifications, m/s; about 0.001 on
twins of a known hull."""

MOVING = 0.005
"""Vertical motion (m/s) above which it is reported: the accuracy that users require of vertical velocities."""

_PITCH = ("sensors.pitch_offset", "sensors.pitch_scale")
_SAMPLES = 120
"""Largest number of samples of a profile that are compared."""
_DIFFERENCE = 0.05
"""Difference, in plausible deviations, of the derivatives."""
_PROBABILITY = 0.99
"""Probability of the quantile of chi-square above which the hull contradicts the depth rates."""
_LEGS = 2
"""Number of means that are compared, and expectation of their chi-square."""
_MIN_FACTOR = 1.4
"""Smallest factor between two divisors that are tried."""
_ROUNDS = 20
"""Largest number of divisors that are tried."""


@dataclass(frozen=True, eq=False)
class GlideSamples:
    """Samples of steady glides with their depth rate.

    Attributes
    ----------
    profile : (n,) of int
        Index of the profile of each sample.
    climbing : (n,) of bool
        Mask of the samples with a negative depth rate.
    attitude : MeasuredAttitude
        Roll, pitch, rate of turn and depth.
    actuators, water : (n, 4), (n, 4) or None
        Controls in SI units, and depth with the water's density, temperature and pressure where the buoyancy used them.
    depth_rate : (n,)
        Measured depth rate, m/s.
    """

    profile: NDArray[np.int64]
    climbing: NDArray[np.bool_]
    attitude: MeasuredAttitude
    actuators: Array
    water: Array | None
    depth_rate: Array


@dataclass(frozen=True, eq=False)
class HullGlides:
    """Glides of a hull in still water at one value of its errors, from which those of similar errors are found.

    Attributes
    ----------
    at : StillWaterGlide
        The glides.
    slopes : (n, k)
        Derivatives of their depth rates with respect to the chosen parameters.
    """

    at: StillWaterGlide
    slopes: Array


@dataclass(frozen=True)
class DepthRateCheck:
    """Comparison of a hull with the depth rates of steady glides.

    Attributes
    ----------
    motion : float
        Root mean square of the depth rate within a leg that errors of the hull do not explain, m/s.
    dive, climb : float
        Mean depth rate of the hull minus the measured one, on dives and climbs, m/s.
    dive_std, climb_std : float
        Their standard deviations, from the hull's covariance and from the scatter of the profiles.
    chi_square : float
        Chi-square of the two means.
    divisor : float
        Number by which the information of all profiles is divided.
    """

    motion: float
    dive: float
    climb: float
    dive_std: float
    climb_std: float
    chi_square: float
    divisor: float = 1.0

    @property
    def contradicts(self) -> bool:
        """Return whether the depth rates contradict the hull.

        Where the depth rate also varies within the legs by more than the hull explains, a chi-square beyond its
        expectation is enough; elsewhere it must exceed its 99 % quantile.
        """
        return bool(self.chi_square > (_LEGS if self.motion > MOVING else chi_square_quantile(_PROBABILITY, _LEGS)))

    @property
    def warning(self) -> str:
        """Sentence for the reader, empty if there is nothing to warn of."""
        within = f"{100.0 * self.motion:.1f} cm/s within a dive or climb (root mean square)"
        if self.contradicts:
            return (
                "the values of the hull that the profiles gave contradict the depth rate of the steady glides by "
                f"{_cm(self.dive, self.dive_std)} on dives and {_cm(self.climb, self.climb_std)} on climbs, as where "
                "water moves vertically or its density is not that of the model; the depth rate varies by "
                f"{within} more than the hull explains; the profiles' information was divided by {self.divisor:.0f}, "
                "which widens the intervals until the two agree; do not use these values for ballasting or trim"
            )
        if self.motion > MOVING:
            return (
                "the water moves vertically, or its density is not that of the model: the depth rate varies by "
                f"{within} more than the hull explains; such motion may shift drag and lift in every profile alike, "
                "although the mean depth rate does not contradict the values"
            )
        return ""


def _cm(mean: float, std: float) -> str:
    return f"{100.0 * mean:+.1f} ± {100.0 * std:.1f} cm/s"


def read_glides(archive: Archive, numbers: Sequence[int], platform: Platform) -> GlideSamples | None:
    """Read the steady glides of at most `MAX_PROFILES` profiles; None if too few have them on dive and climb."""
    chosen = np.linspace(0, len(numbers) - 1, min(MAX_PROFILES, len(numbers))).round().astype(int).tolist()
    profiles = read_recorded_profiles(archive, [numbers[i] for i in chosen])
    sampled = [_samples(profile, i) for profile, i in zip(profiles, chosen, strict=True)]
    parts = [part for part in sampled if part is not None]
    if len(parts) < MIN_COMPARED or len({part.water is None for part in parts}) > 1:
        return None
    samples = _joined(parts)
    glides = _part(samples, np.isfinite(_glide(samples, platform, 0.0, 1.0).depth_rate))
    complete = [index for index in np.unique(glides.profile) if _has_both_legs(glides, glides.profile == index)]
    return _part(glides, np.isin(glides.profile, complete)) if len(complete) >= MIN_COMPARED else None


def _has_both_legs(glides: GlideSamples, of_profile: NDArray[np.bool_]) -> bool:
    return of_profile.sum() > _LEGS and len(np.unique(glides.climbing[of_profile])) == _LEGS


def _joined(parts: Sequence[GlideSamples]) -> GlideSamples:
    columns = ("roll", "pitch", "turn_rate", "depth")
    attitude = MeasuredAttitude(*(np.concatenate([getattr(part.attitude, name) for part in parts]) for name in columns))
    profile, climbing, actuators, rate = (
        np.concatenate([getattr(part, name) for part in parts])
        for name in ("profile", "climbing", "actuators", "depth_rate")
    )
    waters = [part.water for part in parts if part.water is not None]
    return GlideSamples(profile, climbing, attitude, actuators, np.concatenate(waters) if waters else None, rate)


def _samples(data: RecordedProfile, index: int) -> GlideSamples | None:
    """Samples of one profile that may be steady glides; None if it has hardly any."""
    record = np.flatnonzero(data.sampled & np.isfinite(data.measured).all(axis=1))
    if len(record) < _SAMPLES // 10:
        return None
    time, measured = data.record_time[record], data.measured[record]
    usable = undisturbed(data)[record] & (measured[:, 3] > MIN_DEPTH)
    rate = depth_rate_filter(time, usable).slopes(measured[:, 3])
    turn_rate = np.radians(
        depth_rate_filter(time, np.ones(len(record), np.bool_)).with_truncated_windows(measured[:, 2])
    )
    known = np.flatnonzero(np.isfinite(rate))
    taken = known[np.unique(np.linspace(0, max(len(known) - 1, 0), min(_SAMPLES, len(known))).round().astype(int))]
    roll, pitch = np.radians(measured[taken, :2].T)
    water = None if data.seawater is None else np.column_stack([measured[:, 3], data.seawater[record]])[taken]
    attitude = MeasuredAttitude(roll, pitch, turn_rate[taken], measured[taken, 3])
    return GlideSamples(
        np.full(len(taken), index), rate[taken] < 0.0, attitude,
        data.controls[record[taken]] * CONTROLS_SI, water, rate[taken],
    )  # fmt: skip


def _part(samples: GlideSamples, mask: NDArray[np.bool_]) -> GlideSamples:
    return GlideSamples(
        samples.profile[mask], samples.climbing[mask], samples.attitude.select(mask), samples.actuators[mask],
        None if samples.water is None else samples.water[mask], samples.depth_rate[mask],
    )  # fmt: skip


def _glide(
    samples: GlideSamples, platform: Platform, pitch_offset: float, pitch_scale: float,
    near: StillWaterGlide | None = None,
) -> StillWaterGlide:  # fmt: skip
    """Glide of a hull in still water, at the pitch without an offset (rad) and scale; found from a similar glide."""
    glider, old = Glider(platform), samples.attitude
    bodies = glider.bodies(model_controls(platform, samples.actuators, samples.water))
    pitch = pitch_scale * (old.pitch - pitch_offset)
    return still_water_glide(glider, bodies, MeasuredAttitude(old.roll, pitch, old.turn_rate, old.depth), near)


def _chosen(parameters: Sequence[HullParameter]) -> list[int]:
    """Parameters on which the depth rate depends."""
    return [i for i, p in enumerate(parameters) if p.key in (*KEYS, *_PITCH)]


def _hull_glide(
    samples: GlideSamples, platform: Platform, parameters: Sequence[HullParameter], eta: Array,
    near: StillWaterGlide | None = None,
) -> StillWaterGlide:  # fmt: skip
    """Glide in still water of a hull with errors ``(k,)`` in the chosen parameters; found from a similar glide."""
    moved = np.zeros(len(parameters))
    moved[_chosen(parameters)] = eta
    hull = moved_platform(platform, parameters, moved)
    old, new = platform.sensors, hull.sensors
    offset = np.radians(new.pitch_offset - old.pitch_offset)
    return _glide(samples, hull, float(offset), new.pitch_scale / old.pitch_scale, near)


def glides_of(
    samples: GlideSamples, platform: Platform, parameters: Sequence[HullParameter], mean: Array
) -> HullGlides:
    """Glides of a hull with the given errors ``(p,)``, and the derivatives of their depth rates."""
    eta = mean[_chosen(parameters)]
    at = _hull_glide(samples, platform, parameters, eta)
    columns = [
        _hull_glide(samples, platform, parameters, eta + step, at).depth_rate
        - _hull_glide(samples, platform, parameters, eta - step, at).depth_rate
        for step in _DIFFERENCE * np.eye(len(eta))
    ]
    return HullGlides(at, np.column_stack(columns) / (2.0 * _DIFFERENCE))


def compare(
    samples: GlideSamples,
    platform: Platform,
    parameters: Sequence[HullParameter],
    hull: MissionHull,
    near: HullGlides | None = None,
) -> DepthRateCheck | None:
    """Compare the hull of a mission with the depth rates of its steady glides; None if too few profiles have them.

    ``near`` are the glides of a similar hull, whose derivatives are taken; by default those at the mean of ``hull``.

    Notes
    -----
    The mean residuals of dives and climbs have the covariance ``J C J' + S / n + s^2 1``: the hull's covariance through
    the derivatives of the means, the scatter of the residuals between ``n`` profiles, and `MODEL_ERROR`. The motion
    within a leg is the residual of a fit of the errors, with their prior, to the deviations from the legs' means.
    """
    chosen = _chosen(parameters)
    errors: Gaussian = hull.overall
    if near is None:
        near = glides_of(samples, platform, parameters, errors.mean)
    slopes = near.slopes
    at_mean = _hull_glide(samples, platform, parameters, errors.mean[chosen], near.at).depth_rate - samples.depth_rate
    known = np.isfinite(at_mean + slopes.sum(axis=1))
    legs = [
        [known & (samples.profile == index) & (samples.climbing == up) for up in (False, True)]
        for index in np.unique(samples.profile)
    ]
    legs = [pair for pair in legs if all(leg.any() for leg in pair)]
    if len(legs) < MIN_COMPARED:
        return None
    means = np.array([[at_mean[leg].mean() for leg in pair] for pair in legs])
    by_hull = np.mean([[slopes[leg].mean(axis=0) for leg in pair] for pair in legs], axis=0)
    covariance = by_hull @ errors.covariance[np.ix_(chosen, chosen)] @ by_hull.T
    covariance += np.cov(means.T) / len(means) + MODEL_ERROR**2 * np.eye(_LEGS)
    dive, climb = means.mean(axis=0).tolist()
    dive_std, climb_std = np.sqrt(np.diag(covariance)).tolist()
    chi_square = float(np.array([dive, climb]) @ np.linalg.solve(covariance, [dive, climb]))
    motion = _motion_within(at_mean, slopes, [leg for pair in legs for leg in pair])
    return DepthRateCheck(motion, dive, climb, dive_std, climb_std, chi_square)


def _motion_within(residual: Array, slopes: Array, legs: Sequence[NDArray[np.bool_]]) -> float:
    """Root mean square of the deviations from the legs' means that no error of the hull explains, m/s."""
    left = np.concatenate([residual[leg] - residual[leg].mean() for leg in legs])
    by_hull = np.concatenate([slopes[leg] - slopes[leg].mean(axis=0) for leg in legs])
    variance = float(np.mean(left**2))
    for _ in range(3):
        matrix = by_hull.T @ by_hull / max(variance, MODEL_ERROR**2) + np.eye(by_hull.shape[1])
        eta = np.linalg.solve(matrix, by_hull.T @ left / max(variance, MODEL_ERROR**2))
        variance = float(np.mean((left - by_hull @ eta) ** 2))
    return float(np.sqrt(variance))


def check_hull(
    samples: GlideSamples,
    platform: Platform,
    parameters: Sequence[HullParameter],
    terms: Sequence[ProfileTerm],
    undivided: MissionHull,
    *,
    robust: bool = True,
) -> DepthRateCheck | None:
    """Compare the sum of the terms with the depth rates of steady glides, and find the divisor if the two disagree.

    ``undivided`` is the sum of their undivided information. If the depth rates contradict it, the divisor of the terms'
    information is the number that brings chi-square to its expectation; otherwise it is one. All other figures are
    those of the undivided information, at whose mean the derivatives are taken.
    """
    with threadpool_limits(limits=1):
        near = glides_of(samples, platform, parameters, undivided.overall.mean)
        first = now = compare(samples, platform, parameters, undivided, near)
        if first is None or not first.contradicts:
            return first
        divisor = undivided.inflation  # Up to it, a divisor only takes its place.
        # Step by step, since a hull that hardly any profile determines may contradict the depth rates again.
        for _ in range(_ROUNDS):
            divisor *= _MIN_FACTOR if now is None else max(now.chi_square / _LEGS, _MIN_FACTOR)
            hull = solve_mission([term.weakened(divisor) for term in terms], undivided.prior, robust=robust)
            now = compare(samples, platform, parameters, hull, near)
            if now is not None and now.chi_square <= _LEGS:
                break
    return replace(first, divisor=divisor)
