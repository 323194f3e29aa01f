"""Earlier versions of copied files, kept until a new version has proved to be worth as much.

A file that was complete can arrive again damaged or cut short. A dive that was reported must not be lost by this.
"""

import hashlib
import shutil
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from gliderhpc.api.watch_state import ReportedDive, WatchState
from gliderhpc.observations.in_memory import read_records
from gliderhpc.observations.landing import CopiedFile
from gliderhpc.output_files import written_aside

EARLIER = "earlier"
"""Name of the folder with the earlier versions, within that of the copies."""

_LEAST_SHARE = 0.98
"""Smallest share of a reported dive's samples that a new version must have; other processing may drop a few."""


def keep_earlier(copy: Path) -> None:
    """Keep a copy that is about to be replaced, unless one of this file is kept already."""
    kept = copy.parent / EARLIER / copy.name
    if copy.exists() and not kept.exists():
        kept.parent.mkdir(exist_ok=True)
        with written_aside(kept, overwrite=True) as aside:
            shutil.copyfile(copy, aside)


def kept_names(folder: Path) -> list[str]:
    """Return the names of the files in a folder of copies of which an earlier version is kept.

    A version that was only partly written when the watch was killed is not a file's.
    """
    return sorted(path.name for path in (folder / EARLIER).glob("*") if (folder / path.name).exists())


def drop_earlier(folder: Path, names: Iterable[str]) -> None:
    """Remove earlier versions."""
    for name in names:
        (folder / EARLIER / name).unlink()


def restore_earlier(folder: Path, names: Iterable[str], state: WatchState) -> None:
    """Replace the copies by their earlier versions; the new ones count as read until they change."""
    for name in names:
        kept = folder / EARLIER / name
        digest = hashlib.sha256(kept.read_bytes()).hexdigest()
        state.add_file(name, CopiedFile(state.copied[name].state, digest))
        kept.replace(folder / name)


def refused_versions(
    folder: Path, names: Iterable[str], faults: Mapping[str, str], lost: ReportedDive | None
) -> dict[str, str]:
    """Return the files whose new version is worth less than the earlier one, with the reason.

    Parameters
    ----------
    folder : Path
        Folder of the copies.
    names : iterable of str
        Files of which an earlier version is kept.
    faults : mapping of str to str
        Files that cannot be used, with the reason.
    lost : ReportedDive, optional
        A dive of which the records now have fewer samples than when it was reported.
    """
    names = list(names)
    refused = {name: f"the new version cannot be used ({faults[name]})" for name in names if name in faults}
    if lost is not None:
        shorter = [name for name in names if _size(folder / name) < _size(folder / EARLIER / name)]
        for name in shorter or names:
            refused.setdefault(name, f"the new version has fewer samples of dive {lost.profile}")
    return {name: f"{why}; the earlier one remains in use" for name, why in refused.items()}


def _size(path: Path) -> int:
    return path.stat().st_size


def lost_dive(records: Path, reported: Iterable[ReportedDive]) -> ReportedDive | None:
    """Return a reported dive of which an observation file has fewer samples than were reported, if there is one."""
    with read_records(records) as content:
        times = content["time"].values
    for dive in reported:
        found = (times >= np.datetime64(dive.start)) & (times <= np.datetime64(dive.end))
        if found.sum() < _LEAST_SHARE * dive.count:
            return dive
    return None
