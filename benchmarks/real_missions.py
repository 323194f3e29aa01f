"""Import and invert real missions of three gliders, and write ``docs/real-missions.md`` from the archives.

Usage: ``python benchmarks/real_missions.py DATA_FOLDER [WORK_FOLDER]``, where DATA_FOLDER holds
``seaexplorer-sea035-M010``, ``seaexplorer-sea035-M012`` and ``slocum-modena-2015``. The hulls are uncalibrated: sizes,
not accuracy.
"""

import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import xarray as xr

from gliderhpc import load_platform, open_mission
from gliderhpc.mission.executors import default_workers, local_executor
from gliderhpc.mission.run import run_mission
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.observations import open_observations
from gliderhpc.observations.seaexplorer import ImportSummary as SeaExplorerImport
from gliderhpc.observations.seaexplorer import import_seaexplorer
from gliderhpc.observations.slocum import ImportSummary as SlocumImport
from gliderhpc.observations.slocum import import_slocum

Summary = SeaExplorerImport | SlocumImport


@dataclass(frozen=True)
class Mission:
    """A mission of a real glider, and how it is inverted.

    Attributes
    ----------
    folder : str
        Where its records lie in the data folder.
    importer : callable
        Turns sources into an observation file.
    platform : str
        The shipped hull.
    overrides : mapping
        Values of the hull that are replaced.
    every : int
        Of how many complete profiles one is inverted.
    """

    folder: str
    importer: Callable[[list[Path], Path], Summary]
    platform: str
    overrides: Mapping[str, str] = field(default_factory=dict)
    every: int = 1


MISSIONS: Mapping[str, Mission] = {
    "M010": Mission("seaexplorer-sea035-M010", import_seaexplorer, "seaexplorer"),
    "M012": Mission("seaexplorer-sea035-M012", import_seaexplorer, "seaexplorer", {"buoyancy.neutral_volume": "-215"}),
    "modena": Mission("slocum-modena-2015", import_slocum, "slocum", every=6),
}
VIBRATION = 1
NATIVE = "modena-2015-native-days0-20.nc"
REPORTED_WITHIN = np.timedelta64(20, "m")
"""The glider reports the current of a dive as long after it, at most."""


def invert(mission: Mission, name: str, data: Path, work: Path) -> tuple[Summary, xr.DataTree]:
    """Import one mission and run it with default settings; what the import said, and the archive."""
    path, store = work / f"{name}.nc", work / f"{name}.zarr"
    summary = mission.importer([data / mission.folder], path)
    platform = load_platform(mission.platform, mission.overrides)
    with open_observations(path) as observations:
        numbers = observations.profile_numbers
        if mission.every > 1:
            numbers = [number for number in numbers if number not in observations.faults][:: mission.every]
        run_mission(
            observations, platform, MissionSettings(), tuple(numbers), store, lambda: local_executor(default_workers()),
            overwrite=True,
        )  # fmt: skip
    return summary, open_mission(store)


def imported(summary: Summary) -> list[tuple[str, str]]:
    """What the import found."""
    faults = Counter(profile.fault.partition(": ")[2] for profile in summary.profiles if profile.fault)
    reasons = Counter(reason.partition(",")[0].partition(" in all")[0] for reason in faults.elements())
    depths = np.array([profile.max_depth for profile in summary.complete])
    minutes = np.array([profile.duration / 60.0 for profile in summary.complete])
    return [
        ("profiles found, complete", f"{len(summary.profiles)}, {len(summary.complete)}"),
        ("rejected, and why", "; ".join(f"{count}: {reason}" for reason, count in reasons.items()) or "none"),
        ("sampling interval, s", f"{summary.sample_interval:.2f}"),
        ("rows, with CTD", f"{summary.rows}, {summary.ctd_samples}"),
        ("GPS fixes, left out as implausible", f"{summary.fixes}, {summary.fixes_dropped}"),
        ("greatest depth of a profile, m", spread(depths, ".0f")),
        ("duration of a profile, minutes", spread(minutes, ".0f")),
    ]


def own_current(data: Path, tree: xr.DataTree) -> str:
    """Vector difference to the current that the Slocum's own dead reckoning gives for the same dives, m/s."""
    with xr.open_dataset(data / NATIVE) as native:
        own = native[["m_present_time", "m_final_water_vx", "m_final_water_vy"]].load()
    said = np.isfinite(own.m_final_water_vx.values)
    time, east, north = (own[name].values[said] for name in own.data_vars)
    table = tree.ds.load()
    start = table.start_time.to_numpy()
    end = start + (table.duration.to_numpy() * 1e9).astype("timedelta64[ns]")
    nearest = np.minimum(np.searchsorted(time, end), len(time) - 1)
    matched = (time[nearest] >= end) & (time[nearest] - end <= REPORTED_WITHIN)
    difference = np.hypot(table.dac_north.to_numpy() - north[nearest], table.dac_east.to_numpy() - east[nearest])[
        matched
    ]
    return f"{spread(difference)}, {np.isfinite(difference).sum()} profiles"


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


def numbered(numbers: list[int], most: int = 12) -> str:
    """Numbers of profiles, or how many there are where they are too many to name."""
    return ", ".join(map(str, numbers)) or "none" if len(numbers) <= most else f"{len(numbers)} of them"


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
        ("profiles done of those taken", f"{done.sum()} of {done.size}"),
        ("not inverted, and why", "; ".join(failed.values()) or "none"),
        ("windows converged", f"{np.average(chosen.converged_fraction, weights=windows):.1%} of {windows.sum()}"),
        ("iterations a window, median (p10 to p90 over profiles)", spread(chosen.iterations_median.to_numpy(), ".0f")),
        ("filter: samples gated, inflated, reset", " ".join(
            str(int(chosen[f"{what}_count"].sum())) for what in ("gated", "inflated", "reset"))),
        ("vibration set, share of the time", spread(chosen.vibration_fraction.to_numpy())),
        ("speed through water in steady glide, m/s", spread(speed)),
        ("angle of attack in steady glide, degree", spread(attack, ".1f")),
        ("share of steady glide with |angle of attack| within 10 degrees", f"{np.mean(np.abs(attack) <= 10.0):.1%}"),
        ("profiles whose message calls the self-motion implausible", numbered(implausible)),
        ("depth-averaged current, m/s", f"{spread(size)}, {np.isfinite(size).sum()} profiles"),
        ("the same by the glide angle, m/s", spread(conventional)),
        ("difference of the two (vector), m/s", spread(difference)),
        ("surface drift where fixes allow, m/s", spread(
            np.hypot(chosen.surface_drift_north, chosen.surface_drift_east).to_numpy())),
    ]  # fmt: skip


def table(columns: Mapping[str, list[tuple[str, str]]]) -> list[str]:
    """A Markdown table with one column a mission."""
    entries = zip(*columns.values(), strict=True)
    return [
        "| | " + " | ".join(columns) + " |",
        "| --- |" + " --- |" * len(columns),
        *(f"| {row[0][0]} | " + " | ".join(value for _, value in row) + " |" for row in entries),
    ]


def main(data: Path, work: Path) -> None:
    """Run the missions and write the page."""
    found, results = {}, {}
    for name, mission in MISSIONS.items():
        summary, tree = invert(mission, name, data, work)
        found[name], results[name] = imported(summary), rows(tree)
        own = own_current(data / mission.folder, tree) if mission.importer is import_slocum else "not reported"
        results[name].append(("difference to the glider's own current (vector), m/s", own))
    lines = [
        "# Three real missions",
        "",
        "SeaExplorer SEA035 off British Columbia (M010, M012) and Slocum modena in the Gulf of Mexico, with the shipped,",
        "uncalibrated `seaexplorer` and `slocum` hulls (M012 with `platform.buoyancy.neutral_volume=-215`), default settings.",
        f"Of modena's complete profiles one in {MISSIONS['modena'].every} is taken.",
        "No truth exists for these: the tables show sizes and spread (median, 10th to 90th percentile), not accuracy.",
        "Made by `python benchmarks/real_missions.py DATA_FOLDER`.",
        "",
        "## Imported",
        "",
        *table(found),
        "",
        "## Inverted",
        "",
        *table(results),
    ]
    page = Path(__file__).resolve().parents[1] / "docs" / "real-missions.md"
    page.write_text("\n".join(lines) + "\n", "utf-8")
    print("\n".join(lines))


if __name__ == "__main__":
    if len(sys.argv) > 2:
        main(Path(sys.argv[1]), Path(sys.argv[2]))
    else:
        with tempfile.TemporaryDirectory() as folder:
            main(Path(sys.argv[1]), Path(folder))
