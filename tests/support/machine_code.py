"""Machine code of a kernel: its arithmetic on doubles, by register width."""

import re
from collections import Counter
from typing import Any

from gliderhpc.kernels import pairs, quasi_newton, window
from gliderhpc.kernels.compiler import KernelDispatcher
from gliderhpc.kernels.lane_memory import allocate

_ARITHMETIC = re.compile(
    r"^(?:\s+[0-9a-f]+:)?\s+v?(?:add|sub|mul|div|sqrt|max|min|fn?m(?:add|sub)\d+)(pd|sd)\s+(.*)$", re.MULTILINE
)
_WIDTHS = {"z": 8, "y": 4, "x": 2}


def arithmetic(kernel: Any) -> Counter[int]:
    """Count `arithmetic_of` a compiled kernel."""
    (code,) = kernel.inspect_asm().values()
    return arithmetic_of(code)


def arithmetic_of(code: str) -> Counter[int]:
    """Count additions, products, quotients, roots and extremes in machine code by the doubles each works on."""
    counts: Counter[int] = Counter()
    for form, operands in _ARITHMETIC.findall(code):
        widest = max((_WIDTHS[register] for register in re.findall(r"%([xyz])mm", operands)), default=2)
        counts[1 if form == "sd" else widest] += 1
    return counts


def compiled_kernels() -> dict[str, Any]:
    """Kernels that run over lanes, compiled afresh: those from the cache show no machine code."""
    p, d, progress = allocate(8, 3)
    arguments = {
        window.forward: (p.hull, p.bodies, p.state0, p.trial, p.durations, p.states, p.tape),
        window.adjoint: (
            p.hull, p.bodies, p.states, p.tape, p.measurements, p.weights, p.durations, p.gradient, p.gradient_state0,
            p.cost,
        ),
        quasi_newton.measure_trial: (p, d),
        quasi_newton.accept_trial: (p, d),
        pairs.multiply_pairs: (d, 0, 1),
        pairs.point_directions: (d, progress),
        quasi_newton.place_trial: (p, d),
    }  # fmt: skip
    return {kernel.py_func.__name__: _afresh(kernel, given) for kernel, given in arguments.items()}


def _afresh(kernel: Any, arguments: tuple[Any, ...]) -> Any:
    compiled = KernelDispatcher(kernel.py_func, targetoptions=kernel.targetoptions)
    compiled(*arguments)
    return compiled
