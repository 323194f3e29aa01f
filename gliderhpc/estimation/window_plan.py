"""Lengths of a profile's windows (section 4.3), changes of the length, and the scale of the unknowns (eq. 38)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gliderhpc.estimation.settings import USUAL_WINDOW, EstimationSettings
from gliderhpc.platform import DisturbancePrior

Array = NDArray[np.float64]

_SPLIT = 1.25
"""Length, in usual windows, beyond which windows that do not converge are halved."""

_LONG_WINDOW = 4.0
"""Length, in usual windows, beyond which windows are halved after a third of the iterations; shorter ones, if they
result from halving."""

_GROWTH = 4
"""Growth, with every failure, of the number of windows that must converge before a longer one is tried again."""

_LONGEST_WAIT = 64
"""Largest number of windows that must converge before a longer one is tried again."""


@dataclass(frozen=True)
class WindowPlan:
    """Lengths and thresholds of the windows.

    Attributes
    ----------
    length, margin : int
        Window length and margin, steps.
    cost_threshold : float
        Cost (rad2 s) at and above which a window hands over without retraction.
    scale : tuple of 6 floats
        Scale s of the control-variable transform ``b = s x`` for this length, N and N m.
    shorter : WindowPlan, optional
        Plan with which a window that does not converge is solved again.
    halves_early : bool
        Whether a third of the iterations are enough before this.
    """

    length: int
    margin: int
    cost_threshold: float
    scale: tuple[float, ...] = (1.0,) * 6
    shorter: "WindowPlan | None" = None
    halves_early: bool = False

    def max_windows(self, steps: int) -> int:
        """Count the windows of a profile in which every one is retracted."""
        return -(-steps // (self.length - self.margin)) + 1


def plan_windows(settings: EstimationSettings, interval: float, prior: DisturbancePrior | None = None) -> WindowPlan:
    """Plan the windows of a record with a sample interval (s).

    The disturbance prior scales the unknowns. Without a prior there is neither a scale nor a shorter window. If the
    length is not set, windows of slow sensors may be halved until they are as short as those of fast ones.
    """
    lengths = [settings.window_length(interval)]
    while prior is not None and settings.window.length is None and lengths[-1] > _SPLIT * USUAL_WINDOW:
        lengths.append(max(0.5 * lengths[-1], USUAL_WINDOW))
    plan: WindowPlan | None = None
    for length in reversed(lengths):
        share = length / lengths[0]
        steps, margin = _whole_records(length, share * settings.window_margin(interval), settings)
        scale = np.ones(6) if prior is None else transform_scale(prior, length, settings)
        early = plan is not None and (length > _LONG_WINDOW * USUAL_WINDOW or length < lengths[0])
        plan = WindowPlan(steps, margin, share * settings.cost_threshold(interval), tuple(scale.tolist()), plan, early)
    assert plan is not None
    return plan


def _whole_records(length: float, margin: float, settings: EstimationSettings) -> tuple[int, int]:
    """Length and margin (s) in steps, as whole output intervals, which makes windows start at stored records."""
    records = settings.steps_per_record
    steps = max(records, max(1, round(length / settings.step)) // records * records)
    return steps, min(round(margin / settings.step) // records * records, steps - records)


def transform_scale(prior: DisturbancePrior, length: float, settings: EstimationSettings) -> Array:
    """Scale ``s (6,)`` of the control-variable transform for a window length (s): set, from the prior, or ones."""
    if settings.optimizer.scale is not None:
        return np.array(settings.optimizer.scale)
    if not settings.transformed:
        return np.ones(6)
    share = np.minimum(1.0, 2.0 * length / np.array(prior.correlation_time))
    return np.array(prior.deviation) * np.sqrt(share)


class WindowLength:
    """Plan of the next window: shorter after one that does not converge, longer again after some that do.

    The longer plan is tried again after one window that converges, and after four times as many with every failure. A
    record on which long windows never converge therefore takes little more time than short windows alone.
    """

    def __init__(self, plan: WindowPlan) -> None:
        self.plan = plan
        self._longer: list[WindowPlan] = []
        self._wait, self._next_wait = 0, 1

    def shorten(self) -> bool:
        """Switch to the shorter plan; return whether there is one."""
        if self.plan.shorter is None:
            return False
        self._longer.append(self.plan)
        self.plan = self.plan.shorter
        self._wait, self._next_wait = self._next_wait, min(_GROWTH * self._next_wait, _LONGEST_WAIT)
        return True

    def count_converged(self) -> None:
        """Count a window that converged, and switch to the longer plan after enough of them."""
        if not self._longer:
            self._next_wait = 1
            return
        self._wait -= 1
        if self._wait <= 0:
            self.plan = self._longer.pop()
