"""Corrections of the records that a user asks for: of the pitch, the compass and a lag of the depth."""

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gliderhpc.estimation.settings import RecordSettings
from gliderhpc.observations.records import ProfileRecord

Array = NDArray[np.float64]

HARMONICS = ("sin", "cos", "sin 2", "cos 2")
"""Of the heading read, in the order of `RecordSettings.heading_deviation`."""


def harmonics(heading: ArrayLike) -> Array:
    """Return sine and cosine ``(n, 4)`` of headings ``(n,)`` (rad) and of twice them, in the order of `HARMONICS`."""
    psi = np.asarray(heading, dtype=np.float64)
    return np.column_stack([np.sin(psi), np.cos(psi), np.sin(2.0 * psi), np.cos(2.0 * psi)])


def corrected(record: ProfileRecord, settings: RecordSettings) -> ProfileRecord:
    """Give a record without the errors that the settings name; the record itself where they name none."""
    if settings == RecordSettings():
        return record
    error = np.radians(settings.heading_offset + harmonics(record.heading) @ np.array(settings.heading_deviation))
    return replace(
        record,
        pitch=settings.pitch_scale * (record.pitch - np.radians(settings.pitch_offset)),
        heading=np.mod(record.heading - error, 2.0 * np.pi),
        depth=_earlier(record.time, record.depth, settings.depth_lag),
    )


def _earlier(time: Array, values: Array, lag: float) -> Array:
    """Give at each time what was recorded a lag later; NaN where the sample nearest to then is missing, or none is."""
    known = np.isfinite(values)
    if lag == 0.0 or not known.any():
        return values
    moved = np.interp(time + lag, time[known], values[known])
    there = np.interp(time + lag, time, known.astype(np.float64)) >= 0.5
    inside = (time + lag >= time[0]) & (time + lag <= time[-1])
    return np.where(there & inside, moved, np.nan)
