"""Study ``reconstruction``: reproduction of the records by the estimated disturbances (section 5.1)."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from gliderhpc.archive.profile import ADJOINT, SETTLING, ProfileData, goes_by_density
from gliderhpc.errors import InputError, ProfileError
from gliderhpc.estimation.filter import run_filter
from gliderhpc.estimation.preparation import controls_of, on_steps
from gliderhpc.estimation.profile import ProfileEstimate, estimate_profile
from gliderhpc.estimation.self_motion import SelfMotion, model_motion
from gliderhpc.flight.glider import Glider
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.observations import ProfileRecord, ProfileSeries, Survey, open_observations
from gliderhpc.observations.truth import most_impulses, read_profile_truth
from gliderhpc.platform import Platform, with_overrides
from gliderhpc.studies.archived import platform_of, settings_of
from gliderhpc.studies.library.profile_reconstruction import (
    cost_row,
    motions_of,
    named_rms,
    open_loop_row,
    self_motion_row,
    tracking_row,
    vibration_row,
)
from gliderhpc.studies.reconstruction.comparison import (
    TRUE_YAW,
    estimators,
    regime_row,
    true_yaw,
    truth_columns,
)
from gliderhpc.studies.study import Preparation, ProfileContext, Request, Row, Study
from gliderhpc.vocabulary import CHANNELS

HEAVE = 2


def without_depth_slope_row(
    data: ProfileData, nominal: SelfMotion, record: ProfileRecord, platform: Platform, settings: MissionSettings
) -> dict[str, Any]:
    """Invert a profile with ``k_z = 0``: effect on tracking, heave disturbance and self-motion.

    Parameters
    ----------
    data, nominal : ProfileData, SelfMotion
        The archive's estimate, with the hull's own ``k_z``, and its self-motion.
    record : ProfileRecord
        The record to invert.
    platform, settings : Platform, MissionSettings
        The archive's.

    Raises
    ------
    ProfileError
        The filter cannot follow the record without the compensation.

    Notes
    -----
    The heave channel has to supply the compensation that the model lacks: the slope of the difference with depth should
    come near ``-k_z cos(theta)``.
    """
    glider = Glider(with_overrides(platform, {"buoyancy.depth_slope": "0"}))
    series = on_steps(record, settings)
    estimate = estimate_profile(glider, series, settings)
    residuals = estimate.residuals
    counted = (series.weights > 0.0) & (series.time - series.time[0] >= SETTLING)
    motion = model_motion(estimate.solution.states, estimate.vibrating, series.step)
    row = {
        **named_rms("no_slope_steady", residuals[counted & ~estimate.vibrating]),
        **named_rms("no_slope_vibration", residuals[counted & estimate.vibrating]),
        "no_slope_heave_slope": _heave_slope(data, estimate),
        "filter_seconds": _filter_seconds(glider, series, estimate, settings),
    }
    before = nominal.total
    length = float(np.linalg.norm(before))
    change = float(np.linalg.norm(motion.total - before))
    row["no_slope_self_motion"] = change / length if length > 0.0 else float("nan")
    return row


def _heave_slope(data: ProfileData, estimate: ProfileEstimate) -> float:
    """Slope (N/m) with depth of the heave disturbance without the compensation less that with it, in steady glide."""
    n = min(len(estimate.solution.disturbances), len(data.time))
    steady = data.steady[:n]
    difference = estimate.solution.disturbances[:n, HEAVE][steady] - data.disturbances[:n, HEAVE][steady]
    depth = estimate.series.measurements[:n, 3][steady]
    known = np.isfinite(difference)
    return float(np.polyfit(depth[known], difference[known], 1)[0]) if known.sum() > 1 else float("nan")


def _filter_seconds(
    glider: Glider, series: ProfileSeries, estimate: ProfileEstimate, settings: MissionSettings
) -> float:
    bodies = glider.bodies(controls_of(glider.platform, series))
    began = time.perf_counter()
    run_filter(glider, series, bodies, estimate.vibrating, settings)
    return time.perf_counter() - began


NAME = "reconstruction"


@dataclass(frozen=True)
class Source:
    """The observation file, and its profiles to invert with ``k_z = 0``."""

    path: str
    survey: Survey
    numbers: tuple[int, ...]


@dataclass(frozen=True)
class ReconstructionInputs:
    """Inputs that the profiles share: the observations, the place of the truth, and its largest count of impulses."""

    source: Source | None
    truth: str | None
    impulses: int


def study_profile(data: ProfileData, context: ProfileContext) -> Row:
    """Reconstruction of one profile: tracking, open loop, self-motion, cost, regimes; and errors against a truth."""
    archive, platform, inputs = context.archive, context.platform, context.inputs
    motions = motions_of(data, platform)
    row: dict[str, Any] = {
        **tracking_row(data),
        **open_loop_row(data, Glider(platform)),
        **self_motion_row(data, motions),
        **vibration_row(data),
        **cost_row(archive, data),
        **regime_row(data),
    }
    if inputs.source is not None and data.number in inputs.source.numbers:
        with open_observations(inputs.source.path, survey=inputs.source.survey.only([data.number])) as observations:
            try:
                record = observations.profile(data.number)
                row |= without_depth_slope_row(data, motions.estimate, record, platform, settings_of(archive))
            except ProfileError as error:
                row["message"] = f"not inverted with k_z = 0: {error}"
    if inputs.truth is None:
        return row
    truth = read_profile_truth(inputs.truth, data.number)
    return {**row, **truth_columns(data, truth, inputs.impulses), TRUE_YAW: true_yaw(data, truth)}


def prepare(request: Request, archive: xr.DataTree, numbers: tuple[int, ...], settings: None) -> Preparation:
    """Find the records to invert with ``k_z = 0``, and the size of the truth.

    Raises
    ------
    InputError
        The observation file or the truth is not the archive's.
    """
    source, remarks = _source(request, archive, platform_of(archive), numbers)
    truth = None if request.truth is None else str(request.truth.resolve())
    # An axis has one place at least, whether or not there was an impulse.
    impulses = 1 if truth is None else max(1, most_impulses(truth))
    return Preparation(
        ReconstructionInputs(source, truth, impulses),
        {"impulse": impulses},
        {"channel": list(CHANNELS), "estimator": estimators(request.estimate)},
        {"with_truth": truth is not None},
        remarks,
    )


def _source(
    request: Request, archive: xr.DataTree, platform: Platform, numbers: tuple[int, ...]
) -> tuple[Source | None, tuple[str, ...]]:
    """Observations of the profiles to be inverted with k_z = 0, and why others are not."""
    if request.estimate != ADJOINT:
        return None, ("the inversion with k_z = 0 is held against the adjoint, so there is none here",)
    if platform.buoyancy.depth_slope == 0.0:
        return None, ("the hull's k_z is zero already, so there is no second inversion",)
    by_slope = tuple(number for number in numbers if not goes_by_density(archive, number))
    remarks = () if by_slope == numbers else (
        "where the buoyancy goes by measured density there is no inversion with k_z = 0, for k_z compensates nothing",
    )  # fmt: skip
    if not by_slope:
        return None, remarks
    if request.observations is None:
        return None, ("no --observations given: the inversion with k_z = 0 and the filter's time are left out",)
    with open_observations(request.observations) as opened:
        if opened.digest() != archive.attrs.get("observations_digest"):
            raise InputError(
                f"{request.observations}: is not the file that the archive was made from "
                f"({archive.attrs.get('observations')})"
            )
        path = str(Path(request.observations).resolve())
        chosen = by_slope[:1] if request.quick else by_slope
        return Source(path, opened.survey.only(list(chosen)), chosen), remarks


STUDY = Study(
    NAME,
    "how the estimated motion follows the records; filter against adjoint",
    prepare=prepare,
    profile=study_profile,
    takes_settings=False,
)
