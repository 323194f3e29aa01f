"""What the vehicle was doing: the navigation states (column ``NavState``) that the records show."""

import numpy as np
import numpy.typing as npt

from gliderhpc.observations.records import FloatArray

DIVING = 100
INFLECTING_DOWN = 110
SURFACING = 115
TRANSMITTING = 116
CLIMBING = 117
INFLECTING_UP = 118

_GLIDING = (DIVING, INFLECTING_DOWN, CLIMBING, INFLECTING_UP)


def is_gliding(state: FloatArray, *, include_surfacing: bool = False) -> npt.NDArray[np.bool_]:
    """Whether the glider is under way below the surface, or leaving it.

    In the surfacing manoeuvre the battery runs fully forward at about 9 m, the nose drops to -70 degrees and the glider
    rises tail first: no gliding flight that the model of the paper could follow, so it is left out unless asked for.
    """
    return np.isin(state, (*_GLIDING, SURFACING) if include_surfacing else _GLIDING)
