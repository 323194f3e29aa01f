"""Compare the lanes engine with the reference engine on a synthetic mission, window by window and against the truth.

Usage: ``python -m benchmarks.agreement [PROFILES]`` simulates, inverts with both engines and presets, and writes
``docs/engines.md``; ``python -m benchmarks.agreement LANES.zarr SCIPY.zarr TRUTH.nc`` prints the table of two archives.
"""

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr

from benchmarks.command_line import positional
from gliderhpc import load_platform, open_mission
from gliderhpc.archive.profile import done_profiles
from gliderhpc.findings.formatting import markdown
from gliderhpc.mission.executors import local_executor
from gliderhpc.mission.local_workers import default_workers
from gliderhpc.mission.planning import prepare_mission
from gliderhpc.mission.run import run_mission
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.observations import open_observations
from gliderhpc.observations.truth import truth_path
from gliderhpc.platform import Platform, with_overrides
from gliderhpc.report.accuracy import accuracy_table
from gliderhpc.simulator import Scenario, simulate_mission

PLATFORM = "petrel-l"
SEED = 11
PROFILES = 12
PRESETS = ("recommended", "paper")
ENGINES = ("lanes", "scipy")
NUDGES = (1e-13, -1e-13, 2e-13)
"""Relative changes of the hull's depth slope, each of which makes the same problem but for rounding."""
Window = tuple[int, int, int]


@dataclass(frozen=True)
class Agreement:
    """Two archives of one mission compared with each other.

    Attributes
    ----------
    windows : int
        Windows that either has.
    same_outcome : float
        Share of them that both have, over the same samples and with the same outcome.
    iterations : tuple of float
        Median iterations of a window, of each archive.
    rmse : dict
        Of each quantity (its unit with it) both archives' RMSE, medians over profiles: disturbances against the truth,
        tracking against the measurements, the current against the truth.
    """

    windows: int
    same_outcome: float
    iterations: tuple[float, float]
    rmse: dict[str, tuple[float, float]]


def windows_of(archive: xr.DataTree) -> dict[Window, tuple[int, int]]:
    """Outcome and iterations of every window, by its profile and its first and last sample."""
    found = {}
    for number in done_profiles(archive):
        table = archive["windows"].ds.sel(profile=number).load()
        for k in range(int(archive.to_dataset()["window_count"].sel(profile=number))):
            row = table.isel(window=k)
            key = (number, int(row["start"]), int(row["stop"]))
            found[key] = (int(row["outcome"]), int(row["iterations"]))
    return found


def agreement(first: xr.DataTree, second: xr.DataTree, truth: Path) -> Agreement:
    """Hold two archives of a synthetic mission against each other and its truth."""
    ours, theirs = windows_of(first), windows_of(second)
    same = [key for key in ours.keys() & theirs.keys() if ours[key][0] == theirs[key][0]]
    tables = (accuracy_table(archive, truth) for archive in (first, second))
    return Agreement(
        windows=len(ours.keys() | theirs.keys()),
        same_outcome=len(same) / len(ours.keys() | theirs.keys()),
        iterations=tuple(float(np.median([n for _, n in windows.values()])) for windows in (ours, theirs)),
        rmse={f"{a.label}, {a.unit}": (a.adjoint.rmse, b.adjoint.rmse) for a, b in zip(*tables, strict=True)},
    )


def table(found: Agreement, itself: Sequence[Agreement] = ()) -> str:
    """Lay an agreement out as a Markdown table, with the reference engine's departures from itself where known."""
    rows = []
    for name, (ours, theirs) in figures(found).items():
        ratios = [first / second for first, second in (figures(other)[name] for other in itself)]
        spread = [f"{min(ratios):.3f} to {max(ratios):.3f}"] if ratios else []
        rows.append([name, f"{ours:.4g}", f"{theirs:.4g}", f"{ours / theirs:.3f}", *spread])
    columns = ("quantity", *ENGINES, "ratio", *(["scipy nudged, ratio"] if itself else []))
    return markdown(columns, rows, columns[1:])


def figures(found: Agreement) -> dict[str, tuple[float, float]]:
    """Both archives' figures by name."""
    return {"iterations of a window, median": found.iterations, **found.rmse}


def section(title: str, found: Agreement, itself: Sequence[Agreement] = ()) -> list[str]:
    """Lay an agreement out under a heading."""
    text = f"{found.windows} windows; {found.same_outcome:.2%} of them cover the same samples with the same outcome"
    if itself:
        text += f" (nudged: {min(other.same_outcome for other in itself):.2%})"
    return [f"## {title}", "", text + ".", "", table(found, itself), ""]


def estimate(observations: Path, store: Path, preset: str, engine: str, platform: Platform) -> xr.DataTree:
    """Invert the whole mission into an archive, and open that."""
    settings = MissionSettings.model_validate({"preset": preset, "engine": engine})
    with open_observations(observations) as mission:
        prepared = prepare_mission(mission, platform, settings)
        run_mission(prepared, store, lambda: local_executor(default_workers()))
    return open_mission(store)


def nudged(platform: Platform, share: float) -> Platform:
    """The hull with its depth slope changed in the last decimals."""
    return with_overrides(platform, {"buoyancy.depth_slope": repr(platform.buoyancy.depth_slope * (1.0 + share))})


def page(profiles: int) -> list[str]:
    """Simulate, invert by every preset and engine, compare."""
    lines = [
        "# Two engines, one problem",
        "",
        "Does the choice of the engine change the results? This page compares the fast engine with the reference engine, and their",
        "difference with the effect of rounding.",
        "",
        f"Made by `python -m benchmarks.agreement {profiles}`: {profiles} dives of {PLATFORM} to 200 m, the simulator's default",
        f"scenario, seed {SEED}. The `lanes` engine (batched L-BFGS, the default) compared with the reference engine (`scipy`, L-BFGS-B).",
        "Values are RMSE, medians over profiles and steady glide as in [accuracy.md](accuracy.md): disturbances and current",
        "relative to the truth, roll, pitch, heading and depth relative to the measurements. The ratio is lanes over scipy.",
        "",
        f"The last column is the ratio of the reference engine's result for a problem changed by rounding ({len(NUDGES)} runs, the hull's",
        f"depth slope changed by at most {max(NUDGES):.0e} of itself) to its result for the unchanged problem. An optimiser that is stopped",
        "early leaves components that the records hardly determine (surge, heave and pitch moment without the transform of preset",
        "`recommended`) where its path ended, and rounding makes paths diverge: two engines cannot agree better than one with itself.",
        "",
    ]
    platform = load_platform(PLATFORM)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "twin.nc"
        simulate_mission(platform, path, scenario=Scenario().replaced({"profiles": profiles}), seed=SEED)
        truth = truth_path(path)
        for preset in PRESETS:
            runs = [(engine, platform) for engine in ENGINES] + [("scipy", nudged(platform, share)) for share in NUDGES]
            lanes, reference, *others = (
                estimate(path, Path(folder) / f"{preset}-{number}.zarr", preset, *run)
                for number, run in enumerate(runs)
            )
            itself = [agreement(other, reference, truth) for other in others]
            lines += section(f"Preset `{preset}`", agreement(lanes, reference, truth), itself)
    return lines[:-1]


def main(arguments: list[str]) -> None:
    """Compare two archives that are given, or make the page."""
    if len(arguments) == 3:
        first, second, truth = map(Path, arguments)
        found = agreement(open_mission(first), open_mission(second), truth)
        print("\n".join(section(f"{first.name} and {second.name}", found)))
        return
    lines = page(int(arguments[0]) if arguments else PROFILES)
    written = Path(__file__).resolve().parents[1] / "docs" / "engines.md"
    written.write_text("\n".join(lines) + "\n", "utf-8")
    print("\n".join(lines))


if __name__ == "__main__":
    main(positional(__doc__, arguments={"nargs": "*"}).arguments)
