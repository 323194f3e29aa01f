"""Compile the kernels in parts, so that two processes can share what takes one a minute and a half.

Each part calls the kernels as the estimation does. What a part should leave out, the first test compiles.
"""

import sys

import numpy as np

from gliderhpc.estimation import preparation, profile
from gliderhpc.estimation.filter import FilterEstimate, FilterRequest
from gliderhpc.estimation.settings import EstimationSettings, candidate_priors
from gliderhpc.mission.warm import estimate_a_few_seconds, warm_simulator


def compile_filter() -> None:
    """The filter alone: its estimate goes no further."""

    def taken_and_dropped(ready, _):
        for _ in ready:
            pass
        return iter(())

    profile._ENGINES["lanes"] = taken_and_dropped
    estimate_a_few_seconds()


def compile_the_rest() -> None:
    """Windows and smoother, from an estimate that no filter made."""

    def made_up(requests: list[FilterRequest], _: EstimationSettings):
        for request in requests:
            rows = len(request.series.time)
            states = np.zeros((rows, 12))
            states[:, [0, 1, 2, 5]] = request.series.measurements
            states[:, 6] = 0.3
            disturbances, unfed = np.zeros((rows, 6)), np.zeros((0, 4))
            estimate = FilterEstimate(states, disturbances, 0, 0, 0, 5, np.zeros(rows, np.uint8), unfed, unfed)
            yield estimate, next(iter(candidate_priors(request.glider.platform).items()))

    preparation.filter_with_candidates = lambda requests, settings: list(made_up(requests, settings))
    estimate_a_few_seconds()


PARTS = {"filter": (compile_filter, warm_simulator), "rest": (compile_the_rest,)}
"""What each process compiles; both take about as long."""

if __name__ == "__main__":
    for compile_part in PARTS[sys.argv[1]]:
        compile_part()
