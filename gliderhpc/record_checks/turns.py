"""Information of turns on errors of the compass that depend on the heading."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gliderhpc.estimation.least_squares import (
    biweight_stiffness,
    biweights,
    left_out_covariance,
    solve_normal_equations,
)
from gliderhpc.estimation.preparation import vibration_set
from gliderhpc.estimation.resample import harmonics
from gliderhpc.observations import ProfileSeries
from gliderhpc.observations.profiles import stretches
from gliderhpc.platform import Platform

Array = NDArray[np.float64]

STRETCH = 20.0
"""Length of a stretch (s), at least three sample intervals."""

MIN_RATE = np.radians(0.3)
"""Rate of turn (rad/s) above which a stretch is counted as turning."""

MIN_PROFILES = 8
"""Minimum number of profiles for an estimate of the scatter."""

MIN_STRETCHES = 40
MIN_EXPLAINED = 0.8
"""Fraction of the rate's variance that roll and rudder must explain; otherwise the water turns the glider too."""

_PASSES = 3
_MIN_SCALE = 1e-6
_HARMONICS = 4


@dataclass(frozen=True, eq=False)
class TurnInformation:
    """Information on the compass's errors ``A + B sin + C cos + D sin 2 + E cos 2`` of the heading read.

    Attributes
    ----------
    information : (5, 5)
        Inverse covariance, rad-2; it has no information on the constant.
    vector : (5,)
        Information times estimate, rad-1.
    count : int
        Number of stretches of turning flight; zero without any information.
    """

    information: Array
    vector: Array
    count: int


@dataclass(frozen=True, eq=False)
class TurnStretches:
    """Averages over n calm stretches: heading, roll, rudder (rad), rate of turn (rad/s), and a mask of the climbs."""

    profile: NDArray[np.int64]
    heading: Array
    roll: Array
    rudder: Array
    rate: Array
    climbing: NDArray[np.bool_]


def turn_stretches(platform: Platform, series: ProfileSeries) -> TurnStretches:
    """Cut a profile's calm flight into stretches."""
    length = round(max(STRETCH, 3.0 * series.sample_interval) / series.step)
    calm = ~vibration_set(platform, series) & (series.weights > 0.0)
    starts = [s for a, b in stretches(calm) for s in range(a, b - length, length)]
    parts = [series.measurements[start : start + length + 1] for start in starts]
    means = np.reshape([part.mean(axis=0) for part in parts], (len(parts), 4))
    rudder = np.array([series.controls[start : start + length, 3].mean() for start in starts])
    rates = np.reshape([(part[-1] - part[0]) / (length * series.step) for part in parts], (len(parts), 4))
    return TurnStretches(
        np.full(len(parts), series.number), means[:, 2], means[:, 0], rudder, rates[:, 2], rates[:, 3] < 0.0
    )


def turn_information(parts: Sequence[TurnStretches], plausible: float) -> TurnInformation:
    """Combine the information of the turns of some profiles.

    Parameters
    ----------
    parts : sequence of TurnStretches
        Stretches of each profile.
    plausible : float
        Standard deviation of compass errors in general (rad), which limits directions that no turn determines.

    Notes
    -----
    A glider turns by roll and by rudder, and its rate of turn is linear in both, separately in dives and in climbs. A
    compass that reads ``delta(psi)`` too high shows that rate times ``1 + delta'(psi)``. The linear relation and the
    harmonics are fitted together by Gauss-Newton steps, with stretches weighted by Tukey's biweight. The covariance
    comes from leaving out one profile at a time; its inverse is reduced by the factor for few profiles. There is no
    result if roll and rudder do not explain most of the turning, since other causes may depend on the heading.
    """
    nothing = TurnInformation(np.zeros((5, 5)), np.zeros(5), 0)
    profile = np.concatenate([part.profile for part in parts]) if parts else np.zeros(0, dtype=np.int64)
    if len(np.unique(profile)) < MIN_PROFILES:
        return nothing
    names = ("heading", "roll", "rudder", "rate")
    heading, roll, rudder, rate = (np.concatenate([getattr(part, name) for part in parts]) for name in names)
    climbing = np.concatenate([part.climbing for part in parts])
    turning = int(np.count_nonzero(np.abs(rate) > MIN_RATE))
    if turning < MIN_STRETCHES:
        return nothing
    phases = [climbing, ~climbing]
    line = np.column_stack([phase * column for phase in phases for column in (np.ones(len(roll)), roll, rudder)])
    line = line[:, np.abs(line).sum(axis=0) > 0.0]
    slopes = _slopes(heading)
    coefficients, deviation = np.linalg.lstsq(line, rate, rcond=None)[0], np.zeros(_HARMONICS)
    if np.var(rate - line @ coefficients) > (1.0 - MIN_EXPLAINED) * np.var(rate):
        return nothing
    for _ in range(_PASSES):
        design = np.column_stack([line * (1.0 + slopes @ deviation)[:, None], slopes * (line @ coefficients)[:, None]])
        residual = rate - (line @ coefficients) * (1.0 + slopes @ deviation)
        weights = biweights(residual, _MIN_SCALE)
        prior = np.append(np.zeros(line.shape[1]), np.full(_HARMONICS, plausible**-2.0))
        score = design.T @ (weights * residual) - prior * np.append(coefficients, deviation)
        step = solve_normal_equations(design.T @ (weights[:, None] * design) + np.diag(prior), score)
        coefficients = coefficients + step[: line.shape[1]]
        deviation = deviation + step[line.shape[1] :]
    stiffness = biweight_stiffness(residual, _MIN_SCALE)
    covariance = left_out_covariance(design, weights, residual, profile, prior, stiffness)
    covariance = covariance[line.shape[1] :, line.shape[1] :]
    information, factor = np.zeros((5, 5)), _hartlap_factor(len(np.unique(profile)))
    information[1:, 1:] = factor * _without_prior(covariance, plausible)
    # The prior shifts the estimate towards zero; the information vector must not contain this effect.
    vector = np.append(0.0, factor * np.linalg.solve(covariance, deviation))
    return TurnInformation(information, vector, turning)


def _hartlap_factor(profiles: int) -> float:
    """Factor on the inverse of a covariance estimated from few profiles that makes it unbiased (Hartlap 2007)."""
    return (profiles - _HARMONICS - 2) / (profiles - 1)


def _without_prior(covariance: Array, plausible: float) -> Array:
    """Information that the turns add to the prior; zero in directions that only the prior determines."""
    values, vectors = np.linalg.eigh(np.linalg.inv(covariance))
    return np.asarray((vectors * np.maximum(values - plausible**-2.0, 0.0)) @ vectors.T)


def _slopes(heading: Array) -> Array:
    """Derivatives ``(n, 4)`` of `harmonics` by the heading."""
    sine, cosine, sine2, cosine2 = harmonics(heading).T
    return np.column_stack([cosine, -sine, 2.0 * cosine2, -2.0 * sine2])
