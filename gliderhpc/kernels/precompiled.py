"""Precompiled kernels, in the wheel or in a folder of a cluster, for a level of processors.

Numba compiles for the present processor and stores code under its name. Code for a level of the x86-64 psABI runs on
every processor of that level or a higher one; one set of files is sufficient for all of them. It is loaded only if it
was compiled from the same sources by the same numba, for this Python and this level, and if no setting of numba names
another processor. Otherwise kernels are compiled on this machine.
"""

import json
import logging
import os
import platform
import sys
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

from gliderhpc.kernels.cache import SOURCES, refusal_to_run, source_digest

log = logging.getLogger(__name__)

VARIABLE = "GLIDERHPC_KERNELS"
"""Environment variable that names a folder from ``python -m gliderhpc.mission.precompile``, instead of the wheel's."""

SHIPPED = SOURCES / "compiled"
"""Folder of the wheel's compiled kernels; a checkout has none."""

MANIFEST = "made-for.json"
"""File with the sources, versions, system and levels for which the kernels of a folder were compiled."""

_V2 = ("cx16", "popcnt", "sahf", "sse3", "sse4.1", "sse4.2", "ssse3")
_V3 = (*_V2, "avx", "avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe", "xsave")
_V4 = (*_V3, "avx512bw", "avx512cd", "avx512dq", "avx512f", "avx512vl")

LEVELS = {"x86-64-v4": _V4, "x86-64-v3": _V3, "x86-64-v2": _V2}
"""Features of every level, by LLVM's names, the highest level first (System V ABI, AMD64 supplement, table 3.1)."""


def host_level() -> str:
    """Return the highest level of this processor; empty if it has none or numba is configured for another processor.

    A level for which kernels compute another number of lanes does not count: the number is part of the code.
    """
    import llvmlite.binding
    from numba.core import config

    from gliderhpc.kernels.lane_type import LANES, lanes_with

    named = any(getattr(config, setting) is not None for setting in ("CPU_NAME", "CPU_FEATURES"))
    if named or platform.machine() not in ("x86_64", "AMD64"):
        return ""
    found = llvmlite.binding.get_host_cpu_features()
    fitting = {level: needed for level, needed in LEVELS.items() if lanes_with(wide="avx512f" in needed) == LANES}
    return next((level for level, needed in fitting.items() if all(found.get(name) for name in needed)), "")


def level_features(level: str) -> str:
    """Return the features of a level in the form for LLVM and ``NUMBA_CPU_FEATURES``.

    The last one, with AVX-512: for a processor known only by its level, LLVM would split vectors into two halves.
    """
    features = ",".join(f"+{name}" for name in LEVELS[level])
    return features + ",-prefer-256-bit" if "avx512f" in LEVELS[level] else features


def made_for() -> dict[str, str]:
    """Return the properties on which compiled kernels depend besides the level: sources, versions, system."""
    return {
        "sources": source_digest(),
        "python": f"{sys.version_info[0]}.{sys.version_info[1]}",
        "numba": version("numba"),
        "llvmlite": version("llvmlite"),
        "system": f"{platform.system()} {platform.machine()}",
    }


class NotUsable(Exception):  # noqa: N818 - a finding that callers report, not a failure
    """Reason why precompiled kernels are not loaded."""


def find_precompiled() -> Path:
    """Return the folder of the precompiled kernels for this process.

    Raises
    ------
    NotUsable
        There are none, they were compiled for something else, or other users can write the folder.
    """
    named = os.environ.get(VARIABLE)
    base = Path(named) if named else SHIPPED
    try:
        manifest = _read_manifest(base)
        folder = base / _level_of_host(manifest, base)
        # Files of the installation are trusted like its Python code.
        refused = refusal_to_run(folder) if named else ""
    except (OSError, ValueError) as error:
        raise NotUsable(f"{base}: no compiled kernels" if named else "none in this installation") from error
    if refused:
        raise NotUsable(refused)
    return folder


def _read_manifest(base: Path) -> dict[str, Any]:
    """Return the manifest of a folder of compiled kernels.

    Raises
    ------
    OSError, ValueError
        There is no manifest, or it cannot be read.
    """
    manifest = json.loads((base / MANIFEST).read_text("utf-8"))
    if not isinstance(manifest, dict) or not isinstance(manifest.get("levels"), list):
        raise ValueError(f"{base / MANIFEST}: not a manifest")  # noqa: TRY004 - as for any other wrong content
    return manifest


def _level_of_host(manifest: dict[str, Any], base: Path) -> str:
    """Return this processor's level if the kernels of a manifest were compiled for it, else raise `NotUsable`."""
    for name, here in made_for().items():
        if manifest.get(name) != here:
            found = "other sources" if name == "sources" else f"{name} {manifest.get(name)}, not {here}"
            raise NotUsable(f"{base}: compiled for {found}")
    level, levels = host_level(), manifest["levels"]
    if level not in levels:
        raise NotUsable(f"{base}: compiled for {', '.join(map(str, levels))}, not for {level or 'this processor'}")
    return level


@cache
def precompiled_kernels() -> tuple[Path | None, str]:
    """Return the folder of precompiled kernels, or None and the reason; determined once per process."""
    try:
        return find_precompiled(), ""
    except NotUsable as reason:
        named = bool(os.environ.get(VARIABLE))
        log.log(
            logging.WARNING if named else logging.DEBUG,
            "kernels are compiled on this machine unless they already are: %s",
            reason,
        )
        return None, str(reason)
