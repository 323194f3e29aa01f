"""True disturbance of one profile: sinusoids and random processes in every channel, and impulses of the yaw moment."""

from dataclasses import dataclass

import numpy as np
import scipy

from gliderhpc.observations.records import FloatArray
from gliderhpc.simulator.sections import Disturbances, GaussMarkov

YAW = 5
"""Channel of the yaw moment B_cr."""

_REACH = 8.0
"""Extent of an impulse in widths; beyond it, the impulse is below 1e-13 of its peak."""


@dataclass(frozen=True)
class Impulse:
    """One impulse of the yaw moment.

    Attributes
    ----------
    time : float
        Time of its peak, s.
    amplitude : float
        Peak moment, N m.
    width : float
        Standard deviation of its Gaussian shape, s.
    """

    time: float
    amplitude: float
    width: float


@dataclass(frozen=True)
class Wave:
    """One sinusoid of one channel: amplitude (N or N m), angular frequency (rad/s), phase (rad)."""

    channel: int
    amplitude: float
    frequency: float
    phase: float


@dataclass(frozen=True)
class RandomProcess:
    """First-order Gauss-Markov processes, and the seed of their random numbers."""

    settings: GaussMarkov
    seed: int

    def sampled(self, count: int, step: float) -> FloatArray:
        """Values ``(count, 6)`` in N and N m at times `step` s apart; their distribution is exact for any step."""
        drawn = np.random.default_rng(self.seed).standard_normal((count, 6))
        time = np.array(self.settings.correlation_time)
        drawn[1:] *= np.sqrt(-np.expm1(-2.0 * step / time))
        decays = np.exp(-step / time)
        columns = [
            scipy.signal.lfilter([1.0], [1.0, -decay], column) for decay, column in zip(decays, drawn.T, strict=True)
        ]
        return np.asarray(np.array(self.settings.deviation) * np.column_stack(columns))


@dataclass(frozen=True)
class Disturbance:
    """The disturbance as a function of time."""

    waves: tuple[Wave, ...]
    impulses: tuple[Impulse, ...]
    process: RandomProcess | None = None

    def sampled(self, count: int, step: float) -> FloatArray:
        """Values ``(count, 6)`` in N and N m at the midpoints of steps of `step` s from time 0."""
        time = (np.arange(count) + 0.5) * step
        values = np.zeros((count, 6))
        for wave in self.waves:
            values[:, wave.channel] += wave.amplitude * np.sin(wave.frequency * time + wave.phase)
        for impulse in self.impulses:
            reach = _REACH * impulse.width
            near = slice(*np.searchsorted(time, (impulse.time - reach, impulse.time + reach)))
            values[near, YAW] += impulse.amplitude * np.exp(-0.5 * ((time[near] - impulse.time) / impulse.width) ** 2)
        return values if self.process is None else values + self.process.sampled(count, step)


def draw_disturbance(settings: Disturbances, duration: float, rng: np.random.Generator) -> Disturbance:
    """Draw a disturbance for the first `duration` s of a profile."""
    waves, impulses = _draw_waves(settings, rng), _draw_impulses(settings, duration, rng)
    if settings.gauss_markov is None:
        return Disturbance(waves, impulses)
    return Disturbance(waves, impulses, RandomProcess(settings.gauss_markov, int(rng.integers(2**63))))


def _draw_waves(settings: Disturbances, rng: np.random.Generator) -> tuple[Wave, ...]:
    waves = []
    for channel, rms in enumerate(settings.slow_rms):
        amplitude = rms * np.sqrt(2.0 / settings.slow_terms)
        for _ in range(settings.slow_terms):
            # Numbers are drawn for silent channels too, so switching one on does not change the others.
            period, phase = rng.uniform(*settings.slow_periods), rng.uniform(0.0, 2.0 * np.pi)
            if rms > 0.0:
                waves.append(Wave(channel, float(amplitude), float(2.0 * np.pi / period), float(phase)))
    return tuple(waves)


def _draw_impulses(settings: Disturbances, duration: float, rng: np.random.Generator) -> tuple[Impulse, ...]:
    if settings.impulse_interval is None:
        return ()
    impulses = []
    time = rng.exponential(settings.impulse_interval)
    while time < duration:
        amplitude = rng.uniform(*settings.impulse_amplitude) * rng.choice((-1.0, 1.0))
        impulses.append(Impulse(float(time), float(amplitude), float(rng.uniform(*settings.impulse_width))))
        time += rng.exponential(settings.impulse_interval)
    return tuple(impulses)
