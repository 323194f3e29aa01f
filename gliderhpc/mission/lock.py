"""Lock on an archive, which lets only one run at a time write to it; its holder refreshes it while it is alive.

The lock is ``ARCHIVE.zarr.lock``, created by one writer only: on a file system by exclusive creation, in an object
store by a conditional put. A lock that has not been refreshed for a long time, or whose process on this machine has
ended, belongs to a killed run and is taken over. Workers check the lock before they write, and workers of an abandoned
run write nothing more.
"""

import json
import logging
import os
import secrets
import socket
import stat
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Protocol

from gliderhpc.errors import ArchiveInUseError, InputError, RunStoppedError
from gliderhpc.output_files import check_parents, link_unless_there, raise_full_disk
from gliderhpc.store_schema.location import Location, absolute, is_address, network_errors, with_suffix

log = logging.getLogger(__name__)

REFRESH_INTERVAL = 20.0
"""Seconds between refreshes."""

STALE_AGE = 180.0
"""Seconds since the last refresh after which a lock is taken over."""

SUFFIX = ".lock"

_MAX_BYTES = 4096
"""Maximum number of bytes read from a lock."""


class LockStore(Protocol):
    """Location of a lock, which only one of several writers can create."""

    def create(self, content: bytes) -> bool:
        """Create the lock; return False if it exists."""

    def read(self) -> bytes | None:
        """Return the content of the lock, or None if there is none."""

    def refresh(self, content: bytes) -> None:
        """Record that the holder is alive."""

    def age(self) -> float:
        """Return the seconds since the last refresh."""

    def release(self, content: bytes) -> None:
        """Remove the lock if it still has that content; leave one that another run has acquired."""

    def remove(self) -> None:
        """Remove the lock."""


def lock_store(name: str) -> LockStore:
    """Return the location of the lock of that name."""
    return ObjectLock(name) if is_address(name) else FileLock(Path(name))


class FileLock:
    """A lock on a file system; exclusive creation works on NFS too."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def __str__(self) -> str:
        return str(self._path)

    def create(self, content: bytes) -> bool:
        """Write under a temporary name and link the file, so that the lock never appears without its content."""
        self._path.parent.mkdir(parents=True, exist_ok=True)
        temporary = self._temporary_path()
        # Written inside the block: a run that is interrupted at any moment must leave no file.
        try:
            temporary.write_bytes(content)
            link_unless_there(temporary, self._path)
        except FileExistsError:
            return False
        finally:
            temporary.unlink(missing_ok=True)
        return True

    def read(self) -> bytes | None:
        """Return the first bytes of the file, more than any lock of gliderhpc has.

        Raises
        ------
        InputError
            The name is taken by a folder, a link or a pipe.
        """
        try:
            if not stat.S_ISREG(self._path.lstat().st_mode):
                raise InputError(f"{self._path}: is not a lock of gliderhpc but a folder, link or device; remove it")
            with self._path.open("rb") as file:
                return file.read(_MAX_BYTES)
        except FileNotFoundError:
            return None

    def refresh(self, content: bytes) -> None:
        """Touch the file."""
        os.utime(self._path)

    def age(self) -> float:
        """Return the age by the file system's clock, which need not be this machine's."""
        temporary = self._temporary_path()
        try:
            temporary.touch()
            return temporary.stat().st_mtime - self._path.stat().st_mtime
        except FileNotFoundError:
            return 0.0
        finally:
            temporary.unlink(missing_ok=True)

    def release(self, content: bytes) -> None:
        """Rename the file, which only one of several runs can do; restore it if it belongs to another run.

        If a third run has acquired the lock in between, there is nothing to restore.
        """
        renamed = self._temporary_path()
        try:
            self._path.rename(renamed)
        except FileNotFoundError:
            return
        if FileLock(renamed).read() != content:
            with suppress(FileExistsError):
                link_unless_there(renamed, self._path)
        renamed.unlink()

    def remove(self) -> None:
        """Remove the file."""
        self._path.unlink(missing_ok=True)

    def _temporary_path(self) -> Path:
        return self._path.with_name(f"{self._path.name}.{os.getpid()}.{time.monotonic_ns()}")


class ObjectLock:
    """A lock in an object store with conditional puts."""

    def __init__(self, address: str) -> None:
        from gliderhpc.store_schema.location import bucket_at

        folder, _, self._key = address.rpartition("/")
        self._address = address
        self._store: Any = bucket_at(folder)

    def __str__(self) -> str:
        return self._address

    def create(self, content: bytes) -> bool:
        """Put the object only if it does not exist."""
        from obstore.exceptions import AlreadyExistsError

        try:
            with network_errors():
                self._store.put(self._key, content, mode="create")
        except AlreadyExistsError:
            return False
        return True

    def read(self) -> bytes | None:
        """Return the content of the object."""
        try:
            with network_errors():
                return bytes(self._store.get(self._key).bytes())
        except FileNotFoundError:
            return None

    def refresh(self, content: bytes) -> None:
        """Put the object again."""
        with network_errors():
            self._store.put(self._key, content)

    def age(self) -> float:
        """Return the age by the server's time stamp and this machine's clock."""
        try:
            with network_errors():
                stamped: datetime = self._store.head(self._key)["last_modified"]
        except FileNotFoundError:
            return 0.0
        return (datetime.now(UTC) - stamped).total_seconds()

    def release(self, content: bytes) -> None:
        """Delete the object if its content is unchanged."""
        if self.read() == content:
            self.remove()

    def remove(self) -> None:
        """Delete the object."""
        with network_errors():
            self._store.delete(self._key)


@dataclass(frozen=True)
class Holder:
    """Holder of a lock: host, process, start time, unique token, and the namespace of the process's number."""

    host: str
    process: int
    since: str
    token: str
    namespace: str = ""

    def describe(self) -> str:
        """Describe the holder."""
        return f"process {self.process} on {self.host} since {self.since}"


_UNKNOWN_HOLDER = Holder("an unknown host", -1, "an unknown time", "")
"""Holder of a lock whose content cannot be interpreted."""


def lock_name(archive: Location) -> str:
    """Return the path or address of an archive's lock."""
    return with_suffix(absolute(archive), SUFFIX)


@contextmanager
def locked(archive: Location) -> Iterator[str]:
    """Hold an archive's lock, and yield the token by which workers recognise it.

    Raises
    ------
    ArchiveInUseError
        Another run holds the lock.
    InputError
        The lock cannot be written.
    """
    lock = lock_store(lock_name(archive))
    now = datetime.now(UTC).isoformat(timespec="seconds")
    holder = Holder(socket.gethostname(), os.getpid(), now, secrets.token_hex(8), _namespace())
    try:
        _acquire(lock, holder, archive)
    except OSError as error:
        raise_full_disk(error, archive)
        if isinstance(error, FileExistsError | NotADirectoryError):
            check_parents(Path(absolute(archive)), "another place with `store`")
        raise InputError(
            f"{archive}: cannot be written ({error.strerror}); give an archive in a folder that you may write to, "
            "since its lock is written there"
        ) from None
    stop = threading.Event()
    refresher = threading.Thread(target=_keep_refreshing, args=(lock, holder, stop), daemon=True)
    refresher.start()
    try:
        yield holder.token
    finally:
        stop.set()
        refresher.join()
        _release(lock, holder)


def _release(lock: LockStore, holder: Holder) -> None:
    try:
        if _read_holder(lock) == holder:
            lock.remove()
    except OSError as error:
        log.warning("the lock %s cannot be removed (%s); after %.0f s it counts as abandoned", lock, error, STALE_AGE)


def check_held(archive: Location, token: str | None) -> None:
    """Check that the run with this token still holds the archive; without a token nothing is checked.

    Raises
    ------
    RunStoppedError
        The run has ended, or another has taken its place.
    """
    if token is None:
        return
    holder = _read_holder(lock_store(lock_name(archive)))
    if holder is None or holder.token != token:
        raise RunStoppedError(f"{archive}: the run of this job has ended, so nothing more is written for it")


def _acquire(lock: LockStore, holder: Holder, archive: Location) -> None:
    content = json.dumps(asdict(holder)).encode()
    if lock.create(content):
        return
    existing = lock.read()
    if existing is not None:
        other = _parse_holder(existing)
        if not _is_dead(lock, other):
            raise ArchiveInUseError(
                f"{archive}: another run is writing it ({other.describe()}); wait for it, or remove {lock} if that "
                "run has ended"
            )
        log.warning("%s: taking over from a run that was killed (%s)", archive, other.describe())
        lock.release(existing)
    if not lock.create(content):
        raise ArchiveInUseError(f"{archive}: another run has just begun to write it; wait for it")


def _is_dead(lock: LockStore, other: Holder) -> bool:
    # A container may share its host's name, but not the numbers of its processes.
    on_this_machine = (other.host, other.namespace) == (socket.gethostname(), _namespace())
    if on_this_machine and not _is_alive(other.process):
        return True
    return lock.age() > STALE_AGE


def _namespace() -> str:
    """Name of the namespace of this system's process numbers; empty where a system has none."""
    try:
        return str(Path("/proc/self/ns/pid").readlink())
    except OSError:
        return ""


def _is_alive(process: int) -> bool:
    if os.name == "nt":  # There, signal 0 is Ctrl-C; the lock's age alone decides.
        return True
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True


def _read_holder(lock: LockStore) -> Holder | None:
    content = lock.read()
    return None if content is None else _parse_holder(content)


def _parse_holder(content: bytes) -> Holder:
    """Return the holder stated in a lock; a lock of unknown content is taken over once it is stale."""
    try:
        holder = Holder(**json.loads(content))
    except (ValueError, TypeError, RecursionError):
        return _UNKNOWN_HOLDER
    texts = (holder.host, holder.since, holder.token, holder.namespace)
    is_process = type(holder.process) is int and 0 < holder.process < 1 << 31
    return holder if is_process and all(isinstance(text, str) for text in texts) else _UNKNOWN_HOLDER


def _keep_refreshing(lock: LockStore, holder: Holder, stop: threading.Event) -> None:
    content = json.dumps(asdict(holder)).encode()
    while not stop.wait(REFRESH_INTERVAL):
        try:
            if _read_holder(lock) != holder:
                log.error("the lock %s was removed; the run stops at its next profile", lock)
                return
            lock.refresh(content)
        except (OSError, InputError) as error:
            log.warning("the lock %s cannot be refreshed now: %s", lock, error)
