"""Compare the library of Fortran kernels with Numba's kernels on this machine.

``make fortran`` runs the comparison after the build. ``python -m gliderhpc.estimation.fortran_check`` runs it alone, on
any host that is to use the library.
"""

import sys

import numpy as np

from gliderhpc.errors import InputError
from gliderhpc.estimation.engines import WindowProblem, fortran_library
from gliderhpc.estimation.windows import WindowData
from gliderhpc.flight.glider import SENSED, Glider
from gliderhpc.flight.steady_glide import steady_glide
from gliderhpc.kernels.fortran.library import Library
from gliderhpc.kernels.lane_memory import Problem, allocate, load_window
from gliderhpc.kernels.lane_type import LANES
from gliderhpc.platform import read_platform

STEPS, STEP = 100, 0.1
BOUND = 1e-10
"""Relative difference of cost and gradient beyond which the library is faulty."""

_DISTURBED = np.array([0.05, 0.05, 0.05, 0.05, 0.02, 1.0])
_ERRORS = np.array([5e-4, 5e-4, 5e-4, 0.03])


def posed_window(seed: int) -> WindowData:
    """Simulate a window of petrel-l under random disturbances, with errors of the measurements."""
    rng = np.random.default_rng(seed)
    glider = Glider(read_platform("petrel-l"))
    dive = steady_glide(glider, 0.4, np.radians(-23.0), 100.0)
    assert dive is not None, "petrel-l glides at 23 degrees"
    controls = np.tile(dive.control, (STEPS, 1))
    states = glider.simulate(dive.state, controls, rng.normal(size=(STEPS, 6)) * _DISTURBED, STEP)
    measured = states[:, [0, 1, 2, 5]] + rng.normal(size=(STEPS + 1, 4)) * _ERRORS
    return WindowData(
        glider.hull, glider.bodies(controls), dive.state[SENSED], measured, np.ones(STEPS + 1), STEP, np.ones(6)
    )


def evaluated(library: Library, windows: list[WindowData]) -> Problem:
    """Evaluate windows without disturbance, one in each lane, with the library."""
    problem, descent, progress = allocate(STEPS, 1)
    for lane, data in enumerate(windows):
        load_window(
            problem, descent, progress, lane, data.hull, data.bodies, data.state0, data.measurements, data.weights,
            data.step, data.scale, np.zeros((STEPS, 6)), 0.0, 1,
        )  # fmt: skip
    library.evaluation(problem)()
    return problem


def difference(library: Library) -> float:
    """Largest relative difference of any lane's cost and gradient from Numba's kernel; NaN if any of them is NaN."""
    windows = [posed_window(lane) for lane in range(LANES)]
    problem = evaluated(library, windows)
    found = []
    for lane, data in enumerate(windows):
        cost, gradient = WindowProblem(data).evaluate(np.zeros(6 * STEPS))
        lacking = np.abs(problem.gradient[..., lane].ravel() - gradient).max() / np.abs(gradient).max()
        found += [abs(problem.cost[0, lane] - cost) / cost, lacking]
    return float(np.max(found))


def main() -> None:
    """Print the library's properties and difference from Numba; exit with 1 beyond `BOUND`, with 2 if there is none."""
    try:
        library = fortran_library()
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
    found = difference(library)
    print(f"{library.path}\n{library.compiler}, {LANES} lanes, flags {library.flags}")
    print(f"cost and gradient differ from Numba's by {found:.0e}, relative to the largest entry")
    # NaN fails the comparison, as intended.
    if not found < BOUND:
        print(f"error: rounding explains at most {BOUND:.0e}; build the library with other flags", file=sys.stderr)
        sys.exit(1)


if __name__ == "__main__":
    main()
