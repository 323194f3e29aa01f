"""Backups of copied files, retained until the new version has proved to be at least as complete.

A file that was complete can arrive again damaged or cut short; dives reported from it must not be lost.
"""

import hashlib
import shutil
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from gliderhpc.api.watch_state import ReportedDive, WatchState
from gliderhpc.observations.in_memory import read_records
from gliderhpc.observations.landing import CopiedFile
from gliderhpc.output_files import written_aside

BACKUPS = "earlier"
"""Name of the folder with the backups, within that of the copies."""

_MIN_SHARE = 0.98
"""Smallest share of a reported dive's samples that a new version must have; other processing may drop a few."""


def back_up_version(copy: Path) -> None:
    """Back up a copy that is about to be replaced, unless the file has a backup already."""
    backup = copy.parent / BACKUPS / copy.name
    if copy.exists() and not backup.exists():
        backup.parent.mkdir(exist_ok=True)
        with written_aside(backup, overwrite=True) as aside:
            shutil.copyfile(copy, aside)


def accept_or_restore(folder: Path, faults: Mapping[str, str], records: Path, state: WatchState) -> dict[str, str]:
    """Accept the new versions of files, or restore the backups of those that are less complete.

    Parameters
    ----------
    folder : Path
        Folder of the copies.
    faults : mapping of str to str
        Files that cannot be used, with the reason.
    records : Path
        Observation file made from the copies; there may be none.
    state : WatchState
        Dives reported so far. Restored copies are recorded in it; their new versions then count as read until they
        change.

    Returns
    -------
    dict of str to str
        Files whose new version was refused, with the reason.
    """
    # A backup that was only partly written when the watch was killed does not have the name of a copy.
    names = sorted(path.name for path in (folder / BACKUPS).glob("*") if (folder / path.name).exists())
    if not names:
        return {}
    lost = _lost_dive(records, state.reported) if records.exists() else None
    refused = _inferior_versions(folder, names, faults, lost)
    for name in names:
        backup = folder / BACKUPS / name
        if name in refused:
            digest = hashlib.sha256(backup.read_bytes()).hexdigest()
            state.add_file(name, CopiedFile(state.copied[name].state, digest))
            # The backup is removed last (`remove_backups`): until the state is saved, a restart must find it again.
            with written_aside(folder / name, overwrite=True) as aside:
                shutil.copyfile(backup, aside)
        else:
            backup.unlink()
    return refused


def remove_backups(folder: Path, names: Iterable[str]) -> None:
    """Remove the backups of files that were restored, once the state is saved."""
    for name in names:
        (folder / BACKUPS / name).unlink(missing_ok=True)


def _inferior_versions(
    folder: Path, names: Sequence[str], faults: Mapping[str, str], lost: ReportedDive | None
) -> dict[str, str]:
    """Return the files whose new version is unusable or, where a reported `lost` dive has fewer samples, smaller."""
    refused = {name: f"the new version cannot be used ({faults[name]})" for name in names if name in faults}
    if lost is not None:
        shorter = [name for name in names if _size(folder / name) < _size(folder / BACKUPS / name)]
        for name in shorter or names:
            refused.setdefault(name, f"the new version has fewer samples of dive {lost.profile}")
    return {name: f"{why}; the earlier one remains in use" for name, why in refused.items()}


def _size(path: Path) -> int:
    return path.stat().st_size


def _lost_dive(records: Path, reported: Iterable[ReportedDive]) -> ReportedDive | None:
    """Return a reported dive that has fewer samples in an observation file than were reported, if there is one."""
    with read_records(records) as content:
        times = content["time"].values
    for dive in reported:
        found = (times >= np.datetime64(dive.start)) & (times <= np.datetime64(dive.end))
        if found.sum() < _MIN_SHARE * dive.count:
            return dive
    return None
