"""Digests of the inputs of a profile's results, with which an archive records its sources."""

import hashlib
import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from gliderhpc.mission.settings import MissionSettings
from gliderhpc.observations import Observations
from gliderhpc.platform import Platform
from gliderhpc.store_schema import Commit, read_attributes, read_commits
from gliderhpc.store_schema.location import Location
from gliderhpc.version import __version__

FIXES = "fixes"
"""Kind of input that affects only the currents."""


def differs_in_fixes_only(commit: Commit, inputs: Mapping[str, str]) -> bool:
    """Return whether only the fixes differ, and the commit stores the data needed to recompute the currents."""
    unchanged = all(commit.inputs.get(kind) == digest for kind, digest in inputs.items() if kind != FIXES)
    return unchanged and bool(commit.extra) and commit.row.get("status") == "done"


def common_digests(platform: Platform, settings: MissionSettings) -> dict[str, str]:
    """Return the digests, by kind, of the inputs that all profiles of a run have in common."""
    return {
        "software": __version__,
        "settings": _digest(settings.model_dump(mode="json")),
        "platform": _digest(platform.model_dump(mode="json")),
    }


def input_digests(
    observations: Observations, number: int, mission_start: np.datetime64, common: Mapping[str, str]
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
    common : mapping of str to str
        Digests of the inputs that all profiles have in common (`common_digests`).
    """
    return {
        **common,
        "record": _record_digest(observations, number, mission_start),
        FIXES: observations.fix_digest(number),
    }


def earliest_start(observations: Observations) -> np.datetime64:
    """Return the start of the earliest profile, the origin of a mission's `elapsed_days`."""
    return min(map(observations.start_time, observations.profile_numbers))


def is_made_from(location: Location, observations: Observations, profiles: Mapping[int, int]) -> bool:
    """Return whether an archive's profiles were made from these observations, regardless of how a file stores them.

    Parameters
    ----------
    location : str or Path
        The archive.
    observations : Observations
        The open file. An identical file is accepted at once; for any other the record of each profile is compared.
    profiles : mapping of int to int
        Positions of the profiles by number.
    """
    if read_attributes(location).get("observations_digest") == observations.digest():
        return True
    if not set(profiles) <= set(observations.profile_numbers):
        return False
    commits, start = read_commits(location, profiles.values()), earliest_start(observations)
    records = {
        number: (commit.inputs.get("record"), commit.inputs.get(FIXES))
        for number, index in profiles.items()
        if isinstance(commit := commits.get(index), Commit)
    }
    return bool(records) and all(
        (_record_digest(observations, number, start), observations.fix_digest(number)) == made_from
        for number, made_from in records.items()
    )


def _record_digest(observations: Observations, number: int, mission_start: np.datetime64) -> str:
    return _digest([observations.profile_digest(number), str(mission_start)])


def _digest(content: Any) -> str:
    return hashlib.blake2b(json.dumps(content, sort_keys=True).encode(), digest_size=16).hexdigest()
