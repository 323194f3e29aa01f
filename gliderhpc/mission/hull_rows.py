"""Row of the archive's group ``hull``: a profile's information on its hull."""

from functools import partial

import numpy as np
from numpy.typing import NDArray

from gliderhpc.estimation.smoother.posterior import HullPart
from gliderhpc.flight.hull_parameters import among_parameters

Array = NDArray[np.float64]


def hull_row(hull: HullPart) -> dict[str, Array]:
    """Return a profile's row of group ``hull``, with missing values for parameters without effect."""
    information = hull.information
    placed = partial(among_parameters, keys=information.names)
    alone = np.array([hull.errors.mean, np.sqrt(np.diag(hull.errors.covariance))])
    if not information.is_sound:
        alone[:] = np.nan
    return {
        "value": placed(information.value),
        "plausible_deviation": placed(information.plausible_deviation),
        "score": placed(information.score),
        "information": placed(placed(information.information).T).T,
        "score_other": np.array([placed(score) for score, _ in information.others]),
        "information_other": np.array([placed(placed(matrix).T).T for _, matrix in information.others]),
        "estimate_alone": placed(alone[0]),
        "estimate_alone_std": placed(alone[1]),
        "displacement_sensitivity": placed(information.displacement),
        "median_sensitivity": placed(hull.glide.medians),
        "speed_sensitivity": placed(hull.glide.speeds),
        "displacement_covariance": hull.displacement_covariance,
        "variance_share": hull.share,
    }
