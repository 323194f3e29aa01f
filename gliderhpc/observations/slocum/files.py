"""Which files make up a mission: one of the flight and one of the science computer for every segment, or netCDF."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from gliderhpc.errors import InputError
from gliderhpc.observations.sources import refuse_compressed

FLIGHT = ("dbd", "dcd", "mbd", "mcd", "sbd", "scd")
"""Endings of the flight computer's files, the fullest record first; the middle letter c marks the compressed ones."""

SCIENCE = ("ebd", "ecd", "nbd", "ncd", "tbd", "tcd")
"""Endings of the science computer's files, in the same order."""

_DECODED = "nc"


@dataclass(frozen=True)
class MissionFiles:
    """The files of one glider's mission.

    Attributes
    ----------
    flight, science : tuple of Path
        Binary files, one a segment.
    decoded : tuple of Path
        netCDF files of native sensors.
    """

    flight: tuple[Path, ...]
    science: tuple[Path, ...]
    decoded: tuple[Path, ...]


def is_binary(path: Path) -> bool:
    """Whether a file is named as the glider names its binary records."""
    return _ending(path) in (*FLIGHT, *SCIENCE)


def is_compressed(path: Path) -> bool:
    """Whether a file is named as the glider names its compressed records."""
    return is_binary(path) and _ending(path)[1] == "c"


def find_files(sources: Sequence[Path], out: Path) -> MissionFiles:
    """Collect the files of a mission.

    Parameters
    ----------
    sources : sequence of Path
        Files, or folders that hold them. Of a folder the binary files are taken, the netCDF files where it has none.
    out : Path
        The file to be written, which is no source.

    Raises
    ------
    InputError
        A source does not exist or is neither a binary nor a netCDF file, or no source holds a flight record.
    """
    files = [path for source in sources for path in _expand(source, out)]
    flight = _fullest([path for path in files if _ending(path) in FLIGHT], FLIGHT)
    science = _fullest([path for path in files if _ending(path) in SCIENCE], SCIENCE)
    decoded = tuple(dict.fromkeys(path for path in files if _ending(path) == _DECODED))
    if not flight and not decoded:
        raise InputError(
            f"{', '.join(map(str, sources))}: no flight record there (*.dbd, *.sbd, their compressed forms, or "
            "netCDF); give the folder that holds them"
        )
    return MissionFiles(flight, science, decoded)


def _ending(path: Path) -> str:
    return path.suffix.removeprefix(".").lower()


def _expand(source: Path, out: Path) -> list[Path]:
    if source.is_dir():
        held = sorted(path for path in source.iterdir() if path.is_file() and path.resolve() != out.resolve())
        found = [path for path in held if is_binary(path)] or [path for path in held if _ending(path) == _DECODED]
        if not found:
            refuse_compressed(path for path in held if _is_record(path.with_suffix("")))
        return found
    if not source.is_file():
        raise InputError(f"{source}: no such file or folder")
    if not _is_record(source):
        refuse_compressed([source])
        raise InputError(f"{source}: is neither a Slocum record (*.dbd, *.ebd and their kin) nor a netCDF file")
    return [source]


def _is_record(path: Path) -> bool:
    return is_binary(path) or _ending(path) == _DECODED


def _fullest(files: list[Path], endings: tuple[str, ...]) -> tuple[Path, ...]:
    """One file a segment: the fullest record of it that is there."""
    best: dict[str, Path] = {}
    for path in sorted(files, key=lambda path: endings.index(_ending(path))):
        best.setdefault(path.stem.lower(), path)
    return tuple(sorted(best.values(), key=_segment_order))


def _segment_order(path: Path) -> list[str | tuple[int, str]]:
    """Order names by their numbers, so that segment 10 comes after segment 9."""
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", path.name)]
