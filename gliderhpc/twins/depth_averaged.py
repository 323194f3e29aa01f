"""The depth-averaged current of one twin as the pipeline gives it, beside its truth."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gliderhpc.errors import InputError
from gliderhpc.estimation.current_errors import CurrentErrors, Drift
from gliderhpc.estimation.currents import cycles_of, depth_averaged_current
from gliderhpc.estimation.self_motion import model_motion
from gliderhpc.twins.inversion import TwinInversion

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class TwinCurrent:
    """Depth-averaged current of one twin.

    Attributes
    ----------
    velocity, truth : (2,) arrays
        As estimated, and averaged over the dive; north and east, m/s.
    drift : Drift
        What the estimate was made from.
    """

    velocity: Array
    truth: Array
    drift: Drift

    @property
    def error(self) -> Array:
        """Estimated minus true current ``(2,)``, m/s."""
        return np.asarray(self.velocity - self.truth)


def twin_current(inversion: TwinInversion) -> TwinCurrent:
    """Take the current from an inverted twin (eqs. 39 and 40).

    Raises
    ------
    InputError
        The twin has no fixes.
    """
    estimate, record = inversion.estimate, inversion.record
    motion = model_motion(estimate.solution.states, estimate.shaken, inversion.step)
    current = depth_averaged_current(record, estimate.series, motion, cycles_of(estimate.series), CurrentErrors())
    if current is None:
        raise InputError("a twin without fixes has no current")
    return TwinCurrent(current.velocity, inversion.profile_truth.current, current.drift)
