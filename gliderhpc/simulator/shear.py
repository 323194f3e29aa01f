"""The current as a function of depth and time: uniform part, surface layer, vertical modes, smooth random profile.

Layer and modes have amplitudes that vary slowly and smoothly from profile to profile, as sums of sinusoids in the
profile's number, so that any profile's current follows from the seed alone, whichever profiles are simulated.
"""

from dataclasses import dataclass

import numpy as np

from gliderhpc.observations.records import FloatArray
from gliderhpc.seeds import MISSION, Stream, generator
from gliderhpc.simulator.sections import Current

_NODES_PER_SCALE = 8
_LARGEST_SPACING = 5.0
_SLOW_TERMS = 8
_FINE_TERMS = 16


@dataclass(frozen=True, eq=False)
class CurrentProfile:
    """The current of one profile.

    Attributes
    ----------
    spacing : float
        Of the nodes in depth, the first at the surface, m.
    table : (n, 8) array
        Current north and east at the start (m/s), their slopes in depth (1/s), and the rates of these four (per s).
    """

    spacing: float
    table: FloatArray

    def at(self, depths: FloatArray, time: float) -> FloatArray:
        """Current ``(n, 2)`` north and east at depths (m) and one time (s), linear between the nodes."""
        nodes = self.spacing * np.arange(len(self.table))
        values = self.table[:, :2] + time * self.table[:, 4:6]
        return np.column_stack([np.interp(depths, nodes, column) for column in values.T])


def current_profile(settings: Current, seed: int, number: int, *, depth: float, duration: float) -> CurrentProfile:
    """Draw the current of the profile `number` down to `depth` m; it evolves over a `duration` in s.

    Notes
    -----
    The time's part is linear: the amplitudes are those of the slow sums at the profile's beginning and at its end.
    """
    spacing = node_spacing(settings)
    nodes = spacing * np.arange(int(np.ceil(depth / spacing)) + 2, dtype=np.float64)
    begin, end = (_slow_part(settings, seed, float(place), nodes) for place in (number - 1, number))
    steady = _fine_part(settings, generator(seed, number, Stream.SHEAR), nodes)
    steady[:, :2] += draw_uniform(settings, seed, number)
    return CurrentProfile(spacing, np.hstack([begin + steady, (end - begin) / duration]))


def draw_uniform(settings: Current, seed: int, number: int) -> FloatArray:
    """Draw the uniform part ``[north, east]`` of one profile, m/s."""
    rng = generator(seed, number, Stream.CURRENT)
    speed, direction = rng.uniform(*settings.speed), rng.uniform(0.0, 2.0 * np.pi)
    return np.array([speed * np.cos(direction), speed * np.sin(direction)])


def node_spacing(settings: Current) -> float:
    """Distance of the nodes in depth that resolves every part, m."""
    finest = min(settings.surface_scale, settings.fine_scale, settings.mode_depth / settings.modes)
    return min(finest / _NODES_PER_SCALE, _LARGEST_SPACING)


def _slow_part(settings: Current, seed: int, place: float, nodes: FloatArray) -> FloatArray:
    """Layer and modes ``(n, 4)`` at a place in the mission, counted in profiles: north, east and their slopes."""
    amplitudes = _slow_amplitudes(settings, seed, place)
    decay = np.exp(-nodes / settings.surface_scale)
    part = settings.surface_rms * np.outer(decay, _paired(amplitudes[0], -1.0 / settings.surface_scale))
    for k, amplitude in enumerate(amplitudes[1:], start=1):
        wavenumber = k * np.pi / settings.mode_depth
        part[:, :2] += settings.mode_rms / k * np.outer(np.cos(wavenumber * nodes), amplitude)
        part[:, 2:] -= settings.mode_rms / k * wavenumber * np.outer(np.sin(wavenumber * nodes), amplitude)
    return part


def _paired(amplitude: FloatArray, factor: float) -> FloatArray:
    return np.concatenate([amplitude, factor * amplitude])


def _slow_amplitudes(settings: Current, seed: int, place: float) -> FloatArray:
    """Amplitudes ``(1 + modes, 2)`` of unit variance, of Gaussian correlation over `Current.evolution` profiles."""
    rng = generator(seed, MISSION, Stream.SHEAR)
    shape = (1 + settings.modes, 2, _SLOW_TERMS)
    frequency = rng.normal(0.0, np.sqrt(2.0) / settings.evolution, shape)
    phase = rng.uniform(0.0, 2.0 * np.pi, shape)
    amplitudes: FloatArray = np.sqrt(2.0 / _SLOW_TERMS) * np.cos(frequency * place + phase).sum(axis=-1)
    return amplitudes


def _fine_part(settings: Current, rng: np.random.Generator, nodes: FloatArray) -> FloatArray:
    """Smooth random profile ``(n, 4)``, of Gaussian correlation over `Current.fine_scale`."""
    wavenumber = rng.normal(0.0, np.sqrt(2.0) / settings.fine_scale, (2, _FINE_TERMS))
    phase = rng.uniform(0.0, 2.0 * np.pi, (2, _FINE_TERMS))
    angle = wavenumber[:, None, :] * nodes[:, None] + phase[:, None, :]
    amplitude = settings.fine_rms * np.sqrt(2.0 / _FINE_TERMS)
    values = amplitude * np.cos(angle).sum(axis=-1)
    slopes = -amplitude * (wavenumber[:, None, :] * np.sin(angle)).sum(axis=-1)
    return np.column_stack([*values, *slopes])
