"""Compile the kernels of simulation and estimation for chosen processor levels: for a wheel, or for a cluster's folder.

The kernels are compiled for the signatures with which a process has called them. These are the same for every level,
since the number of lanes is part of the code and not of the arrays' types. Each level is compiled in a separate
process, in which numba is set to that level; the compiled code is not run there.

    python -m gliderhpc.mission.precompile FOLDER [LEVEL ...]
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

WHEEL_LEVELS = ("x86-64-v4", "x86-64-v3")
"""Levels in a wheel: processors with AVX-512, and processors with AVX2, that is, all since about 2015."""

_COMPILE_LEVEL = "from gliderhpc.mission.precompile import compile_level_of_stdin as run; import sys; run(sys.argv[1])"

Signatures = list[tuple[str, str, tuple[Any, ...]]]
"""Module, name and types of the arguments of every kernel to compile."""


def used_signatures() -> Signatures:
    """Return the signatures of the kernels that this process has called from Python, in the order of their names."""
    found = [
        (dispatcher.py_func.__module__, dispatcher.py_func.__name__, types)
        for dispatcher in _dispatchers()
        for types in dispatcher.overloads
    ]
    return sorted(found, key=lambda entry: (entry[0], entry[1], str(entry[2])))


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
        _compile_in_subprocess(level, folder / level, signatures)
    manifest.write_text(json.dumps({**made_for(), "levels": list(levels)}, indent=1) + "\n", "utf-8")


def _compile_in_subprocess(level: str, folder: Path, signatures: Signatures) -> None:
    """Compile for a level in a separate process, whose own cache is discarded."""
    folder.mkdir(exist_ok=True)
    for old in folder.iterdir():
        old.unlink()
    environment = {name: value for name, value in os.environ.items() if name != VARIABLE}
    environment |= {"NUMBA_CPU_NAME": level, "NUMBA_CPU_FEATURES": level_features(level), "PYTHONHASHSEED": "0"}
    with tempfile.TemporaryDirectory() as cache:
        subprocess.run(
            [sys.executable, "-c", _COMPILE_LEVEL, str(folder)],
            input=pickle.dumps(signatures),
            env={**environment, VARIABLES[0]: cache},
            check=True,
        )


def compile_level_of_stdin(folder: str) -> None:
    """Compile the kernels whose signatures arrive on stdin, for the level that numba is set to, into a folder."""
    signatures: Signatures = pickle.load(sys.stdin.buffer)
    for module, name, types in signatures:
        dispatcher = getattr(import_module(module), name)
        if not isinstance(dispatcher._cache, LevelCache):
            dispatcher._cache = LevelCache(dispatcher.py_func, Path(folder))
        dispatcher.compile(types)


def main(folder: str, *levels: str) -> int:
    """Compile all kernels that the program calls, by default for the levels of a wheel."""
    unknown = [level for level in levels if level not in LEVELS]
    if unknown:
        sys.stderr.write(f"{unknown[0]}: not a processor level; give some of {', '.join(LEVELS)}\n")
        return 2
    # Imported here, since the process that compiles a level needs only the kernels.
    from gliderhpc.mission.warm import warm_everything

    warm_everything()
    precompile(Path(folder).absolute(), used_signatures(), levels or WHEEL_LEVELS)
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
