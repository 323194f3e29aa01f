"""Sizes of problems that suit the kernels: uncompiled (``NUMBA_DISABLE_JIT=1``) they run 1,000 times slower."""

from numba import config

COMPILED = not config.DISABLE_JIT


def scaled(compiled: int, interpreted: int) -> int:
    """One of two sizes, by how the kernels run."""
    return compiled if COMPILED else interpreted
