"""Backups of copied files, retained until the new version has proved to be at least as complete.

A file that was complete can arrive again damaged or cut short; dives reported from it must not be lost.
"""

import hashlib
import logging
import shutil
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gliderhpc.errors import InputError
from gliderhpc.observations.files.landing import CopiedFile
from gliderhpc.observations.in_memory import read_records
from gliderhpc.output_files import written_aside
from gliderhpc.watch.records import FileImport
from gliderhpc.watch.state import ReportedDive, WatchState
from gliderhpc.wording import counted

log = logging.getLogger("gliderhpc.watch")

Times = NDArray[np.datetime64]

BACKUPS = "earlier"
"""Name of the folder with the backups, within that of the copies."""

_MIN_SHARE = 0.98
"""Smallest share of a reported dive's samples that a new version must have; other processing may drop a few."""

_MAX_NAMED = 10
"""Maximum number of dives that a message names."""


def back_up_version(copy: Path) -> None:
    """Back up a copy that is about to be replaced, unless the file has a backup already."""
    backup = copy.parent / BACKUPS / copy.name
    if copy.exists() and not backup.exists():
        backup.parent.mkdir(exist_ok=True)
        with written_aside(backup, overwrite=True) as aside:
            shutil.copyfile(copy, aside)


def accept_or_restore(
    folder: Path, faults: Mapping[str, str], records: Path, state: WatchState, importing: FileImport
) -> dict[str, str]:
    """Restore the backups of files whose new versions are less complete; if there are none, accept all new versions.

    After a restoration the records are made again, and the remaining new versions are judged by those.

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
    importing : FileImport
        Import of the files.

    Returns
    -------
    dict of str to str
        Files whose new version was refused, with the reason.
    """
    # A backup that was only partly written when the watch was killed does not have the name of a copy.
    names = sorted(path.name for path in (folder / BACKUPS).glob("*") if (folder / path.name).exists())
    if not names:
        return {}
    lost = _lost_dives(_times_of(records), state.reported) if records.exists() else []
    refused = _unusable_versions(names, faults)
    refused |= _shorter_versions(folder, [name for name in names if name not in refused], lost, importing)
    if lost and not refused:
        refused = dict.fromkeys(names, _fewer_samples(lost))
    refused = {name: f"{why}; the earlier one remains in use" for name, why in refused.items()}
    for name in refused:
        backup = folder / BACKUPS / name
        digest = hashlib.sha256(backup.read_bytes()).hexdigest()
        state.add_file(name, CopiedFile(state.copied[name].state, digest))
        # The backup is removed last (`remove_backups`): until the state is saved, a restart must find it again.
        with written_aside(folder / name, overwrite=True) as aside:
            shutil.copyfile(backup, aside)
    if not refused:
        remove_backups(folder, names)
    return refused


def remove_backups(folder: Path, names: Iterable[str]) -> None:
    """Remove the backups of accepted files, or of restored ones once the state is saved."""
    for name in names:
        (folder / BACKUPS / name).unlink(missing_ok=True)


def _unusable_versions(names: Iterable[str], faults: Mapping[str, str]) -> dict[str, str]:
    return {name: f"the new version cannot be used ({faults[name]})" for name in names if name in faults}


def _shorter_versions(
    folder: Path, names: Iterable[str], lost: Sequence[ReportedDive], importing: FileImport
) -> dict[str, str]:
    """Return the files whose new version alone has fewer samples of lost dives than the earlier one alone."""
    shortened = {}
    for name in names if lost else ():
        earlier, new = (_times_of_file(path, importing) for path in (folder / BACKUPS / name, folder / name))
        shorter = [dive for dive in lost if _count(new, dive) < _MIN_SHARE * _count(earlier, dive)]
        if shorter:
            shortened[name] = _fewer_samples(shorter)
    return shortened


def _fewer_samples(dives: Sequence[ReportedDive]) -> str:
    numbers = [str(dive.profile) for dive in dives]
    more = f" and {counted(len(numbers) - _MAX_NAMED, 'other')}" if len(numbers) > _MAX_NAMED else ""
    return f"the new version has fewer samples of dive {', '.join(numbers[:_MAX_NAMED])}{more}"


def _lost_dives(times: Times, reported: Iterable[ReportedDive]) -> list[ReportedDive]:
    """Return the reported dives of which there are fewer samples than were reported."""
    return [dive for dive in reported if _count(times, dive) < _MIN_SHARE * dive.count]


def _count(times: Times, dive: ReportedDive) -> int:
    return int(np.sum((times >= np.datetime64(dive.start)) & (times <= np.datetime64(dive.end))))


def _times_of_file(path: Path, importing: FileImport) -> Times:
    """Return the times of the samples of one file; none if it cannot be imported alone."""
    with tempfile.TemporaryDirectory() as aside:
        out = Path(aside) / "records.nc"
        try:
            importing.import_files([path], out)
        except InputError as error:
            log.debug("%s: cannot be imported alone: %s", path, error)
        return _times_of(out) if out.exists() else np.zeros(0, "datetime64[ns]")


def _times_of(records: Path) -> Times:
    with read_records(records) as content:
        return np.asarray(content["time"].values)
