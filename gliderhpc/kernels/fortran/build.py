"""Compile the Fortran kernels into this folder.

Usage: ``make fortran``, or ``python -m gliderhpc.kernels.fortran.build [--lanes 4] [--compiler gfortran-13]
[--flags='-O3 -march=haswell']`` where the package is installed. A library is made for a number of lanes and named by
it, so that libraries for several kinds of processors can coexist.
"""

import argparse
import hashlib
import platform
import shlex
import subprocess
import sys
import tempfile
from pathlib import Path

from gliderhpc.kernels.lane_type import LANES

FOLDER = Path(__file__).parent
COMPILER = "gfortran"
FLAGS = "-O3 -march=native"

_LANGUAGE = ("-std=f2018", "-cpp", "-fPIC", "-shared", "-fopenmp-simd", "-Wall", "-Wextra", "-Wno-compare-reals")
# Follows the caller's flags: NaN must stay visible, and (x + c) - c is no x. Sums of products
# may be fused, and a quotient may be a product with a reciprocal, as Numba's kernels have it.
_ARITHMETIC = (
    "-fno-finite-math-only", "-fno-associative-math", "-freciprocal-math", "-fno-signed-zeros", "-fno-math-errno",
    "-fno-trapping-math", "-fprotect-parens",
)  # fmt: skip
# Every formula has to dissolve into the loop over lanes: a call in it would leave it to single numbers.
_INLINING = (
    "-fno-semantic-interposition", "-finline-limit=1000000", "--param=inline-unit-growth=100000",
    "--param=max-inline-insns-single=100000", "--param=large-function-growth=100000",
    "--param=large-stack-frame-growth=100000", "--param=large-unit-insns=1000000",
)  # fmt: skip


_UNSAFE = {"-Ofast", "-ffast-math", "-funsafe-math-optimizations"}
"""Flags that change how the whole process calculates: linked with them, the library switches denormal numbers off."""


class BuildError(Exception):
    """No library could be built; the message gives the reason in one line."""


def source_digest() -> str:
    """Hex digest of every Fortran source; a library contains the digest of its own sources."""
    digest = hashlib.sha256()
    for path in sorted(FOLDER.glob("*.f90")):
        digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()[:16]


def library_path(lanes: int = LANES) -> Path:
    """Path of the library for a number of lanes."""
    return FOLDER / f"libgliderhpc_lanes{lanes}.so"


def command_of(compiler: str, flags: str, lanes: int, modules: str, output: Path) -> list[str]:
    """Command that compiles the library to ``output``, its module files in the folder ``modules``."""
    # Left to itself the compiler prefers half of a wide register.
    width = ["-mprefer-vector-width=512"] if lanes == 8 and platform.machine().lower() in {"x86_64", "amd64"} else []
    return [
        *shlex.split(compiler), *_LANGUAGE, *shlex.split(flags), *width, *_ARITHMETIC, *_INLINING,
        f"-DGLIDERHPC_LANES={lanes}", f'-DGLIDERHPC_SOURCES="{source_digest()}"',
        f'-DGLIDERHPC_FLAGS="{flags}"', "-J", modules,
        str(FOLDER / "library.f90"), "-o", str(output),
    ]  # fmt: skip


def build(compiler: str = COMPILER, flags: str = FLAGS, lanes: int = LANES) -> Path:
    """Compile the library, and move it into place once it is complete.

    Parameters
    ----------
    compiler, flags : str
        GNU Fortran's command, and the options that are the caller's to choose.
    lanes : int
        Profiles side by side: 8 for processors with AVX-512, 4 for others.

    Raises
    ------
    BuildError
        There is no such compiler, it failed (its own messages have gone to standard error), or a flag is not safe.
    """
    if unsafe := _UNSAFE.intersection(shlex.split(flags)):
        raise BuildError(
            f"flag {min(unsafe)} would change the arithmetic of the whole program; use -O3 with -march=..."
        )
    path = library_path(lanes)
    try:
        with tempfile.TemporaryDirectory(dir=FOLDER) as modules:
            made = Path(modules) / path.name
            subprocess.run(command_of(compiler, flags, lanes, modules, made), check=True)
            made.replace(path)
    except FileNotFoundError:
        raise BuildError(
            f"no Fortran compiler '{compiler}' on the path; install one (apt-get install gfortran, module load gcc) or "
            "name another: make fortran FC=..."
        ) from None
    except subprocess.CalledProcessError as error:
        raise BuildError(f"{compiler} ended with status {error.returncode}; its messages are above") from None
    except OSError as error:
        raise BuildError(f"{error.filename or FOLDER}: cannot be written ({error.strerror or error})") from None
    return path


def main() -> None:
    """Build by the command line's options."""
    parser = argparse.ArgumentParser(
        prog="python -m gliderhpc.kernels.fortran.build", description="Compile the Fortran kernels into the package."
    )
    parser.add_argument("--compiler", default=COMPILER, help="GNU Fortran's command; default %(default)s")
    parser.add_argument("--flags", default=FLAGS, help="its options; default %(default)s")
    parser.add_argument("--lanes", type=int, choices=(4, 8), default=LANES, help="8 with AVX-512; here %(default)s")
    chosen = parser.parse_args()
    try:
        print(f"built {build(chosen.compiler, chosen.flags, chosen.lanes)}")
    except BuildError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(1)


if __name__ == "__main__":
    main()
