"""Scatter of the errors of the hull from dive to dive, which a change must exceed.

The stated covariances of the dives do not include everything that has the same effect as an error of the hull: packets
of internal waves, for example, appear as a different lift in the dives that cross them. A few such dives at one end of
a mission would pass for a change. The error may therefore also differ from dive to dive at random, by an unknown
standard deviation.

On the other hand the covariances contain forces of the water that change slowly, as large as the prior of the
disturbances allows. Where the water is calmer, the dives agree better than stated, and smaller changes show. The
differences between successive dives tell how much better; a change of the hull hardly affects them.
"""

from collections.abc import Sequence

import numpy as np

from gliderhpc.distributions import chi_square_quantile
from gliderhpc.mission_hull.gaussian_chain import Array, Gaussian, Information, times_vector

LEVELS = (0.0, 0.05, 0.12, 0.3, 0.7, 1.6)
"""Standard deviations tried for the scatter, in plausible deviations of the error."""

_STATED_SUFFICES = 0.9
"""Prior probability that there is no such scatter: the stated covariances are already scaled to the dives' scatter."""

LOG_PRIOR = np.log(np.array([_STATED_SUFFICES, *[(1.0 - _STATED_SUFFICES) / (len(LEVELS) - 1)] * (len(LEVELS) - 1)]))
"""Log of the prior probabilities of `LEVELS`; those above zero are equally probable."""

MIN_VARIANCE_RATIO = 0.1
"""Minimum ratio of the variance between dives to the stated one: below, errors that all dives share would matter."""
_CONFIDENCE = 0.95
"""Probability that the ratio is not larger than the one returned: a few dives can agree by chance."""
_INDEPENDENT = 1.0 / 3.0
"""Independent values per difference between successive dives: each dive is in two of them, and a median of chi-squares
is about half as precise as their mean."""


def variance_ratio(terms: Sequence[Information], prior: Gaussian, suspects: Sequence[int]) -> float:
    """Upper bound of the ratio of the variance between successive dives to the stated one.

    Parameters
    ----------
    terms : sequence of Information
        Information of at least two dives, in the order of time.
    prior : Gaussian
        Prior of the errors, of which there are ``p``.
    suspects : sequence of int
        Indices of the errors whose variance is judged, as those that may change.

    Notes
    -----
    Let ``r = h - L eta`` be the score of a dive about the mission's mean, of covariance ``L``. The chi-squares of the
    differences of successive ``r``, for the suspects alone, have the same median as a chi-square distribution if the
    covariances are right. The median is not sensitive to single dives, nor to an abrupt or slow change.
    """
    dives = Information.stacked(terms)
    mission, _ = prior.updated(Information(dives.vector.sum(axis=0), dives.matrix.sum(axis=0), 0.0))
    chosen = list(suspects)
    score = (dives.vector - times_vector(dives.matrix, mission.mean))[:, chosen]
    stated = dives.matrix[:, chosen][:, :, chosen]
    covariance = stated[1:] + stated[:-1]
    informative = np.linalg.matrix_rank(covariance, hermitian=True) == len(chosen)
    if not informative.any():
        return np.inf
    difference = np.diff(score, axis=0)[informative]
    solved = np.linalg.solve(covariance[informative], difference[..., None])[..., 0]
    chi_square = np.sum(difference * solved, axis=1)
    freedom = _INDEPENDENT * len(chosen) * len(chi_square)
    ratio = float(np.median(chi_square)) / float(chi_square_quantile(0.5, len(chosen)))
    return ratio * freedom / float(chi_square_quantile(1.0 - _CONFIDENCE, freedom))


def with_scatter(term: Information, deviation: Array) -> Information:
    """Return a dive's information on the unknowns if they differ from those of the mission at random.

    Parameters
    ----------
    term : Information
        Information of the dive about its own unknowns.
    deviation : (p,)
        Standard deviations of the differences, which are independent.

    Notes
    -----
    With differences of covariance ``D``, the information matrix becomes ``(1 + L D)^-1 L`` and the vector
    ``(1 + L D)^-1 h``; the constant includes the integral over the differences.
    """
    scattered = np.flatnonzero(deviation)
    if not len(scattered):
        return term
    size = deviation[scattered]
    columns = term.matrix[:, scattered] * size
    scaled = term.vector[scattered] * size
    inner = np.eye(len(scattered)) + columns[scattered] * size[:, None]
    solved = np.linalg.solve(inner, np.column_stack([columns.T, scaled]))
    matrix = term.matrix - columns @ solved[:, :-1]
    constant = term.constant + 0.5 * float(scaled @ solved[:, -1]) - 0.5 * float(np.linalg.slogdet(inner)[1])
    return Information(term.vector - columns @ solved[:, -1], 0.5 * (matrix + matrix.T), constant)


def averaged_over_levels(
    log_weight: Array, log_ratio: Array, size: Array, variance: Array
) -> tuple[Array, Array, Array]:
    """Average the evidence of candidates, and their sizes, over levels of the scatter.

    Parameters
    ----------
    log_weight : (l,)
        Log weights of the levels without a change.
    log_ratio : (l, ...)
        Log evidence of the candidates relative to no change at the same level.
    size, variance : (l, ...) or (l, ..., k)
        Means and variances of the candidates' sizes, one or several of each.

    Returns
    -------
    log_ratio, size, variance
        Without the axis of the levels.
    """
    each = log_weight.reshape(-1, *[1] * (log_ratio.ndim - 1)) + log_ratio
    evidence = np.logaddexp.reduce(each, axis=0)
    share = np.exp(each - evidence)
    share = share.reshape(share.shape + (1,) * (size.ndim - share.ndim))
    mean = np.sum(share * size, axis=0)
    spread = np.sum(share * (variance + (size - mean) ** 2), axis=0)
    return evidence - np.logaddexp.reduce(log_weight), mean, spread
