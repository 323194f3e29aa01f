"""Validity of an archive's profiles on resume: which can be reused, which must be recomputed, and why."""

import hashlib
import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gliderhpc.mission.profile_rows import Row
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.observations import Observations
from gliderhpc.platform import Platform
from gliderhpc.store_schema import read_commits
from gliderhpc.store_schema.commits import Commit, damages
from gliderhpc.store_schema.deep_check import Fault, as_lines
from gliderhpc.store_schema.place import Place
from gliderhpc.version import __version__

KINDS = {
    "software": "another version of gliderhpc",
    "settings": "other settings",
    "platform": "another platform",
    "record": "another record",
}
"""Kinds of input, each with the description of a difference, in the order in which they are reported."""


def inputs_of(
    observations: Observations, number: int, mission_start: np.datetime64, platform: Platform, settings: MissionSettings
) -> dict[str, str]:
    """Return the digests, by kind, of all inputs that determine a profile's results.

    Parameters
    ----------
    observations : Observations
        The open file.
    number : int
        Number of the profile.
    mission_start : numpy.datetime64
        Origin of its `elapsed_days`.
    platform, settings : Platform, MissionSettings
        Hull and settings of the run.
    """
    return {
        "software": __version__,
        "settings": _digest(settings.model_dump(mode="json")),
        "platform": _digest(platform.model_dump(mode="json")),
        "record": _digest([observations.profile_digest(number), str(mission_start)]),
    }


def describe_difference(found: Mapping[str, str], wanted: Mapping[str, str]) -> str | None:
    """Describe the first input of a profile that differs from the wanted one, None where all are the same."""
    return next((text for kind, text in KINDS.items() if found.get(kind) != wanted[kind]), None)


def _digest(content: Any) -> str:
    return hashlib.blake2b(json.dumps(content, sort_keys=True).encode(), digest_size=16).hexdigest()


MISSING, FAILED, DAMAGED = "missing", "failed before", "damaged"


@dataclass(frozen=True)
class Validity:
    """Validity of an archive's profiles for a run.

    Attributes
    ----------
    valid : mapping of int to Row
        By position, the table row of every profile that is still valid.
    outstanding : mapping of int to str
        By position, the reason why a profile must be computed.
    damages : tuple of str
        Damaged chunks, one line each.
    """

    valid: Mapping[int, Row]
    outstanding: Mapping[int, str]
    damages: tuple[str, ...] = ()

    def describe(self) -> str:
        """Describe for the log how many profiles are valid, and how many must be computed for which reason."""
        counts = Counter(self.outstanding.values())
        reasons = ", ".join(f"{count} {reason}" for reason, count in counts.most_common())
        rest = f"to be computed: {reasons}" if reasons else "nothing to compute"
        return f"{len(self.valid)} profiles are valid; {rest}"


def check_profiles(place: Place, numbers: Sequence[int], inputs: Mapping[int, Mapping[str, str]]) -> Validity:
    """Determine the valid profiles: done, from these inputs, and with every chunk as it was written.

    Parameters
    ----------
    place : str or Path
        The archive.
    numbers : sequence of int
        Numbers of its profiles.
    inputs : mapping of int to mapping of str to str
        By position, the digests of each profile's inputs; profiles without an entry are not valid.
    """
    commits = read_commits(place)
    reasons = {index: _describe_reason(commits.get(index), inputs.get(index)) for index in range(len(numbers))}
    outstanding = {index: reason for index, reason in reasons.items() if reason is not None}
    candidates = {
        index: commit
        for index, reason in reasons.items()
        if reason is None and isinstance(commit := commits[index], Commit)
    }
    found = damages(place, candidates)
    outstanding |= {damage.profile_index: DAMAGED for damage in found}
    valid = {index: dict(commit.row) for index, commit in candidates.items() if index not in outstanding}
    faults = [
        Fault(f"profile {numbers[one.profile_index]}", one.variable, one.what, "it is computed again") for one in found
    ]
    return Validity(valid, dict(sorted(outstanding.items())), tuple(as_lines(faults)))


def _describe_reason(commit: Commit | str | None, inputs: Mapping[str, str] | None) -> str | None:
    """Describe why a profile is not valid, None where it is, but for damaged chunks."""
    if commit is None or inputs is None:
        return MISSING
    if isinstance(commit, str):
        return DAMAGED
    difference = describe_difference(commit.inputs, inputs)
    if difference is not None:
        return f"made with {difference}"
    return None if commit.row.get("status") == "done" else FAILED
