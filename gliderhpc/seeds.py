"""Random numbers that belong to one profile and one purpose, whatever else is drawn."""

from enum import IntEnum

import numpy as np


class Stream(IntEnum):
    """What the random numbers are for; a change of one leaves the others as they are."""

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


MISSION = 0
"""In place of a profile's number: what belongs to the whole mission."""


def generator(seed: int, profile: int, stream: Stream) -> np.random.Generator:
    """Make the generator of one profile's stream.

    It depends on nothing but its arguments, so profiles can be simulated in any order and by any number of workers.
    """
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(profile, int(stream))))
