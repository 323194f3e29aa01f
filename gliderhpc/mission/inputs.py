"""What a profile is made from, as digests: a profile made from other inputs is not the profile that is asked for."""

import hashlib
import json
from typing import Any

import numpy as np

from gliderhpc.mission.settings import MissionSettings
from gliderhpc.observations import Observations
from gliderhpc.platform import Platform
from gliderhpc.version import __version__

KINDS = {
    "software": "another version of gliderhpc",
    "settings": "other settings",
    "platform": "another platform",
    "record": "another record",
}
"""Kinds of input, each with what a profile was made with where it differs, in the order in which they are told."""


def inputs_of(
    observations: Observations, number: int, mission_start: np.datetime64, platform: Platform, settings: MissionSettings
) -> dict[str, str]:
    """Digest by kind of all that decides a profile's results.

    Parameters
    ----------
    observations : Observations
        The open file.
    number : int
        Number of the profile.
    mission_start : numpy.datetime64
        Where its `elapsed_days` count from.
    platform, settings : Platform, MissionSettings
        The run's.
    """
    return {
        "software": __version__,
        "settings": _digest(settings.model_dump(mode="json")),
        "platform": _digest(platform.model_dump(mode="json")),
        "record": _digest([observations.profile_digest(number), str(mission_start)]),
    }


def first_difference(found: dict[str, str], wanted: dict[str, str]) -> str | None:
    """Say what a profile was made with that is not what is wanted, None where all is the same."""
    return next((what for kind, what in KINDS.items() if found.get(kind) != wanted[kind]), None)


def _digest(content: Any) -> str:
    return hashlib.blake2b(json.dumps(content, sort_keys=True).encode(), digest_size=16).hexdigest()
