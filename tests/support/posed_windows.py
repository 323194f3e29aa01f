"""Window problems of steady glides, for the tests of the engines."""

from functools import cache

import numpy as np

from gliderhpc.estimation.filter import FilterEstimate
from gliderhpc.estimation.lanes import LaneBatch, Run
from gliderhpc.estimation.preparation import PreparedProfile
from gliderhpc.estimation.priors import default_prior
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.estimation.window_plan import WindowPlan
from gliderhpc.estimation.windows import ProfileProblem, WindowData, WindowSolution, WindowTask
from gliderhpc.flight.glider import SENSED, Glider
from gliderhpc.flight.steady_glide import SteadyGlide, steady_glide
from gliderhpc.kernels.quasi_newton import run_until_done
from gliderhpc.observations import ProfileSeries
from gliderhpc.platform import Platform, read_platform

Array = np.ndarray

PETREL = read_platform("petrel-l")
STEP = 0.1
SCALE = np.array([0.05, 0.05, 0.05, 0.05, 0.02, 1.0])
"""Of the control-variable transform (docs/theory/estimate.md)."""
_ERRORS = np.array([5e-4, 5e-4, 5e-4, 0.03])


@cache
def _glide(name: str) -> SteadyGlide:
    return glide_of(read_platform(name))


def glide_of(platform: Platform) -> SteadyGlide:
    """The dive of a hull at 23 degrees and 100 m, 0.4 kg heavy."""
    return steady_glide(Glider(platform), 0.4, np.radians(-23.0), 100.0)


def window_data(
    steps: int = 300,
    *,
    disturbance: Array | None = None,
    scale: Array | None = None,
    noise: float = 1.0,
    seed: int = 0,
    hull: str = "petrel-l",
) -> WindowData:
    """Pose a window of a steady dive that was flown under a disturbance and measured with errors."""
    glider, dive = Glider(read_platform(hull)), _glide(hull)
    controls = np.tile(dive.control, (steps, 1))
    truth = np.zeros((steps, 6)) if disturbance is None else disturbance
    states = glider.simulate(dive.state, controls, truth, STEP)
    errors = np.random.default_rng(seed).normal(size=(steps + 1, 4)) * _ERRORS
    return WindowData(
        glider.hull, glider.bodies(controls), dive.state[SENSED], states[:, [0, 1, 2, 5]] + noise * errors,
        np.ones(steps + 1), STEP, SCALE if scale is None else scale,
    )  # fmt: skip


def posed_dive(
    glider: Glider,
    controls: Array,
    measured: Array,
    weights: Array,
    states: Array,
    *,
    fallback: float,
    start: Array,
    plan: WindowPlan,
    vibrating: Array | None = None,
) -> ProfileProblem:
    """Pose a dive under model controls, from a filter with given states and a constant disturbance."""
    rows = len(measured)
    series = ProfileSeries(
        1, np.datetime64("2024-01-01", "ns"), STEP, STEP * np.arange(rows), measured, weights, np.zeros((rows - 1, 4)),
        1.0, 0.0, np.arange(0, rows, 10),
    )  # fmt: skip
    unfed = np.zeros((0, 4))
    filtered = FilterEstimate(
        states, np.full((rows, 6), fallback), 0, 0, 0, 0, np.zeros(rows, np.uint8), unfed, unfed, "usual",
        default_prior(glider.platform),
    )  # fmt: skip
    vibrating = np.zeros(rows, dtype=bool) if vibrating is None else vibrating
    return ProfileProblem(PreparedProfile(glider, series, glider.bodies(controls), vibrating), filtered, start, plan)


def impulse(steps: int = 300) -> Array:
    """A yaw moment of 2 N m that comes and goes within seconds, twelve seconds after the start."""
    disturbance = np.zeros((steps, 6))
    disturbance[:, 5] = 2.0 * np.exp(-0.5 * ((np.arange(steps) - 120) * STEP / 1.8) ** 2)
    return disturbance


def at_rest(data: WindowData) -> Array:
    """The disturbance that every test starts from: none."""
    return np.zeros((len(data.bodies), 6))


def solve_together(
    tasks: list[WindowTask], settings: EstimationSettings, run: Run = run_until_done
) -> list[WindowSolution]:
    """Solutions of windows put side by side, in their order."""
    batch, solutions = LaneBatch(settings, run), {}
    for lane, task in enumerate(tasks):
        batch.load(lane, task)
    while len(solutions) < len(tasks):
        solutions.update(batch.run())
    return [solutions[lane] for lane in range(len(tasks))]
