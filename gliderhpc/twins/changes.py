"""What is done to a twin's records before they are inverted: offsets, longer sample intervals, dropouts, gaps."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gliderhpc.observations.format import MEASURED, SEAWATER
from gliderhpc.observations.records import ProfileRecord

_SAMPLED = ("time", *MEASURED, "battery_position", "battery_rotation", "ballast_volume", "rudder")
_TURN = 2.0 * np.pi
_ROUNDING = 1e-6


@dataclass(frozen=True)
class RecordChanges:
    """Changes of a record, applied in the order of the attributes.

    Attributes
    ----------
    roll_offset, pitch_offset, heading_offset : float
        Constant errors of the attitude, degree.
    sample_interval : float, optional
        Keep one sample in this time, s; None keeps all.
    dropout : float
        Share of the samples whose attitude and depth are lost, at random.
    gap, gap_spacing : float
        Every `gap_spacing` s attitude and depth are lost for `gap` s.
    """

    roll_offset: float = 0.0
    pitch_offset: float = 0.0
    heading_offset: float = 0.0
    sample_interval: float | None = None
    dropout: float = 0.0
    gap: float = 0.0
    gap_spacing: float = 300.0

    def applied(self, record: ProfileRecord, rng: np.random.Generator) -> ProfileRecord:
        """Give the record with these changes; `rng` draws the dropouts."""
        record = _offset(record, self)
        if self.sample_interval is not None:
            record = _thinned(record, self.sample_interval)
        lost = rng.random(len(record.time)) < self.dropout
        if self.gap > 0.0:
            lost |= _in_gaps(record, self.gap, self.gap_spacing)
        return _without(record, lost) if lost.any() else record


def _offset(record: ProfileRecord, changes: RecordChanges) -> ProfileRecord:
    roll, pitch, heading = np.radians([changes.roll_offset, changes.pitch_offset, changes.heading_offset])
    return replace(
        record,
        roll=record.roll + roll,
        pitch=record.pitch + pitch,
        heading=np.mod(record.heading + heading, _TURN),
    )


def _thinned(record: ProfileRecord, interval: float) -> ProfileRecord:
    """Keep the first sample in every interval: a slower recorder sees instants, not means."""
    _, kept = np.unique(np.floor(record.time / interval + _ROUNDING), return_index=True)
    names = (*_SAMPLED, *(name for name in SEAWATER if getattr(record, name) is not None))
    thinned: dict[str, Any] = {name: getattr(record, name)[kept] for name in names}
    return replace(record, **thinned)


def _in_gaps(record: ProfileRecord, gap: float, spacing: float) -> NDArray[np.bool_]:
    since = np.mod(record.time, spacing)
    # Centred, so that neither the start nor a control interval coincides with one.
    return np.asarray(np.abs(since - 0.5 * spacing) < 0.5 * gap, dtype=np.bool_)


def _without(record: ProfileRecord, lost: NDArray[np.bool_]) -> ProfileRecord:
    """Take attitude and depth out of the samples that are lost; the actuators' log is kept."""
    holed: dict[str, Any] = {name: np.where(lost, np.nan, getattr(record, name)) for name in MEASURED}
    return replace(record, **holed)
