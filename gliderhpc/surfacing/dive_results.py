"""Message of a surfacing, collected from the archive: the results of one dive."""

import math

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gliderhpc.archive.current import adopted_current
from gliderhpc.archive.mission import platform_name
from gliderhpc.archive.profile import ADJOINT, SMOOTHED, ProfileData, filter_fallbacks, read_profile_data
from gliderhpc.archive.reader import Archive
from gliderhpc.distributions import chi_square_quantile
from gliderhpc.estimation.quality import MAX_REJECTED_SHARE
from gliderhpc.findings.formatting import iso_instant
from gliderhpc.studies.archived import platform_or_none
from gliderhpc.studies.hull import has_statements
from gliderhpc.studies.library.scores import covariance_matrix, ellipse_axes
from gliderhpc.surfacing.dive_plan import DivePlan
from gliderhpc.surfacing.message import (
    MESSAGE_VERSION,
    Current,
    Ellipse,
    Fix,
    HullParameter,
    Inversion,
    NextSurfacing,
    SurfacingMessage,
    Water,
)
from gliderhpc.surfacing.next_surfacing import PROBABILITY, predict_surfacing
from gliderhpc.surfacing.recent_hull import hull_changes, joint_change, recent_hull, trim_of
from gliderhpc.vocabulary import QUALITY
from gliderhpc.wording import counted

Array = NDArray[np.float64]

_SHARES = {"gap_in_the_record": 0.05, "implausible_self_motion": 0.01, "prior_used_because_the_window_failed": 0.01}
"""Quality flags, and the fraction of a dive above which a remark is added for each."""


def error_ellipse(covariance: Array, probability: float = PROBABILITY) -> Ellipse:
    """Return the ellipse of a Gaussian about its mean.

    Parameters
    ----------
    covariance : (2, 2) array
        Covariance of north and east.
    probability : float
        Probability that it contains the true value.
    """
    longer, shorter, angle = ellipse_axes(covariance)
    scale = math.sqrt(chi_square_quantile(probability, 2))
    direction = (90.0 - angle) % 180.0
    return Ellipse(probability=probability, major=scale * longer, minor=scale * shorter, direction=direction)


def surfacing_message(
    archive: Archive,
    number: int,
    revision: int = 0,
    changes: tuple[str, ...] = (),
    plan: DivePlan | None = None,
) -> SurfacingMessage:
    """Collect the message of one profile of an archive.

    Parameters
    ----------
    archive : Archive
        The archive, opened.
    number : int
        Number of a profile that is done or has failed.
    revision, changes
        Revision of the message, and the changes since the previous one.
    plan : DivePlan, optional
        Plan of the next dive.
    """
    row = archive.to_dataset().sel(profile=number).load()
    done = str(row["status"].values) == "done"
    smoothed = done and has_smoothed(archive, number)
    data = read_best_estimate(archive, number, smoothed=smoothed) if done else None
    hull = recent_hull(archive, number) if done and _has_hull_information(archive) else None
    return SurfacingMessage(
        version=MESSAGE_VERSION,
        mission=str(archive.attrs.get("mission") or ""),
        platform=platform_name({str(key): value for key, value in archive.attrs.items()}),
        profile=number,
        revision=revision,
        changes=changes,
        start_time=iso_instant(row["start_time"].values) or "",
        duration=_value(row, "duration") or 0.0,
        max_depth=_value(row, "max_depth"),
        samples=_count(row, "sample_count"),
        surfacing=_surfacing(row),
        current=current_of_dive(row),
        surface_drift=_pair(row, "surface_drift_north", "surface_drift_east"),
        water=None if data is None else water_of_dive(archive, data),
        next_surfacing=_next_surfacing(archive, number, plan) if smoothed else None,
        inversion=Inversion(
            status=str(row["status"].values),
            message=str(row["message"].values),
            windows=_count(row, "window_count"),
            converged_fraction=_value(row, "converged_fraction"),
            smoothed=smoothed,
            seconds=_value(row, "run_seconds"),
        ),
        odd=() if data is None else _anomalies(row, data),
        hull=_hull(archive, number) if smoothed else (),
        hull_changes=() if hull is None else hull_changes(hull),
        hull_joint_change=None if hull is None else joint_change(hull),
        trim=() if hull is None else tuple(trim_of(hull)),
        hull_warning="" if hull is None else hull.warning,
    )


def has_smoothed(archive: Archive, number: int) -> bool:
    """Return whether the smoother has an estimate of a done profile."""
    return "smoothed" in archive.children and not filter_fallbacks(archive, [number])


def _count(row: xr.Dataset, name: str) -> int:
    return int(_value(row, name) or 0)


def _value(row: xr.Dataset, name: str) -> float | None:
    value = float(row[name]) if name in row else math.nan
    return value if math.isfinite(value) else None


def _pair(row: xr.Dataset, first: str, second: str) -> tuple[float, float] | None:
    value, second_value = _value(row, first), _value(row, second)
    return None if value is None or second_value is None else (value, second_value)


def _surfacing(row: xr.Dataset) -> Fix | None:
    position = _pair(row, "exit_latitude", "exit_longitude")
    if position is None:
        return None
    return Fix(time=iso_instant(row["exit_time"].values) or "", latitude=position[0], longitude=position[1])


def _next_surfacing(archive: Archive, number: int, plan: DivePlan | None) -> NextSurfacing | None:
    predicted = predict_surfacing(archive, number, plan)
    if predicted is None:
        return None
    return NextSurfacing(
        plan="" if plan is None else plan.text,
        time=iso_instant(predicted.time) or "",
        latitude=predicted.latitude,
        longitude=predicted.longitude,
        ellipse=error_ellipse(predicted.covariance),
        current_north=float(predicted.current[0]),
        current_east=float(predicted.current[1]),
        current_ellipse=error_ellipse(predicted.current_covariance),
        dives=predicted.dives,
        deviation=predicted.deviation,
        correlation_time=predicted.correlation_time,
    )


def current_of_dive(row: xr.Dataset) -> Current | None:
    """Return the adopted current from a profile's row of the archive's table; None if it is not known."""
    adopted = adopted_current(row)
    if not adopted.known:
        return None
    north, east, north_std, east_std, covariance = (
        float(value) for value in (adopted.north, adopted.east, adopted.north_std, adopted.east_std, adopted.covariance)
    )
    return Current(
        north=north,
        east=east,
        north_std=north_std,
        east_std=east_std,
        covariance=covariance,
        speed=math.hypot(north, east),
        direction=math.degrees(math.atan2(east, north)) % 360.0,
        ellipse=error_ellipse(covariance_matrix(north_std, east_std, covariance)),
        estimate=str(adopted.estimate),
    )


def read_best_estimate(archive: Archive, number: int, *, smoothed: bool) -> ProfileData:
    """Read a done profile with the smoother's estimate, or with the adjoint's where the smoother has none."""
    return read_profile_data(archive, number, SMOOTHED if smoothed else ADJOINT)


def water_of_dive(archive: Archive, data: ProfileData) -> Water | None:
    """Return the motion through the water of a profile, with errors where the estimate is the smoother's.

    Without any velocity in the archive it is None.
    """
    motion, duration = data.motion, float(data.time[-1])
    speeds = np.linalg.norm(motion[:, 2:5], axis=1)
    if not np.isfinite(speeds).any():
        return None
    north, east = (float(value) for value in motion[-1, :2] - motion[0, :2])
    deviations: dict[str, float | None] = dict.fromkeys(("north_std", "east_std", "horizontal_speed_std"))
    if data.estimate == SMOOTHED:
        row = archive["smoothed"].to_dataset().sel(profile=data.number)
        north, east = (float(row[f"displacement_{name}"]) for name in ("north", "east"))
        deviations = _displacement_errors(row, np.array([north, east]), duration)
    return Water(
        speed=float(np.nanmean(speeds)),
        horizontal_speed=math.hypot(north, east) / duration,
        north=north,
        east=east,
        **deviations,
    )


def displacement_covariance(row: xr.Dataset) -> Array:
    """Return the covariance (2, 2) of the displacement north and east (m2) from a row of group ``smoothed``."""
    return covariance_matrix(*(row[f"displacement_{name}"] for name in ("north_std", "east_std", "covariance")))


def _displacement_errors(row: xr.Dataset, displacement: Array, duration: float) -> dict[str, float | None]:
    covariance = displacement_covariance(row)
    along = displacement / max(float(np.linalg.norm(displacement)), 1e-9)
    values = {
        "north_std": math.sqrt(covariance[0, 0]),
        "east_std": math.sqrt(covariance[1, 1]),
        "horizontal_speed_std": math.sqrt(float(along @ covariance @ along)) / duration,
    }
    return {name: value if math.isfinite(value) else None for name, value in values.items()}


def _anomalies(row: xr.Dataset, data: ProfileData) -> tuple[str, ...]:
    """List the anomalies in the records of a profile, beginning with the archive's own remarks."""
    remarks = [part for part in str(row["message"].values).split("; ") if part]
    gated, samples = _count(row, "gated_count"), _count(row, "sample_count")
    if gated > MAX_REJECTED_SHARE * samples:
        remarks.append(f"the filter rejected {gated} of {counted(samples, 'sample')}")
    if data.estimate != SMOOTHED:
        remarks.append("the smoother diverged; the filter's estimate is used")
    for meaning, share in _SHARES.items():
        part = float(np.mean((data.quality & QUALITY.meanings[meaning]) != 0))
        if part > share:
            remarks.append(f"{meaning.replace('_', ' ')}: {part:.0%} of the time")
    return tuple(dict.fromkeys(remarks))


def _has_hull_information(archive: Archive) -> bool:
    """Return whether the archive has the dives' information on a hull that this program can read."""
    return platform_or_none(archive) is not None and has_statements(archive)


def _hull(archive: Archive, number: int) -> tuple[HullParameter, ...]:
    if "hull" not in archive.children:
        return ()
    row = archive["hull"].to_dataset().sel(profile=number).load()
    columns = ("parameter", "value", "plausible_deviation", "estimate_alone", "estimate_alone_std")
    rows = zip(*(row[name].values.tolist() for name in columns), strict=True)
    return tuple(
        HullParameter(parameter=name, value=value, plausible_deviation=deviation, error=error, error_std=std)
        for name, value, deviation, error, std in rows
        if all(map(math.isfinite, (value, deviation, error, std)))
    )
