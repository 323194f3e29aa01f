"""Compilation of the kernels before workers start.

Compiling takes about half a minute of processor time, once for each version and machine. If there is a second core,
another process compiles the smoother's kernels at the same time; both store them in the same cache.

    python -m gliderhpc.mission.warm PART ...
"""

import logging
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from gliderhpc.estimation.filter import FilterEstimate
from gliderhpc.estimation.preparation import PreparedProfile, prepare_profile
from gliderhpc.estimation.priors import candidate_priors
from gliderhpc.estimation.profile import estimate_profiles, smooth_profile
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.flight.glider import SENSED, Glider
from gliderhpc.kernels.cache import VARIABLES, compiled_cache
from gliderhpc.kernels.jacobian import ENTRIES
from gliderhpc.kernels.jit import is_uncompiled
from gliderhpc.kernels.points import rates_and_partials, viscous_yaw_moments
from gliderhpc.kernels.precompiled import precompiled_kernels
from gliderhpc.mission.local_workers import default_workers
from gliderhpc.observations import ProfileSeries
from gliderhpc.platform import read_platform
from gliderhpc.simulator import read_scenario, simulate_profile

log = logging.getLogger(__name__)


def warm_simulator() -> None:
    """Compile the simulator's kernels, or load them from the cache, by simulating a dip of 15 m."""
    simulate_profile(read_platform("petrel-l"), read_scenario({"depth": 15.0}), 0)


def warm_kernels(engine: str = "lanes") -> None:
    """Compile every kernel of the estimation, or load it from the cache, by inverting a record of four seconds.

    Raises
    ------
    InputError
        The engine cannot run on this machine.
    """
    record, settings = _short_record(), _short_settings(engine)
    if not is_compiled():
        from_prior = settings.model_copy(update={"start": "prior"})
        with compile_in_background("smoother"):
            # Two records, since the windows of a single one would be solved without lanes.
            list(estimate_profiles([(None, record), (None, record)], from_prior))
    list(estimate_profiles([(None, record)], settings, with_hull=True))


def warm_single_window() -> None:
    """Compile the kernels for a single window, which a run compiles only when it first needs them."""
    from_prior = _short_settings("lanes").model_copy(update={"start": "prior"})
    list(estimate_profiles([(None, _short_record())], from_prior))


def warm_points() -> None:
    """Compile the kernels of the model at single points, which `Glider`, calibration and studies use."""
    glider = Glider(read_platform("petrel-l"))
    motion, control = np.array([[0.3, 0.0, 0.01, 0.0, 0.0, 0.0]]), np.array([0.0, 0.0, 400e-6, 0.0])
    state, bodies = np.concatenate([np.zeros(6), motion[0]]), glider.bodies(control[None])
    glider.rhs(state, control, np.zeros(6))
    glider.jacobian(state, control)
    glider.simulate(state, control[None], np.zeros((1, 6)), 0.1)
    rates_and_partials(glider.hull, bodies, state[None, SENSED], np.empty((1, 10)), np.empty((1, ENTRIES)))
    viscous_yaw_moments(glider.hull, motion, np.zeros(1), np.empty(1))


def warm_everything() -> None:
    """Compile every kernel that the program calls, for a wheel or a cluster's folder."""
    warm_simulator()
    for engine in ("lanes", "scipy"):
        warm_kernels(engine)
    warm_single_window()
    warm_points()


def warm_smoother() -> None:
    """Compile the smoother's kernels by smoothing a record of four seconds about an artificial trajectory."""
    record = _short_record()
    smooth_profile(record, _artificial_trajectory(record), _short_settings("lanes"))


def is_compiled() -> bool:
    """Return whether the kernels need not be compiled: they are in the cache, or were compiled beforehand.

    Only the smoother's are checked, since they come last. Any that are missing are compiled when they are called.
    """
    if is_uncompiled() or precompiled_kernels()[0] is not None:
        return True
    return any(compiled_cache().glob("smoother.forward*.nbi"))


@contextmanager
def compile_in_background(part: str) -> Iterator[None]:
    """Compile one of `PARTS` in another process while the block runs; the block's end waits for it.

    Nothing is started if all kernels are compiled, or if there is only one core. If that process fails, its kernels are
    compiled when they are called.
    """
    if is_compiled() or default_workers() < 2 or not sys.executable:
        yield
        return
    # -P excludes modules in the working folder.
    command = [sys.executable, "-P", "-m", "gliderhpc.mission.warm", part]
    environment, null = {**os.environ, VARIABLES[0]: str(compiled_cache().parent)}, subprocess.DEVNULL
    process = subprocess.Popen(command, env=environment, stdin=null, stdout=null, stderr=null)
    try:
        yield
        if process.wait() != 0:
            log.debug("%s ended with status %d: compiling here", " ".join(command), process.returncode)
    finally:
        process.terminate()
        process.wait()


def _short_settings(engine: str) -> EstimationSettings:
    values = {"engine": engine, "window": {"length": 4.0}, "filter": {"max_rejected_fraction": 1.0}}
    return EstimationSettings.model_validate(values)


def _short_record() -> PreparedProfile:
    """Return an artificial record of four seconds."""
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
    return prepare_profile(Glider(read_platform("petrel-l")), series)


def _artificial_trajectory(record: PreparedProfile) -> FilterEstimate:
    """Return an artificial trajectory through the measurements at 0.3 m/s, in the form of the filter's result."""
    rows = len(record.series.time)
    states, no_innovations = np.zeros((rows, 12)), np.zeros((0, 4))
    states[:, [0, 1, 2, 5]], states[:, 6] = record.series.measurements, 0.3
    name, prior = next(iter(candidate_priors(record.glider.platform).items()))
    return FilterEstimate(
        states=states,
        disturbances=np.zeros((rows, 6)),
        gated=0,
        inflated=0,
        reset=0,
        fed=len(record.series.sample_index),
        events=np.zeros(rows, np.uint8),
        innovations=no_innovations,
        innovation_variances=no_innovations,
        prior_name=name,
        prior=prior,
    )


PARTS = {"simulator": warm_simulator, "kernels": warm_kernels, "smoother": warm_smoother}
"""Parts that this module can compile when run as a program."""

if __name__ == "__main__":
    for _part in sys.argv[1:]:
        PARTS[_part]()
