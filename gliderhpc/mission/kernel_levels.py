"""Compile kernels for levels of processors, which may differ from that of this machine.

The kernels are compiled for the signatures with which a process has called them. These are the same for every level,
since the number of lanes is in the arrays' lengths and not in their types. Each level is compiled in a separate
process, in which numba is set to that level; the compiled code is not run there.

    python -m gliderhpc.mission.kernel_levels FOLDER < SIGNATURES
"""

import json
import os
import pickle
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

from gliderhpc.kernels.cache import VARIABLES
from gliderhpc.kernels.compiler import KernelDispatcher
from gliderhpc.kernels.jit import LevelCache
from gliderhpc.kernels.precompiled import LEVELS, MANIFEST, VARIABLE, level_features, made_for

Signatures = list[tuple[str, str, tuple[Any, ...]]]
"""Module, name and types of the arguments of every kernel to compile."""


def used_signatures() -> Signatures:
    """Return the signatures of the kernels that this process has called from Python, in the order of their names."""
    found = [
        (dispatcher.py_func.__module__, dispatcher.py_func.__name__, types)
        for dispatcher in _dispatchers()
        for types in dispatcher.overloads
    ]
    return sorted(found, key=lambda one: (one[0], one[1], str(one[2])))


def _dispatchers() -> Iterator[Any]:
    """Yield the kernels, defined in the modules loaded so far, that Python may call."""
    for name, module in sorted(sys.modules.items()):
        if name.startswith("gliderhpc.kernels."):
            for value in vars(module).values():
                if isinstance(value, KernelDispatcher) and value.py_func.__module__ == name:
                    yield value


def precompile(folder: Path, signatures: Signatures, levels: Sequence[str] = tuple(LEVELS)) -> None:
    """Compile kernels for some levels into a folder, which `GLIDERHPC_KERNELS` may name.

    The same sources and versions give the same bytes. The manifest is written last: without it a folder is not used.

    Raises
    ------
    subprocess.CalledProcessError
        A level cannot be compiled.
    """
    folder.mkdir(parents=True, exist_ok=True)
    manifest = folder / MANIFEST
    manifest.unlink(missing_ok=True)
    for level in levels:
        _compile_apart(level, folder / level, signatures)
    manifest.write_text(json.dumps({**made_for(), "levels": list(levels)}, indent=1) + "\n", "utf-8")


def _compile_apart(level: str, folder: Path, signatures: Signatures) -> None:
    """Compile for a level in a separate process, which stores nothing else."""
    folder.mkdir(exist_ok=True)
    for old in folder.iterdir():
        old.unlink()
    environment = {name: value for name, value in os.environ.items() if name != VARIABLE}
    environment |= {"NUMBA_CPU_NAME": level, "NUMBA_CPU_FEATURES": level_features(level), "PYTHONHASHSEED": "0"}
    with tempfile.TemporaryDirectory() as aside:
        subprocess.run(
            [sys.executable, "-m", "gliderhpc.mission.kernel_levels", str(folder)],
            input=pickle.dumps(signatures),
            env={**environment, VARIABLES[0]: aside},
            check=True,
        )


def compile_level(folder: Path, signatures: Signatures) -> None:
    """Compile kernels for the level that numba is set to, into a folder."""
    for module, name, types in signatures:
        dispatcher = getattr(import_module(module), name)
        if not isinstance(dispatcher._cache, LevelCache):
            dispatcher._cache = LevelCache(dispatcher.py_func, folder)
        dispatcher.compile(types)


if __name__ == "__main__":
    compile_level(Path(sys.argv[1]), pickle.load(sys.stdin.buffer))
