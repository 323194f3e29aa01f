"""State of a watch: files copied, and faults and dives reported so far, with their messages.

The state is one file, which is replaced as a whole. Messages may be damaged, or of an earlier version of this program.
"""

import json
import logging
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from gliderhpc.errors import InputError
from gliderhpc.observations.files.landing import CopiedFile, FileState
from gliderhpc.observations.times import SECOND
from gliderhpc.output_files import write_text
from gliderhpc.surfacing.message import SurfacingMessage

log = logging.getLogger("gliderhpc.watch")

STATE_FILE = "state.json"

_VERSION = 1


class ReportedDive(BaseModel):
    """A dive that was reported.

    Attributes
    ----------
    profile : int
        Number of the dive when it was reported.
    start, end : str
        Times of the first and last sample. They identify the dive, as numbers can change when a late file arrives.
    samples : str
        Digest of the samples, without number and fixes.
    count : int
        Number of samples.
    revision : int
        Revision of the message.
    current_known : bool, optional
        Whether the message has a current; None if an earlier version of this program reported the dive.
    file : str
        Name of the message file.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")
    profile: int
    start: str
    end: str
    samples: str
    count: int = 0
    revision: int
    current_known: bool | None = None
    file: str

    def overlap(self, start: np.datetime64, end: np.datetime64) -> float:
        """Return the overlap with a span of time, s; negative if they are disjoint."""
        first, last = max(np.datetime64(self.start), start), min(np.datetime64(self.end), end)
        return float((last - first) / SECOND)


class _FileEntry(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")
    size: int
    modified: int
    digest: str


class WatchState(BaseModel):
    """State of a watch.

    Attributes
    ----------
    files : dict of str to entry
        Copied files, by name.
    unread : dict of str to str
        Files that could not be read, with the reason last reported.
    faults : dict of str to str
        Files and pieces that could not be used, with the reason last reported.
    inputs : str
        Digest of the files, options, hull and settings that were last processed completely.
    reported : list of ReportedDive
        Reported dives, in the order of their first report.
    """

    model_config = ConfigDict(extra="forbid")
    version: int = _VERSION
    files: dict[str, _FileEntry] = Field(default_factory=dict)
    unread: dict[str, str] = Field(default_factory=dict)
    faults: dict[str, str] = Field(default_factory=dict)
    inputs: str = ""
    reported: list[ReportedDive] = Field(default_factory=list)

    @property
    def copied(self) -> dict[str, CopiedFile]:
        """Copied files, by name."""
        return {
            name: CopiedFile(FileState(entry.size, entry.modified), entry.digest) for name, entry in self.files.items()
        }

    def add_file(self, name: str, copied: CopiedFile) -> None:
        """Add or replace a file."""
        self.files[name] = _FileEntry(size=copied.state.size, modified=copied.state.modified, digest=copied.digest)

    def find(self, start: np.datetime64, end: np.datetime64) -> int | None:
        """Return the position of the reported dive that shares most time with a span; None if there is no overlap."""
        shared = [(dive.overlap(start, end), index) for index, dive in enumerate(self.reported)]
        longest, index = max(shared, default=(0.0, 0))
        return index if longest > 0.0 else None

    def new_faults(self, faults: Mapping[str, str]) -> dict[str, str]:
        """Store the faults found, and return those that are new or different from those reported."""
        before, self.faults = self.faults, dict(faults)
        return _new_or_changed(faults, before)

    def new_unread(self, unread: Mapping[str, str]) -> dict[str, str]:
        """Store the files that could not be read, and return those that are new or different from those reported."""
        before, self.unread = self.unread, dict(unread)
        return _new_or_changed(unread, before)

    def save(self, folder: Path) -> None:
        """Replace the state file."""
        content: dict[str, Any] = self.model_dump()
        # Without indentation, which would take most of the time of writing.
        write_text(folder / STATE_FILE, json.dumps(content) + "\n", overwrite=True)


def _new_or_changed(now: Mapping[str, str], before: Mapping[str, str]) -> dict[str, str]:
    return {name: why for name, why in now.items() if before.get(name) != why}


def read_state(folder: Path) -> WatchState:
    """Read the state of a watch, or return an empty one if there is none yet.

    Raises
    ------
    InputError
        The state file is damaged.
    """
    path = folder / STATE_FILE
    try:
        return WatchState.model_validate_json(path.read_bytes())
    except FileNotFoundError:
        return WatchState()
    except ValidationError as error:
        what = error.errors()[0]["msg"]
        raise InputError(
            f"{path}: damaged ({what}); remove it (every dive is then reported again), or give another `out`"
        ) from None


def was_current_reported(dive: ReportedDive, folder: Path) -> bool:
    """Return whether a dive was reported with its current; one whose message cannot be read counts as such."""
    if dive.current_known is not None:
        return dive.current_known
    try:
        message = SurfacingMessage.model_validate_json((folder / dive.file).read_text("utf-8"))
    except (OSError, ValueError):
        return True
    return message.current is not None


def changes_since(message: SurfacingMessage, path: Path) -> tuple[str, ...]:
    """List the differences from the earlier message in a file; none, with a warning, if that cannot be read."""
    if not path.exists():
        return ()
    try:
        return message.changes_since(path.read_text("utf-8"))
    except ValueError:  # Not UTF-8, not JSON, or not such a message.
        log.warning("%s: is not a readable message, so the changes since then are not reported; it is replaced", path)
        return ()
