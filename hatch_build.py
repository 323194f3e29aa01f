"""Build hook of the wheel: it takes in kernels compiled beforehand, where `GLIDERHPC_KERNELS` names a folder of them.

Such a wheel is for one version of Python and for the systems for which numba's own wheel is. Without the variable the
wheel is for all, and kernels are compiled where they are used.
"""

import os
import sys
from importlib.metadata import distribution
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class CompiledKernels(BuildHookInterface):
    """Add compiled kernels to the wheel and name its tag accordingly."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Take in the folder that the variable names."""
        folder = os.environ.get("GLIDERHPC_KERNELS")
        if folder is None or self.target_name != "wheel":
            return
        if not (Path(folder) / "made-for.json").is_file():
            raise FileNotFoundError(f"{folder}: no compiled kernels; python -m gliderhpc.mission.precompile makes them")
        python = f"cp{sys.version_info[0]}{sys.version_info[1]}"
        build_data["pure_python"] = False
        build_data["tag"] = f"{python}-{python}-{_platform_of_numba()}"
        build_data["force_include"][folder] = "gliderhpc/kernels/compiled"


def _platform_of_numba() -> str:
    """Return the platforms that the wheel of the installed numba is for, as a tag: nothing but numba loads the code."""
    lines = (distribution("numba").read_text("WHEEL") or "").splitlines()
    return ".".join(sorted(line.rpartition("-")[2] for line in lines if line.startswith("Tag: ")))
