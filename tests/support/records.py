"""Profile records with linear signals."""

import numpy as np

from gliderhpc.observations import ProfileRecord

EPOCH = np.datetime64("2024-05-01T12:00:00", "ns")


def record(time: np.ndarray, **changes: np.ndarray) -> ProfileRecord:
    values = {
        "roll": 0.1 + 1e-3 * time,
        "pitch": -0.3 + 2e-4 * time,
        "heading": np.mod(6.0 + 0.01 * time, 2.0 * np.pi),
        "depth": 1.0 + 0.15 * time,
        "battery_position": 0.01 + 1e-5 * time,
        "battery_rotation": 0.2 - 1e-4 * time,
        "ballast_volume": -2e-4 + 1e-7 * time,
        "rudder": np.zeros_like(time),
    } | changes
    return ProfileRecord(number=7, epoch=EPOCH, time=time, **values)
