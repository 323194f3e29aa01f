"""Scatter of one error of the hull from dive to dive, which a change must exceed.

The stated covariances of the dives do not include all that acts like an error of the hull: packets of internal waves,
for example, look like another lift in the dives that cross them. A few such dives at one end of a mission would pass
for a change. The error may therefore also differ from dive to dive at random, by an unknown standard deviation.
"""

from collections.abc import Sequence

import numpy as np

from gliderhpc.tuning.gaussian_chain import Array, Gaussian, Information, Transition

LEVELS = (0.0, 0.05, 0.12, 0.3, 0.7, 1.6)
"""Standard deviations tried for the scatter, in plausible deviations of the error."""

_STATED_SUFFICES = 0.9
"""Prior probability that there is no such scatter: the stated covariances are already scaled to the dives' scatter."""

LOG_PRIOR = np.log(np.array([_STATED_SUFFICES, *[(1.0 - _STATED_SUFFICES) / (len(LEVELS) - 1)] * (len(LEVELS) - 1)]))
"""Log of the prior probabilities of `LEVELS`; those above zero are equally probable."""


def widened(term: Information, deviation: Array) -> Information:
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


def log_evidence(prior: Gaussian, changes: Sequence[Transition], terms: Sequence[Information]) -> float:
    """Log evidence of the dives, one after the other."""
    belief, total = prior, 0.0
    for number, term in enumerate(terms):
        if number:
            belief = changes[number - 1].applied(belief)
        belief, gained = belief.updated(term)
        total += float(gained)
    return total
