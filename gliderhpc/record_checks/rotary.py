"""Comparison of errors of the compass with currents that rotate at the inertial or a tidal period.

Where each heading was flown in one block of time only, such a current differs between the headings as an error of the
compass does. The scatter of the currents does not show this, since both explain it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from gliderhpc.vocabulary import TIDAL_PERIODS

Array = NDArray[np.float64]

EARTH_ROTATION = 7.292115e-5
"""Angular velocity of the earth, rad/s."""

LEAST_GAIN = float(np.log(20.0))
"""Gain of the log likelihood above which an error of the compass explains the currents clearly better."""

_LEAST_SHARE = 0.5
"""Share of the effect of an error that a rotation must explain to be considered."""
_TIDE = 2.0 * np.pi / (3600.0 * TIDAL_PERIODS["M2"])
"""Frequency of the semidiurnal tide, rad/s."""
_LOWEST_FREQUENCY = 2.0 * np.pi / (5.0 * 86400.0)
"""Inertial frequency (rad/s) below which a current is slow enough for the lasting part of the model."""
_AMPLITUDES = (0.03, 0.1, 0.3)
"""Standard deviations (m/s) tried for the components of the rotating current."""
_MEAN, _SPEED_ERROR = 1.0, 0.3
"""Standard deviations of the mean current (m/s) and of the relative error of the speed."""
_MEMORIES = np.geomspace(3e3, 1e6, 5)
_RATIOS = (0.0, 0.3, 1.0, 3.0, 10.0)
_SCATTERS = np.geomspace(3e-3, 0.3, 9)
"""Correlation times (s), ratios of variances and standard deviations (m/s) tried for the rest of the current."""


@dataclass(frozen=True, eq=False)
class CurrentModel:
    """Currents of some legs, and their sensitivities to the errors of the compass and of the speed.

    Attributes
    ----------
    time : (n,)
        Times of the legs, s.
    latitude : (n,)
        Latitudes of the legs, degree; NaN where not known.
    current : (2 n,)
        Currents north, then east, m/s.
    by_error : (2 n, 5)
        Derivatives by the errors of the compass, m/s per rad.
    by_speed : (2 n,)
        Derivatives by a relative error of the speed, m/s.
    information, vector : (5, 5), (5,)
        Information of turns on the errors of the compass.
    prior : float
        Plausible standard deviation of an error of the compass, rad.
    """

    time: Array
    latitude: Array
    current: Array
    by_error: Array
    by_speed: Array
    information: Array
    vector: Array
    prior: float


def is_explained_by_rotation(model: CurrentModel, values: Array, tested: Sequence[int]) -> bool:
    """Return whether a current that rotates explains the legs nearly as well as some errors of the compass.

    Parameters
    ----------
    model : CurrentModel
        The legs.
    values : (5,)
        Estimated errors of the compass, rad; zero where not estimated.
    tested : sequence of int
        Errors of the compass that are compared with the rotation; the other nonzero ones are estimated in any case.

    Notes
    -----
    The effect of the tested errors on the currents is projected on rotating currents: one that rotates at the inertial
    frequency of the latitude, clockwise in the northern hemisphere, and an ellipse at the frequency of M2. Where
    the headings were flown in turn, little of it is explained, and the scatter of the currents is decisive. Where each
    heading was flown in one block of time, two models of the currents are compared, one with the tested errors and one
    without; either may contain the rotation. Both have a mean current, an error of the speed, a part of the current
    that decorrelates exponentially and a part of each profile alone. Errors and amplitudes have Gaussian priors and are
    integrated out; the variances and the correlation time are those of the greatest likelihood.
    """
    rotation = rotating_columns(model.time, model.latitude)
    effect = model.by_error[:, tested] @ values[tested]
    if _share_explained(effect, rotation, _systematic(model)) < _LEAST_SHARE:
        return False
    others = [index for index in np.flatnonzero(values).tolist() if index not in tested]
    return _best(model, sorted({*tested, *others}), rotation) - _best(model, others, rotation) < LEAST_GAIN


def _share_explained(effect: Array, rotation: Array, systematic: Array) -> float:
    """Share of an effect's square, after a mean and an error of the speed, that a rotation explains (adjusted).

    The squares are divided by their degrees of freedom, so that headings at random give a share about zero.
    """
    without, with_rotation = (
        effect - design @ np.linalg.lstsq(design, effect, rcond=None)[0]
        for design in (systematic, np.hstack([systematic, rotation]))
    )
    freedom = len(effect) - systematic.shape[1]
    size, remaining = float(without @ without) / freedom, float(with_rotation @ with_rotation)
    if not size > 0.0 or freedom <= rotation.shape[1]:
        return 1.0
    return float(1.0 - remaining / (freedom - rotation.shape[1]) / size)


def rotating_columns(time: Array, latitude: Array) -> Array:
    """Return the currents (2 n, k) of unit amplitude that rotate at the inertial and the tidal frequencies.

    Parameters
    ----------
    time, latitude : (n,), (n,)
        Times, s, and latitudes, degree. If no latitude is known, the inertial rotation is left out.
    """
    seconds = time - time[0]
    tide = _TIDE * seconds
    columns = [np.kron(np.eye(2), np.column_stack([np.cos(tide), np.sin(tide)]))]
    if np.isfinite(latitude).any():
        inertial = 2.0 * EARTH_ROTATION * np.sin(np.radians(np.nanmean(latitude)))
        if abs(inertial) > _LOWEST_FREQUENCY:
            # The direction increases with time (clockwise) in the northern hemisphere.
            phase = inertial * seconds
            sine, cosine = np.sin(phase), np.cos(phase)
            columns.append(np.column_stack([np.append(cosine, sine), np.append(-sine, cosine)]))
    return np.hstack(columns)


def _best(model: CurrentModel, errors: list[int], rotation: Array) -> float:
    """Return the greatest log likelihood with some errors of the compass, with and without a rotating current."""
    count, systematic = len(model.time), _systematic(model)
    expected, gain, root = _errors_after_turns(model, errors)
    columns = model.by_error[:, errors]
    residual = model.current - columns @ expected
    base = systematic @ systematic.T + columns @ root @ root.T @ columns.T
    bases = [base] + [base + amplitude**2 * rotation @ rotation.T for amplitude in _AMPLITUDES]
    separation = np.abs(model.time[:, None] - model.time[None, :])
    shapes = [np.eye(count)] + [
        np.eye(count) + ratio * np.exp(-separation / memory) for memory in _MEMORIES for ratio in _RATIOS if ratio
    ]
    densities = [
        _log_density(residual, own + scatter**2 * np.kron(np.eye(2), shape))
        for own in bases
        for shape in shapes
        for scatter in _SCATTERS
    ]
    return gain + max(densities)


def _systematic(model: CurrentModel) -> Array:
    """Return the effects (2 n, 3) of a mean current and of an error of the speed of plausible size."""
    mean = np.kron(np.eye(2), np.ones((len(model.time), 1)))
    return np.hstack([_MEAN * mean, _SPEED_ERROR * model.by_speed[:, None]])


def _errors_after_turns(model: CurrentModel, errors: list[int]) -> tuple[Array, float, Array]:
    """Return mean and root of the covariance of some errors given the turns, and the turns' log likelihood."""
    information, vector = model.information[np.ix_(errors, errors)], model.vector[errors]
    posterior = np.linalg.inv(information + np.eye(len(errors)) / model.prior**2)
    expected = posterior @ vector
    spread = np.eye(len(errors)) + model.prior**2 * information
    gain = 0.5 * float(vector @ expected) - 0.5 * float(np.linalg.slogdet(spread)[1])
    return expected, gain, np.linalg.cholesky(posterior)


def _log_density(residual: Array, covariance: Array) -> float:
    """Log density of a Gaussian residual, up to a constant."""
    factor = np.linalg.cholesky(covariance)
    whitened = scipy.linalg.solve_triangular(factor, residual, lower=True)
    return -0.5 * float(whitened @ whitened) - float(np.log(np.diag(factor)).sum())
