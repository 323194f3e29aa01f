"""The ocean of a scenario: stratification, current profiles and vertical motion.

The true density is computed from the exact Gibbs function at the true depth. The estimator uses the 75-term equation
and the recorded values. A current has a uniform part, a surface layer, vertical modes and a smooth random profile. The
amplitudes of the layer and the modes vary slowly and smoothly from profile to profile, as sums of sinusoids in the
profile's number. The current of a profile therefore depends only on the seed and its number, and not on which profiles
are simulated.
"""

import math
from dataclasses import dataclass

import gsw
import numpy as np

from gliderhpc.observations.records import FloatArray
from gliderhpc.seeds import MISSION, Stream, generator
from gliderhpc.simulator.sections import Current, Latitude, Longitude, Ocean, VerticalCurrent

SPACING = 0.25
"""Spacing of the nodes in depth, m."""

_DEPTH_MARGIN = 100.0


@dataclass(frozen=True, eq=False)
class OceanColumn:
    """The ocean as a function of depth, linear between nodes.

    Attributes
    ----------
    depth : (n,) array
        Depths of the nodes, m.
    temperature, practical_salinity, pressure : (n,) arrays
        In-situ temperature (degC), practical salinity (1) and pressure (dbar).
    density : (n,) array
        In-situ density, kg/m3.
    """

    depth: FloatArray
    temperature: FloatArray
    practical_salinity: FloatArray
    pressure: FloatArray
    density: FloatArray

    def measured(self, depth: FloatArray, settings: Ocean, interval: float, rng: np.random.Generator) -> FloatArray:
        """Temperature, practical salinity and pressure (m, 3) of a CTD at depths (m); `interval` is in s."""
        columns = (self.temperature, self.practical_salinity, self.pressure)
        true = np.column_stack([np.interp(depth, self.depth, column) for column in columns])
        noise = np.array([settings.temperature_noise, settings.salinity_noise, settings.pressure_noise])
        measured: FloatArray = true + noise * rng.standard_normal(true.shape)
        spiked = rng.random(len(depth)) < settings.spikes * interval / 3600.0
        measured[spiked, 1] += settings.spike_size * rng.standard_normal(int(spiked.sum()))
        return measured


def ocean_column(settings: Ocean, position: tuple[Latitude, Longitude], deepest: float) -> OceanColumn:
    """Compute a scenario's ocean down to 100 m below `deepest` (m), at a latitude and longitude (degree)."""
    depth = SPACING * np.arange(math.ceil((deepest + _DEPTH_MARGIN) / SPACING) + 1, dtype=np.float64)
    above = _above(settings, depth)
    temperature = settings.deep_temperature + (settings.surface_temperature - settings.deep_temperature) * above
    salinity = settings.deep_salinity + (settings.surface_salinity - settings.deep_salinity) * above
    pressure = np.asarray(gsw.p_from_z(-depth, position[0]))
    absolute = gsw.SA_from_SP(salinity, pressure, position[1], position[0])
    return OceanColumn(depth, temperature, salinity, pressure, gsw.rho_t_exact(absolute, temperature, pressure))


def _above(settings: Ocean, depth: FloatArray) -> FloatArray:
    """Fraction of surface water: 1 at the surface, about one half at the thermocline, 0 far below."""
    place = settings.thermocline / settings.thickness
    return np.asarray((1.0 + math.exp(-place)) / (1.0 + np.exp(depth / settings.thickness - place)))


_NODES_PER_SCALE = 8
_MAX_SPACING = 5.0
_SLOW_TERMS = 8
_FINE_TERMS = 16


@dataclass(frozen=True, eq=False)
class CurrentProfile:
    """The current of one profile.

    Attributes
    ----------
    spacing : float
        Spacing of the nodes in depth, the first at the surface, m.
    table : (n, 8) array
        Current north and east at the start (m/s), their slopes in depth (1/s), and the rates of change of these four
        (per s).
    """

    spacing: float
    table: FloatArray

    def at(self, depths: FloatArray, time: float) -> FloatArray:
        """Current ``(n, 2)`` north and east (m/s) at depths (m) and one time (s), linear between the nodes."""
        nodes = self.spacing * np.arange(len(self.table))
        values = self.table[:, :2] + time * self.table[:, 4:6]
        return np.column_stack([np.interp(depths, nodes, column) for column in values.T])


def current_profile(settings: Current, seed: int, number: int, *, depth: float, duration: float) -> CurrentProfile:
    """Draw the current of the profile `number` down to `depth` (m); it evolves over `duration` (s).

    Notes
    -----
    The slow part is linear in time, between its values at the beginning and the end of the profile.
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
    """Spacing of the nodes in depth that resolves every part, m."""
    finest = min(settings.surface_scale, settings.fine_scale, settings.mode_depth / settings.modes)
    return min(finest / _NODES_PER_SCALE, _MAX_SPACING)


def _slow_part(settings: Current, seed: int, place: float, nodes: FloatArray) -> FloatArray:
    """Layer and modes ``(n, 4)`` (north, east and their slopes) at a time in the mission, in profiles."""
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
    """Amplitudes ``(1 + modes, 2)`` of unit variance, with a Gaussian correlation over `Current.evolution` profiles."""
    rng = generator(seed, MISSION, Stream.SHEAR)
    shape = (1 + settings.modes, 2, _SLOW_TERMS)
    frequency = rng.normal(0.0, np.sqrt(2.0) / settings.evolution, shape)
    phase = rng.uniform(0.0, 2.0 * np.pi, shape)
    amplitudes: FloatArray = np.sqrt(2.0 / _SLOW_TERMS) * np.cos(frequency * place + phase).sum(axis=-1)
    return amplitudes


def _fine_part(settings: Current, rng: np.random.Generator, nodes: FloatArray) -> FloatArray:
    """Smooth random profile ``(n, 4)``, with a Gaussian correlation over `Current.fine_scale`."""
    wavenumber = rng.normal(0.0, np.sqrt(2.0) / settings.fine_scale, (2, _FINE_TERMS))
    phase = rng.uniform(0.0, 2.0 * np.pi, (2, _FINE_TERMS))
    angle = wavenumber[:, None, :] * nodes[:, None] + phase[:, None, :]
    amplitude = settings.fine_rms * np.sqrt(2.0 / _FINE_TERMS)
    values = amplitude * np.cos(angle).sum(axis=-1)
    slopes = -amplitude * (wavenumber[:, None, :] * np.sin(angle)).sum(axis=-1)
    return np.column_stack([*values, *slopes])


@dataclass(frozen=True, eq=False)
class VerticalMotion:
    """Vertical motion of the water.

    Attributes
    ----------
    amplitude, frequency, phase : (k,) arrays
        Amplitude (m/s), angular frequency (rad/s) and phase (rad) of the sinusoids of the upward velocity.
    """

    amplitude: FloatArray
    frequency: FloatArray
    phase: FloatArray

    def velocity(self, time: FloatArray) -> FloatArray:
        """Upward velocity (n,) at times (s), m/s."""
        return np.asarray(np.sin(np.outer(time, self.frequency) + self.phase) @ self.amplitude)

    def rise(self, begin: float, time: FloatArray) -> FloatArray:
        """Rise of the water (n,) from `begin` to times (s), m."""
        phase = np.cos(self.frequency * begin + self.phase) - np.cos(np.outer(time, self.frequency) + self.phase)
        return np.asarray(phase @ (self.amplitude / self.frequency))


def draw_vertical_motion(settings: VerticalCurrent, rng: np.random.Generator) -> VerticalMotion:
    """Draw the vertical motion of one profile's water."""
    periods = rng.uniform(*settings.periods, settings.terms)
    phase = rng.uniform(0.0, 2.0 * np.pi, settings.terms)
    amplitude = settings.rms * np.sqrt(2.0 / settings.terms)
    return VerticalMotion(np.full(settings.terms, amplitude), 2.0 * np.pi / periods, phase)
