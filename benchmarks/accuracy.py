"""Both presets and the filter compared with the truth of a synthetic mission; writes ``docs/accuracy.md``.

Usage: ``python -m benchmarks.accuracy [PROFILES]``. The simulator integrates at half the estimator's step, its actuators
lag the commands that are recorded, and the estimator never sees the truth file.
"""

import tempfile
from pathlib import Path

import numpy as np

from benchmarks.command_line import positional
from benchmarks.sections import section_of, with_section
from benchmarks.series_intervals import PAGE, SECTION
from gliderhpc import Glider, load_platform, open_mission
from gliderhpc.estimation.preparation import controls_of, prepare_profile
from gliderhpc.estimation.profile import ProfileEstimate, estimate_profile
from gliderhpc.estimation.quality import SEGMENT, first_stretch
from gliderhpc.estimation.resample import on_steps
from gliderhpc.estimation.windows import misfit
from gliderhpc.findings.formatting import markdown
from gliderhpc.mission.executors import local_executor
from gliderhpc.mission.local_workers import default_workers
from gliderhpc.mission.planning import prepare_mission
from gliderhpc.mission.run import run_mission
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.observations import open_observations
from gliderhpc.observations.truth import truth_path
from gliderhpc.report.accuracy import COLUMNS, accuracy_table, cells_of
from gliderhpc.simulator import Scenario, simulate_mission

PLATFORM = "petrel-l"
SEED = 7
PROFILES = 12
PRESETS = ("recommended", "paper")


def open_loop(path: Path) -> list[str]:
    """Markdown of Table 2's lower block: open-loop residual over a steady segment, medians over profiles."""
    glider = Glider(load_platform(PLATFORM))
    figures: dict[str, list[np.ndarray]] = {}
    with open_observations(path) as observations:
        records = [observations.profile(number) for number in observations.profile_numbers]
    for preset in PRESETS:
        settings = MissionSettings.model_validate({"preset": preset})
        for record in records:
            estimate = estimate_profile(prepare_profile(glider, on_steps(record, settings)), settings)
            segment = steady_segment(estimate)
            if segment is None:
                continue
            start = estimate.solution.states[segment[0]]
            disturbances = {
                f"adjoint, {preset}": estimate.solution.disturbances,
                "filter": estimate.filtered.disturbances[:-1],
            }
            for name, disturbance in disturbances.items():
                rmse = open_loop_rmse(glider, estimate, disturbance, start, *segment)
                figures.setdefault(name, []).append(np.r_[np.degrees(rmse[:3]), rmse[3]])
    lines = ["| | roll, degree | pitch, degree | heading, degree | depth, m |", "| --- | --- | --- | --- | --- |"]
    for name, values in sorted(figures.items()):
        lines.append(f"| {name} | " + " | ".join(f"{value:.3f}" for value in np.median(values, axis=0)) + " |")
    return lines


def steady_segment(estimate: ProfileEstimate, length: float = SEGMENT, after: float = 60.0) -> tuple[int, int] | None:
    """First stretch ``(begin, end)`` in samples of that length (s) free of vibration and gaps, or None.

    The first seconds of the record, `after` of them, are left out: the filter has yet to settle.
    """
    series = estimate.series
    steps = round(length / series.step)
    usable = ~estimate.vibrating & (series.weights > 0.0)
    usable[: round(after / series.step)] = False
    return first_stretch(usable, steps)


def open_loop_rmse(
    glider: Glider, estimate: ProfileEstimate, disturbances: np.ndarray, state0: np.ndarray, begin: int, end: int
) -> np.ndarray:
    """RMSE ``(4,)`` in roll, pitch, heading (rad) and depth (m) of one forward run under a disturbance, no feedback.

    Parameters
    ----------
    disturbances : (n, 6)
        Whole profile, N and N m.
    state0 : (12,)
        State at sample `begin`.
    begin, end : int
        Samples of the segment.
    """
    series = estimate.series
    controls = controls_of(glider.platform, series)[begin:end]
    flown = glider.simulate(state0, controls, disturbances[begin:end], series.step)[1:]
    residual = misfit(flown, series.measurements[begin + 1 : end + 1])
    return np.asarray(np.sqrt(np.mean(residual**2, axis=0)))


def main(profiles: int) -> None:
    """Simulate, invert with both presets, and write the page."""
    platform = load_platform(PLATFORM)
    lines = [
        "# Accuracy on a synthetic mission",
        "",
        "How accurate are disturbances, motion and currents if the hull is known exactly? This page compares the estimates of a",
        "simulated mission with its truth, for both presets. It gives the smallest errors to expect, since on a",
        "real glider those of the hull are added.",
        "",
        f"Made by `python -m benchmarks.accuracy {profiles}`: {profiles} dives of {PLATFORM} to 200 m (about 42 minutes),",
        f"seed {SEED}, 1 Hz, attitude quantised to 0.1 degree, depth noise 0.03 m. Truth: slow longitudinal disturbances,",
        "yaw impulses of 0.6 to 3 N m and 1.2 to 2.5 s (standard deviation of a Gaussian pulse), one in 90 s on average.",
        "Medians over profiles, over steady-glide samples (outside the vibration set, first minute excluded). Roll, pitch,",
        "heading and depth: difference of the reconstruction from the measurements.",
        "",
    ]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "twin.nc"
        simulate_mission(platform, path, scenario=Scenario().replaced({"profiles": profiles}), seed=SEED)
        for preset in PRESETS:
            store = Path(folder) / f"{preset}.zarr"
            with open_observations(path) as observations:
                prepared = prepare_mission(observations, platform, MissionSettings.model_validate({"preset": preset}))
                run_mission(prepared, store, lambda: local_executor(default_workers()))
            lines += [
                f"## Preset `{preset}`",
                "",
                markdown(COLUMNS, map(cells_of, accuracy_table(open_mission(store), truth_path(path))), COLUMNS[2:]),
                "",
            ]
        lines += [
            "## Open loop",
            "",
            f"One forward run over {SEGMENT:.0f} s of steady glide under the identified disturbance, no feedback, from the",
            "adjoint's state: difference from the measurements, the lower block of the paper's Table 2 (its figures: adjoint",
            "0.057, 0.280, 0.097 degree, 0.014 m; EKF 0.078, 1.015, 3.340 degree, 2.985 m).",
            "",
            *open_loop(path),
        ]
    intervals = section_of(PAGE.read_text("utf-8"), SECTION)
    text = "\n".join([*lines, "", f"<!-- {SECTION} --><!-- /{SECTION} -->", ""])
    PAGE.write_text(with_section(text, SECTION, intervals), "utf-8")
    print("\n".join(lines))


if __name__ == "__main__":
    main(positional(__doc__, profiles={"type": int, "nargs": "?", "default": PROFILES}).profiles)
