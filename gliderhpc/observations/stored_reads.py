"""Results of reading files, stored by the files' content, so that a file that has not changed is read once.

A result is read back by a restricted unpickler: arrays, the record classes of this package and plain values, and
nothing that could run code.
"""

import hashlib
import io
import pickle
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any, Protocol, TypeVar

from gliderhpc.errors import InputError
from gliderhpc.output_files import written_aside
from gliderhpc.version import __version__

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
    """Calls a function that reads a file."""

    def __call__(self, read: Callable[..., Result], path: Path, *arguments: Any) -> Result:
        """Return ``read(path, *arguments)``."""


def read_directly(read: Callable[..., Result], path: Path, *arguments: Any) -> Result:
    """Read a file, whatever was read before."""
    return read(path, *arguments)


@dataclass(frozen=True, eq=False)
class StoredReads:
    """Reads that are stored in a folder.

    A failed read is not stored: it is tried again, since what it lacked may be there by then.

    Attributes
    ----------
    folder : Path
        Where results are stored; it exists.
    digests : mapping of Path to str
        Digest of each file's content; other files are read directly.
    used : set of str
        Names of the results that were asked for.
    """

    folder: Path
    digests: Mapping[Path, str]
    used: set[str] = field(default_factory=set, init=False)

    def __call__(self, read: Callable[..., Result], path: Path, *arguments: Any) -> Result:
        """Return ``read(path, *arguments)``, from the store where it has been read before.

        The function must depend on the file's content and on the arguments alone, and arguments that differ must
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
        _store(place, (found,))
        return found

    def remove_unused(self) -> None:
        """Remove the results that were not asked for: of files that have changed since."""
        for path in self.folder.iterdir():
            if path.name not in self.used:
                path.unlink(missing_ok=True)


def _name(read: Callable[..., Any], path: Path, digest: str, arguments: tuple[Any, ...]) -> str:
    """Name a result by all that it depends on."""
    what = (_version(), read.__module__, read.__qualname__, str(path), digest, arguments)
    return hashlib.sha256(repr(what).encode()).hexdigest()


@cache
def _version() -> str:
    """Version of the importers: of the program, and the digest of this package's sources."""
    sha = hashlib.sha256(__version__.encode())
    for source in sorted(Path(__file__).parent.glob("*.py")):
        sha.update(source.read_bytes())
    return sha.hexdigest()


def _store(place: Path, content: tuple[Any]) -> None:
    data = pickle.dumps(content, protocol=5)
    try:
        with written_aside(place, overwrite=True) as aside:
            aside.write_bytes(hashlib.sha256(data).digest() + data)
    except OSError as error:
        raise InputError(f"{place}: cannot be written: {error.strerror or error}") from error


def _load(place: Path) -> tuple[Any] | None:
    """Return a stored result, None where there is none or it is damaged."""
    try:
        stored = place.read_bytes()
    except FileNotFoundError:
        return None
    check, data = stored[:_CHECK_LENGTH], stored[_CHECK_LENGTH:]
    if hashlib.sha256(data).digest() != check:
        return None
    try:
        content: tuple[Any] = _Unpickler(io.BytesIO(data)).load()
    except pickle.UnpicklingError:
        return None
    return content


class _Unpickler(pickle.Unpickler):
    """Reads arrays, plain values and the dataclasses of this package."""

    def find_class(self, module: str, name: str) -> Any:
        """Find a class or function that a result names; an error for any that is not expected."""
        if (module, name) in _OTHERS:
            return super().find_class(module, name)
        if module.startswith(_OURS) and "." not in name:
            found = super().find_class(module, name)
            if isinstance(found, type) and is_dataclass(found) and found.__module__ == module:
                return found
        raise pickle.UnpicklingError(f"{module}.{name} is not expected in a stored result")
