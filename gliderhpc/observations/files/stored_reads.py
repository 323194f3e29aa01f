"""Stored results of reading files, by the content of the files; an unchanged file is read only once.

Stored results are loaded with a restricted unpickler. It accepts arrays, the record classes of this package and plain
values, and nothing that could run code.
"""

import hashlib
import io
import logging
import pickle
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any, Protocol, TypeVar

from gliderhpc.errors import InputError
from gliderhpc.output_files import output_file
from gliderhpc.version import __version__

log = logging.getLogger(__name__)

Result = TypeVar("Result")

_OURS = "gliderhpc.observations."

_OTHERS = {
    ("collections", "Counter"), ("pathlib", "PosixPath"), ("pathlib._local", "PosixPath"), ("pathlib", "WindowsPath"),
    ("pathlib._local", "WindowsPath"), ("numpy", "ndarray"), ("numpy", "dtype"),
    *((f"numpy.{core}.{module}", name) for core in ("core", "_core") for module, name in (
        ("multiarray", "_reconstruct"), ("multiarray", "scalar"), ("numeric", "_frombuffer"),
    )),
}  # fmt: skip
"""Names outside this package that a stored result may use."""

_CHECK_LENGTH = hashlib.sha256().digest_size


class Reads(Protocol):
    """Callable that applies a reading function to a file, or returns an equal stored result."""

    def __call__(self, read: Callable[..., Result], path: Path, *arguments: Any) -> Result:
        """Return ``read(path, *arguments)``."""


def read_directly(read: Callable[..., Result], path: Path, *arguments: Any) -> Result:
    """Read a file directly, without stored results."""
    return read(path, *arguments)


@dataclass(frozen=True, eq=False)
class StoredReads:
    """Reads whose results are stored in a folder.

    A failed read is not stored. It is tried again next time, when a missing file may have arrived.

    Attributes
    ----------
    folder : Path
        Existing folder of the results.
    digests : mapping of Path to str
        Digest of each file's content; files without a digest are read directly.
    used : set of str
        Names of the requested results.
    """

    folder: Path
    digests: Mapping[Path, str]
    used: set[str] = field(default_factory=set, init=False)

    def __call__(self, read: Callable[..., Result], path: Path, *arguments: Any) -> Result:
        """Return ``read(path, *arguments)``, from the store if it was read before.

        The result must depend only on the path, the file's content and the arguments, and different arguments must
        have a different `repr`.
        """
        digest = self.digests.get(path)
        if digest is None:
            return read(path, *arguments)
        place = self.folder / _name(read, path, digest, arguments)
        self.used.add(place.name)
        stored = _load(place)
        if stored is not None:
            result: Result = stored[0]
            return result
        found = read(path, *arguments)
        try:
            _store(place, (found,))
        except InputError as error:
            log.warning("%s; the file is read again next time", error)
        except OSError as error:
            log.warning("%s: cannot be written: %s; the file is read again next time", place, error.strerror)
        return found

    def remove_unused(self) -> None:
        """Remove the results that were not requested, such as those of files that have changed."""
        for path in self.folder.iterdir():
            if path.name not in self.used:
                path.unlink(missing_ok=True)


def _name(read: Callable[..., Any], path: Path, digest: str, arguments: tuple[Any, ...]) -> str:
    """Return the name of a result: a digest of everything on which it depends."""
    what = (_version(), read.__module__, read.__qualname__, str(path), digest, arguments)
    return hashlib.sha256(repr(what).encode()).hexdigest()


@cache
def _version() -> str:
    """Digest of the program's version and of the sources of this subpackage, which identifies the importers."""
    sha = hashlib.sha256(__version__.encode())
    for source in sorted(Path(__file__).parents[1].rglob("*.py")):
        sha.update(source.read_bytes())
    return sha.hexdigest()


def _store(place: Path, content: tuple[Any]) -> None:
    data = pickle.dumps(content, protocol=5)
    with output_file(place, overwrite=True) as aside:
        aside.write_bytes(hashlib.sha256(data).digest() + data)


def _load(place: Path) -> tuple[Any] | None:
    """Return a stored result; None if there is none or it is damaged."""
    try:
        stored = place.read_bytes()
    except FileNotFoundError:
        return None
    check, data = stored[:_CHECK_LENGTH], stored[_CHECK_LENGTH:]
    if hashlib.sha256(data).digest() != check:
        return None
    try:
        content: tuple[Any] = _Unpickler(io.BytesIO(data)).load()
    except (pickle.UnpicklingError, ImportError, AttributeError):
        # Another version of Python may have stored it, whose classes are in other modules.
        return None
    return content


class _Unpickler(pickle.Unpickler):
    """Unpickler of arrays, plain values and the dataclasses of this package."""

    def find_class(self, module: str, name: str) -> Any:
        """Find a class or function named in a result; raise an error for any unexpected one."""
        if (module, name) in _OTHERS:
            return super().find_class(module, name)
        if module.startswith(_OURS) and "." not in name:
            found = super().find_class(module, name)
            if isinstance(found, type) and is_dataclass(found) and found.__module__ == module:
                return found
        raise pickle.UnpicklingError(f"{module}.{name} is not expected in a stored result")
