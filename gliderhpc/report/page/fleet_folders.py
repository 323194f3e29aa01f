"""Names of the folders for the missions of a fleet, derived from the names of the archives."""

import itertools
from collections import Counter
from collections.abc import Sequence

from gliderhpc.errors import InputError
from gliderhpc.store_schema.place import Place, absolute, is_address

_SUFFIX = ".zarr"
_RESERVED = ("index.html", "fleet.csv", "fleet_map.png", "fleet_map.svg")
"""File names reserved for the fleet's page."""


def folder_names(places: Sequence[Place]) -> list[str]:
    """Return a folder name for each archive: its name without ``.zarr``, preceded by parent folders if names are equal.

    Names that differ only in case are regarded as equal, since some file systems do not distinguish them.

    Raises
    ------
    InputError
        An archive is given twice.
    """
    counts = Counter(map(absolute, places))
    for place in places:
        if counts[absolute(place)] > 1:
            raise InputError(f"{place}: this archive is given {counts[absolute(place)]} times; give each once")
    parts = [_parts(place) for place in places]
    depths = [1] * len(parts)
    while True:
        names = ["-".join(one[-depth:]) for one, depth in zip(parts, depths, strict=True)]
        same = [index for index in _ambiguous(names) if depths[index] < len(parts[index])]
        if not same:
            return _numbered(names)
        for index in same:
            depths[index] += 1


def _parts(place: Place) -> list[str]:
    """Return the parts of a place's name that can name a folder, the last one without ``.zarr``."""
    # The scheme of an address is not a folder.
    name = absolute(place).partition("://")[2] if is_address(place) else absolute(place)
    parts = [part for part in name.replace("\\", "/").split("/") if part not in ("", ".", "..")] or ["archive"]
    return [*parts[:-1], parts[-1].removesuffix(_SUFFIX) or parts[-1]]


def _ambiguous(names: Sequence[str]) -> list[int]:
    counts = Counter((*map(str.casefold, names), *_RESERVED))
    return [index for index, name in enumerate(names) if counts[name.casefold()] > 1]


def _numbered(names: Sequence[str]) -> list[str]:
    """Number the names that the parent folders do not distinguish, from the second on."""
    numbered: list[str] = []
    taken, wanted = set(_RESERVED), {name.casefold() for name in names}
    for name in names:
        candidates = (f"{name}-{count}" for count in itertools.count(2))
        free = (one for one in candidates if one.casefold() not in taken | wanted)
        numbered.append(name if name.casefold() not in taken else next(free))
        taken.add(numbered[-1].casefold())
    return numbered
