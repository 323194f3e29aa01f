"""Vertical motion of the water in one profile: a sum of sinusoids in time, the same at all depths."""

from dataclasses import dataclass

import numpy as np

from gliderhpc.observations.records import FloatArray
from gliderhpc.simulator.sections import VerticalCurrent


@dataclass(frozen=True, eq=False)
class VerticalMotion:
    """What the water does up and down.

    Attributes
    ----------
    amplitude, frequency, phase : (k,) arrays
        Of the upward velocity's sinusoids: m/s, rad/s, rad.
    """

    amplitude: FloatArray
    frequency: FloatArray
    phase: FloatArray

    def velocity(self, time: FloatArray) -> FloatArray:
        """Velocity upward (n,) at times (s), m/s."""
        return np.asarray(np.sin(np.outer(time, self.frequency) + self.phase) @ self.amplitude)

    def rise(self, begin: float, time: FloatArray) -> FloatArray:
        """How far the water has risen (n,) from a time until others (s), m."""
        phase = np.cos(self.frequency * begin + self.phase) - np.cos(np.outer(time, self.frequency) + self.phase)
        return np.asarray(phase @ (self.amplitude / self.frequency))


def draw_vertical_motion(settings: VerticalCurrent, rng: np.random.Generator) -> VerticalMotion:
    """Draw the vertical motion of one profile's water."""
    periods = rng.uniform(*settings.periods, settings.terms)
    phase = rng.uniform(0.0, 2.0 * np.pi, settings.terms)
    amplitude = settings.rms * np.sqrt(2.0 / settings.terms)
    return VerticalMotion(np.full(settings.terms, amplitude), 2.0 * np.pi / periods, phase)
