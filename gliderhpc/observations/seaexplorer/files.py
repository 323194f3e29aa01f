"""Which files make up a mission: one of navigation and one of the payload for every cycle."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from gliderhpc.errors import InputError
from gliderhpc.observations.sources import files_of

_NAME = re.compile(
    r"(?P<vehicle>\w+)\.(?P<mission>\d+)\.(?P<kind>gli|pld1)\.sub\.(?P<cycle>\d+)(?:\.gz)?", re.IGNORECASE
)


@dataclass(frozen=True)
class MissionFiles:
    """The files of one glider's mission.

    Attributes
    ----------
    vehicle : str
        Name of the glider in capitals, for example SEA035.
    mission : int
        Number of the mission.
    navigation, payload : dict of int to Path
        The ``gli`` and the ``pld1`` file of every cycle, by ascending cycle.
    """

    vehicle: str
    mission: int
    navigation: dict[int, Path]
    payload: dict[int, Path]


def is_seaexplorer_file(path: Path) -> bool:
    """Whether a file is named as the glider names its records."""
    return _NAME.fullmatch(path.name) is not None


def find_files(sources: Sequence[Path]) -> MissionFiles:
    """Collect the files of a mission.

    Parameters
    ----------
    sources : sequence of Path
        Files, or folders that hold them.

    Raises
    ------
    InputError
        A source does not exist or is no SeaExplorer file, there is no navigation file, a cycle comes twice, or the
        files belong to more than one mission.
    """
    navigation: dict[int, Path] = {}
    payload: dict[int, Path] = {}
    owners: dict[tuple[str, int], Path] = {}
    for path in files_of(sources, is_seaexplorer_file):
        match = _NAME.fullmatch(path.name)
        if match is None:
            raise InputError(f"{path}: is not named like a SeaExplorer record (*.gli.sub.N or *.pld1.sub.N)")
        owners.setdefault((match["vehicle"].upper(), int(match["mission"])), path)
        kind, cycle = (navigation if match["kind"].lower() == "gli" else payload), int(match["cycle"])
        if cycle in kind:
            raise InputError(f"{path}: cycle {cycle} is already there as {kind[cycle]}; give every cycle once")
        kind[cycle] = path
    if not navigation:
        raise InputError(f"{', '.join(map(str, sources))}: no *.gli.sub.* file there; give the folder that holds them")
    if len(owners) > 1:
        first, second = list(owners.values())[:2]
        raise InputError(f"{second}: belongs to another mission than {first}; import one mission at a time")
    (vehicle, mission), _ = owners.popitem()
    return MissionFiles(vehicle, mission, dict(sorted(navigation.items())), dict(sorted(payload.items())))
