"""One run at a time on an archive: a lock beside it, kept fresh while its holder lives.

The lock is ``ARCHIVE.zarr.lock``, made by one writer only: on a file system by exclusive creation, in an object store
by a conditional put. Its holder freshens it; one that has not been freshened for long, or whose process on this machine
is gone, was left by a run that was killed and is taken over. Workers look at it before they write, so those of a run
that was given up write nothing any more.
"""

import errno
import json
import logging
import os
import secrets
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from datetime import UTC, datetime

from gliderhpc.errors import InputError, RunStoppedError
from gliderhpc.mission.lock_places import LockPlace, lock_place_of
from gliderhpc.store_schema.place import Place, absolute, beside

log = logging.getLogger(__name__)

FRESHENED = 20.0
"""Seconds between signs of life."""

STALE = 180.0
"""Seconds without a sign of life after which a lock is taken over."""

SUFFIX = ".lock"


@dataclass(frozen=True)
class Holder:
    """Who holds a lock: host, process, since when, and a word that nobody else has."""

    host: str
    process: int
    since: str
    token: str

    def told(self) -> str:
        """Name the holder."""
        return f"process {self.process} on {self.host} since {self.since}"


_NOBODY = Holder("an unknown host", -1, "an unknown time", "")
"""Holder of a lock whose content is none of ours."""


def lock_name(archive: Place) -> str:
    """Where the lock of an archive lies."""
    return beside(absolute(archive), SUFFIX)


@contextmanager
def locked(archive: Place) -> Iterator[str]:
    """Hold an archive's lock; yields the token by which workers know it.

    Raises
    ------
    InputError
        Another run holds it.
    """
    place = lock_place_of(lock_name(archive))
    holder = Holder(socket.gethostname(), os.getpid(), _now(), secrets.token_hex(8))
    try:
        _take(place, holder, archive)
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            raise
        raise InputError(f"{archive}: cannot be written ({error.strerror}); give another place with --store") from None
    stop = threading.Event()
    freshener = threading.Thread(target=_keep_fresh, args=(place, holder, stop), daemon=True)
    freshener.start()
    try:
        yield holder.token
    finally:
        stop.set()
        freshener.join()
        if _holder_of(place) == holder:
            place.remove()


def check_held(archive: Place, token: str | None) -> None:
    """Make sure that the run with this token still holds the archive; without a token there is nothing to hold.

    Raises
    ------
    RunStoppedError
        The run has ended, or another has taken its place.
    """
    if token is None:
        return
    holder = _holder_of(lock_place_of(lock_name(archive)))
    if holder is None or holder.token != token:
        raise RunStoppedError(f"{archive}: the run that asked for this has ended; nothing more is written for it")


def _take(place: LockPlace, holder: Holder, archive: Place) -> None:
    content = json.dumps(asdict(holder)).encode()
    if place.create(content):
        return
    found = place.read()
    if found is not None:
        other = _holder_in(found)
        if not _is_dead(place, other):
            raise InputError(
                f"{archive}: another run is writing it ({other.told()}); wait for it, or remove {place} if that is "
                "gone for good"
            )
        log.warning("%s: taking over from a run that was killed (%s)", archive, other.told())
        place.replace(found)
    if not place.create(content):
        raise InputError(f"{archive}: another run has just begun to write it")


def _is_dead(place: LockPlace, other: Holder) -> bool:
    if other.host == socket.gethostname() and not _is_alive(other.process):
        return True
    return place.age() > STALE


def _is_alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True


def _holder_of(place: LockPlace) -> Holder | None:
    content = place.read()
    return None if content is None else _holder_in(content)


def _holder_in(content: bytes) -> Holder:
    """Return who a lock names; what no run of ours wrote names nobody, and is taken over once it is old."""
    try:
        holder = Holder(**json.loads(content))
    except (ValueError, TypeError, RecursionError):
        return _NOBODY
    texts = (holder.host, holder.since, holder.token)
    is_process = type(holder.process) is int and 0 < holder.process < 1 << 31
    return holder if is_process and all(isinstance(text, str) for text in texts) else _NOBODY


def _keep_fresh(place: LockPlace, holder: Holder, stop: threading.Event) -> None:
    content = json.dumps(asdict(holder)).encode()
    while not stop.wait(FRESHENED):
        try:
            if _holder_of(place) != holder:
                log.error("the lock %s was taken away; the run stops at its next profile", place)
                return
            place.freshen(content)
        except (OSError, InputError) as error:
            log.warning("the lock %s cannot be freshened now: %s", place, error)


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")
