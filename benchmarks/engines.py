"""The project's engines, one entry each: a new engine is one function and one line of `ENGINES`."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from benchmarks.peers.base import Answer, Contender, Evaluator, one_at_a_time
from benchmarks.peers.quasi_newton import options_of
from benchmarks.windows import Window
from gliderhpc import Glider, __version__
from gliderhpc.estimation.profile import estimate_profile
from gliderhpc.estimation.scipy_engine import solve_window
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.estimation.window_problem import WindowProblem
from gliderhpc.observations import ProfileSeries

Profiles = Callable[[Glider, Sequence[ProfileSeries]], object]


@dataclass(frozen=True)
class Engine:
    """An engine as it solves windows, and as it estimates whole profiles (filter, windows, forward run)."""

    contender: Contender
    estimate: Profiles


def scipy_engine(settings: EstimationSettings) -> Engine:
    """Give the reference engine: scalar kernels about scipy's L-BFGS-B, one window at a time."""

    def evaluator(window: Window) -> Evaluator:
        return WindowProblem(window.data).evaluate

    def solve(window: Window) -> Answer:
        solution = solve_window(window.data, window.start, settings)
        x = np.asarray((solution.disturbances / window.data.scale).ravel())
        return Answer(x, solution.iterations, solution.evaluations)

    def estimate(glider: Glider, profiles: Sequence[ProfileSeries]) -> object:
        return [estimate_profile(glider, series, settings) for series in profiles]

    contender = one_at_a_time(
        "scipy", "gliderhpc, engine scipy", evaluator, solve, options_of(settings, settings.step),
        {"gliderhpc": __version__, "scipy": scipy.__version__},
    )  # fmt: skip
    return Engine(contender, estimate)


ENGINES: dict[str, Callable[[EstimationSettings], Engine]] = {"scipy": scipy_engine}

REFERENCE = "scipy"
"""The engine whose time is one in every ratio."""
