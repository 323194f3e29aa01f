"""The second witness, which no adjoint enters: the error of the forward model, as `validate` left it in the archive."""

from dataclasses import dataclass

import numpy as np
import pandas as pd
import scipy
import xarray as xr

from gliderhpc.archive.profile import ADJOINT
from gliderhpc.studies.drift.medians import column
from gliderhpc.studies.drift.series import days_of, trend_of, values_of
from gliderhpc.studies.drift.trends import SeriesTrend
from gliderhpc.studies.library.trend import LEAST, known_pairs

GROUP, ERROR = "validation", "longitudinal_rmse"
WITNESS = "forward_rmse"
"""Name of the forward model's error in the study's table."""


@dataclass(frozen=True)
class Correlation:
    """Spearman's rank correlation and its two-sided probability of chance."""

    rho: float
    p: float


@dataclass(frozen=True, eq=False)
class Witness:
    """Trend of the forward model's error, and how it goes with the days and with the axial force on the climb."""

    trend: SeriesTrend
    with_day: Correlation
    with_axial: Correlation


def forward_errors(archive: xr.DataTree, numbers: list[int]) -> list[float] | None:
    """Longitudinal error of the forward model of some profiles; None where the archive was not validated."""
    if GROUP not in archive.children or ERROR not in archive[GROUP].to_dataset():
        return None
    errors = archive[GROUP].to_dataset()[ERROR].sel(profile=numbers).values
    return errors.tolist() if np.isfinite(errors).any() else None


def witness_of(table: pd.DataFrame, resamples: int, seed: int) -> Witness | None:
    """Find the second witness; None where the table has none."""
    if WITNESS not in table:
        return None
    error = values_of(table, WITNESS)
    axial = np.abs(values_of(table, column("B_cu", "climb", ADJOINT)))
    return Witness(
        trend_of(table, WITNESS, resamples, seed), _correlation(error, days_of(table)), _correlation(error, axial)
    )


def _correlation(one: object, other: object) -> Correlation:
    a, b = known_pairs(np.asarray(one), np.asarray(other))
    if len(a) < LEAST or np.ptp(a) == 0.0 or np.ptp(b) == 0.0:
        return Correlation(float("nan"), float("nan"))
    found = scipy.stats.spearmanr(a, b)
    return Correlation(float(found.statistic), float(found.pvalue))
