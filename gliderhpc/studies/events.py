"""Study ``events``: catalogue of impulsive events stronger than any in the nulls, with time and place (section 5.3)."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray
from pydantic import Field

from gliderhpc.archive.profile import ProfileData
from gliderhpc.archive.reader import Archive
from gliderhpc.distributions import MAD_TO_STD
from gliderhpc.observations.regions import wrapped_longitude
from gliderhpc.store_schema.columns import CATALOGUE, EVENT
from gliderhpc.studies.archived import outdated_input_remarks, platform_of
from gliderhpc.studies.library.tracks import estimated_positions, motions_of
from gliderhpc.studies.library.turbulence.ensembles import NullFloor, null_floor
from gliderhpc.studies.library.turbulence.series import (
    ChannelSeries,
    FastSettings,
    GappySeries,
    channel_of,
    fast_part,
    missing_band,
)
from gliderhpc.studies.request import Request
from gliderhpc.studies.study import GroupContent, Plan, Preparation, ProfileContext, Row, Study

Array = NDArray[np.float64]

NAME = "events"


class EventSettings(FastSettings):
    """Threshold and separation of events, and the samples that are searched."""

    threshold: float | None = Field(
        None, gt=0, description="smallest magnitude, N or N m; null: the nulls' ceiling or, without nulls, sigma"
    )
    sigma: float = Field(6.0, gt=0, description="smallest magnitude in noise floors, if there are no nulls")
    separation: float = Field(5.0, gt=0, description="of two peaks closer than this, only the larger counts, s")
    actuated: bool = Field(
        False, description="whether to include samples at which actuators move or the battery is rotated"
    )
    strongest: int = Field(12, ge=1, description="number of events in the table of the strongest")


# Peaks


@dataclass(frozen=True, eq=False)
class Peaks:
    """Peaks of the magnitude of a series.

    Attributes
    ----------
    at : (k,) int array
        Indices of the peaks' samples.
    amplitude : (k,) array
        Values at the peaks, with their sign.
    width : (k,) array
        Time over which the series is at least half as large, with the same sign, s.
    """

    at: NDArray[np.int64]
    amplitude: Array
    width: Array


def find_peaks(series: GappySeries, threshold: float, separation: float) -> Peaks:
    """Find the peaks above a threshold that are the largest within `separation` (s), among the samples used."""
    magnitude = np.where(series.counted, np.abs(series.values), 0.0)
    # The first or the last sample may be a peak too.
    padded = np.concatenate([[0.0], magnitude, [0.0]])
    distance = max(1, round(separation / series.step))
    at = np.asarray(scipy.signal.find_peaks(padded, height=threshold, distance=distance)[0] - 1, dtype=np.int64)
    widths = [_half_width(series.values, int(sample)) * series.step for sample in at]
    return Peaks(at, series.values[at], np.array(widths))


def _half_width(values: Array, at: int) -> int:
    """Number of consecutive samples around a peak that have at least half its value."""
    below = values * np.sign(values[at]) < 0.5 * abs(values[at])
    before, after = below[:at][::-1], below[at:]
    left = int(np.argmax(before)) if before.any() else at
    right = int(np.argmax(after)) if after.any() else len(after)
    return left + right


def noise_floor(series: GappySeries) -> float:
    """Standard deviation of a Gaussian series with the same median magnitude; impulses hardly affect it."""
    values = series.values[series.counted]
    return float(MAD_TO_STD * np.median(np.abs(values))) if values.size else float("nan")


# One profile


def study_profile(data: ProfileData, context: ProfileContext) -> Row:
    """Find noise floor, number of events and ``events`` of one profile; events have the catalogue's columns."""
    settings: EventSettings = context.settings
    floor: NullFloor | None = context.inputs
    channel = channel_of(data, settings.channel, context.platform)
    part = fast_part(channel, settings, actuated=settings.actuated)
    if part.message:
        return {"message": part.message}
    noise = noise_floor(part.series) if floor is None else floor.noise
    threshold = _threshold(settings, floor, noise)
    peaks = find_peaks(part.series, threshold, settings.separation)
    positions = _positions(context.archive, data, channel.time[peaks.at])
    events = [
        {
            "source_profile": data.number,
            **_sample_columns(data, channel, int(sample)),
            "latitude": float(position[0]),
            "longitude": wrapped_longitude(float(position[1])),
            "channel": settings.channel,
            "amplitude": float(amplitude),
            "width": float(width),
            "sigma": abs(float(amplitude)) / noise if noise > 0.0 else float("nan"),
            "over_ceiling": abs(float(amplitude)) / threshold,
        }
        for sample, position, amplitude, width in zip(peaks.at, positions, peaks.amplitude, peaks.width, strict=True)
    ]
    return {"noise": noise, "count": len(events), "events": events}


def _sample_columns(data: ProfileData, channel: ChannelSeries, sample: int) -> dict[str, Any]:
    return {
        "time": data.epoch + np.timedelta64(round(float(channel.time[sample]) * 1e9), "ns"),
        "depth": float(channel.depth[sample]),
        "quality": int(channel.quality[sample]),
    }


def _threshold(settings: EventSettings, floor: NullFloor | None, noise: float) -> float:
    if settings.threshold is not None:
        return settings.threshold
    return settings.sigma * noise if floor is None else floor.ceiling


def _positions(archive: Archive, data: ProfileData, times: Array) -> Array:
    """Latitude and longitude ``(k, 2)`` on the estimate's track at times (s); NaN without fixes."""
    missing_positions = np.full((len(times), 2), np.nan)
    if not len(times):
        return missing_positions
    positions = estimated_positions(archive, data, motions_of(data, platform_of(archive)).estimate)
    if positions is None:
        return missing_positions
    return positions[np.clip(np.searchsorted(data.record_time, times), 0, len(data.record_time) - 1)]


# The mission


def prepare(request: Request, archive: Archive, numbers: tuple[int, ...], settings: EventSettings) -> Preparation:
    """Read the nulls' ceiling and noise, if there are nulls."""
    floor, remarks = null_floor(archive, request.estimate, settings)
    outdated = () if floor is None else outdated_input_remarks(archive, "nulls")
    attributes = {"floor": None if floor is None else asdict(floor)}
    return Preparation(inputs=floor, attributes=attributes, remarks=remarks + outdated)


def catalogue(plan: Plan, rows: Mapping[int, Row]) -> GroupContent:
    """Combine the events of all profiles into one catalogue, with the strongest first."""
    unsorted = [event for row in rows.values() for event in row.get("events", ())]
    events = sorted(unsorted, key=lambda event: -abs(event["amplitude"]))
    return GroupContent(
        sizes={EVENT: len(events)},
        variables={variable.name: [event[variable.name] for event in events] for variable in CATALOGUE},
    )


STUDY = Study(
    NAME,
    "the catalogue of impulsive events above the nulls' ceiling",
    profile=study_profile,
    mission=catalogue,
    settings=EventSettings,
    missing=missing_band,
    prepare=prepare,
)
