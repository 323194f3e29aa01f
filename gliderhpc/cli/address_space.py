"""Refuse a limit on the address space in which the libraries cannot be loaded."""

import sys

from gliderhpc.errors import InputError

MIN_ADDRESS_SPACE = 600_000_000
"""Smallest limit (bytes) in which numpy, scipy and numba can be loaded. With less, OpenBLAS does not fail but tries to
allocate its buffers forever, or interrupts the process as Ctrl-C does."""


def check_address_space() -> None:
    """Refuse a limit on the address space below `MIN_ADDRESS_SPACE`, before a library is loaded.

    Raises
    ------
    InputError
        The limit is too low.
    """
    if sys.platform == "win32":
        return
    import resource

    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    if limit != resource.RLIM_INFINITY and limit < MIN_ADDRESS_SPACE:
        raise InputError(
            f"not enough memory: this process may use {limit / 1e6:.0f} MB of address space, and needs at least "
            f"{MIN_ADDRESS_SPACE / 1e6:.0f} MB; raise the limit (ulimit -v, or that of the batch system)"
        )
