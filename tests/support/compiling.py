"""Compile the kernels in parts, so that two processes can share what takes one a minute and a half.

Each part calls the kernels as the estimation does. What a part should leave out, the first test compiles.
"""

import sys

import numpy as np

from gliderhpc.estimation import profile
from gliderhpc.estimation.filter import FilterEstimate
from gliderhpc.estimation.preparation import PreparedProfile
from gliderhpc.estimation.settings import candidate_priors
from gliderhpc.mission.warm import warm_kernels, warm_simulator


def compile_filter() -> None:
    """The filter alone: its estimate goes no further."""

    def taken_and_dropped(ready, _):
        for _ in ready:
            pass
        return iter(())

    profile.solve_dives = taken_and_dropped
    warm_kernels()


def compile_the_rest() -> None:
    """Windows and smoother, from an estimate that no filter made."""

    def made_up(profiles: list[PreparedProfile]):
        for one in profiles:
            rows = len(one.series.time)
            states = np.zeros((rows, 12))
            states[:, [0, 1, 2, 5]] = one.series.measurements
            states[:, 6] = 0.3
            disturbances, unfed = np.zeros((rows, 6)), np.zeros((0, 4))
            prior = next(iter(candidate_priors(one.glider.platform).items()))
            yield FilterEstimate(states, disturbances, 0, 0, 0, 5, np.zeros(rows, np.uint8), unfed, unfed, *prior)

    profile.run_filters = lambda profiles, _: list(made_up(profiles))
    warm_kernels()


PARTS = {"filter": (compile_filter, warm_simulator), "rest": (compile_the_rest,)}
"""Kernels that each process compiles; both take about as long."""

if __name__ == "__main__":
    for compile_part in PARTS[sys.argv[1]]:
        compile_part()
