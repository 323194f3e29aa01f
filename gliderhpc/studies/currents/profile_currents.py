"""One profile of the study: retrieval, uncertainty and bins, as the archive's group ``currents`` keeps them."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gliderhpc.archive.profile import SMOOTHED, ProfileData
from gliderhpc.estimation.current_errors import CurrentErrors, current_uncertainty
from gliderhpc.flight.glider import Glider
from gliderhpc.flight.steady_glide import sign_in_doubt
from gliderhpc.platform import Platform
from gliderhpc.studies.archived import platform_of
from gliderhpc.studies.currents.coefficient_draws import half_width, scale_draws
from gliderhpc.studies.currents.depth_bins import bins_of
from gliderhpc.studies.currents.retrieval import Retrieval, retrieve
from gliderhpc.studies.currents.settings import DepthResolvedSettings
from gliderhpc.studies.library.archived_drift import archived_drift
from gliderhpc.studies.library.scores import rms

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Row = Mapping[str, Any]

PHASES = ("dive", "climb", "both")
_COMPONENTS = ("north", "east")
_SIGNIFICANT = 2.0
"""Standard deviations of the identification noise beyond which a yaw moment counts as the water's."""


@dataclass(frozen=True, eq=False)
class ProfileCurrents:
    """Row of the group's table, its records and its bins."""

    row: Row
    records: Row
    bins: Row


@dataclass(frozen=True)
class Beliefs:
    """What is believed of the errors.

    Attributes
    ----------
    current : CurrentErrors
        Terms of the depth-averaged current's uncertainty.
    identification_noise : float
        Root mean square of the high-passed yaw moment that noise alone leaves, N m; NaN where nobody measured it.
    """

    current: CurrentErrors
    identification_noise: float


def profile_currents(
    archive: xr.DataTree, data: ProfileData, settings: DepthResolvedSettings, beliefs: Beliefs, bins: int
) -> ProfileCurrents:
    """Study one profile; a hull whose yaw moment cannot tell the direction keeps its depth-averaged current alone."""
    platform = platform_of(archive)
    averaged = _averaged_row(archive, data, settings, beliefs)
    doubt = _doubt(data, platform, settings)
    row = {**averaged, "sign_in_doubt": doubt}
    if doubt > settings.largest_doubt:
        why = (
            f"no depth-resolved current: within {100 * settings.coefficient_error:.0f} % of the coefficients the yaw "
            f"moment has the other sign in {100 * doubt:.0f} % of draws"
        )
        return ProfileCurrents({**row, "message": why}, {}, {})
    found = retrieve(data, Glider(platform), settings)
    scales = scale_draws(platform, found.angle_of_attack, settings.coefficient_error, settings.draws, settings.seed)
    noise = _noise(data, found, beliefs)
    absolute = found.horizontal + np.array([averaged["current_north"], averaged["current_east"]])
    return ProfileCurrents(
        row={**row, **_retrieval_row(data, found, scales, noise, absolute)},
        records={
            "yaw_moment": found.moment,
            "lateral": found.lateral,
            "lateral_coefficient_std": np.abs(found.lateral) * half_width(scales, axis=1),
            "lateral_noise_std": noise,
            "condition": found.condition,
            **_components("shear", found.horizontal),
        },
        bins=_binned(data, found, scales, noise, settings, bins),
    )


def _averaged_row(
    archive: xr.DataTree, data: ProfileData, settings: DepthResolvedSettings, beliefs: Beliefs
) -> dict[str, Any]:
    """Depth-averaged current with the terms of its uncertainty, NaN without fixes."""
    drift = archived_drift(archive, data, data.estimate)
    if drift is None:
        return dict.fromkeys(("current_north", "current_east"), float("nan"))
    velocity, terms = drift.velocity, current_uncertainty(drift, _errors(settings, beliefs))
    major, minor = terms.axes
    return dict(zip(("current_north", "current_east"), velocity.tolist(), strict=True)) | {
        "speed": float(np.linalg.norm(velocity)),
        "direction": float(np.degrees(np.arctan2(velocity[1], velocity[0])) % 360.0),
        "axial_std": terms.axial,
        "cross_track_std": terms.cross_track,
        "magnitude_std": terms.magnitude,
        "heading_std": terms.heading,
        "fix_std": terms.fixes,
        "actuation_std": terms.actuation,
        "current_north_std": float(np.sqrt(terms.covariance[0, 0])),
        "current_east_std": float(np.sqrt(terms.covariance[1, 1])),
        "current_covariance": float(terms.covariance[0, 1]),
        "ellipse_major": major,
        "ellipse_minor": minor,
        "ellipse_direction": terms.orientation,
    }


def _errors(settings: DepthResolvedSettings, beliefs: Beliefs) -> CurrentErrors:
    if settings.actuation_error is None:
        return beliefs.current
    return beliefs.current.model_copy(update={"actuation_error": settings.actuation_error})


def _doubt(data: ProfileData, platform: Platform, settings: DepthResolvedSettings) -> float:
    """Largest share of coefficient draws of the other sign at the median angle of attack of dive and of climb."""
    angle = np.arctan2(data.motion[:, 4], data.motion[:, 2])
    climbing = _climbing(data)
    medians = [np.median(angle[phase]) for phase in (climbing, ~climbing) if phase.any()]
    return max(sign_in_doubt(platform, float(alpha), settings.coefficient_error) for alpha in medians)


def _noise(data: ProfileData, found: Retrieval, beliefs: Beliefs) -> Array:
    """Standard deviation ``(m,)`` of the lateral current by the yaw moment's own, m/s; NaN where nobody knows it."""
    moment = np.full(len(found.gain), beliefs.identification_noise)
    if data.estimate == SMOOTHED:
        moment = np.interp(data.record_time, data.time[:-1], data.disturbances_std[:-1, 5])
    return np.asarray(moment / np.abs(found.gain))


def _retrieval_row(data: ProfileData, found: Retrieval, scales: Array, noise: Array, absolute: Array) -> Row:
    known = np.isfinite(found.lateral)
    signal = rms(found.lateral[known])
    scatter = rms((np.abs(found.lateral) * half_width(scales, axis=1))[known])
    over = np.abs(found.moment[known]) > _SIGNIFICANT * noise[known] * np.abs(found.gain[known])
    speed = np.linalg.norm(absolute[known], axis=1)
    return {
        "shear_rms": signal,
        "coefficient_share": scatter / signal if signal > 0.0 else np.nan,
        "coefficient_share_absolute": scatter / rms(speed) if known.any() else np.nan,
        "significant_fraction": float(over.mean()) if known.any() and np.isfinite(noise[known]).all() else np.nan,
        "retrieved_fraction": float(known[data.steady_records].mean()) if data.steady_records.any() else np.nan,
        "rootless": found.rootless,
        "ill_conditioned": found.ill_conditioned,
        "interrupted": found.interrupted,
    }


def _binned(
    data: ProfileData, found: Retrieval, scales: Array, noise: Array, settings: DepthResolvedSettings, bins: int
) -> Row:
    """Means, spread, count and standard deviations a bin, of dive, climb and both."""
    depth, known = data.measured[:, 3], np.isfinite(found.horizontal).all(axis=1)
    climbing = _climbing(data)
    interval = float(data.attributes["output_interval"])
    row: dict[str, Any] = {"bin_depth": (np.arange(bins) + 0.5) * settings.bin}
    for phase, chosen in zip(PHASES, (~climbing, climbing, np.ones_like(climbing)), strict=True):
        sorted_ = bins_of(depth, known & chosen, settings.bin, bins)
        independent = np.maximum(1.0, sorted_.count * interval / settings.smoothing)
        drawn = np.stack([sorted_.mean(found.horizontal[:, i, None] * scales) for i in range(2)], axis=-1)
        of_noise = np.sqrt(sorted_.mean((noise[:, None] * found.across) ** 2) / independent[:, None])
        row |= {
            f"{phase}_count": sorted_.count,
            **_components(f"{phase}_shear", sorted_.mean(found.horizontal)),
            **_components(f"{phase}_shear_spread", sorted_.spread(found.horizontal)),
            **_components(f"{phase}_shear_coefficient_std", half_width(drawn, axis=1)),
            **_components(f"{phase}_shear_noise_std", of_noise),
        }
    return row


def _climbing(data: ProfileData) -> Mask:
    return data.on_records(data.flagged("climbing"))


def _components(name: str, values: Array) -> dict[str, Array]:
    return {f"{name}_{along}": values[:, i] for i, along in enumerate(_COMPONENTS)}
