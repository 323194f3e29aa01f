"""The library of Fortran kernels, loaded by ctypes after a check that it fits these sources and arrays."""

import ctypes
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import llvmlite.binding
import numpy as np

from gliderhpc.kernels.fortran.build import library_path, source_digest
from gliderhpc.kernels.jacobian import ENTRIES
from gliderhpc.kernels.lane_memory import Problem
from gliderhpc.kernels.lane_type import LANES
from gliderhpc.kernels.parameters import Body, Hull
from gliderhpc.kernels.window import TAPE

INTERFACE_VERSION = 1
"""Version of the entry points and of the layout of their arguments; `library.f90` has the same."""

HOW = "build them here with `make fortran` (or `python -m gliderhpc.kernels.fortran.build`)"

_LAYOUT = {
    "interface version": INTERFACE_VERSION, "lanes": LANES, "numbers of a hull": len(Hull._fields),
    "numbers of a body": len(Body._fields), "numbers of a step on the tape": TAPE, "entries of a Jacobian": ENTRIES,
}  # fmt: skip
_VECTORS = {8: "avx512f", 4: "avx2"}
"""Feature of the processor required for vectors of 8 or 4 doubles, if not every processor has it."""

_COUNT, _NUMBER = ctypes.c_int64, ctypes.c_double
_ARRAY = np.ctypeslib.ndpointer(np.float64, flags="C_CONTIGUOUS")
_SIGNATURES: Mapping[str, tuple[Any, ...]] = {
    "sincos": (_COUNT, *[_ARRAY] * 3),
    "arctan2": (_COUNT, *[_ARRAY] * 3),
    "wrap": (_COUNT, *[_ARRAY] * 2),
    "rhs": (_ARRAY,) * 5,
    "rates_vjp": (_ARRAY,) * 6,
    "rhs_jacobian": (_ARRAY,) * 4,
    "step": (*[_ARRAY] * 4, _NUMBER, _ARRAY),
    "step_vjp": (*[_ARRAY] * 5, _NUMBER, *[_ARRAY] * 2),
    "simulate": (_COUNT, *[_ARRAY] * 4, _NUMBER, _ARRAY),
    "advance": (_COUNT, *[_ARRAY] * 6, _COUNT),
    "pull_back": (_COUNT, *[_ARRAY] * 5, _COUNT),
}
"""Arguments of each kernel, in the order of `library.f90`; arrays as Python's kernels have them."""

_ARRAYS = (
    "hull", "bodies", "state0", "trial", "measurements", "weights", "durations", "states", "tape", "gradient",
    "gradient_state0", "cost",
)  # fmt: skip


class LibraryError(Exception):
    """The library cannot be used; the message gives reason and remedy in one line."""


class _Problem(ctypes.Structure):
    """`problem_type` of ``library.f90``."""

    _fields_ = (("steps", ctypes.c_int64), *((name, ctypes.c_void_p) for name in _ARRAYS))


@dataclass(frozen=True)
class Library:
    """The library, with its provenance.

    Attributes
    ----------
    path : Path
        Where it is.
    compiler, flags : str
        What made it.
    kernels : mapping of str to callable
        By the kernel's name: takes contiguous arrays of float64, and numbers.
    """

    path: Path
    compiler: str
    flags: str
    kernels: Mapping[str, Callable[..., None]]

    def evaluation(self, problem: Problem) -> Callable[[], None]:
        """Give the call that leaves cost and gradient of every lane's trial in ``problem``."""
        steps = len(problem.bodies)
        argument = _Problem(steps, *(getattr(problem, name).ctypes.data for name in _ARRAYS))
        # The arrays live as long as the call may be made.
        argument.owner = problem
        return partial(self.kernels["cost_and_gradient"], ctypes.byref(argument))


@cache
def load() -> Library:
    """Load the library for this processor's lanes.

    Raises
    ------
    LibraryError
        It is not built, was built from other sources, or for another processor or layout of arrays.
    """
    return _opened(library_path())


def _opened(path: Path) -> Library:
    if not path.exists():
        raise LibraryError(f"the Fortran kernels are not built for {LANES} lanes ({path} is missing); {HOW}")
    try:
        library = ctypes.CDLL(str(path))
        layout = tuple((ctypes.c_int64 * (len(_LAYOUT) + 1)).in_dll(library, "gliderhpc_layout"))
        sources, compiler, flags = _provenance(library)
    except (OSError, ValueError) as error:
        raise LibraryError(f"{path}: cannot be loaded ({error}); {HOW}") from None
    _check(path, layout, sources)
    return Library(path, compiler, flags, _kernels(library))


def _provenance(library: ctypes.CDLL) -> list[str]:
    """Provenance of the library: digest of the sources, compiler, flags."""
    text = ctypes.addressof(ctypes.c_char.in_dll(library, "gliderhpc_built_from"))
    return ctypes.string_at(text).decode().split("\n")


def _check(path: Path, layout: tuple[int, ...], sources: str) -> None:
    """Reject a library that was built for other sources, lanes, layout or processor."""
    for (name, wanted), found in zip(_LAYOUT.items(), layout, strict=False):
        if found != wanted:
            raise LibraryError(f"{path}: was built for {name} {found}, but {wanted} is needed here; {HOW}")
    if sources != source_digest():
        raise LibraryError(f"{path}: was not built from the sources next to it; {HOW}")
    vector = _VECTORS.get(layout[-1])
    if vector is not None and not llvmlite.binding.get_host_cpu_features().get(vector, False):
        raise LibraryError(f"{path}: uses {vector}, which this processor does not have; {HOW}")


def _kernels(library: ctypes.CDLL) -> dict[str, Callable[..., None]]:
    kernels: dict[str, Callable[..., None]] = {}
    for name, arguments in {**_SIGNATURES, "cost_and_gradient": (ctypes.c_void_p,)}.items():
        function = getattr(library, f"gliderhpc_{name}")
        function.argtypes, function.restype = arguments, None
        kernels[name] = function
    return kernels
