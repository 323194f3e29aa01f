"""The depth-averaged current of one twin as the pipeline gives it, beside its truth."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gliderhpc.analysis.twin.inversion import TwinInversion
from gliderhpc.errors import InputError
from gliderhpc.estimation.currents import CurrentSettings, cycles_of, depth_averaged_current
from gliderhpc.estimation.self_motion import SelfMotion, model_motion

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class TwinCurrent:
    """Depth-averaged current of one twin.

    Attributes
    ----------
    velocity, truth : (2,) arrays
        As estimated, and averaged over the dive; north and east, m/s.
    motion : SelfMotion
        The modelled motion through the water that it is the rest of.
    duration : float
        From fix to fix, s.
    """

    velocity: Array
    truth: Array
    motion: SelfMotion
    duration: float

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
    current = depth_averaged_current(record, estimate.series, motion, cycles_of(estimate.series), CurrentSettings())
    if current is None or record.entry_fix is None or record.exit_fix is None:
        raise InputError("a twin without fixes has no current")
    duration = float((record.exit_fix.time - record.entry_fix.time) / np.timedelta64(1, "s"))
    return TwinCurrent(current.velocity, inversion.profile_truth.current, motion, duration)
