"""Dives whose information on a hull is drawn about known errors: petrel-l's, or any five unknowns."""

import numpy as np

from gliderhpc.flight.hull_parameters import hull_parameters
from gliderhpc.mission_hull.estimate import ProfileTerm
from gliderhpc.mission_hull.single_changes import change_chains, single_changes
from gliderhpc.platform import read_platform

PARAMETERS = hull_parameters(read_platform("petrel-l"))
KEYS = [p.key for p in PARAMETERS]
START = np.datetime64("2024-04-01T00:00:00", "ns")

P = 5
"""Number of unknowns of the dives whose information is drawn at random."""


def dives(count, courses, seed=0, information=30.0):
    """Terms of dives six hours apart, whose hull follows some courses (n,) by key, in plausible deviations."""
    rng = np.random.default_rng(seed)
    terms = []
    for n in range(count):
        truth = np.array([courses[key][n] if key in courses else 0.1 for key in KEYS])
        matrix = information * np.eye(len(KEYS))
        score = matrix @ truth + np.sqrt(information) * rng.standard_normal(len(KEYS))
        time = START + np.timedelta64(6 * n, "h")
        terms.append(ProfileTerm(n + 1, time, np.zeros(len(KEYS)), score, matrix))
    return tuple(terms)


def information(rng, rank=P, size=30.0):
    """Return a random information matrix, singular where the rank is less than P."""
    root = rng.standard_normal((P, rank)) * np.sqrt(size)
    return root @ root.T


def dive(rng, truth, number, *, rank=P, size=30.0, hours=6.0, point=None, current=None):
    """Return the term of a dive whose own likelihood is about a truth plus what its information leaves open."""
    matrix = information(rng, rank, size)
    point = 0.3 * rng.standard_normal(P) if point is None else point
    values, vectors = np.linalg.eigh(matrix)
    noise = vectors @ (np.sqrt(np.maximum(values, 0.0)) * rng.standard_normal(P))
    time = START + np.timedelta64(int(hours * 3600 * number), "s")
    return ProfileTerm(number, time, point, matrix @ (truth - point) + noise, matrix, current=current)


def changes_alone(dives, suspects, prior, companions=None, *, robust=True):
    """Return the change of each suspect, without that of any of them, which takes longer."""
    return single_changes(change_chains(dives, suspects, prior, robust=robust), suspects, companions)
