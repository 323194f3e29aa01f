"""From the vehicle's own units to those of the observation format."""

import numpy as np
import numpy.typing as npt

from gliderhpc.observations.rows import Rows


def convert(rows: Rows, linear_scale: float, linear_zero: float) -> dict[str, npt.NDArray[np.generic]]:
    """Attitude, depth and controls in the units and signs of the observation format.

    A positive ``AngPos`` goes with starboard down (0.4 degree of roll a degree on SEA035, correlation 0.9): the sign of
    the model's gamma. ``LinPos`` grows forward.

    Parameters
    ----------
    rows : Rows
        Navigation rows.
    linear_scale : float
        Metres of battery travel a unit of ``LinPos``.
    linear_zero : float
        ``LinPos`` at which the battery sits at its nominal position.
    """
    return {
        "time": rows.time,
        "depth": rows["Depth"],
        "roll": rows["Roll"],
        "pitch": rows["Pitch"],
        "heading": np.mod(rows["Heading"] + rows["Declination"], 360.0),
        "battery_position": linear_scale * (rows["LinPos"] - linear_zero),
        "battery_rotation": rows["AngPos"],
        "ballast_volume": rows["BallastPos"],
    }
