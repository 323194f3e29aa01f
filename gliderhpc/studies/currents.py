"""Study ``currents``: depth-averaged and depth-resolved currents with their uncertainty (sections 5.4 and 5.5)."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gliderhpc.archive.profile import SMOOTHED, ProfileData
from gliderhpc.archive.reader import Archive
from gliderhpc.estimation.current_errors import TERMS, CurrentErrors, current_uncertainty, read_budget
from gliderhpc.flight.glider import Glider
from gliderhpc.flight.steady_glide import sign_in_doubt
from gliderhpc.platform import Platform
from gliderhpc.store_schema.columns import CURRENT_PHASES, bin_column, component_column
from gliderhpc.studies.archived import platform_of, settings_of
from gliderhpc.studies.library.reference_currents import (
    ReferenceFile,
    bin_count,
    bins_of,
    compare_with_reference,
    open_reference,
)
from gliderhpc.studies.library.retrieval import DepthResolvedSettings, Retrieval, half_width, retrieve, scale_draws
from gliderhpc.studies.library.scores import rms
from gliderhpc.studies.library.tracks import archived_drift
from gliderhpc.studies.request import Request
from gliderhpc.studies.study import Preparation, ProfileContext, Row, Study
from gliderhpc.vocabulary import COMPONENTS

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

NAME = "currents"


_SIGNIFICANT = 2.0
"""Standard deviations of the identification noise above which a yaw moment is attributed to the water."""


@dataclass(frozen=True)
class UncertaintyModel:
    """Errors of the depth-averaged current and of the yaw moment.

    Attributes
    ----------
    current : CurrentErrors
        Terms of the depth-averaged current's uncertainty.
    identification_noise : float
        Root mean square of the high-passed yaw moment due to noise alone, N m; NaN where it was not measured.
    by_hull : bool
        True if the hull's errors from the mission's run, where it has them, replace the terms for the hull.
    """

    current: CurrentErrors
    identification_noise: float
    by_hull: bool = False


def profile_currents(
    archive: Archive, data: ProfileData, settings: DepthResolvedSettings, errors: UncertaintyModel, bins: int
) -> dict[str, Any]:
    """Compute the currents of one profile: its row of the table, and values on its records and in depth bins.

    If the sign of the yaw moment's response is uncertain, only the depth-averaged current is given.
    """
    platform = platform_of(archive)
    averaged = _averaged_row(archive, data, settings, errors)
    doubt = _sign_doubt(data, platform, settings)
    row = {**averaged, "sign_in_doubt": doubt}
    if doubt > settings.largest_doubt:
        why = (
            f"no depth-resolved current: with errors of up to {100 * settings.coefficient_error:.0f} % in the "
            f"coefficients the yaw moment has the opposite sign in {100 * doubt:.0f} % of draws"
        )
        return {**row, "message": why}
    retrieved = retrieve(data, Glider(platform), settings)
    scales = scale_draws(platform, retrieved.angle_of_attack, settings.coefficient_error, settings.draws, settings.seed)
    noise = _noise(data, retrieved, errors)
    absolute = retrieved.horizontal + np.array([averaged["current_north"], averaged["current_east"]])
    return {
        **row,
        **_retrieval_row(data, retrieved, scales, noise, absolute),
        "yaw_moment": retrieved.moment,
        "lateral": retrieved.lateral,
        "lateral_coefficient_std": np.abs(retrieved.lateral) * half_width(scales, axis=1),
        "lateral_noise_std": noise,
        "condition": retrieved.condition,
        **_components("shear", retrieved.horizontal),
        **_bin_currents(data, retrieved, scales, noise, settings, bins),
    }


def _averaged_row(
    archive: Archive, data: ProfileData, settings: DepthResolvedSettings, errors: UncertaintyModel
) -> dict[str, Any]:
    """Depth-averaged current with the terms of its uncertainty; NaN without fixes."""
    drift = archived_drift(archive, data, data.estimate, by_hull=errors.by_hull)
    if drift is None:
        return dict.fromkeys(("current_north", "current_east"), float("nan"))
    velocity, terms = drift.velocity, current_uncertainty(drift, _current_errors(settings, errors))
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


def _current_errors(settings: DepthResolvedSettings, errors: UncertaintyModel) -> CurrentErrors:
    if settings.actuation_error is None:
        return errors.current
    return errors.current.model_copy(update={"actuation_error": settings.actuation_error})


def _sign_doubt(data: ProfileData, platform: Platform, settings: DepthResolvedSettings) -> float:
    """Share of coefficient draws in which the yaw moment's response has the opposite sign.

    The share is computed at the median angles of attack of dive and climb, and the larger one is returned.
    """
    angle = np.arctan2(data.motion[:, 4], data.motion[:, 2])
    climbing = _climbing(data)
    medians = [np.median(angle[phase]) for phase in (climbing, ~climbing) if phase.any()]
    return max(sign_in_doubt(platform, float(alpha), settings.coefficient_error) for alpha in medians)


def _noise(data: ProfileData, retrieved: Retrieval, errors: UncertaintyModel) -> Array:
    """Standard deviation ``(m,)`` of the lateral current due to that of the yaw moment, m/s; NaN if it is unknown."""
    moment = np.full(len(retrieved.gain), errors.identification_noise)
    if data.estimate == SMOOTHED:
        moment = np.interp(data.record_time, data.time[:-1], data.disturbances_std[:-1, 5])
    return np.asarray(moment / np.abs(retrieved.gain))


def _retrieval_row(data: ProfileData, retrieved: Retrieval, scales: Array, noise: Array, absolute: Array) -> Row:
    known = np.isfinite(retrieved.lateral)
    signal = rms(retrieved.lateral[known])
    scatter = rms((np.abs(retrieved.lateral) * half_width(scales, axis=1))[known])
    over = np.abs(retrieved.moment[known]) > _SIGNIFICANT * noise[known] * np.abs(retrieved.gain[known])
    speed = np.linalg.norm(absolute[known], axis=1)
    return {
        "shear_rms": signal,
        "coefficient_share": scatter / signal if signal > 0.0 else np.nan,
        "coefficient_share_absolute": scatter / rms(speed) if known.any() else np.nan,
        "significant_fraction": float(over.mean()) if known.any() and np.isfinite(noise[known]).all() else np.nan,
        "retrieved_fraction": float(known[data.steady_records].mean()) if data.steady_records.any() else np.nan,
        "rootless": retrieved.rootless,
        "ill_conditioned": retrieved.ill_conditioned,
        "interrupted": retrieved.interrupted,
    }


def _bin_currents(
    data: ProfileData, retrieved: Retrieval, scales: Array, noise: Array, settings: DepthResolvedSettings, bins: int
) -> Row:
    """Means, spreads, counts and standard deviations in each bin, for dive, climb and both."""
    depth, known = data.measured[:, 3], np.isfinite(retrieved.horizontal).all(axis=1)
    climbing = _climbing(data)
    interval = float(data.attributes["output_interval"])
    row: dict[str, Any] = {"bin_depth": (np.arange(bins) + 0.5) * settings.bin}
    for phase, chosen in zip(CURRENT_PHASES, (~climbing, climbing, np.ones_like(climbing)), strict=True):
        sorted_ = bins_of(depth, known & chosen, settings.bin, bins)
        independent = np.maximum(1.0, sorted_.count * interval / settings.smoothing)
        drawn = np.stack([sorted_.mean(retrieved.horizontal[:, i, None] * scales) for i in range(2)], axis=-1)
        with_noise = bins_of(depth, known & chosen & np.isfinite(noise), settings.bin, bins)
        of_noise = np.sqrt(with_noise.mean((noise[:, None] * retrieved.across) ** 2) / independent[:, None])
        row |= {
            bin_column(phase, "count"): sorted_.count,
            **_components(bin_column(phase, "shear"), sorted_.mean(retrieved.horizontal)),
            **_components(bin_column(phase, "shear_spread"), sorted_.spread(retrieved.horizontal)),
            **_components(bin_column(phase, "shear_coefficient_std"), half_width(drawn, axis=1)),
            **_components(bin_column(phase, "shear_noise_std"), of_noise),
        }
    return row


def _climbing(data: ProfileData) -> Mask:
    return data.on_records(data.flagged("climbing"))


def _components(name: str, values: Array) -> dict[str, Array]:
    return {component_column(name, along): values[:, i] for i, along in enumerate(COMPONENTS)}


def study_profile(data: ProfileData, context: ProfileContext) -> Row:
    """Compute the currents of one profile, and compare them with a reference if there is one."""
    settings, (errors, bins, reference) = context.settings, context.inputs
    row = profile_currents(context.archive, data, settings, errors, bins)
    if reference is None:
        return row
    return row | compare_with_reference(data, open_reference(reference), row, settings, bins)


def prepare(
    request: Request, archive: Archive, numbers: tuple[int, ...], settings: DepthResolvedSettings
) -> Preparation:
    """Read the errors, check the reference, and determine the number of depth bins.

    Raises
    ------
    InputError
        The budget or the reference cannot be read.
    """
    reference = None if request.reference is None else ReferenceFile.of(request.reference)
    if reference is not None:
        open_reference(reference)
    errors, remarks = _uncertainty_model(request, archive, platform_of(archive))
    bins = bin_count(float(archive["max_depth"].sel(profile=list(numbers)).max()), settings.bin)
    return Preparation(
        inputs=(errors, bins, reference),
        sizes={"bin": bins},
        attributes={"errors": errors.current.model_dump(), "by_hull": errors.by_hull},
        remarks=remarks,
    )


def _uncertainty_model(
    request: Request, archive: Archive, platform: Platform
) -> tuple[UncertaintyModel, tuple[str, ...]]:
    """Terms of the uncertainty: those of the budget if one is given, otherwise those of the mission's run."""
    settings = settings_of(archive).current
    if request.budget is None:
        model = UncertaintyModel(settings.errors(platform), float("nan"), by_hull=settings.by_hull)
        return model, (
            f"no `budget` given: the ellipses are the run's own ({_origin(platform, model)}), and the yaw moment's "
            "noise floor is not known; `gliderhpc twin recoverability` and then `twin currents` measure both for a "
            "hull",
        )
    budget = read_budget(request.budget)
    remarks: tuple[str, ...] = ()
    if budget.platform != platform.name:
        remarks = (f"{request.budget}: was measured for {budget.platform}, this mission flew {platform.name}",)
    # The budget states the terms of the displacement; those of fixes, actuation and surface remain the run's.
    terms = settings.errors(platform).model_copy(update={name: getattr(budget, name) for name in TERMS})
    return UncertaintyModel(terms, budget.identification_noise), remarks


def _origin(platform: Platform, model: UncertaintyModel) -> str:
    if model.by_hull:
        return "with the hull's errors"
    return "the paper's terms" if platform.calibration is None else "terms measured with calibrated hulls"


STUDY = Study(
    NAME,
    "depth-averaged and depth-resolved currents with their uncertainty",
    settings=DepthResolvedSettings,
    prepare=prepare,
    profile=study_profile,
)
