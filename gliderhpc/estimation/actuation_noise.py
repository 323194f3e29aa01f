"""What the actuators may do otherwise than recorded, as noise of the disturbances.

The recorded positions of battery and ballast are believed to within a lag: what stands in the record may hold a moment
later, or earlier. While an actuator moves, its weight's force and moment are wrong by what they change in that time;
as a disturbance this appears when the move begins and is gone when it has ended. A random walk with the same change
over the lag,

    variance a step = (lag / h) (change from step to step of the lag's error)^2,

leaves the disturbance free to follow that, and no freer.
"""

import numpy as np
from numpy.typing import NDArray

from gliderhpc.kernels.mass import GRAVITY

Array = NDArray[np.float64]


def actuation_noise(bodies: Array, attitude: Array, lag: float, step: float) -> Array:
    """Variance ``(n, 6)`` that each step adds to the disturbances for the actuators' sake, N2 and (N m)2.

    Parameters
    ----------
    bodies : (n, 11)
        Mass properties from `gliderhpc.flight.glider.Glider.bodies`.
    attitude : (n, 2)
        Roll and pitch, rad.
    lag, step : float
        By how much the records may lag or lead, and the step, s.
    """
    rows = max(1, round(lag / step))
    earlier = bodies[np.maximum(np.arange(len(bodies)) - rows, 0)]
    down = _down(attitude)
    moment, weight = (bodies - earlier)[:, :3], (bodies - earlier)[:, 9:10]
    error = np.hstack([weight * down, GRAVITY * np.cross(moment, down)])
    return np.asarray((lag / step) * np.diff(error, axis=0, prepend=error[:1]) ** 2)


def _down(attitude: Array) -> Array:
    """Unit vector downwards in the hull's axes (eq. 2's third row)."""
    roll, pitch = attitude.T
    return np.column_stack([-np.sin(pitch), np.sin(roll) * np.cos(pitch), np.cos(roll) * np.cos(pitch)])
