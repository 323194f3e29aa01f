"""Probabilities of changes of the hull on missions drawn from the model of study ``hull``.

Usage: ``python -m benchmarks.hull_changes ARCHIVE [--missions 150]``. Prints the table of ``docs/studies.md``.

Each dive has the information of the archive's dive, and a score that is drawn about known errors: none that changes, a
drag and a neutral volume that grow over the last half of the mission, alone and together, and errors of the lift that
differ from dive to dive but do not change.
"""

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from gliderhpc.archive.mission import open_for_reading
from gliderhpc.archive.profile import done_profiles
from gliderhpc.findings.formatting import markdown
from gliderhpc.mission_hull.estimate import ProfileTerm
from gliderhpc.mission_hull.joint_change import find_hull_changes
from gliderhpc.mission_hull.single_changes import POSSIBLE, PROBABLE
from gliderhpc.studies.hull import MissionTerms, read_terms

DRAG, VOLUME, LIFT = "viscous.K_D0", "buoyancy.neutral_volume", "viscous.K_L"
GROWTH, SCATTER = {DRAG: 0.5, VOLUME: 0.12}, 0.8
"""Growth until the last dive, and scatter from dive to dive, in plausible deviations."""

KINDS: dict[str, tuple[str, ...]] = {
    "no change": (),
    "drag": (DRAG,),
    "neutral volume": (VOLUME,),
    "drag and neutral volume": (DRAG, VOLUME),
    "no change, lift scatters": (LIFT,),
}


def courses_of(mission: MissionTerms, changed: Sequence[str], rng: np.random.Generator) -> NDArray[np.float64]:
    """Errors ``(dive, parameter)`` of one mission, in plausible deviations."""
    count = len(mission.terms)
    keys = [p.key for p in mission.parameters]
    errors = np.zeros((count, len(keys)))
    grown = np.clip((np.arange(count) - count // 2 + 1) / (count - count // 2), 0.0, 1.0)
    for key in changed:
        scattered = SCATTER * rng.standard_normal(count)
        errors[:, keys.index(key)] = GROWTH[key] * grown if key in GROWTH else scattered
    return errors


def drawn(term: ProfileTerm, errors: NDArray[np.float64], rng: np.random.Generator) -> ProfileTerm:
    """Dive with the information of a term and a score drawn about known errors."""
    values, vectors = np.linalg.eigh(term.information)
    noise = vectors @ (np.sqrt(np.maximum(values, 0.0)) * rng.standard_normal(len(values)))
    return replace(term, point=np.zeros(len(values)), score=term.information @ errors + noise, others=())


def probabilities(mission: MissionTerms, changed: Sequence[str], seed: int) -> tuple[float, float]:
    """Largest probability of a single parameter, and the probability that anything has changed."""
    rng = np.random.default_rng([seed, len(changed), *map(len, changed)])
    terms = [
        drawn(term, errors, rng) for term, errors in zip(mission.terms, courses_of(mission, changed, rng), strict=True)
    ]
    with threadpool_limits(limits=1):
        changes, joint = find_hull_changes(terms, mission.suspects, mission.prior, 1.0, mission.companions)
    if joint is None:
        raise SystemExit("the archive has too few dives")
    return max(change.probability for change in changes.values() if change is not None), joint.probability


def rows(found: Mapping[str, NDArray[np.float64]]) -> list[list[str]]:
    """Rows of the table: shares of missions beyond the two levels, by kind."""
    return [
        [
            kind,
            str(len(values)),
            *(f"{np.mean(values[:, column] >= level):.2f}" for column in (0, 1) for level in (POSSIBLE, PROBABLE)),
        ]
        for kind, values in found.items()
    ]


def main(arguments: list[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("archive")
    parser.add_argument("--missions", type=int, default=150)
    options = parser.parse_args(arguments)
    with open_for_reading(options.archive) as archive:
        mission = read_terms(archive, done_profiles(archive))
    found = {
        kind: np.array([probabilities(mission, changed, seed) for seed in range(options.missions)])
        for kind, changed in KINDS.items()
    }
    head = ["errors", "missions"]
    head += [f"{name} >= {level:g}" for name in ("a parameter", "anything") for level in (POSSIBLE, PROBABLE)]
    print(markdown(head, rows(found)))


if __name__ == "__main__":
    main()
