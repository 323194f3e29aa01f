"""Levenberg-Marquardt damping of the smoother: rows are held to the path where no part of a move lowers the merit.

Near rest the angle of attack swings by tens of degrees within the velocity's uncertainty, and a Gauss-Newton move
overshoots there while the rest of the dive needs it; shortening the whole move further and further would hold up
everything for a few seconds of it. Held are velocities and rates, with the deviations of the initial state's prior over
the root of a strength: rows that the record pins down better than that hardly notice.

References
----------
S. Särkkä, L. Svensson (2020), Levenberg-Marquardt and line-search extended Kalman smoothers, ICASSP 2020, 5875-5879.
"""

import numpy as np

from gliderhpc.kernels.smoother_memory import Dive

_FIRST = 1.0
_TIGHTER = 10.0
_LOOSER = 0.1
_WEAKEST = 0.5
_STRONGEST = 1e6


class Hold:
    """How strongly a dive's rows are held; the dive's ``hold`` is kept up to date."""

    def __init__(self, dive: Dive) -> None:
        self._dive = dive
        self._variance = np.square(dive.deviation[4:10])
        self.strength = 0.0

    @property
    def active(self) -> bool:
        """Whether rows are held at all."""
        return self.strength > 0.0

    @property
    def exhausted(self) -> bool:
        """Whether tightening has no sense any more."""
        return self.strength > _STRONGEST

    def set(self, strength: float) -> None:
        """Hold with a strength; less than the weakest is none."""
        self.strength = strength if strength >= _WEAKEST else 0.0
        self._dive.hold[:] = self._variance / self.strength if self.active else np.inf

    def loosen(self) -> None:
        """Hold less, as after a move that was good."""
        self.set(self.strength * _LOOSER)

    def tighten(self) -> None:
        """Hold more, as after a move that was not."""
        self.set(max(self.strength * _TIGHTER, _FIRST))
