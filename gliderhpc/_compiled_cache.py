"""Where compiled kernels are kept: a user cache folder named by a digest of the kernel sources and versions.

Numba's cache notices a change in the file of a function but not in a function it calls, and would then run stale code;
a folder for each state of the sources cannot be stale. It must be set before numba is imported.

What lies in it is code, so it must be ours, and nobody else may be able to write it or to put another in its place.
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
from importlib.metadata import version
from pathlib import Path

log = logging.getLogger(__name__)


def kernel_digest() -> str:
    """Hex digest of every kernel source, of the versions that compile it and of this machine's architecture."""
    digest = hashlib.sha256()
    for path in sorted((Path(__file__).parent / "kernels").glob("*.py")):
        digest.update(path.name.encode() + path.read_bytes())
    digest.update(f"{sys.version} {version('numba')} {version('llvmlite')} {platform.machine()}".encode())
    return digest.hexdigest()[:16]


def compiled_cache() -> Path | None:
    """Return the cache folder of these sources, None where the user has no folder for caches."""
    base = os.environ.get("XDG_CACHE_HOME", "")
    # By the specification of these folders one that is not absolute counts as not given.
    if not Path(base).is_absolute():
        try:
            base = str(Path.home() / ".cache")
        except RuntimeError:
            return None
    return Path(base) / "gliderhpc" / f"kernels-{kernel_digest()}"


def use_compiled_cache() -> None:
    """Point numba at a folder that nobody else can write: what lies there is run.

    It is the one that ``NUMBA_CACHE_DIR`` names, else that of these sources in the user's cache; where others could
    have put something there, a folder that lasts as long as this process, with a warning.
    """
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    folder = Path(chosen) if chosen else compiled_cache()
    refused = "no home folder is known" if folder is None else _refusal(folder)
    if refused or folder is None:
        folder = _passing_folder()
        log.warning(
            "compiled kernels are not kept (%s): each command compiles them, for a minute or two; point "
            "NUMBA_CACHE_DIR at a folder of your own with mode 0700", refused,
        )  # fmt: skip
    os.environ["NUMBA_CACHE_DIR"] = str(folder)
    if "numba" in sys.modules:
        # Imported before us: it has read the environment already.
        sys.modules["numba"].config.CACHE_DIR = str(folder)


def _refusal(folder: Path) -> str:
    """Make a folder, and say why nothing in it should be run, or nothing where it can be trusted."""
    if not folder.is_absolute():
        return f"{folder}: not an absolute path"
    try:
        for path in (*reversed(folder.parents), folder):
            path.mkdir(mode=0o700, exist_ok=True)
        whole = folder.resolve(strict=True)
        if not hasattr(os, "geteuid"):
            return ""
        if whole.stat().st_uid != os.geteuid():
            return f"{folder}: belongs to another user"
        # Who may add files to a sticky folder may add compiled kernels; the names of folders in it are safe.
        within = {path: _open_to_others(path) for path in (whole, *whole.glob("kernels_*"))}
        above = {path: _open_to_others(path, sticky=True) for path in whole.parents}
        return next((f"{path}: {why}" for path, why in (within | above).items() if why), "")
    except OSError as error:
        return f"{folder}: {error.strerror}"


def _open_to_others(path: Path, sticky: bool = False) -> str:
    """Say who else can put something into a folder, or into its place; the owner of / can whatever we do."""
    found = path.stat()
    if found.st_uid not in (os.geteuid(), 0, Path(path.anchor).stat().st_uid):
        return "belongs to another user"
    if sticky and found.st_mode & stat.S_ISVTX:
        return ""
    if found.st_mode & stat.S_IWOTH:
        return "every user can write it"
    if found.st_mode & stat.S_IWGRP and not _is_own_group(found.st_gid):
        return "its group can write it"
    return ""


def _is_own_group(group: int) -> bool:
    """Whether it is the group that many systems give every user for himself alone, or root's."""
    import grp
    import pwd

    try:
        user, named = pwd.getpwuid(os.geteuid()), grp.getgrgid(group)
    except KeyError:
        return False
    return group == 0 or (
        user.pw_gid == group and named.gr_name == user.pw_name and set(named.gr_mem) <= {user.pw_name}
    )


def _passing_folder() -> Path:
    """Private folder that is removed when this process ends."""
    folder, owner = tempfile.mkdtemp(prefix="gliderhpc-kernels-"), os.getpid()

    def remove() -> None:
        if os.getpid() == owner:
            shutil.rmtree(folder, ignore_errors=True)

    atexit.register(remove)
    return Path(folder)


def clear_compiled_cache() -> Path:
    """Remove our kernels from the cache folder in use (a damaged file raises when loaded) and return the folder."""
    folder = Path(os.environ["NUMBA_CACHE_DIR"])
    # Numba names a subfolder after the folder of the source; what others keep beside it is left alone.
    for file in folder.glob("kernels_*/*.nb[ic]"):
        file.unlink(missing_ok=True)
    return folder
