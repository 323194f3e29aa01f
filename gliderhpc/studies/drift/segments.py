"""Steady segments of a profile, on the step that they are inverted with."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gliderhpc.archive.profile import ProfileData
from gliderhpc.observations import ProfileSeries
from gliderhpc.observations.stretches import stretches
from gliderhpc.platform import Platform
from gliderhpc.studies.archived import series_of
from gliderhpc.studies.drift.depth_band import DepthBand
from gliderhpc.studies.drift.medians import PHASES, counted

Segment = tuple[int, int]
"""First and last record."""


def steady_segments(data: ProfileData, band: DepthBand, phase: str, length: float, count: int) -> list[Segment]:
    """Choose segments of a phase, evenly among all that fit into its stretches of counted records.

    Parameters
    ----------
    data : ProfileData
        The profile.
    band : DepthBand
        Depths that count.
    phase : str
        ``dive`` or ``climb``.
    length : float
        Of a segment, s.
    count : int
        Segments wanted; fewer where no more fit.
    """
    records = round(length / float(data.attributes["output_interval"]))
    fitting = [
        (start, start + records)
        for begin, end in stretches(counted(data, band, phase))
        for start in range(begin, end - records, records)
    ]
    if not fitting:
        return []
    places = (np.arange(count) + 0.5) * len(fitting) / count
    return [fitting[place] for place in sorted(set(places.astype(int).tolist()))]


def segment_series(data: ProfileData, platform: Platform, segment: Segment, step: float) -> ProfileSeries:
    """Give a segment's records, interpolated to a step as the mission's own were.

    Parameters
    ----------
    data, platform : ProfileData, Platform
        The profile and its hull.
    segment : (int, int)
        First and last record.
    step : float
        s.
    """
    whole = series_of(data, platform)
    first, last = segment
    known = slice(first, last + 1)
    time = whole.time[known]
    fine = time[0] + step * np.arange(round((time[-1] - time[0]) / step) + 1)
    middles = fine[:-1] + 0.5 * step
    # Archives of before `sampled` do not tell samples from what was interpolated between them.
    own = data.sampled[known] if data.sampled.any() else np.ones(len(time), dtype=np.bool_)
    sampled = np.flatnonzero(own & (whole.weights[known] > 0.0))
    return replace(
        whole,
        step=step,
        time=fine - fine[0],
        measurements=_interpolated(fine, time, whole.measurements[known]),
        weights=np.where(np.interp(fine, time, whole.weights[known]) == 1.0, 1.0, 0.0),
        controls=_interpolated(middles, whole.time[:-1], whole.controls),
        gap_seconds=0.0,
        sample_index=np.rint((time[sampled] - time[0]) / step).astype(np.int64),
        seawater=None if whole.seawater is None else _interpolated(middles, whole.time[:-1], whole.seawater),
    )


def segments_by_phase(data: ProfileData, band: DepthBand, length: float, count: int) -> dict[str, list[Segment]]:
    """Choose the segments of both phases."""
    return {phase: steady_segments(data, band, phase, length, count) for phase in PHASES}


def _interpolated(
    at: NDArray[np.float64], time: NDArray[np.float64], columns: NDArray[np.float64]
) -> NDArray[np.float64]:
    return np.column_stack([np.interp(at, time, column) for column in columns.T])
