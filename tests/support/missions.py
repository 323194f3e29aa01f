"""Missions for end-to-end tests: simulated, processed by the library or the program, changed, and compared."""

import contextlib
import io
import json
import subprocess
import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import xarray as xr

from gliderhpc.cli import main
from gliderhpc.estimation.preparation import controls_of
from gliderhpc.estimation.resample import on_steps
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.flight.glider import Glider, load_platform
from gliderhpc.mission.executors import local_executor
from gliderhpc.mission.planning import prepare_mission
from gliderhpc.mission.run import MissionResult, run_mission
from gliderhpc.mission.settings import build_settings
from gliderhpc.observations import ProfileSeries, open_observations
from gliderhpc.platform import Platform
from gliderhpc.simulator import read_scenario

CHANNELS = ("B_cu", "B_cv", "B_cw", "B_cp", "B_cq", "B_cr")
SETTLING = 60.0
"""Time from the filter's first sample until its prior is informative (s)."""

WHOLE = ("--platform", "petrel-l", "--workers", 0)
"""Options of a run in this process."""

BRIEF = read_scenario({"name": "brief", "profiles": 3, "depth": 40.0, "steering": {"interval": 120.0}})
"""Three profiles of about nine minutes."""

SWIFT = read_scenario({"name": "swift", "profiles": 3, "depth": 15.0, "steering": {"interval": 120.0}})
"""Three profiles of about three minutes."""

DIPS = SWIFT.replaced({"name": "dips", "profiles": 10})
"""Many profiles of about three minutes."""

TIMED = ("run_seconds", "marker")
"""Parts of an archive that record how long a run took: a variable, and the markers that repeat it."""


@dataclass(frozen=True)
class Answer:
    """Result of a run of the program: its exit status, and what it printed."""

    status: int
    out: str
    err: str

    @property
    def line(self) -> str:
        """The one line of a refusal."""
        assert self.err.count("\n") == 1, self.err
        return self.err.strip()


def program(*arguments: object) -> Answer:
    """Run the program in this process."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            main([str(argument) for argument in arguments])
        except SystemExit as end:
            status = end.code
    return Answer(status, out.getvalue(), err.getvalue())


def program_apart(*arguments: object) -> Answer:
    """Run the program in a separate process, as worker processes need it."""
    code = "import sys; from gliderhpc.cli import main; main(sys.argv[1:])"
    done = subprocess.run(
        [sys.executable, "-c", code, *map(str, arguments)], capture_output=True, text=True, timeout=300, check=False
    )
    return Answer(done.returncode, done.stdout, done.stderr)


def with_xarray_alone(code: str, *arguments: object) -> object:
    """Run code that cannot import gliderhpc in another process; its output is JSON."""
    done = subprocess.run(
        [sys.executable, "-c", f"import sys; sys.modules['gliderhpc'] = None\n{code}", *map(str, arguments)],
        capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def estimate(
    observations: Path, store: Path, preset: str, assignments: dict[str, str] | None = None, platform: str = "petrel-l"
) -> MissionResult:
    """Estimate a whole mission through the library, in this process."""
    settings = build_settings({"preset": preset}, assignments or {})
    with open_observations(observations) as opened:
        prepared = prepare_mission(opened, load_platform(platform), settings)
        return run_mission(prepared, store, lambda: local_executor(0))


def profile_series(observations: Path, number: int, settings: EstimationSettings) -> ProfileSeries:
    """One profile's record on the integration step, as its estimate sees it."""
    with open_observations(observations) as opened:
        return on_steps(opened.profile(number), settings)


def glide_series(
    platform: Platform, state: np.ndarray, controls: np.ndarray, step: float = 0.1, sample_interval: float = 1.0
) -> tuple[ProfileSeries, np.ndarray]:
    """Record of a glider flown without disturbance or sensor errors, and its true states.

    ``controls (n, 4)`` are raw: battery position, battery rotation, ballast volume, rudder.
    """
    n = len(controls)
    every = round(sample_interval / step)
    blank = ProfileSeries(
        1, np.datetime64("2024-01-01", "ns"), step, step * np.arange(n + 1), np.zeros((n + 1, 4)), np.ones(n + 1),
        controls, sample_interval, 0.0, np.arange(0, n + 1, every),
    )  # fmt: skip
    states = Glider(platform).simulate(state, controls_of(platform, blank), np.zeros((n, 6)), step)
    return replaced(blank, measurements=states[:, [0, 1, 2, 5]].copy()), states


def replaced(series: ProfileSeries, **values: object) -> ProfileSeries:
    """Give a series with some of its fields replaced."""
    return replace(series, **values)


def changed_observations(source: Path, out: Path, change: Callable[[xr.Dataset], xr.Dataset | None]) -> Path:
    """Copy an observation file after a change to its variables, times as stored."""
    with xr.open_dataset(source, decode_times=False) as dataset:
        content = dataset.load()
    # The simulator appends to growing dimensions; a change may take such a dimension away.
    content.encoding.pop("unlimited_dims", None)
    content = change(content) or content
    content.to_netcdf(out)
    return out


def samples_of(content: xr.Dataset, number: int) -> np.ndarray:
    """Samples of one profile."""
    return np.flatnonzero(content["profile"].values == number)


def archive_bytes(store: Path, leave_out: Iterable[str] = TIMED) -> dict[str, bytes]:
    """Every file of an archive, but for the variables or groups named."""
    return {
        path.relative_to(store).as_posix(): path.read_bytes()
        for path in sorted(store.rglob("*"))
        if path.is_file() and not set(path.relative_to(store).parts) & set(leave_out)
    }
