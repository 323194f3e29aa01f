"""Earlier versions of copied files, kept until a new version has proved to be worth as much.

A file that was complete can arrive again damaged or cut short. A dive that was reported must not be lost by this.
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


def accept_or_restore(folder: Path, faults: Mapping[str, str], records: Path, state: WatchState) -> dict[str, str]:
    """Accept the new versions of files, or restore the earlier ones of those that are worth less.

    Parameters
    ----------
    folder : Path
        Folder of the copies.
    faults : mapping of str to str
        Files that cannot be used, with the reason.
    records : Path
        Observation file made from the copies; there may be none.
    state : WatchState
        Dives reported so far. The copies that are restored are noted in it; the new versions then count as read until
        they change.

    Returns
    -------
    dict of str to str
        Files whose new version was refused, with the reason.
    """
    # A version that was only partly written when the watch was killed is not a file's.
    names = sorted(path.name for path in (folder / EARLIER).glob("*") if (folder / path.name).exists())
    if not names:
        return {}
    lost = _lost_dive(records, state.reported) if records.exists() else None
    refused = _worth_less(folder, names, faults, lost)
    for name in names:
        kept = folder / EARLIER / name
        if name in refused:
            digest = hashlib.sha256(kept.read_bytes()).hexdigest()
            state.add_file(name, CopiedFile(state.copied[name].state, digest))
            # The kept file goes last (`forget_earlier`): until the state is saved, a restart must find it again.
            with written_aside(folder / name, overwrite=True) as aside:
                shutil.copyfile(kept, aside)
        else:
            kept.unlink()
    return refused


def forget_earlier(folder: Path, names: Iterable[str]) -> None:
    """Remove the kept versions of files that were restored, once the state is saved."""
    for name in names:
        (folder / EARLIER / name).unlink(missing_ok=True)


def _worth_less(
    folder: Path, names: Sequence[str], faults: Mapping[str, str], lost: ReportedDive | None
) -> dict[str, str]:
    """Return the files whose new version is unusable or, where a reported `lost` dive has fewer samples, smaller."""
    refused = {name: f"the new version cannot be used ({faults[name]})" for name in names if name in faults}
    if lost is not None:
        shorter = [name for name in names if _size(folder / name) < _size(folder / EARLIER / name)]
        for name in shorter or names:
            refused.setdefault(name, f"the new version has fewer samples of dive {lost.profile}")
    return {name: f"{why}; the earlier one remains in use" for name, why in refused.items()}


def _size(path: Path) -> int:
    return path.stat().st_size


def _lost_dive(records: Path, reported: Iterable[ReportedDive]) -> ReportedDive | None:
    """Return a reported dive of which an observation file has fewer samples than were reported, if there is one."""
    with read_records(records) as content:
        times = content["time"].values
    for dive in reported:
        found = (times >= np.datetime64(dive.start)) & (times <= np.datetime64(dive.end))
        if found.sum() < _LEAST_SHARE * dive.count:
            return dive
    return None
