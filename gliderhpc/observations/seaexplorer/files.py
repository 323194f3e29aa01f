"""Files of a mission: for every cycle one of navigation and one or two of the payload.

The vehicle sends a sub-sampled payload record (``pld1.sub``) from sea and keeps the full one (``pld1.raw``), which is
there after recovery (delayed mode). Both may lie side by side.
"""

import gzip
import re
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from gliderhpc.errors import InputError
from gliderhpc.observations.sources import files_of

_NAME = re.compile(
    r"(?P<vehicle>\w+)\.(?P<mission>\d{1,9})\.(?P<kind>gli|pld1)\.(?P<rate>sub|raw)\.(?P<cycle>\d{1,6})(?:\.gz)?",
    re.IGNORECASE,
)

LARGEST_CONTENT = 500_000_000
"""Bytes of a cycle's record, unpacked: a week of it at 1 Hz is 100 MB."""

PREFERENCE = {"gli": ("sub", "raw"), "pld1": ("raw", "sub")}
"""Rates of a cycle's files, the preferred one first: the payload's full record, and the navigation that is usual."""


@dataclass(frozen=True)
class MissionFiles:
    """The files of one glider's mission.

    Attributes
    ----------
    vehicle : str
        Name of the glider in capitals, for example SEA035.
    mission : int
        Number of the mission.
    navigation : dict of int to Path
        The ``gli`` file of every cycle, by ascending cycle.
    payload : dict of int to tuple of Path
        The ``pld1`` files of every cycle that has any, by ascending cycle: the full record before the sub-sampled one.
    """

    vehicle: str
    mission: int
    navigation: dict[int, Path]
    payload: dict[int, tuple[Path, ...]]


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
        A source does not exist or is no SeaExplorer file, there is no navigation file, two files of different content
        claim the same cycle, or the files belong to more than one mission.
    """
    found: dict[tuple[str, str], dict[int, Path]] = {
        (kind, rate): {} for kind in PREFERENCE for rate in PREFERENCE[kind]
    }
    owners: dict[tuple[str, int], Path] = {}
    for path in files_of(sources, is_seaexplorer_file):
        match = _NAME.fullmatch(path.name)
        if match is None:
            raise InputError(
                f"{path}: is not named like a SeaExplorer record (*.gli.sub.N, *.pld1.sub.N or *.pld1.raw.N)"
            )
        owners.setdefault((match["vehicle"].upper(), int(match["mission"])), path)
        cycles, cycle = found[match["kind"].lower(), match["rate"].lower()], int(match["cycle"])
        first = cycles.setdefault(cycle, path)
        if first != path and read_content(first) != read_content(path):
            raise InputError(f"{path}: cycle {cycle} is already there as {first}; give every cycle once")
    navigation = {cycle: paths[0] for cycle, paths in _by_cycle(found, "gli").items()}
    if not navigation:
        raise InputError(f"{', '.join(map(str, sources))}: no *.gli.sub.* file there; give the folder that holds them")
    if len(owners) > 1:
        first, second = list(owners.values())[:2]
        raise InputError(f"{second}: belongs to another mission than {first}; import one mission at a time")
    (vehicle, mission), _ = owners.popitem()
    return MissionFiles(vehicle, mission, navigation, _by_cycle(found, "pld1"))


def read_content(path: Path) -> bytes:
    """Bytes of a file, plain or gzipped.

    Raises
    ------
    InputError
        It cannot be read, was cut short, or holds more than any cycle.
    """
    try:
        with gzip.open(path) if path.suffix.lower() == ".gz" else path.open("rb") as stream:
            content = stream.read(LARGEST_CONTENT + 1)
    except (OSError, EOFError, zlib.error) as error:
        raise InputError(f"{path}: cannot be read: {error}") from error
    if len(content) > LARGEST_CONTENT:
        raise InputError(f"{path}: holds more than {LARGEST_CONTENT / 1e6:.0f} MB, which is no record of one cycle")
    return content


def _by_cycle(found: Mapping[tuple[str, str], Mapping[int, Path]], kind: str) -> dict[int, tuple[Path, ...]]:
    """Files of a kind, by ascending cycle, the preferred rate first."""
    rates = [found[kind, rate] for rate in PREFERENCE[kind]]
    cycles = sorted({cycle for rate in rates for cycle in rate})
    return {cycle: tuple(rate[cycle] for rate in rates if cycle in rate) for cycle in cycles}
