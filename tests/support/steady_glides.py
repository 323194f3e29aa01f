"""Segments of exact steady glides, in the form of `gliderhpc.estimation.steady_segments`."""

import math

import numpy as np

from gliderhpc.estimation.steady_segments import SteadySegments
from gliderhpc.flight.glider import Glider
from gliderhpc.flight.hull_parameters import with_values
from gliderhpc.flight.steady_glide import steady_glide


def glides(truth, platform, masses=(0.3, 0.4), pitches=(20.0, 24.0, 28.0), profiles=4, trend=0.0):
    """Segments of exact steady glides of a hull, a profile every ten days; its neutral volume may drift, cm3 a day."""
    rows = []
    for profile in range(1, profiles + 1):
        volume = truth.buoyancy.neutral_volume + 10.0 * trend * (profile - 2.5)
        hull = with_values(truth, {"buoyancy.neutral_volume": volume})
        glider = Glider(hull)
        for mass in masses:
            for pitch in pitches:
                for sign in (1.0, -1.0):
                    for depth in (20.0, 80.0):
                        glide = steady_glide(glider, sign * mass, -sign * math.radians(pitch), depth)
                        volume = hull.buoyancy.neutral_volume_m3 - sign * mass / hull.buoyancy.water_density
                        rows.append((profile, glide, volume))
    numbers, found, volumes = zip(*rows, strict=True)
    none = np.zeros(len(rows))
    return SteadySegments(
        np.array(numbers), np.datetime64("2024-01-01", "ns") + np.array(numbers) * np.timedelta64(10, "D"),
        np.column_stack([[g.battery_position for g in found], none, volumes, none]), none,
        np.array([g.pitch for g in found]), none, np.array([g.depth for g in found]),
        np.array([g.depth_rate for g in found]), np.ones(len(rows), dtype=bool), np.full((len(rows), 4), np.nan),
        np.full((len(rows), 3), np.nan), np.full(len(rows), ""),
    )  # fmt: skip
