"""Rates and their derivatives at many points, for balances that are solved over whole arrays."""

from gliderhpc.kernels.dynamics import rates
from gliderhpc.kernels.jacobian import store_partials
from gliderhpc.kernels.jit import kernel
from gliderhpc.kernels.mass import load_body


@kernel
def rates_and_partials(hull, bodies, states, values, entries):
    """Fill the undisturbed rates ``values (n, 10)`` of sensed states ``(n, 10)``, and their Jacobians' entries.

    ``entries (n, ENTRIES)`` is the list of `gliderhpc.kernels.jacobian`, row by row.
    """
    for k in range(states.shape[0]):
        y = (
            states[k, 0], states[k, 1], states[k, 2], states[k, 3], states[k, 4],
            states[k, 5], states[k, 6], states[k, 7], states[k, 8], states[k, 9],
        )  # fmt: skip
        body = load_body(bodies, k)
        d = rates(hull, body, y, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
        for i in range(10):
            values[k, i] = d[i]
        store_partials(hull, body, y, 1.0, entries, (k,))
