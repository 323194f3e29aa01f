"""Where compiled kernels are kept: a user cache folder named by a digest of the kernel sources and versions.

Numba's cache notices a change in the file of a function but not in a function it calls, and would then run stale code;
a folder for each state of the sources cannot be stale. It must be set before numba is imported.
"""

import hashlib
import os
import platform
import sys
from importlib.metadata import version
from pathlib import Path


def kernel_digest() -> str:
    """Hex digest of every kernel source, of the versions that compile it and of this machine's architecture."""
    digest = hashlib.sha256()
    for path in sorted((Path(__file__).parent / "kernels").glob("*.py")):
        digest.update(path.name.encode() + path.read_bytes())
    digest.update(f"{sys.version} {version('numba')} {version('llvmlite')} {platform.machine()}".encode())
    return digest.hexdigest()[:16]


def compiled_cache() -> Path:
    """Return the cache folder of these sources."""
    base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return base / "gliderhpc" / kernel_digest()


def use_compiled_cache() -> None:
    """Point numba at the cache folder of these sources, unless the user has chosen one."""
    if "NUMBA_CACHE_DIR" in os.environ:
        return
    folder = str(compiled_cache())
    os.environ["NUMBA_CACHE_DIR"] = folder
    if "numba" in sys.modules:
        # Imported before us: it has read the environment already.
        sys.modules["numba"].config.CACHE_DIR = folder


def clear_compiled_cache() -> Path:
    """Remove our kernels from the cache folder in use (a damaged file raises when loaded) and return the folder."""
    folder = Path(os.environ["NUMBA_CACHE_DIR"])
    # Numba names a subfolder after the folder of the source; what others keep beside it is left alone.
    for file in folder.glob("kernels_*/*.nb[ic]"):
        file.unlink(missing_ok=True)
    return folder
