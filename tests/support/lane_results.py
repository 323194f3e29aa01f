"""Results of a machine's lanes, from a separate process in which the processor can be made to appear narrower.

Writes, as JSON, the lane count, cost, gradient and solution of one window, and what its machine code is made of.
"""

import json
import sys

from gliderhpc.estimation.lanes import LaneBatch
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.kernels.elementwise import LANES
from support.machine_code import arithmetic, compiled_kernels
from support.posed_windows import at_rest, impulse, window_data


def results() -> dict[str, object]:
    """Solve one window in the last lane."""
    data = window_data(disturbance=impulse())
    batch = LaneBatch(EstimationSettings())
    batch.load(LANES - 1, (data, at_rest(data)))
    ((_, solution),) = batch.run()
    return {
        "lanes": LANES,
        "cost": solution.cost,
        "iterations": solution.iterations,
        "evaluations": solution.evaluations,
        "disturbances": solution.disturbances.tolist(),
        "states": solution.states.tolist(),
        "arithmetic": {name: dict(arithmetic(kernel)) for name, kernel in compiled_kernels().items()},
    }


if __name__ == "__main__":
    json.dump(results(), sys.stdout)
