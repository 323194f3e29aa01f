"""Folder of compiled kernels, named after a digest of the kernels' sources and versions.

Numba's cache notices a change in the file of a function, but it misses a change in a function that is called from
there, and would then run stale code. A separate folder for each state of the sources cannot be stale. Numba's own
settings are not changed: `gliderhpc.kernels.jit` uses the folder for our kernels only.

The files are code. The folder must therefore belong to this user, and no other user may be able to write or replace it.
"""

import atexit
import hashlib
import logging
import os
import platform
import shutil
import stat
import sys
import tempfile
from functools import cache
from importlib.metadata import version
from pathlib import Path

log = logging.getLogger(__name__)

VARIABLES = ("GLIDERHPC_CACHE", "NUMBA_CACHE_DIR")
"""Environment variables that name the parent of the kernels' folder: ours, else numba's."""

SOURCES = Path(__file__).resolve().parent
"""Folder of the kernels' sources."""


@cache
def compiled_cache() -> Path:
    """Return the folder of this process's kernels, chosen once by `choose_folder`."""
    return choose_folder()


def choose_folder() -> Path:
    """Create a folder that no other user can write, since its files are executed.

    Its parent is the folder that one of `VARIABLES` names, else the user's cache. If other users could have put files
    there, a warning is logged and a private folder is used, which is removed when this process ends.
    """
    base = _base()
    folder = None if base is None else base / f"kernels-{kernel_digest()}"
    refused = "no home folder is known" if folder is None else _refusal(folder)
    if folder is not None and not refused:
        return folder
    log.warning(
        "compiled kernels are not stored (%s): each command compiles them, for about half a minute; set %s to a "
        "folder of your own with mode 0700",
        refused,
        VARIABLES[0],
    )
    return _temporary_folder()


def source_digest(sources: Path = SOURCES) -> str:
    """Return a hex digest of the kernel sources."""
    digest = hashlib.sha256()
    for path in sorted(sources.glob("*.py")):
        digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()


def kernel_digest(sources: Path = SOURCES) -> str:
    """Return a hex digest of the kernel sources, of the versions that compile them and of the processor.

    Hosts that share a home thus have a folder for each kind of processor. In a common one, numba could confuse the code
    of two hosts that compile at the same time: it numbers the files without a lock.
    """
    import llvmlite.binding

    versions = f"{sys.version} {version('numba')} {version('llvmlite')} {platform.machine()}"
    processor = f"{llvmlite.binding.get_host_cpu_name()} {llvmlite.binding.get_host_cpu_features().flatten()}"
    return hashlib.sha256(f"{source_digest(sources)} {versions} {processor}".encode()).hexdigest()[:16]


def _base() -> Path | None:
    """Return the parent of the kernels' folder, None if the user has no folder for caches."""
    for name in VARIABLES:
        if os.environ.get(name):
            return Path(os.environ[name])
    caches = Path(os.environ.get("XDG_CACHE_HOME", ""))
    # The XDG specification requires that a relative path is ignored.
    if not caches.is_absolute():
        try:
            caches = Path.home() / ".cache"
        except RuntimeError:
            return None
    return caches / "gliderhpc"


def _refusal(folder: Path) -> str:
    """Create a folder; return the reason not to run code in it, or an empty text if it can be trusted."""
    if not folder.is_absolute():
        return f"{folder}: not an absolute path"
    try:
        for path in (*reversed(folder.parents), folder):
            path.mkdir(mode=0o700, exist_ok=True)
        resolved = folder.resolve(strict=True)
        if not os.access(resolved, os.W_OK):
            return f"{folder}: cannot be written"
        if hasattr(os, "geteuid") and resolved.stat().st_uid != os.geteuid():
            return f"{folder}: belongs to another user"
        return refusal_to_run(resolved)
    except OSError as error:
        return f"{folder}: {error.strerror}"


def refusal_to_run(folder: Path) -> str:
    """Return the reason not to run code in an existing folder, or an empty text if only we or root can write it.

    Raises
    ------
    OSError
        The folder cannot be examined.
    """
    if not hasattr(os, "geteuid"):
        return ""
    resolved = folder.resolve(strict=True)
    # Users who may add files to a sticky folder could add compiled kernels, but they cannot replace its subfolders.
    found = {resolved: _open_to_others(resolved)}
    found |= {path: _open_to_others(path, sticky=True) for path in resolved.parents}
    return next((f"{path}: {why}" for path, why in found.items() if why), "")


def _open_to_others(path: Path, sticky: bool = False) -> str:
    """Describe which other users can write or replace a folder; the owner of / always can and is accepted."""
    found = path.stat()
    if found.st_uid not in (os.geteuid(), 0, Path(path.anchor).stat().st_uid):
        return "belongs to another user"
    if sticky and found.st_mode & stat.S_ISVTX:
        return ""
    if found.st_mode & stat.S_IWOTH:
        return "every user can write to it"
    if found.st_mode & stat.S_IWGRP and not _is_own_group(found.st_gid):
        return "its group can write to it"
    return ""


def _is_own_group(group: int) -> bool:
    """Return whether a group is the user's private group, which many systems create, or root's."""
    import grp
    import pwd

    try:
        user, named = pwd.getpwuid(os.geteuid()), grp.getgrgid(group)
    except KeyError:
        return False
    return group == 0 or (
        user.pw_gid == group and named.gr_name == user.pw_name and set(named.gr_mem) <= {user.pw_name}
    )


def _temporary_folder() -> Path:
    """Create a private folder for the kernels that is removed when this process ends."""
    base, owner = Path(tempfile.mkdtemp(prefix="gliderhpc-kernels-")), os.getpid()

    def remove() -> None:
        if os.getpid() == owner:
            shutil.rmtree(base, ignore_errors=True)

    atexit.register(remove)
    folder = base / f"kernels-{kernel_digest()}"
    folder.mkdir(mode=0o700)
    return folder
