"""Which files make up a mission: one for every dive."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from gliderhpc.errors import InputError
from gliderhpc.observations.sources import files_of

_NAME = re.compile(r"p(?P<vehicle>\d{3})(?P<dive>\d{4})(?:_\d{8})?\.nc", re.IGNORECASE)


@dataclass(frozen=True)
class MissionFiles:
    """The files of one Seaglider's mission.

    Attributes
    ----------
    vehicle : int
        Number of the glider.
    dives : dict of int to Path
        The file of every dive, by ascending dive.
    """

    vehicle: int
    dives: dict[int, Path]


def is_seaglider_file(path: Path) -> bool:
    """Whether a file is named as the basestation names its per-dive files."""
    return _NAME.fullmatch(path.name) is not None


def find_files(sources: Sequence[Path]) -> MissionFiles:
    """Collect the per-dive files of a mission.

    Parameters
    ----------
    sources : sequence of Path
        Files, or folders that hold them.

    Raises
    ------
    InputError
        A source does not exist or is no per-dive file, there is none, a dive comes twice, or the files belong to more
        than one glider.
    """
    dives: dict[int, Path] = {}
    owners: dict[int, Path] = {}
    for path in files_of(sources, is_seaglider_file):
        match = _NAME.fullmatch(path.name)
        if match is None:
            raise InputError(f"{path}: is not named like a Seaglider's per-dive file (pGGGDDDD.nc)")
        owners.setdefault(int(match["vehicle"]), path)
        dive = int(match["dive"])
        if dive in dives:
            raise InputError(f"{path}: dive {dive} is already there as {dives[dive]}; give every dive once")
        dives[dive] = path
    if not dives:
        raise InputError(f"{', '.join(map(str, sources))}: no pGGGDDDD.nc there; give the folder of per-dive files")
    if len(owners) > 1:
        first, second = list(owners.values())[:2]
        raise InputError(f"{second}: belongs to another glider than {first}; import one glider at a time")
    return MissionFiles(next(iter(owners)), dict(sorted(dives.items())))
