"""Accuracy of a synthetic mission's estimates against its truth, for comparison with the paper's Table 2."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr
from rich.table import Table

from gliderhpc.archive.profile import TRACKED, ProfileData, done_profiles, read_profile_data, truth_on_samples
from gliderhpc.archive.reader import Archive
from gliderhpc.errors import InputError
from gliderhpc.observations.truth import read_profile_truths
from gliderhpc.studies.library.scores import EstimateScore, finite_median, rms, score_columns
from gliderhpc.vocabulary import CHANNELS

NAMES = {
    "B_cu": "surge force",
    "B_cv": "sway force",
    "B_cw": "heave force",
    "B_cp": "roll moment",
    "B_cq": "pitch moment",
    "B_cr": "yaw moment",
}
"""Names of the six disturbances."""

COLUMNS = ("quantity", "unit", "adjoint RMSE", "correlation", "filter RMSE", "correlation")
"""Columns of the table of accuracy."""

_ABSENT = "–"


@dataclass(frozen=True)
class ProfileAccuracy:
    """Accuracy of one profile against its truth, over steady glide.

    Attributes
    ----------
    number : int
        Number of the profile.
    adjoint, prior : tuple of EstimateScore
        Scores of the six disturbances, N and N m.
    tracking : tuple of float
        RMSE of the reconstruction against the measurements: roll, pitch, heading (degree) and depth (m).
    current_error : float
        Magnitude of the difference between depth-averaged and true current, m/s; NaN without a current.
    """

    number: int
    adjoint: tuple[EstimateScore, ...]
    prior: tuple[EstimateScore, ...]
    tracking: tuple[float, ...]
    current_error: float


@dataclass(frozen=True)
class AccuracyRow:
    """One row of the table: medians over profiles, NaN where a value does not apply.

    Attributes
    ----------
    quantity : str
        ``B_cu`` ... ``B_cr``, ``roll``, ``pitch``, ``heading``, ``depth`` or ``current``.
    label : str
        Name of the quantity in the table.
    unit : str
        Unit of the errors.
    adjoint, prior : EstimateScore
        Scores of adjoint and filter; the archive has neither a reconstruction nor a current of the filter.
    """

    quantity: str
    label: str
    unit: str
    adjoint: EstimateScore
    prior: EstimateScore


def accuracy_table(archive: Archive, truth_path: str | Path) -> list[AccuracyRow]:
    """Compare a synthetic mission's estimates with its truth.

    Only samples in steady glide are used: outside vibration and gaps, and after the first minute.

    Parameters
    ----------
    archive : Archive
        Archive, as :func:`gliderhpc.archive.mission.open_mission` or `open_for_reading` returns it.
    truth_path : str or Path
        The mission's truth file.

    Returns
    -------
    list of AccuracyRow
        The six disturbances, the four tracked quantities and the current.

    Raises
    ------
    InputError
        No profile of the archive is done, or the truth cannot be read or belongs to another mission.
    """
    done = done_profiles(archive)
    if not done:
        raise InputError("no profile of the archive is done, so there is nothing to compare with the truth")
    profiles = [
        profile_accuracy(read_profile_data(archive, number), truth)
        for number, truth in zip(done, read_profile_truths(truth_path, done), strict=True)
    ]
    channels = [
        AccuracyRow(
            name,
            f"{name} {NAMES[name]}",
            unit,
            _median_score(profile.adjoint[channel] for profile in profiles),
            _median_score(profile.prior[channel] for profile in profiles),
        )
        for channel, (name, (unit, _)) in enumerate(CHANNELS.items())
    ]
    tracked = [
        _error_row(name, f"tracking of {name}", unit, (profile.tracking[i] for profile in profiles))
        for i, (name, unit) in enumerate(TRACKED.items())
    ]
    errors = (profile.current_error for profile in profiles)
    return [*channels, *tracked, _error_row("current", "depth-averaged current", "m/s", errors)]


def profile_accuracy(data: ProfileData, truth: xr.Dataset) -> ProfileAccuracy:
    """Compare one profile with its truth.

    Parameters
    ----------
    data : ProfileData
        The profile.
    truth : xarray.Dataset
        Its truth, as :func:`gliderhpc.observations.truth.read_profile_truth` returns it.

    Raises
    ------
    InputError
        The truth covers none of the profile's time.
    """
    true, steady = truth_on_samples(data, truth), data.steady
    return ProfileAccuracy(
        number=data.number,
        adjoint=score_columns(data.disturbances[steady], true[steady]),
        prior=score_columns(data.prior[steady], true[steady]),
        tracking=tracking_rmse(data),
        current_error=float(
            np.hypot(data.table["dac_north"] - truth["current_north"], data.table["dac_east"] - truth["current_east"])
        ),
    )


def tracking_rmse(data: ProfileData) -> tuple[float, ...]:
    """Return the RMSE of reconstruction minus measurement over steady glide: three angles (degrees), depth (m)."""
    return tuple(rms(column) for column in data.residuals[data.steady_records].T)


def render(rows: Sequence[AccuracyRow], title: str | None = None) -> Table:
    """Format the rows as a table for a terminal."""
    table = Table(title=title, title_justify="left")
    for position, column in enumerate(COLUMNS):
        table.add_column(column, justify="left" if position < 2 else "right")
    for row in rows:
        table.add_row(*cells_of(row), end_section=row.quantity in ("B_cr", "depth"))
    return table


def _median_score(scores: Iterable[EstimateScore]) -> EstimateScore:
    all_scores = list(scores)
    return EstimateScore(
        finite_median([score.rmse for score in all_scores]), finite_median([score.correlation for score in all_scores])
    )


def _error_row(quantity: str, label: str, unit: str, errors: Iterable[float]) -> AccuracyRow:
    nan = float("nan")
    return AccuracyRow(quantity, label, unit, EstimateScore(finite_median(list(errors)), nan), EstimateScore(nan, nan))


def cells_of(row: AccuracyRow) -> tuple[str, ...]:
    """Return the text of a row's cells, one for each of `COLUMNS`."""
    numbers = (row.adjoint.rmse, row.adjoint.correlation, row.prior.rmse, row.prior.correlation)
    return (row.label, row.unit, *(f"{number:.3f}" if np.isfinite(number) else _ABSENT for number in numbers))
