"""Import and invert the SeaExplorer missions M010 and M012, and write ``docs/real-missions.md`` from the archives.

Usage: ``python benchmarks/real_missions.py DATA_FOLDER [WORK_FOLDER]``, where DATA_FOLDER holds
``seaexplorer-sea035-M010`` and ``seaexplorer-sea035-M012``. The hull is uncalibrated: sizes, not accuracy.
"""

import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import xarray as xr

from gliderhpc import load_platform, open_mission
from gliderhpc.mission.executors import default_workers, local_executor
from gliderhpc.mission.run import run_mission
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.observations import open_observations
from gliderhpc.observations.seaexplorer import import_seaexplorer

MISSIONS: Mapping[str, dict[str, str]] = {
    "M010": {},
    "M012": {"buoyancy.neutral_volume": "-215"},
}
VIBRATION = 1


def invert(name: str, data: Path, work: Path) -> xr.DataTree:
    """Import one mission and run it with default settings; its archive."""
    path, store = work / f"{name}.nc", work / f"{name}.zarr"
    import_seaexplorer([data / f"seaexplorer-sea035-{name}"], path)
    platform = load_platform("seaexplorer", MISSIONS[name])
    with open_observations(path) as observations:
        numbers = tuple(observations.profile_numbers)
        run_mission(
            observations, platform, MissionSettings(), numbers, store, lambda: local_executor(default_workers()),
            overwrite=True,
        )  # fmt: skip
    return open_mission(store)


def spread(values: np.ndarray, form: str = ".3f") -> str:
    """Median and the range from the 10th to the 90th percentile."""
    low, middle, high = np.nanpercentile(values, [10, 50, 90])
    return f"{middle:{form}} ({low:{form}} to {high:{form}})"


def steady(tree: xr.DataTree, name: str, numbers: np.ndarray) -> np.ndarray:
    """A quantity of the reconstructed motion over the steady-glide records, one array for all profiles."""
    parts = []
    every = round(tree.attrs["output_interval"] / tree.attrs["step"])
    for number in numbers:
        state = tree["state"].ds[["u", "v", "w"]].sel(profile=number).load()
        shaken = tree["series"].ds.quality.sel(profile=number).to_numpy()[::every] & VIBRATION > 0
        speed = np.sqrt(state.u**2 + state.v**2 + state.w**2)
        value = speed if name == "speed" else np.degrees(np.arctan2(state.w, state.u))
        parts.append(value.to_numpy()[~shaken[: value.size] & np.isfinite(value.to_numpy())])
    return np.concatenate(parts)


def rows(tree: xr.DataTree) -> list[tuple[str, str]]:
    """What is reported of one mission."""
    table = tree.ds.load()
    done = (table.status == "done").to_numpy()
    numbers = table.profile.to_numpy()[done]
    chosen = table.isel(profile=done)
    failed = {int(n): str(table.message.sel(profile=n).item()) for n in table.profile.to_numpy()[~done]}
    size = np.hypot(chosen.dac_north, chosen.dac_east).to_numpy()
    conventional = np.hypot(chosen.dac_north_glide_angle, chosen.dac_east_glide_angle).to_numpy()
    difference = np.hypot(
        chosen.dac_north - chosen.dac_north_glide_angle, chosen.dac_east - chosen.dac_east_glide_angle
    ).to_numpy()
    attack, speed = steady(tree, "attack", numbers), steady(tree, "speed", numbers)
    windows = chosen.window_count.to_numpy()
    implausible = [int(n) for n in numbers if "implausible" in str(table.message.sel(profile=n).item())]
    return [
        ("profiles done of those found", f"{done.sum()} of {done.size}"),
        ("not inverted, and why", "; ".join(failed.values()) or "none"),
        ("windows converged", f"{np.average(chosen.converged_fraction, weights=windows):.1%} of {windows.sum()}"),
        ("iterations a window, median (p10 to p90 over profiles)", spread(chosen.iterations_median.to_numpy(), ".0f")),
        ("filter: samples gated, inflated, reset", " ".join(
            str(int(chosen[f"{what}_count"].sum())) for what in ("gated", "inflated", "reset"))),
        ("vibration set, share of the time", spread(chosen.vibration_fraction.to_numpy())),
        ("speed through water in steady glide, m/s", spread(speed)),
        ("angle of attack in steady glide, degree", spread(attack, ".1f")),
        ("share of steady glide with |angle of attack| within 10 degrees", f"{np.mean(np.abs(attack) <= 10.0):.1%}"),
        ("profiles whose message calls the self-motion implausible", ", ".join(map(str, implausible)) or "none"),
        ("depth-averaged current, m/s", f"{spread(size)}, {np.isfinite(size).sum()} profiles"),
        ("the same by the glide angle, m/s", spread(conventional)),
        ("difference of the two (vector), m/s", spread(difference)),
        ("surface drift where fixes allow, m/s", spread(
            np.hypot(chosen.surface_drift_north, chosen.surface_drift_east).to_numpy())),
    ]  # fmt: skip


def main(data: Path, work: Path) -> None:
    """Run both missions and write the page."""
    tables = {}
    for name in MISSIONS:
        tables[name] = rows(invert(name, data, work))
    lines = [
        "# Two real missions",
        "",
        "SeaExplorer SEA035 off British Columbia, sampled every 20 s, with the shipped, uncalibrated `seaexplorer` hull"
        " (M012 with `platform.buoyancy.neutral_volume=-215`), default settings. No truth exists for these: the table",
        "shows sizes and spread (median, 10th to 90th percentile), not accuracy.",
        "Made by `python benchmarks/real_missions.py DATA_FOLDER`.",
        "",
        "| | " + " | ".join(MISSIONS) + " |",
        "| --- |" + " --- |" * len(MISSIONS),
    ]
    for index, (what, _) in enumerate(tables["M010"]):
        lines.append(f"| {what} | " + " | ".join(table[index][1] for table in tables.values()) + " |")
    page = Path(__file__).resolve().parents[1] / "docs" / "real-missions.md"
    page.write_text("\n".join(lines) + "\n", "utf-8")
    print("\n".join(lines))


if __name__ == "__main__":
    if len(sys.argv) > 2:
        main(Path(sys.argv[1]), Path(sys.argv[2]))
    else:
        with tempfile.TemporaryDirectory() as folder:
            main(Path(sys.argv[1]), Path(folder))
