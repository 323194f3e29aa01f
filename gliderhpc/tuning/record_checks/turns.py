"""Errors of the compass by turns: its rate compared with the rate that the roll makes, heading by heading."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gliderhpc.estimation.measurements import harmonics, vibration_set
from gliderhpc.observations import ProfileSeries
from gliderhpc.observations.profiles import stretches
from gliderhpc.platform import Platform
from gliderhpc.tuning.least_squares import biweights, left_out_covariance, solved

Array = NDArray[np.float64]

STRETCH = 20.0
"""Length of a stretch (s), at least three sample intervals."""

MIN_RATE = np.radians(0.3)
"""Slower turns (rad/s) say nothing."""

MIN_PROFILES = 5
MIN_STRETCHES = 40
MIN_EXPLAINED = 0.8
"""Part of the variance of the rate that roll and rudder must explain: else the water turns the glider too."""

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
        Stretches of turning flight that it rests on.
    """

    information: Array
    vector: Array
    count: int


@dataclass(frozen=True, eq=False)
class TurnStretches:
    """Averages over n calm stretches: heading, roll, rudder (rad), rate of turn (rad/s), and whether it climbs."""

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
    """Gather what the turns of some profiles say.

    Parameters
    ----------
    parts : sequence of TurnStretches
        A profile each.
    plausible : float
        Standard deviation of errors of compasses at large (rad), which keeps directions that no turn tells in bounds.

    Notes
    -----
    A glider turns as it rolls and by its rudder: on dive and on climb each, the rate is linear in both. A compass
    that reads ``delta(psi)`` too much shows that rate times ``1 + delta'(psi)``. Line and harmonics are fitted in turn,
    stretches weighted by Tukey's biweight; the covariance is by leaving one profile out. Where roll and rudder explain
    less than most of the turning, there is no result: what else turns the glider need not be alike on all headings.
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
    coefficients, found = np.linalg.lstsq(line, rate, rcond=None)[0], np.zeros(_HARMONICS)
    if np.var(rate - line @ coefficients) > (1.0 - MIN_EXPLAINED) * np.var(rate):
        return nothing
    for _ in range(_PASSES):
        design = np.column_stack([line * (1.0 + slopes @ found)[:, None], slopes * (line @ coefficients)[:, None]])
        left = rate - (line @ coefficients) * (1.0 + slopes @ found)
        weights = biweights(left, _MIN_SCALE)
        prior = np.append(np.zeros(line.shape[1]), np.full(_HARMONICS, plausible**-2.0))
        score = design.T @ (weights * left) - prior * np.append(coefficients, found)
        step = solved(design.T @ (weights[:, None] * design) + np.diag(prior), score)
        coefficients = coefficients + step[: line.shape[1]]
        found = found + step[line.shape[1] :]
    covariance = left_out_covariance(design, weights, left, profile, prior)[line.shape[1] :, line.shape[1] :]
    information = np.zeros((5, 5))
    information[1:, 1:] = _without_prior(covariance, plausible)
    # The estimate was drawn towards zero by the prior, which the vector of the information must not be.
    vector = np.append(0.0, np.linalg.solve(covariance, found))
    return TurnInformation(information, vector, turning)


def _without_prior(covariance: Array, plausible: float) -> Array:
    """Information that the turns add to the prior; none in directions that only the prior tells."""
    values, vectors = np.linalg.eigh(np.linalg.inv(covariance))
    return np.asarray((vectors * np.maximum(values - plausible**-2.0, 0.0)) @ vectors.T)


def _slopes(heading: Array) -> Array:
    """Derivatives ``(n, 4)`` of `harmonics` by the heading."""
    sine, cosine, sine2, cosine2 = harmonics(heading).T
    return np.column_stack([cosine, -sine, 2.0 * cosine2, -2.0 * sine2])
