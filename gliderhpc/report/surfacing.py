"""Message of a surfacing: results of one dive, as a model that states its own JSON schema."""

import math
from dataclasses import asdict
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from gliderhpc.archive.current import adopted_current
from gliderhpc.archive.profile import ADJOINT, SMOOTHED, ProfileData, filter_fallbacks, read_profile_data
from gliderhpc.archive.reader import Archive
from gliderhpc.report.facts import ellipse_axes, iso_instant, platform_name, polar
from gliderhpc.report.hull_news import hull_news
from gliderhpc.report.next_surfacing import predict_surfacing
from gliderhpc.vocabulary import QUALITY

Array = NDArray[np.float64]

MESSAGE_VERSION = "1.0"
"""Version of the message; the first number changes when a field changes its meaning or goes."""

PROBABILITY = 0.68
"""Probability that an ellipse holds the true value."""

_SHARES = {"gap_in_the_record": 0.05, "implausible_self_motion": 0.01, "prior_used_because_the_window_failed": 0.01}
"""Quality flags, and the part of a dive from which each is worth a remark."""

_FIFTH = 0.2

_MANY_GATED = 0.02
"""Part of the samples refused by the filter from which this is worth a remark."""


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


def _of(unit: str, what: str) -> Any:
    return Field(description=f"{what} ({unit})" if unit else what)


class Ellipse(_Part):
    """Region of two components that holds the true value with a probability."""

    probability: float = _of("1", "probability that it holds the true value")
    major: float = _of("", "longer semi-axis, in the unit of the components")
    minor: float = _of("", "shorter semi-axis, in the unit of the components")
    direction: float = _of("degree", "direction of the longer semi-axis, clockwise from north, 0 to 180")


class Current(_Part):
    """Depth-averaged current of the dive."""

    north: float = _of("m s-1", "to the north")
    east: float = _of("m s-1", "to the east")
    north_std: float = _of("m s-1", "standard deviation of north")
    east_std: float = _of("m s-1", "standard deviation of east")
    covariance: float = _of("m2 s-2", "covariance of north and east")
    speed: float = _of("m s-1", "speed")
    direction: float = _of("degree", "direction towards which it flows, clockwise from north")
    ellipse: Ellipse
    estimate: str = _of("", "smoothed, or adjoint where the smoother has none")


class Water(_Part):
    """Motion through the water."""

    speed: float = _of("m s-1", "mean speed along the path")
    horizontal_speed: float = _of("m s-1", "length of the displacement over the dive's duration")
    horizontal_speed_std: float | None = _of("m s-1", "its standard deviation")
    north: float = _of("m", "displacement to the north")
    east: float = _of("m", "displacement to the east")
    north_std: float | None = _of("m", "standard deviation of north")
    east_std: float | None = _of("m", "standard deviation of east")


class Fix(_Part):
    """Time and position."""

    time: str = _of("", "ISO 8601, UTC")
    latitude: float = _of("degree_north", "latitude")
    longitude: float = _of("degree_east", "longitude")


class Inversion(_Part):
    """State of the dive in the archive."""

    status: str = _of("", "done or failed")
    message: str = _of("", "why it failed, or what to mind about it")
    windows: int = _of("1", "windows solved")
    converged_fraction: float | None = _of("1", "part of the windows that converged")
    smoothed: bool = _of("", "whether the smoother has an estimate")
    seconds: float | None = _of("s", "computing time")


class HullParameter(_Part):
    """Error of one number of the platform file."""

    parameter: str = _of("", "key in the platform file")
    value: float = _of("", "value in the platform file, in its unit")
    plausible_deviation: float = _of("", "plausible standard deviation, in that unit or relative")
    error: float = _of("1", "error by this dive alone, in plausible deviations")
    error_std: float = _of("1", "its standard deviation")


class HullChange(_Part):
    """Change of one number of the platform file over the dives so far, at most the last hundred."""

    parameter: str = _of("", "key in the platform file")
    meaning: str = _of("", "description")
    unit: str = _of("", "unit of value and change")
    first: float = _of("", "value at the first of the dives")
    probability: float = _of("1", "probability that it changed since, one half before the dives")
    change: float = _of("", "change from the first dive to this one, if it changed")
    change_std: float = _of("", "standard deviation of change")
    since: int = _of("1", "number of the first dive that is changed, median")
    dives: int = _of("1", "dives that it goes by")
    above_20_percent: float = _of("1", "probability that it grew by more than a fifth of first")


class NextSurfacing(_Part):
    """End of a next dive of the same displacement and duration, by the currents so far."""

    time: str = _of("", "ISO 8601, UTC")
    latitude: float = _of("degree_north", "latitude")
    longitude: float = _of("degree_east", "longitude")
    ellipse: Ellipse = _of("m", "of the position")
    current_north: float = _of("m s-1", "predicted mean current until then, to the north")
    current_east: float = _of("m s-1", "predicted mean current until then, to the east")
    current_ellipse: Ellipse = _of("m s-1", "of the predicted current, the hull's errors included")
    dives: int = _of("1", "dives whose currents it goes by")
    deviation: float = _of("m s-1", "standard deviation of the current's variable part")
    correlation_time: float = _of("s", "correlation time of the current's variable part")


class SurfacingMessage(_Part):
    """Results of one dive, at its surfacing."""

    version: str = _of("", "version of this message")
    mission: str
    platform: str = _of("", "name of the hull")
    profile: int = _of("1", "number of the profile in the archive")
    revision: int = _of("1", "0 for the first message of a dive; higher where its record has changed since")
    changes: tuple[str, ...] = _of("", "what changed since the revision before")
    start_time: str = _of("", "first sample, ISO 8601, UTC")
    duration: float = _of("s", "time from the first to the last sample")
    max_depth: float | None = _of("m", "greatest depth")
    samples: int = _of("1", "number of samples")
    surfacing: Fix | None = _of("", "first fix after the dive")
    current: Current | None
    surface_drift: tuple[float, float] | None = _of("m s-1", "drift at the surface, north and east")
    water: Water | None
    next_surfacing: NextSurfacing | None
    inversion: Inversion
    odd: tuple[str, ...] = _of("", "what is odd in the records")
    hull: tuple[HullParameter, ...] = _of("", "errors of the hull by this dive alone, where they were estimated")
    hull_changes: tuple[HullChange, ...] = _of("", "changes of what can change, from the fourth dive on")

    def changes_since(self, earlier: str) -> tuple[str, ...]:
        """List what differs from an earlier message, given as JSON."""
        before = SurfacingMessage.model_validate_json(earlier)
        pairs = {
            "samples": (before.samples, self.samples),
            "duration, s": (round(before.duration), round(self.duration)),
            "greatest depth, m": (_rounded(before.max_depth, 0), _rounded(self.max_depth, 0)),
            "current north, m/s": (_component(before.current, "north"), _component(self.current, "north")),
            "current east, m/s": (_component(before.current, "east"), _component(self.current, "east")),
            "status": (before.inversion.status, self.inversion.status),
        }
        return tuple(f"{name}: {one} to {other}" for name, (one, other) in pairs.items() if one != other)

    @property
    def line(self) -> str:
        """One line for a terminal."""
        parts = [f"dive {self.profile}" + (f" (revision {self.revision})" if self.revision else "")]
        if self.max_depth is not None:
            parts.append(f"{self.max_depth:.0f} m, {self.duration / 60.0:.0f} min")
        if self.current is not None:
            ellipse = self.current.ellipse
            parts.append(f"current {polar(self.current.north, self.current.east)} ± {ellipse.major:.3f}")
        elif self.inversion.status == "done":
            parts.append("current unknown")
        if self.water is not None:
            parts.append(f"through the water {self.water.speed:.3f} m/s")
        if self.surfacing is not None:
            parts.append(f"at {self.surfacing.latitude:.4f}, {self.surfacing.longitude:.4f}")
        if self.next_surfacing is not None:
            following = self.next_surfacing
            place = f"{following.latitude:.4f}, {following.longitude:.4f}"
            parts.append(f"next {following.time[11:16]} at {place} ± {following.ellipse.major:.0f} m")
        if self.inversion.status != "done":
            parts.append(f"failed: {self.inversion.message}")
        elif self.inversion.converged_fraction is not None:
            parts.append(f"{self.inversion.converged_fraction:.0%} of {self.inversion.windows} windows converged")
        if self.odd:
            parts.append(f"odd: {'; '.join(self.odd)}")
        return "; ".join(parts)


def _rounded(value: float | None, digits: int) -> str:
    return "unknown" if value is None else f"{value:.{digits}f}"


def _component(current: Current | None, name: str) -> str:
    return _rounded(None if current is None else getattr(current, name), 3)


def error_ellipse(covariance: Array, probability: float = PROBABILITY) -> Ellipse:
    """Return the ellipse of a Gaussian about its mean.

    Parameters
    ----------
    covariance : (2, 2) array
        Of north and east.
    probability : float
        That it holds the true value.
    """
    longer, shorter, angle = ellipse_axes(covariance)
    # The square of a two-dimensional Mahalanobis distance is exponentially distributed with mean 2.
    scale = math.sqrt(-2.0 * math.log1p(-probability))
    direction = (90.0 - angle) % 180.0
    return Ellipse(probability=probability, major=scale * longer, minor=scale * shorter, direction=direction)


def surfacing_message(
    archive: Archive, number: int, revision: int = 0, changes: tuple[str, ...] = ()
) -> SurfacingMessage:
    """Collect the message of one profile of an archive.

    Parameters
    ----------
    archive : Archive
        The archive, opened.
    number : int
        Number of a profile that is done or has failed.
    revision, changes
        Of the message.
    """
    row = archive.to_dataset().sel(profile=number).load()
    done = str(row["status"].values) == "done"
    data = read_profile_data(archive, number) if done else None
    smoothed = done and not filter_fallbacks(archive, [number])
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
        samples=int(row["sample_count"]),
        surfacing=_surfacing(row),
        current=_current(row),
        surface_drift=_pair(row, "surface_drift_north", "surface_drift_east"),
        water=_water(archive, number, smoothed) if done else None,
        next_surfacing=_next_surfacing(archive, number) if smoothed else None,
        inversion=Inversion(
            status=str(row["status"].values),
            message=str(row["message"].values),
            windows=int(row["window_count"]) if done else 0,
            converged_fraction=_value(row, "converged_fraction"),
            smoothed=smoothed,
            seconds=_value(row, "run_seconds"),
        ),
        odd=() if data is None else _odd(row, data, smoothed),
        hull=_hull(archive, number) if smoothed else (),
        hull_changes=_hull_changes(archive, number) if smoothed else (),
    )


def _value(row: xr.Dataset, name: str) -> float | None:
    value = float(row[name]) if name in row else math.nan
    return value if math.isfinite(value) else None


def _pair(row: xr.Dataset, first: str, second: str) -> tuple[float, float] | None:
    one, other = _value(row, first), _value(row, second)
    return None if one is None or other is None else (one, other)


def _surfacing(row: xr.Dataset) -> Fix | None:
    place = _pair(row, "exit_latitude", "exit_longitude")
    if place is None:
        return None
    return Fix(time=iso_instant(row["exit_time"].values) or "", latitude=place[0], longitude=place[1])


def _next_surfacing(archive: Archive, number: int) -> NextSurfacing | None:
    found = predict_surfacing(archive, number)
    if found is None:
        return None
    return NextSurfacing(
        time=iso_instant(found.time) or "",
        latitude=found.latitude,
        longitude=found.longitude,
        ellipse=error_ellipse(found.covariance),
        current_north=float(found.current[0]),
        current_east=float(found.current[1]),
        current_ellipse=error_ellipse(found.current_covariance),
        dives=found.dives,
        deviation=found.deviation,
        correlation_time=found.correlation_time,
    )


def _current(row: xr.Dataset) -> Current | None:
    found = adopted_current(row)
    if not found.known:
        return None
    north, east, north_std, east_std, covariance = (
        float(value) for value in (found.north, found.east, found.north_std, found.east_std, found.covariance)
    )
    matrix = np.array([[north_std**2, covariance], [covariance, east_std**2]])
    return Current(
        north=north,
        east=east,
        north_std=north_std,
        east_std=east_std,
        covariance=covariance,
        speed=math.hypot(north, east),
        direction=math.degrees(math.atan2(east, north)) % 360.0,
        ellipse=error_ellipse(matrix),
        estimate=str(found.estimate),
    )


def _water(archive: Archive, number: int, smoothed: bool) -> Water:
    data = read_profile_data(archive, number, SMOOTHED if smoothed else ADJOINT)
    motion, duration = data.motion, float(data.time[-1])
    north, east = (float(value) for value in motion[-1, :2] - motion[0, :2])
    deviations: dict[str, float | None] = dict.fromkeys(("north_std", "east_std", "horizontal_speed_std"))
    if smoothed:
        row = archive["smoothed"].to_dataset().sel(profile=number)
        north, east = (float(row[f"displacement_{name}"]) for name in ("north", "east"))
        deviations = _displacement_errors(row, np.array([north, east]), duration)
    return Water(
        speed=float(np.nanmean(np.linalg.norm(motion[:, 2:5], axis=1))),
        horizontal_speed=math.hypot(north, east) / duration,
        north=north,
        east=east,
        **deviations,
    )


def displacement_covariance(row: xr.Dataset) -> Array:
    """Covariance (2, 2) of the displacement north and east (m2) from a row of group ``smoothed``."""
    north, east, both = (float(row[f"displacement_{name}"]) for name in ("north_std", "east_std", "covariance"))
    return np.array([[north**2, both], [both, east**2]])


def _displacement_errors(row: xr.Dataset, displacement: Array, duration: float) -> dict[str, float | None]:
    covariance = displacement_covariance(row)
    along = displacement / max(float(np.linalg.norm(displacement)), 1e-9)
    values = {
        "north_std": math.sqrt(covariance[0, 0]),
        "east_std": math.sqrt(covariance[1, 1]),
        "horizontal_speed_std": math.sqrt(float(along @ covariance @ along)) / duration,
    }
    return {name: value if math.isfinite(value) else None for name, value in values.items()}


def _odd(row: xr.Dataset, data: ProfileData, smoothed: bool) -> tuple[str, ...]:
    """List what is odd in the records of a profile, the archive's own remark first."""
    remarks = [part for part in str(row["message"].values).split("; ") if part]
    gated, samples = int(row["gated_count"]), int(row["sample_count"])
    if gated > _MANY_GATED * samples:
        remarks.append(f"the filter refused {gated} of {samples} samples")
    if not smoothed:
        remarks.append("the smoother diverged; the filter's estimate is used")
    for meaning, share in _SHARES.items():
        part = float(np.mean((data.quality & QUALITY.meanings[meaning]) != 0))
        if part > share:
            remarks.append(f"{meaning.replace('_', ' ')}: {part:.0%} of the time")
    return tuple(dict.fromkeys(remarks))


def _hull_changes(archive: Archive, number: int) -> tuple[HullChange, ...]:
    if "hull" not in archive.children:
        return ()
    return tuple(
        HullChange(**asdict(news), above_20_percent=news.probability_above(_FIFTH))
        for news in hull_news(archive, number)
    )


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
