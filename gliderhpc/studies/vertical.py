"""Study ``vertical``: vertical velocity of the water, and its dependence on the hull's parameters.

The model is the usual one: the hull's steady glide in still water at the measured attitude and ballast (Merckelbach et
al. 2010, 2019; Frajka-Williams et al. 2011). The reconstructed motion is not used, because its disturbances have
absorbed the motion of the water.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gliderhpc.archive.mission import open_for_reading
from gliderhpc.archive.profile import ProfileData
from gliderhpc.archive.reader import Archive
from gliderhpc.errors import InputError, ProfileError
from gliderhpc.observations.times import SECOND
from gliderhpc.observations.truth import read_profile_truth
from gliderhpc.store_schema.columns import effect_column, leg_column
from gliderhpc.studies.library.scores import correlation, rms
from gliderhpc.studies.library.vertical_velocity import VerticalVelocity, vertical_velocity
from gliderhpc.studies.request import Request
from gliderhpc.studies.study import ESTIMATE_UNUSED, Preparation, ProfileContext, Row, Study
from gliderhpc.vocabulary import PHASES

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

NAME = "vertical"

LEVELS = 20
"""Number of equal depth intervals in which the dive is compared with the climb."""


def record_rows(data: ProfileData, velocity: VerticalVelocity) -> dict[str, Array]:
    """Rows of the group's variables on the records (m,); NaN between samples."""
    columns = {
        "water_up": velocity.water,
        "water_up_std": np.where(np.isfinite(velocity.water), velocity.std, np.nan),
        "water_up_noise_std": np.where(np.isfinite(velocity.water), velocity.noise, np.nan),
        "depth_rate": velocity.measured,
        "depth_rate_still": np.where(np.isfinite(velocity.measured), velocity.model, np.nan),
        "speed_still": velocity.speed,
    }
    return {name: _on_records(data, velocity, column) for name, column in columns.items()}


def legs_row(velocity: VerticalVelocity) -> dict[str, Any]:
    """Means over dive and climb with their errors and spreads, and the effect of every hull parameter."""
    known = np.isfinite(velocity.water)
    row: dict[str, Any] = {
        "window": velocity.filter.window,
        "count": float(known.sum()),
        "share": float(known.mean()),
        "mean_square": float(np.mean(velocity.water[known] ** 2)),
        "noise_std": float(np.median(velocity.noise[known])),
    }
    for leg, chosen in legs(velocity).items():
        if not chosen.any():
            continue
        by_hull, by_pitch = velocity.by_hull[chosen].mean(axis=0), float(velocity.by_pitch[chosen].mean())
        row |= {
            leg_column("mean", leg): float(velocity.water[chosen].mean()),
            leg_column("spread", leg): float(velocity.water[chosen].std()),
            leg_column("mean_std", leg): float(np.sqrt(by_hull @ velocity.errors.covariance @ by_hull + by_pitch**2)),
        }
        row |= {
            effect_column(parameter.key.rpartition(".")[2], leg): float(change)
            for parameter, change in zip(velocity.errors.parameters, by_hull, strict=True)
        }
    return row


def legs(velocity: VerticalVelocity) -> dict[str, Mask]:
    """Masks (n,) of the samples with a velocity on dive and climb."""
    known = np.isfinite(velocity.water)
    return dict(zip(PHASES, (known & velocity.diving, known & velocity.climbing), strict=True))


def difference_row(velocity: VerticalVelocity) -> dict[str, Any]:
    """Difference of dive and climb, averaged over depth levels: zero if the water is the same on both.

    Notes
    -----
    Frajka-Williams et al. (2011) choose the hull's parameters by this difference and by the variance. The expected
    standard deviation includes the errors of the hull, which are common to both legs, and the rounding of pitch, which
    is independent on each leg.
    """
    levels = CommonLevels(velocity)
    if not levels.common:
        return {"levels": 0.0}
    difference = levels.difference(velocity.water)
    by_hull = levels.difference(velocity.by_hull).mean(axis=0)
    by_pitch = [float(levels.means(velocity.by_pitch, leg).mean()) for leg in legs(velocity).values()]
    return {
        "levels": float(len(levels.common)),
        "difference": float(difference.mean()),
        "difference_rms": rms(difference),
        "difference_std": float(np.sqrt(by_hull @ velocity.errors.covariance @ by_hull + np.sum(np.square(by_pitch)))),
    }


class CommonLevels:
    """Depth levels that a profile covers on both dive and climb."""

    def __init__(self, velocity: VerticalVelocity) -> None:
        depth = velocity.attitude.depth
        self._legs = legs(velocity)
        self._level = np.minimum((LEVELS * depth / depth.max()).astype(np.int64), LEVELS - 1)
        self.common = [k for k in range(LEVELS) if all((leg & (self._level == k)).any() for leg in self._legs.values())]

    def means(self, values: Array, leg: Mask) -> Array:
        """Means of values (n,) or (n, p) over a leg, one row for each level."""
        return np.array([values[leg & (self._level == k)].mean(axis=0) for k in self.common])

    def difference(self, values: Array) -> Array:
        """Means of the dive minus means of the climb, one row for each level."""
        return np.asarray(self.means(values, self._legs["dive"]) - self.means(values, self._legs["climb"]))


def truth_row(data: ProfileData, velocity: VerticalVelocity, truth: xr.Dataset) -> dict[str, Any]:
    """Errors relative to the truth, which passes through the same filter."""
    time = (truth["time"].values - data.epoch) / SECOND
    rate = truth["water_up"].values.astype(np.float64)
    risen = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(time) * (rate[1:] + rate[:-1]))])
    true = velocity.filter.slopes(np.interp(data.record_time[velocity.record], time, risen))
    error = velocity.water - true
    return {
        "error_rms": rms(error),
        "error_mean": float(np.nanmean(error)),
        "error_normalised": rms(error / velocity.std),
        "truth_correlation": correlation(velocity.water, true),
    }


def _on_records(data: ProfileData, velocity: VerticalVelocity, values: Array) -> Array:
    column = np.full(len(data.record_time), np.nan)
    column[velocity.record] = values
    return column


def study_profile(data: ProfileData, context: ProfileContext) -> Row:
    """Compute the vertical velocities of one profile: its row of the table, and the values on its records.

    Raises
    ------
    ProfileError
        The profile has no vertical velocity.
    """
    velocity = vertical_velocity(data, context.platform)
    if not np.isfinite(velocity.water).any():
        raise ProfileError(
            f"no {velocity.filter.window:.0f} s of uninterrupted samples in steady glide, so there is no vertical "
            "velocity"
        )
    row = legs_row(velocity) | difference_row(velocity)
    if context.inputs is not None:
        row |= truth_row(data, velocity, read_profile_truth(context.inputs, data.number))
    return row | record_rows(data, velocity)


def truth_file(request: Request, archive: Archive, numbers: tuple[int, ...], settings: None) -> Preparation:
    """Pass the path of the truth to the profiles' jobs."""
    return Preparation(inputs=None if request.truth is None else str(request.truth.resolve()))


def missing_input(request: Request, _: object) -> str | None:
    """Require an archive that distinguishes samples from values interpolated between them."""
    with open_for_reading(request.archive) as archive:
        if "sampled" in archive["observed"].to_dataset():
            return None
    return "the archive does not distinguish samples from values interpolated between them; run the mission again"


def require_velocities(request: Request, rows: Mapping[int, Row]) -> None:
    """Refuse a study in which no profile has a vertical velocity."""
    if all("message" in row for row in rows.values()):
        number, row = next(iter(rows.items()))
        raise InputError(f"{request.archive}: no profile has a vertical velocity; profile {number}: {row['message']}")


STUDY = Study(
    NAME,
    "vertical velocity of the water, and its sensitivity to the hull's parameters",
    missing=missing_input,
    profile=study_profile,
    prepare=truth_file,
    check=require_velocities,
    mission_columns=("elapsed_days",),
    estimate_unused=ESTIMATE_UNUSED,
)
