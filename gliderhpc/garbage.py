"""Less frequent searches for cyclic garbage in processes of this program."""

import gc
from collections.abc import Iterator
from contextlib import contextmanager

ALLOCATIONS = 10_000
"""Number of new containers after which the youngest are searched; with Python's 700, searching takes a tenth of a
report's time."""


@contextmanager
def infrequent_collection() -> Iterator[None]:
    """Search for cyclic garbage less often while the block runs; a process that searches less often still does so."""
    before = gc.get_threshold()
    gc.set_threshold(max(ALLOCATIONS, before[0]), *before[1:])
    try:
        yield
    finally:
        gc.set_threshold(*before)
