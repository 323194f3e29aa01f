"""Dives whose information on petrel-l's hull is drawn about a known course of its errors."""

import numpy as np

from gliderhpc.flight.hull_parameters import hull_parameters
from gliderhpc.platform import read_platform
from gliderhpc.tuning.mission_hull import DiveTerm

PARAMETERS = hull_parameters(read_platform("petrel-l"))
KEYS = [p.key for p in PARAMETERS]
START = np.datetime64("2024-04-01T00:00:00", "ns")


def dives(count, courses, seed=0, information=30.0):
    """Terms of dives six hours apart, whose hull follows some courses (n,) by key, in plausible deviations."""
    rng = np.random.default_rng(seed)
    terms = []
    for n in range(count):
        truth = np.array([courses[key][n] if key in courses else 0.1 for key in KEYS])
        matrix = information * np.eye(len(KEYS))
        score = matrix @ truth + np.sqrt(information) * rng.standard_normal(len(KEYS))
        time = START + np.timedelta64(6 * n, "h")
        terms.append(DiveTerm(n + 1, time, np.zeros(len(KEYS)), score, matrix))
    return tuple(terms)
