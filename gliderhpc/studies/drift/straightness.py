"""Whether a straight line describes the shared drag over a mission."""

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from gliderhpc.studies.drift.change_points import FEWEST_VALUES, amplitude
from gliderhpc.studies.drift.drag import shared_drag, weight_effects
from gliderhpc.studies.drift.medians import DRAG, PHASES, column
from gliderhpc.studies.drift.series import days_of, values_of

CURVED = 3.0
"""Standard deviations by which a curvature differs from none."""


def is_straight(table: pd.DataFrame, estimate: str, outside: NDArray[np.bool_]) -> bool:
    """Test whether the shared drag of an estimate leaves a straight line over the days by a curvature.

    Parameters
    ----------
    table : pandas.DataFrame
        A row a profile.
    estimate : str
        Of those that the medians were taken of.
    outside : (n,) mask
        Profiles that count.

    Notes
    -----
    A parabola is fitted beside the line by generalised least squares under the noise model that then fits best. Too
    few values show no curvature.
    """
    dive, climb = (values_of(table, column(DRAG, phase, estimate)) for phase in PHASES)
    values, days = shared_drag(dive, climb, weight_effects(table)), days_of(table)
    known = np.isfinite(values) & outside
    if known.sum() < FEWEST_VALUES:
        return True
    time = 2.0 * (days[known] - days[known].min()) / np.ptp(days[known]) - 1.0
    line = np.column_stack([np.ones(len(time)), time])
    size, deviation = amplitude(np.flatnonzero(known), line, time**2, values[known])
    return bool(abs(size) <= CURVED * deviation)
