"""Less frequent searches for cyclic garbage in processes of this program."""

import gc
from collections.abc import Iterator
from contextlib import contextmanager

ALLOCATIONS = 10_000
"""Number of new containers after which the youngest are searched; with Python's 700, searching takes a tenth of a
report's time."""


@contextmanager
def infrequent_collection() -> Iterator[None]:
    """Search for cyclic garbage less often while the block runs."""
    before = gc.get_threshold()
    gc.set_threshold(ALLOCATIONS, *before[1:])
    try:
        yield
    finally:
        gc.set_threshold(*before)
