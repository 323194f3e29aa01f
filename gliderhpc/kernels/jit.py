"""Decorators that compile kernels: one for formulas that dissolve into their callers, one for loops."""

from typing import Any

from numba import njit

# No reassociation, no finite-maths assumption: NaN must stay visible, results must not depend on the vector width.
_FASTMATH = {"contract", "nsz", "arcp"}

# Nobody takes a kernel for a C callback, and the wrapper for that is a seventh of the time of compiling.
_COMMON: dict[str, Any] = {"cache": True, "error_model": "numpy", "no_cfunc_wrapper": True}

formula = njit(**_COMMON, fastmath=_FASTMATH, forceinline=True)
"""A straight-line formula on scalars and tuples; always inlined, so that a loop around it may vectorise."""

kernel = njit(**_COMMON, fastmath=_FASTMATH, nogil=True)
"""A loop over samples on preallocated arrays."""

exact_formula = njit(**_COMMON, fastmath={"contract"}, forceinline=True)
"""A formula whose rounding is part of it (argument reduction, polynomials): sums of products may be fused, no more.

Give the flags explicitly: otherwise numba inherits those of the first caller, and the cache holds what it compiled so.
"""
