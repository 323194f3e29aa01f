"""Sensors that have stopped: a heading or a depth that stays the same to the last digit while the glider moves."""

import numpy as np

from gliderhpc.errors import ProfileError
from gliderhpc.observations.headings import MIN_CHANGES, frozen_profiles, share_of_changes
from gliderhpc.observations.profiles import equal_runs
from gliderhpc.observations.records import ProfileRecord

_STUCK_TIME, _STUCK_SAMPLES = 120.0, 10
"""Time (s) and number of samples from which a depth that stays the same is not that of a glide."""
_SURFACE, _WHOLE = 3.0, 0.9
"""Depth (m) above which a glider may stay, and share of the samples from which on it may not stay there either."""
_PITCH = np.radians(8.0)
"""Median size of the pitch above which a glider moves up or down."""


def check_sensors(record: ProfileRecord) -> None:
    """Refuse a record whose heading or depth was not measured for long; rounded values of a steady glide are not meant.

    With a heading that did not change, the current of twins was wrong by 0.1 to 0.16 m/s, and with a depth that did
    not, the speed by 0.37 m/s, at stated deviations of 0.02 to 0.06.

    Raises
    ------
    ProfileError
        The heading stays the same to the last digit as in `frozen_profiles`, or the depth for two minutes of flight.
    """
    number = np.full(len(record.time), record.number, dtype=np.int64)
    reason = frozen_profiles(record.time, record.heading, record.pitch, number).get(record.number)
    # A simulated glide without noise may keep its heading, but then its roll too.
    if reason is not None and share_of_changes(record.roll) >= MIN_CHANGES:
        raise ProfileError(reason)
    known = np.flatnonzero(np.isfinite(record.depth) & np.isfinite(record.pitch))
    time, depth, pitch = record.time[known], record.depth[known], record.pitch[known]
    for start, stop in equal_runs(depth, _STUCK_SAMPLES):
        lasts = time[stop - 1] - time[start]
        angle = float(np.median(np.abs(pitch[start:stop])))
        dived = depth[start] > _SURFACE or stop - start > _WHOLE * len(depth)
        if lasts >= _STUCK_TIME and angle > _PITCH and dived:
            raise ProfileError(
                f"profile {record.number}: the depth stays at {depth[start]:.6g} m for {lasts / 60.0:.0f} minutes, "
                f"from {time[start]:.0f} s on, at a pitch of {np.degrees(angle):.0f} degrees: the sensor had stopped, "
                "or the glider lay on the ground; mark the depth missing (NaN) there, or cut the profile"
            )
