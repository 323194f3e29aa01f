"""Multiplications and additions per second of one core: an upper bound of an engine's arithmetic."""

import re
import time
from collections import Counter
from typing import Any

import numpy as np
from numba import njit

LENGTH, CHAINS, DEPTH = 1024, 8, 16
_FLOPS_A_PASS = 2 * LENGTH * CHAINS * DEPTH


@njit(error_model="numpy", fastmath={"contract"})
def _chains(x: Any, factor: float, term: float, out: Any, passes: int) -> None:
    """Eight independent chains of fused multiply-adds an element: enough in flight to hide their latency."""
    for _ in range(passes):
        for i in range(LENGTH):
            a = x[i]
            b, c, d, e = a + 1.0, a + 2.0, a + 3.0, a + 4.0
            f, g, h = a + 5.0, a + 6.0, a + 7.0
            for _step in range(DEPTH):
                a = a * factor + term
                b = b * factor + term
                c = c * factor + term
                d = d * factor + term
                e = e * factor + term
                f = f * factor + term
                g = g * factor + term
                h = h * factor + term
            out[i] = ((a + b) + (c + d)) + ((e + f) + (g + h))


def fma_peak(repetitions: int = 15, passes: int = 400) -> float:
    """Measured peak of one core, floating-point operations a second (a fused multiply-add counts as two).

    Raises
    ------
    RuntimeError
        The compiler did not vectorise the chains, so that their rate would be no peak.
    """
    x, out = np.linspace(0.0, 1.0, LENGTH), np.empty(LENGTH)
    _chains(x, 0.9, 0.1, out, 1)
    if not vector_instructions():
        raise RuntimeError("the chains of multiply-adds were not vectorised: this CPU or compiler has no vector FMA")
    best = np.inf
    for _ in range(repetitions):
        began = time.perf_counter()
        _chains(x, 0.9, 0.1, out, passes)
        best = min(best, time.perf_counter() - began)
    return passes * _FLOPS_A_PASS / best


def vector_instructions() -> Counter[str]:
    """Count the vector FMA instructions of the compiled chains by register (``ymm``, ``zmm``; ``v`` on ARM)."""
    if not _chains.signatures:
        _chains(np.zeros(LENGTH), 0.9, 0.1, np.empty(LENGTH), 1)
    (assembly,) = _chains.inspect_asm().values()
    return count_vector_fma(assembly)


def count_vector_fma(assembly: str) -> Counter[str]:
    """Count packed FMA instructions in assembly by the kind of register."""
    x86 = re.findall(r"\bvfn?m(?:add|sub)\d{3}pd\b.*?%?([yz]mm)\d+", assembly)
    arm = re.findall(r"\bfmla\s+(v)\d+\.2d", assembly)
    return Counter([*x86, *arm])
