"""Where locks lie: a file, or an object."""

import os
import stat
import time
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Protocol

from gliderhpc.errors import InputError
from gliderhpc.store_schema.place import is_address

_LONGEST = 4096
"""Bytes that are read of a lock."""


class LockPlace(Protocol):
    """Holds one lock, which only one of many can create."""

    def create(self, content: bytes) -> bool:
        """Make the lock; says whether it was not there yet."""

    def read(self) -> bytes | None:
        """Content of the lock, None where there is none."""

    def freshen(self, content: bytes) -> None:
        """Note that the holder lives."""

    def age(self) -> float:
        """Seconds since the holder last gave a sign of life."""

    def replace(self, content: bytes) -> None:
        """Take a lock of that content away; one that has become another's meanwhile is left."""

    def remove(self) -> None:
        """Take the lock away."""


def lock_place_of(name: str) -> LockPlace:
    """Place of the lock of that name."""
    return ObjectLock(name) if is_address(name) else FileLock(Path(name))


class FileLock:
    """A lock on a file system; exclusive creation holds on NFS too."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def __str__(self) -> str:
        return str(self._path)

    def create(self, content: bytes) -> bool:
        """Write aside and link into place, so that the lock is never seen without its content."""
        self._path.parent.mkdir(parents=True, exist_ok=True)
        aside = self._aside()
        aside.write_bytes(content)
        try:
            os.link(aside, self._path)
        except FileExistsError:
            return False
        finally:
            aside.unlink()
        return True

    def read(self) -> bytes | None:
        """First bytes of the file, more than any lock of ours has.

        Raises
        ------
        InputError
            Something else has its name: a folder, a link, a pipe.
        """
        try:
            if not stat.S_ISREG(self._path.lstat().st_mode):
                raise InputError(f"{self._path}: no lock of gliderhpc but a folder, link or device; remove it")
            with self._path.open("rb") as file:
                return file.read(_LONGEST)
        except FileNotFoundError:
            return None

    def freshen(self, content: bytes) -> None:
        """Touch the file."""
        os.utime(self._path)

    def age(self) -> float:
        """Age by the clock that stamps the files, which need not be this machine's."""
        aside = self._aside()
        aside.touch()
        try:
            return aside.stat().st_mtime - self._path.stat().st_mtime
        except FileNotFoundError:
            return 0.0
        finally:
            aside.unlink()

    def replace(self, content: bytes) -> None:
        """Rename it away first, which succeeds for one of many; put back what turns out to be another's."""
        aside = self._aside()
        try:
            self._path.rename(aside)
        except FileNotFoundError:
            return
        if FileLock(aside).read() != content:
            os.link(aside, self._path)
        aside.unlink()

    def remove(self) -> None:
        """Remove the file."""
        self._path.unlink(missing_ok=True)

    def _aside(self) -> Path:
        return self._path.with_name(f"{self._path.name}.{os.getpid()}.{time.monotonic_ns()}")


class ObjectLock:
    """A lock in an object store that knows conditional puts."""

    def __init__(self, address: str) -> None:
        from gliderhpc.store_schema.object_store import bucket_at

        folder, _, self._key = address.rpartition("/")
        self._address = address
        self._store: Any = bucket_at(folder)

    def __str__(self) -> str:
        return self._address

    def create(self, content: bytes) -> bool:
        """Put only where there is nothing."""
        from obstore.exceptions import AlreadyExistsError

        try:
            self._store.put(self._key, content, mode="create")
        except AlreadyExistsError:
            return False
        return True

    def read(self) -> bytes | None:
        """Content of the object."""
        try:
            return bytes(self._store.get(self._key).bytes())
        except FileNotFoundError:
            return None

    def freshen(self, content: bytes) -> None:
        """Put it again."""
        self._store.put(self._key, content)

    def age(self) -> float:
        """Age by the server's stamp and this machine's clock."""
        try:
            stamped: datetime = self._store.head(self._key)["last_modified"]
        except FileNotFoundError:
            return 0.0
        return (datetime.now(UTC) - stamped).total_seconds()

    def replace(self, content: bytes) -> None:
        """Delete it if it is still the same."""
        if self.read() == content:
            self.remove()

    def remove(self) -> None:
        """Delete the object."""
        self._store.delete(self._key)
