"""Compilation of the kernels before workers start."""

import numpy as np

from gliderhpc.estimation.preparation import prepare_profile
from gliderhpc.estimation.profile import estimate_profiles
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.flight.glider import Glider
from gliderhpc.observations import ProfileSeries
from gliderhpc.platform import read_platform
from gliderhpc.simulator import read_scenario, simulate_profile


def warm_simulator() -> None:
    """Compile the simulator's kernels, or load them from the cache, by simulating a dip of 15 m."""
    simulate_profile(read_platform("petrel-l"), read_scenario({"depth": 15.0}), 0)


def warm_kernels(engine: str = "lanes") -> None:
    """Compile every kernel of the estimation, or load it from the cache, by inverting a record of four seconds.

    Raises
    ------
    InputError
        The engine cannot run here.
    """
    platform = read_platform("petrel-l")
    steps = 40
    time = np.linspace(0.0, 0.1 * steps, steps + 1)
    measurements = np.column_stack([0 * time, np.full_like(time, -0.4), 0 * time, 10.0 + 0.15 * time])
    controls = np.tile([0.0, 0.0, 400e-6, 0.0], (steps, 1))
    series = ProfileSeries(
        number=0,
        epoch=np.datetime64("2000-01-01"),
        step=0.1,
        time=time,
        measurements=measurements,
        weights=np.ones(steps + 1),
        controls=controls,
        sample_interval=1.0,
        gap_seconds=0.0,
        sample_index=np.arange(0, steps + 1, 10),
    )
    settings = EstimationSettings.model_validate(
        {"engine": engine, "window": {"length": 4.0}, "filter": {"max_rejected_fraction": 1.0}}
    )
    list(estimate_profiles([(None, prepare_profile(Glider(platform), series))], settings, smooth=True))
