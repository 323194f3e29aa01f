"""Compile every kernel of simulation and estimation for levels of processors: for a wheel, or for a cluster's folder.

python -m gliderhpc.mission.precompile FOLDER [LEVEL ...]
"""

import sys
from pathlib import Path

from gliderhpc.kernels.precompiled import LEVELS
from gliderhpc.mission.kernel_levels import precompile, used_signatures
from gliderhpc.mission.warm import warm_everything

WHEEL_LEVELS = ("x86-64-v4", "x86-64-v3")
"""Levels in a wheel: processors with AVX-512, and processors with AVX2, that is, all since about 2015."""


def main(folder: str, *levels: str) -> int:
    """Compile all kernels that the program calls, by default for the levels of a wheel."""
    unknown = [level for level in levels if level not in LEVELS]
    if unknown:
        sys.stderr.write(f"{unknown[0]}: not a processor level; give some of {', '.join(LEVELS)}\n")
        return 2
    warm_everything()
    precompile(Path(folder).absolute(), used_signatures(), levels or WHEEL_LEVELS)
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
