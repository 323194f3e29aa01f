"""The window problem solved with other tools, for comparison with the project's engines.

`base` says what a contender is and how it is verified and judged; `model` is the right-hand side in plain arithmetic;
`casadi_ipopt`, `casadi_c` and `jax_scan` are the peers. Those whose tools are missing here are skipped with one line.
"""

from collections.abc import Callable

from benchmarks.peers.base import Contender, UnavailableError
from benchmarks.peers.casadi_c import casadi_c
from benchmarks.peers.casadi_ipopt import casadi_ipopt, casadi_ipopt_tuned
from benchmarks.peers.jax_scan import jax_scan
from gliderhpc.estimation.settings import EstimationSettings

PEERS: dict[str, Callable[[EstimationSettings], Contender]] = {
    "casadi_ipopt": casadi_ipopt,
    "casadi_ipopt_tuned": casadi_ipopt_tuned,
    "jax": jax_scan,
    "casadi_c": casadi_c,
}


def available_peers(settings: EstimationSettings) -> tuple[list[Contender], dict[str, str]]:
    """Give the peers that this machine can run, and by name what the others lack."""
    found, missing = [], {}
    for name, make in PEERS.items():
        try:
            found.append(make(settings))
        except UnavailableError as lack:
            missing[name] = str(lack)
    return found, missing
