"""How kernels are compiled: one decorator for formulas that dissolve into their callers, one for loops."""

from numba import njit

# No reassociation, no finite-maths assumption: NaN must stay visible, results must not depend on the vector width.
_FASTMATH = {"contract", "nsz", "arcp"}

formula = njit(cache=True, error_model="numpy", fastmath=_FASTMATH, forceinline=True)
"""A straight-line formula on scalars and tuples; always inlined, so that a loop around it may vectorise."""

kernel = njit(cache=True, error_model="numpy", fastmath=_FASTMATH, nogil=True)
"""A loop over samples on preallocated arrays."""

exact_formula = njit(cache=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
"""A formula whose rounding is part of it (argument reduction, polynomials): sums of products may be fused, no more.

The flags must be said: without, numba takes those of whoever calls it first, and what it compiled so stays cached.
"""
