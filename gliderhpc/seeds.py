"""Random number generators, independent for each profile and purpose."""

from enum import IntEnum

import numpy as np


class Stream(IntEnum):
    """Purpose of random numbers; the streams of different purposes are independent."""

    DISTURBANCE = 0
    CURRENT = 1
    HEADING = 2
    SENSORS = 3
    SURFACE = 4
    SHEAR = 5
    GUSTS = 6
    COEFFICIENTS = 7
    FAULTS = 8
    DEPTH = 9
    CTD = 10
    VERTICAL = 11
    VELOCITY = 12


MISSION = 0
"""Profile number of streams that belong to the whole mission."""


def generator(seed: int, profile: int, stream: Stream) -> np.random.Generator:
    """Return the generator of one profile's stream.

    It depends only on its arguments; profiles can be simulated in any order and by any number of workers.
    """
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(profile, int(stream))))
