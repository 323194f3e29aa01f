"""Watch over a folder: every new dive is imported, inverted into the archive and reported once."""

import logging
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import Path

import numpy as np

from gliderhpc.api.records import kind_by_name
from gliderhpc.archive.current import adopted_current
from gliderhpc.archive.mission import archive_errors, open_for_reading
from gliderhpc.archive.reader import Archive
from gliderhpc.errors import ArchiveInUseError, InputError, first_line
from gliderhpc.mission.lock import locked
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.observations import Observations, open_observations
from gliderhpc.observations.files.landing import (
    FileState,
    copy_file,
    duplicates,
    folder_of,
    list_files,
    older,
    same_names,
    unchanged,
)
from gliderhpc.observations.files.stored_reads import StoredReads
from gliderhpc.output_files import check_folder, write_text
from gliderhpc.platform import Platform
from gliderhpc.report.page.surfacing_page import write_surfacing_page
from gliderhpc.store_schema import is_archive
from gliderhpc.store_schema.location import Location
from gliderhpc.surfacing.dive_plan import DivePlan, read_plan
from gliderhpc.surfacing.dive_results import surfacing_message
from gliderhpc.surfacing.message import SurfacingMessage
from gliderhpc.watch.inversion import WatchWorkers, invert_new
from gliderhpc.watch.records import OBSERVATIONS, FileImport, is_candidate, truncated_missions
from gliderhpc.watch.state import ReportedDive, WatchState, changes_since, read_state, was_current_reported
from gliderhpc.watch.versions import accept_or_restore, back_up_version, remove_backups
from gliderhpc.wording import most_frequent_reason

log = logging.getLogger("gliderhpc.watch")

RECORDS = "records.nc"
"""Name of the observation file from which the archive is made."""

COPIES = "files"
"""Name of the folder with copies of the glider's files."""

CACHED_READS = "read"
"""Name of the folder with the results of reading these copies."""


@dataclass(frozen=True)
class WatchInputs:
    """Inputs and outputs of a watch.

    Attributes
    ----------
    source : str or Path
        Folder, file or pattern to watch.
    importing : FileImport
        Import of the files as records.
    platform, settings : Platform, MissionSettings
        The hull and the settings of the inversion.
    store : str or Path
        The archive.
    out : Path
        Folder for messages, copies of the files, and the state.
    workers : int, optional
        Number of local worker processes, 0 to compute in this process; by default this process for a single dive, and
        one process per core for several.
    plan : Path, optional
        File with the plan of the next dive, read again for each message; by default the next dive resembles the last.
    """

    source: Path | str
    importing: FileImport
    platform: Platform
    settings: MissionSettings
    store: Location
    out: Path
    workers: int | None = None
    plan: Path | None = None


@dataclass(frozen=True)
class Listener:
    """Callbacks: `dive` for each dive and its message file, `fault` for each unusable file and the reason."""

    dive: Callable[[SurfacingMessage, Path], None]
    fault: Callable[[str, str], None]


@dataclass
class Watch:
    """Watch in progress.

    Attributes
    ----------
    watched : WatchInputs
        Inputs and outputs of the watch.
    listener : Listener
        Callbacks for dives and faults.
    state : WatchState
        Files used and dives reported so far.
    failed : int
        Number of dives and files reported as failed by this process.
    """

    watched: WatchInputs
    listener: Listener
    state: WatchState
    failed: int = field(default=0, init=False)

    def __post_init__(self) -> None:
        """Prepare the workers, none of which is started yet."""
        self._workers = WatchWorkers(self.watched.workers, self.watched.settings.engine)

    def close(self) -> None:
        """End the worker processes."""
        self._workers.close()

    @property
    def records(self) -> Path:
        """Observation file from which the archive is made."""
        return self.watched.out / RECORDS

    def once(self, settle: float) -> None:
        """Process the files whose last change is at least `settle` seconds old."""
        files = list_files(self.watched.source)
        self.process(files, older(files, settle))
        self._warn_if_no_file()

    def forever(self, interval: float, sleep: Callable[[float], None] = time.sleep) -> None:
        """List the files every `interval` seconds, and process those that are unchanged since the previous listing.

        While another run, such as a study, writes the archive, new dives wait.
        """
        before: Mapping[Path, FileState] | None = None
        waiting = ""
        while True:
            files = list_files(self.watched.source) if before is None else self._list_files()
            try:
                self.process(files, unchanged(files, before or {}))
                waiting = ""
            except ArchiveInUseError as error:
                if waiting != str(error):
                    waiting = str(error)
                    log.warning("%s; the new dives are added once that run has ended", waiting)
            if files != before:
                self._warn_if_no_file()
            before = files
            sleep(interval)

    def _list_files(self) -> Mapping[Path, FileState]:
        """List the files; return none while the folder, perhaps on another machine, is unreachable."""
        try:
            return list_files(self.watched.source)
        except (InputError, OSError) as error:
            log.warning("%s; trying again", first_line(error))
            return {}

    def replay(self) -> None:
        """Process a finished mission dive by dive, as if each had just arrived."""
        files = list_files(self.watched.source)
        self._copy_new_files(files, files)
        self._import()
        if self.records.exists():
            for records in truncated_missions(self.records, self.watched.out):
                # Skip a truncated mission whose dives were all reported: the archive already contains more.
                self._invert_and_report(records, only_news=records != self.records)
            (self.watched.out / "replayed.nc").unlink(missing_ok=True)
        self._complete()

    def process(self, files: Mapping[Path, FileState], ready: Iterable[Path]) -> None:
        """Copy the files that are ready, and process new data."""
        self._copy_new_files(files, ready)
        if self._inputs() == self.state.inputs:
            return
        self._import()
        if self.records.exists():
            self._invert_and_report(self.records)
        self._complete()

    def _copy_new_files(self, files: Mapping[Path, FileState], ready: Iterable[Path]) -> None:
        """Copy the files that are new or changed."""
        folder, kind = self.watched.out / COPIES, self.watched.importing.kind
        named = kind != OBSERVATIONS and any(kind_by_name(path) is not None for path in files)
        unread = same_names(files)
        before = self.state.copied
        for path in ready:
            known = before.get(path.name)
            if str(path) in unread or not is_candidate(path, kind, named):
                continue
            if known is not None and known.state == files[path]:
                continue
            if path.name not in self.state.faults:
                back_up_version(folder / path.name)
            try:
                copied = copy_file(path, files[path], folder)
            except InputError as error:
                unread[path.name] = str(error)
                continue
            if copied is not None:
                self.state.add_file(path.name, copied)
        for name, why in self.state.new_unread(unread).items():
            self._fail(name, why)
        self.state.save(self.watched.out)

    def _warn_if_no_file(self) -> None:
        if not self.state.files:
            kind = self.watched.importing.kind or "a glider"
            log.warning("%s: no complete file of %s yet", self.watched.source, kind)

    def _files_to_import(self) -> dict[str, str]:
        """Return the digests of the files to import, by name; of several with the same content only one."""
        same = duplicates(self.state.copied)
        for name, first in same.items():
            log.info("%s: same content as %s", name, first)
        return {name: copied.digest for name, copied in self.state.copied.items() if name not in same}

    def _inputs(self) -> str:
        """Return a digest of everything that determines the archive."""
        watched = self.watched
        files = watched.importing.digest(self._files_to_import())
        return sha256(
            f"{files} {watched.platform.model_dump_json()} {watched.settings.model_dump_json()}".encode()
        ).hexdigest()

    def _import(self) -> None:
        copies, importing = self.watched.out / COPIES, self.watched.importing
        faults = self._import_copies()
        while refused := accept_or_restore(copies, faults, self.records, self.state, importing):
            self.state.save(self.watched.out)
            remove_backups(copies, refused)
            for name, why in refused.items():
                self._fail(name, why)
            faults = self._import_copies()
        self._report_faults(faults)

    def _import_copies(self) -> dict[str, str]:
        """Turn the copies into the observation file; return the reason for each one left out."""
        out = self.watched.out
        # In the order of their arrival: a new file that contradicts a reported dive does not replace it.
        digests = {out / COPIES / name: digest for name, digest in self._files_to_import().items()}
        reads = StoredReads(out / CACHED_READS, digests)
        faults = self.watched.importing.import_files(list(digests), self.records, reads)
        reads.remove_unused()
        return faults

    def _complete(self) -> None:
        self.state.inputs = self._inputs()
        self.state.save(self.watched.out)

    def _report_faults(self, faults: Mapping[str, str]) -> None:
        # A file that has changed is reported again, even with the same fault.
        digests = self.state.copied
        marked = {name: f"{why}\n{digests[name].digest if name in digests else ''}" for name, why in faults.items()}
        for name in self.state.new_faults(marked):
            self._fail(name, faults[name])
        self.state.save(self.watched.out)

    def _fail(self, name: str, why: str) -> None:
        self.failed += 1
        self.listener.fault(name, why)

    def _invert_and_report(self, path: Path, *, only_news: bool = False) -> None:
        """Invert and report the dives that are new or whose record has changed.

        Unless `only_news` is set, fixes that arrived later are added to the archive even if no dive is new.
        """
        with open_observations(path, in_memory=True) as observations:
            if not set(observations.profile_numbers) - set(observations.faults):
                reason = most_frequent_reason(observations.faults.values() or ["no dive yet"])
                log.warning("%s: no usable profile; %s", path, reason)
                return
            # The samples include their times, so no two dives have the same digest.
            before = {dive.samples for dive in self.state.reported}
            digests = observations.sample_digests()
            new = {number: digest for number, digest in digests.items() if digest not in before}
            if new or not only_news:
                self._invert(observations, len(new))
                self._report_late_currents(observations, digests)
            for number, digest in new.items():
                self._report(observations, number, digest)

    def _report_late_currents(self, observations: Observations, digests: Mapping[int, str]) -> None:
        """Report again the dives whose current was unknown when they were reported, and is known by now."""
        unknown = {dive.samples for dive in self.state.reported if not was_current_reported(dive, self.watched.out)}
        if not unknown:
            return
        # Numbers may have changed since; the samples identify a dive.
        numbers = {number for number, digest in digests.items() if digest in unknown}
        store = self.watched.store
        with archive_errors(store), open_for_reading(store) as archive:
            table = archive.to_dataset()
            known = table["profile"].values[adopted_current(table).known].tolist()
        for number in sorted(numbers.intersection(known)):
            self._report(observations, number, digests[number])

    def _invert(self, observations: Observations, new: int) -> None:
        watched = self.watched
        invert_new(observations, new, watched.platform, watched.settings, watched.store, self._workers)

    def _report(self, observations: Observations, number: int, digest: str) -> None:
        """Report one dive: write its message and page, call the listener, and then record that it was reported."""
        span = observations.survey.spans[number]
        start, end = span.start_time, span.end_time
        index = self.state.find(start, end)
        before = None if index is None else self.state.reported[index]
        name = before.file if before is not None else _file_name(number, start)
        path = self.watched.out / name
        message = self._message(number, before, path)
        write_text(path, message.model_dump_json(indent=1) + "\n", overwrite=True)
        write_surfacing_page(message, self.watched.out, f"{path.stem}.html")
        self.failed += message.inversion.status != "done"
        self.listener.dive(message, path)
        entry = ReportedDive(
            profile=number,
            start=str(start),
            end=str(end),
            samples=digest,
            count=observations.sample_count(number),
            revision=message.revision,
            current_known=message.current is not None,
            file=name,
        )
        if index is None:
            self.state.reported.append(entry)
        else:
            self.state.reported[index] = entry
        self.state.save(self.watched.out)

    def _message(self, number: int, before: ReportedDive | None, path: Path) -> SurfacingMessage:
        store = self.watched.store
        with archive_errors(store), open_for_reading(store) as archive:
            message = surfacing_message(archive, number, plan=self._plan(archive, number))
        if before is None:
            return message
        return message.model_copy(update={"revision": before.revision + 1, "changes": changes_since(message, path)})

    def _plan(self, archive: Archive, number: int) -> DivePlan | None:
        """Return the plan of the dive after the latest one; None for earlier dives, or if the file cannot be used."""
        if self.watched.plan is None:
            return None
        if archive.to_dataset()["start_time"].load().to_series().idxmax() != number:
            return None
        try:
            return read_plan(self.watched.plan)
        except InputError as error:
            self._fail(self.watched.plan.name, f"{first_line(error)}; the next dive is assumed to be like the last")
            return None


def _file_name(number: int, start: np.datetime64) -> str:
    """Return the name of a dive's message; it includes the time, since a late file can change the numbers."""
    stamp = str(np.datetime_as_string(start, unit="s")).replace("-", "").replace(":", "")
    return f"dive-{number:04d}-{stamp}Z.json"


@contextmanager
def open_watch(watched: WatchInputs, listener: Listener) -> Iterator[Watch]:
    """Open a watch, and lock its output folder against other processes.

    Raises
    ------
    InputError
        The output folder is the watched one or cannot be written, another process uses it, or its state is damaged;
        or the source is an archive.
    """
    check_folder(watched.out)
    if watched.out.resolve() == folder_of(watched.source).resolve():
        raise InputError(
            f"{watched.out}: is the folder being watched; give another one for messages and copies with `out`"
        )
    if is_archive(folder_of(watched.source)):
        raise InputError(f"{watched.source}: is an archive; give the folder in which the glider's files arrive")
    for name in (COPIES, CACHED_READS):
        (watched.out / name).mkdir(parents=True, exist_ok=True)
    with locked(watched.out), closing(Watch(watched, listener, read_state(watched.out))) as watch:
        yield watch
