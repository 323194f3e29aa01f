"""Short dive with its hull, and derivatives by the hull's errors from the second implementation."""

import numpy as np

from gliderhpc.estimation.preparation import PreparedProfile, prepare_profile
from gliderhpc.flight.hull_parameters import hull_parameters, with_values
from gliderhpc.observations.series import ProfileSeries
from gliderhpc.platform import CUBIC_CENTIMETRE
from support import reference
from support.dense_least_squares import ORDER
from support.smoothing import GLIDE, H

OFFSETS = {"sensors.pitch_scale": 1.01, "sensors.heading_offset": 2.0, "sensors.pitch_offset": -1.0}


def profile_of(glider, measurements, controls) -> PreparedProfile:
    """Profile of raw controls ``(n, 4)``, sampled at every tenth of its rows."""
    n = len(controls)
    series = ProfileSeries(
        1, np.datetime64("2024-01-01", "ns"), H, H * np.arange(n + 1), measurements, np.ones(n + 1), controls, 1.0, 0.0,
        np.arange(0, n + 1, 10),
    )  # fmt: skip
    return prepare_profile(glider, series)


def steady_controls(platform, n):
    """Raw controls of `support.smoothing.GLIDE`."""
    buoyancy = platform.buoyancy
    volume = GLIDE.control[2] / (buoyancy.oil_density - buoyancy.water_density)
    return np.tile([GLIDE.control[0], GLIDE.control[1], volume, 0.0], (n, 1))


def hull_only(platform):
    """Parameters that the records do not know."""
    return [p for p in hull_parameters(platform) if not p.key.startswith("sensors.")]


def step_slope(platform, parameter, state, raw, b):
    """Derivative ``(18,)`` of a step by a parameter, sixteen states, X and Y, by the complex step."""
    value = parameter.value(platform) + 1j * reference.STEP * parameter.slope(platform, 0.0)
    moved = with_values(platform, {parameter.key: value})
    buoyancy = moved.buoyancy
    m_b = (buoyancy.oil_density - buoyancy.water_density) * raw[2]
    m_m = buoyancy.water_density * buoyancy.neutral_volume * CUBIC_CENTIMETRE - buoyancy.oil_density * raw[2]
    new = reference.rk4_step(moved, state + 0j, [raw[0], raw[1], m_b, m_m, raw[3]], b, H)
    return np.concatenate([np.imag(new) / reference.STEP, np.zeros(6)])[ORDER]
