"""Windows that every engine and peer solves: those of one synthetic dive, as in the pipeline."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gliderhpc import Glider, load_platform
from gliderhpc.estimation.preparation import prepare_profile
from gliderhpc.estimation.priors import default_prior
from gliderhpc.estimation.profile import estimate_profile
from gliderhpc.estimation.resample import on_steps
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.estimation.window_plan import transform_scale
from gliderhpc.estimation.windows import WindowData, starting_disturbance
from gliderhpc.flight.glider import SENSED
from gliderhpc.observations import ProfileSeries
from gliderhpc.simulator import Scenario, simulate_profile

Array = NDArray[np.float64]

PLATFORM = "petrel-l"
SEED = 1
STEPS = 300


@dataclass(frozen=True, eq=False)
class Window:
    """One window and where its solution starts.

    Attributes
    ----------
    data : WindowData
        The problem.
    start : (n, 6) array
        Disturbance that the optimiser starts from, N and N m.
    """

    data: WindowData
    start: Array

    @property
    def unknown(self) -> Array:
        """The start in the optimiser's unknown ``x = b / s (6 n,)``."""
        return np.asarray((self.start / self.data.scale).ravel())


def settings_of(preset: str) -> EstimationSettings:
    """Give the default settings of a preset, but for the start: windows are compared without a smoother before them."""
    return EstimationSettings.model_validate({"preset": preset, "start": "prior"})


def twin_series(settings: EstimationSettings, depth: float = 200.0, seed: int = SEED) -> ProfileSeries:
    """Fly and record a synthetic dive of petrel-l to a depth (m), and put its record on the steps."""
    scenario = Scenario().replaced({"depth": depth})
    record, _ = simulate_profile(load_platform(PLATFORM), scenario, seed)
    return on_steps(record, settings)


def twin_windows(series: ProfileSeries, settings: EstimationSettings, count: int) -> list[Window]:
    """Give the first `count` whole windows of a dive, each from the state and disturbance that the pipeline had there.

    A window starts at a state of the stitched trajectory that no later window replaces, so that the finished estimate
    still holds it.
    """
    platform = load_platform(PLATFORM)
    glider = Glider(platform)
    estimate = estimate_profile(prepare_profile(glider, series), settings)
    bodies = estimate.profile.bodies
    starts = starting_disturbance(estimate.filtered, series, settings)
    scale = transform_scale(default_prior(platform), settings.window_length(series.sample_interval), settings)
    whole = [window for window in estimate.solution.windows if window.stop - window.start == STEPS]
    return [
        Window(
            WindowData(
                glider.hull,
                bodies[window.start : window.stop],
                estimate.solution.states[window.start][SENSED],
                series.measurements[window.start : window.stop + 1],
                series.weights[window.start : window.stop + 1],
                settings.step,
                scale,
            ),
            starts[window.start : window.stop],
        )
        for window in whole[:count]
    ]
