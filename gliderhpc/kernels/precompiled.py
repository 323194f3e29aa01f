"""Kernels compiled beforehand, in the wheel or in a folder of a cluster, for a level of processors.

Numba compiles for the processor at hand and stores code under its name. Code for a level of the x86-64 psABI runs on
every processor of that level or a higher one, so that one set of files serves all of them. It is loaded where it was
made from these very sources, by the same numba, for this Python and this level, and with no setting of numba's that
names another processor; otherwise kernels are compiled here, as without it.
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
"""Environment variable that names a folder of ``python -m gliderhpc.mission.precompile``, in place of the wheel's."""

SHIPPED = SOURCES / "compiled"
"""Folder of the wheel's compiled kernels; a checkout has none."""

MANIFEST = "made-for.json"
"""File that says for what the kernels of a folder were compiled."""

_V2 = ("cx16", "popcnt", "sahf", "sse3", "sse4.1", "sse4.2", "ssse3")
_V3 = (*_V2, "avx", "avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe", "xsave")
_V4 = (*_V3, "avx512bw", "avx512cd", "avx512dq", "avx512f", "avx512vl")

LEVELS = {"x86-64-v4": _V4, "x86-64-v3": _V3, "x86-64-v2": _V2}
"""Features of every level, by the names of LLVM; the highest first. (System V ABI, AMD64 supplement, table 3.1.)"""


def host_level() -> str:
    """Return the highest level of this processor, or an empty text where it has none or numba is set to another one."""
    import llvmlite.binding
    from numba.core import config

    named = any(getattr(config, setting) is not None for setting in ("CPU_NAME", "CPU_FEATURES"))
    if named or platform.machine() not in ("x86_64", "AMD64"):
        return ""
    found = llvmlite.binding.get_host_cpu_features()
    return next((level for level, needed in LEVELS.items() if all(found.get(name) for name in needed)), "")


def level_features(level: str) -> str:
    """Return the features of a level as LLVM and ``NUMBA_CPU_FEATURES`` take them.

    With AVX-512 LLVM would split vectors in two halves on a processor that it knows by its level alone.
    """
    features = ",".join(f"+{name}" for name in LEVELS[level])
    return features + ",-prefer-256-bit" if "avx512f" in LEVELS[level] else features


def made_for() -> dict[str, str]:
    """Return what compiled kernels depend on apart from the level: sources, versions, system."""
    return {
        "sources": source_digest(),
        "python": f"{sys.version_info[0]}.{sys.version_info[1]}",
        "numba": version("numba"),
        "llvmlite": version("llvmlite"),
        "system": f"{platform.system()} {platform.machine()}",
    }


class NotUsable(Exception):  # noqa: N818 - a finding that callers report, not a failure
    """Why kernels compiled beforehand are not loaded."""


def find_precompiled() -> Path:
    """Return the folder of the kernels compiled beforehand for this process.

    Raises
    ------
    NotUsable
        There are none, or they were made for something else.
    """
    named = os.environ.get(VARIABLE)
    base = Path(named) if named else SHIPPED
    try:
        manifest = _read_manifest(base)
        folder = base / _level_of_host(manifest, base)
        # What the installation holds is trusted as its Python is.
        refused = refusal_to_run(folder) if named else ""
    except (OSError, ValueError) as error:
        raise NotUsable(f"{base}: no compiled kernels" if named else "none in this installation") from error
    if refused:
        raise NotUsable(refused)
    return folder


def _read_manifest(base: Path) -> dict[str, Any]:
    """Return for what the kernels of a folder were compiled.

    Raises
    ------
    OSError, ValueError
        There is no manifest, or it cannot be read.
    """
    manifest = json.loads((base / MANIFEST).read_text("utf-8"))
    if not isinstance(manifest, dict) or not isinstance(manifest.get("levels"), list):
        raise ValueError(f"{base / MANIFEST}: not a manifest")  # noqa: TRY004 - as of any other content that is wrong
    return manifest


def _level_of_host(manifest: dict[str, Any], base: Path) -> str:
    """Return this processor's level where the kernels that a manifest describes were compiled for it."""
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
    """Return the folder of kernels compiled beforehand, or None and the reason; found once a process."""
    try:
        return find_precompiled(), ""
    except NotUsable as reason:
        named = bool(os.environ.get(VARIABLE))
        log.log(
            logging.WARNING if named else logging.DEBUG, "kernels are compiled here, if they were not yet: %s", reason
        )
        return None, str(reason)
