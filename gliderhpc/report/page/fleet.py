"""Report of a fleet: a page for each mission, in its own folder, and one page with a row for each mission."""

from __future__ import annotations

import itertools
import os
import shlex
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from urllib.parse import quote

from gliderhpc.errors import InputError
from gliderhpc.report.page.content import (
    Block,
    Commands,
    FigureBlock,
    LinkedTable,
    LinkedTableEntry,
    Notice,
    Page,
    PageSection,
    Row,
)
from gliderhpc.report.page.fleet_map import fleet_map
from gliderhpc.report.page.fleet_rows import MissionState, read_state
from gliderhpc.report.page.mission_page import MISSION_PAGE, footer, write_mission_page
from gliderhpc.report.page.operator_summary import POORLY_CONVERGED
from gliderhpc.report.page.rendering import ReportFiles, check_outside_archives, write_page
from gliderhpc.store_schema.location import Location, absolute, is_address
from gliderhpc.surfacing.next_surfacing import PROBABILITY
from gliderhpc.wording import counted

_COLUMNS = ("glider", "platform", "time", "dives", "last current", "through the water", "hull", "anomalies")
_CAPTION = (
    "One row per mission. The last current is the depth-averaged current of the last dive that has one, with the "
    f"semi-axes of its {PROBABILITY:.0%} ellipse (m/s); speeds through the water are those of the last dive, with one "
    "standard deviation. Changes of drag and neutral volume are those found by the study hull. Profiles with less "
    f"than {POORLY_CONVERGED:.0%} of their windows converged are listed as anomalies."
)
_MAP_CAPTION = (
    "Tracks from fix to fix, and the last known depth-averaged current of each glider with its "
    f"{PROBABILITY:.0%} ellipse. The numbers are those of the table. Longitudes are scaled to distance at the middle "
    "latitude."
)

_RESERVED = ("index.html", "fleet.csv", "fleet_map.png", "fleet_map.svg")
"""File names reserved for the fleet's page."""


@dataclass(frozen=True, eq=False)
class _Member:
    """Mission of a fleet: archive, folder of its page, state if it can be read, and reason of a failure."""

    number: int
    place: Location
    folder: str
    state: MissionState | None = None
    fault: str = ""

    @property
    def name(self) -> str:
        return self.folder if self.state is None else f"{self.folder}: {self.state.mission}"

    @property
    def entry(self) -> LinkedTableEntry:
        title = f"{self.number}  {self.folder}"
        if self.state is None:
            return LinkedTableEntry(title, str(self.place), None, {}, self.fault)
        address = None if self.fault else f"{quote(os.fsencode(self.folder), safe='')}/{MISSION_PAGE}"
        cells = self.state.cells
        if self.fault:
            cells = {**cells, "anomalies": (f"no separate page: {self.fault}", *self.state.anomalies)}
        return LinkedTableEntry(title, self.state.mission, address, cells)

    @property
    def row(self) -> Row:
        own = {"number": self.number, "archive": _encodable(str(self.place)), "fault": _encodable(self.fault)}
        return own if self.state is None else {**own, **self.state.row()}


def _encodable(text: str) -> str:
    """Replace the parts of a text that UTF-8 cannot encode: bytes of a file's name that are not text."""
    return text.encode("utf-8", "replace").decode("utf-8")


def write_fleet(places: Sequence[Location], out: Path) -> ReportFiles:
    """Write the page of every mission into a separate folder, and the page of the fleet.

    Parameters
    ----------
    places : sequence of str or Path
        At least two archives.
    out : Path
        Folder for the fleet's page and the missions' folders.

    Returns
    -------
    ReportFiles
        Files of the fleet's page; `failed` has a line for each archive without a separate page.

    Raises
    ------
    InputError
        An archive is given twice, a page would be written into an archive, the folder cannot be written, or none of the
        archives can be read.
    """
    names = folder_names(places)
    check_outside_archives(places, [out, *(out / name for name in names)])
    members = [
        _report_member(_Member(number, place, name), out)
        for number, (place, name) in enumerate(zip(places, names, strict=True), start=1)
    ]
    if all(member.state is None for member in members):
        raise InputError(f"none of the {len(members)} archives can be read; the first: {members[0].fault}")
    written = write_page(_fleet_page(members, out), out, MISSION_PAGE, footer(f"{len(places)} archives"))
    return replace(written, failed=tuple(member.fault for member in members if member.fault))


def folder_names(places: Sequence[Location]) -> list[str]:
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
    parts = [_name_parts(place) for place in places]
    depths = [1] * len(parts)
    while True:
        names = ["-".join(words[-depth:]) for words, depth in zip(parts, depths, strict=True)]
        same = [index for index in _duplicates(names) if depths[index] < len(parts[index])]
        if not same:
            return _with_numbers(names)
        for index in same:
            depths[index] += 1


def _name_parts(place: Location) -> list[str]:
    """Return the parts of a place's name that can name a folder, the last one without ``.zarr``."""
    # The scheme of an address is not a folder.
    name = absolute(place).partition("://")[2] if is_address(place) else absolute(place)
    parts = [part for part in name.replace("\\", "/").split("/") if part not in ("", ".", "..")] or ["archive"]
    return [*parts[:-1], parts[-1].removesuffix(".zarr") or parts[-1]]


def _duplicates(names: Sequence[str]) -> list[int]:
    """Return the positions of names that are not unique."""
    counts = Counter((*map(str.casefold, names), *_RESERVED))
    return [index for index, name in enumerate(names) if counts[name.casefold()] > 1]


def _with_numbers(names: Sequence[str]) -> list[str]:
    """Number the names that the parent folders do not distinguish, from the second on."""
    numbered: list[str] = []
    taken, wanted = set(_RESERVED), {name.casefold() for name in names}
    for name in names:
        candidates = (f"{name}-{count}" for count in itertools.count(2))
        free = (candidate for candidate in candidates if candidate.casefold() not in taken | wanted)
        numbered.append(name if name.casefold() not in taken else next(free))
        taken.add(numbered[-1].casefold())
    return numbered


def _report_member(member: _Member, out: Path) -> _Member:
    """Read the state of a mission and write its page; record the reason if the archive cannot be used."""
    try:
        member = replace(member, state=read_state(member.place))
        write_mission_page(member.place, out / member.folder)
    except InputError as error:
        return replace(member, fault=str(error))
    return member


def _fleet_page(members: Sequence[_Member], out: Path) -> Page:
    roster = LinkedTable(
        "fleet", _CAPTION, _COLUMNS, tuple(member.entry for member in members), [member.row for member in members]
    )
    command = shlex.join(["gliderhpc", "report", *(str(member.place) for member in members), "--out", str(out)])
    sections = (
        PageSection("fleet", "The gliders", (roster,)),
        PageSection("map", "Map", (_map_block(members),)),
        PageSection(
            "reproduction", "How to reproduce this", (Commands("This command writes all pages again:", (command,)),)
        ),
    )
    return Page(f"Fleet of {counted(len(members), 'mission')}", _subtitle(members), sections, "fleet.css")


def _subtitle(members: Sequence[_Member]) -> str:
    states = [member.state for member in members if member.state is not None]
    done, failed = (sum(state.summary.statuses.get(status, 0) for state in states) for status in ("done", "failed"))
    unread = len(members) - len(states)
    text = f"{counted(done, 'profile')} done, {failed} failed"
    return f"{text}; {unread} of {len(members)} archives cannot be read" if unread else text


def _map_block(members: Sequence[_Member]) -> Block:
    tracks = [member.state.track(member.number, member.name) for member in members if member.state is not None]
    figure = fleet_map(tracks)
    if figure is None:
        return Notice("no mission has a profile with a fix before or after it, so there is no map")
    missing = [str(track.number) for track in tracks if not len(track.fixes)]
    caption = f"{_MAP_CAPTION} Without fixes: {', '.join(missing)}." if missing else _MAP_CAPTION
    currents = sum(track.has_current for track in tracks)
    drawn = counted(len(tracks) - len(missing), "mission")
    alternative = f"Map of the tracks of {drawn}, with the last current of {currents} as arrows."
    return FigureBlock("fleet_map", caption, alternative, figure)
