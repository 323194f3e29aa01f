"""Import and invert the real missions at hand, and write ``docs/real-missions.md`` from the archives.

Usage: ``python benchmarks/real_missions.py DATA_FOLDER [WORK_FOLDER]``, where DATA_FOLDER holds the folders named in
`MISSIONS`. An archive that is in WORK_FOLDER already is taken as it is. The hulls are uncalibrated: sizes, not accuracy.
"""

import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import xarray as xr

from gliderhpc import load_platform, open_mission
from gliderhpc.mission.executors import default_workers, local_executor
from gliderhpc.mission.run import run_mission
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.observations import Observations, open_observations
from gliderhpc.observations.imported import ImportSummary
from gliderhpc.observations.og1 import import_og1
from gliderhpc.observations.reference import read_reference
from gliderhpc.observations.seaexplorer import import_seaexplorer
from gliderhpc.observations.seaglider import import_seaglider
from gliderhpc.observations.slocum import import_slocum


@dataclass(frozen=True)
class Mission:
    """A mission of a real glider, and how it is inverted.

    Attributes
    ----------
    folder : str
        Where its records lie in the data folder.
    bring : callable
        Turns sources into an observation file.
    platform : str
        The shipped hull.
    overrides : mapping
        Values of the hull that are replaced.
    every : int
        Of how many complete profiles one is inverted.
    """

    folder: str
    bring: Callable[[Sequence[Path], Path], ImportSummary]
    platform: str
    overrides: Mapping[str, str] = field(default_factory=dict)
    every: int = 1


MISSIONS: Mapping[str, Mission] = {
    "SEA035 M010": Mission("seaexplorer-sea035-M010", import_seaexplorer, "seaexplorer"),
    "SEA035 M012": Mission(
        "seaexplorer-sea035-M012", import_seaexplorer, "seaexplorer", {"buoyancy.neutral_volume": "-215"}
    ),
    "modena": Mission("slocum-modena-2015", import_slocum, "slocum", every=6),
    "SG249": Mission("seaglider-sg249-nanoos-2024", import_seaglider, "seaglider"),
    "SG561": Mission("seaglider-sg561-lofoten-2016", import_seaglider, "seaglider"),
    "SG033 (OG1)": Mission("seaglider-sg033-og1-2010", import_og1, "seaglider"),
}
VIBRATION = 1
NATIVE = "modena-2015-native-days0-20.nc"
REPORTED_WITHIN = np.timedelta64(20, "m")
"""A Slocum reports the current of a dive as long after it, at most."""
_SECOND = np.timedelta64(1, "s")

Rows = list[tuple[str, str]]


def invert(name: str, data: Path, work: Path) -> tuple[ImportSummary, xr.DataTree]:
    """Import one mission and run it with default settings; what the import said, and the archive."""
    mission = MISSIONS[name]
    path, store = work / f"{mission.folder}.nc", work / f"{mission.folder}.zarr"
    summary = mission.bring([data / mission.folder], path)
    if not store.exists():
        platform = load_platform(mission.platform, mission.overrides)
        with open_observations(path) as observations:
            run_mission(
                observations, platform, MissionSettings(), _chosen(observations, mission.every), store,
                lambda: local_executor(default_workers()),
            )  # fmt: skip
    return summary, open_mission(store)


def _chosen(observations: Observations, every: int) -> tuple[int, ...]:
    """All profiles, or one of so many complete ones."""
    numbers = observations.profile_numbers
    complete = [number for number in numbers if number not in observations.faults]
    return tuple(numbers if every == 1 else complete[::every])


def imported_rows(summary: ImportSummary) -> Rows:
    """What the import found."""
    dropped = ", ".join(f"{count} {why}" for why, count in summary.rows_dropped.items()) or "none"
    faults = Counter(profile.fault.partition(": ")[2] for profile in summary.profiles if profile.fault)
    refused = Counter(fault.partition(",")[0].partition(" in all")[0] for fault in faults.elements())
    depths = np.array([profile.max_depth for profile in summary.complete])
    minutes = np.array([profile.duration / 60.0 for profile in summary.complete])
    return [
        ("samples", f"{summary.rows}"),
        ("sampling interval within profiles, s", f"{summary.sample_interval:.1f}"),
        ("samples with temperature", f"{summary.ctd_samples}"),
        ("samples dropped", dropped),
        ("profiles found", f"{len(summary.profiles)}"),
        ("complete", f"{len(summary.complete)}"),
        ("rejected, and why", "; ".join(f"{count}: {why}" for why, count in refused.items()) or "none"),
        ("files left out", "; ".join(summary.rejected.values()) or "none"),
        ("without a profile", "; ".join(f"{what}: {why}" for what, why in summary.without_profile.items()) or "none"),
        ("GPS fixes; implausible ones left out", f"{summary.fixes}; {summary.fixes_dropped}"),
        ("greatest depth of a profile, m", spread(depths, ".0f")),
        ("duration of a profile, minutes", spread(minutes, ".0f")),
    ]


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


def inverted_rows(tree: xr.DataTree) -> Rows:
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
        ("share of steady glide at less than 10 degrees of attack, either way", f"{np.mean(np.abs(attack) <= 10.0):.1%}"),
        ("profiles whose message calls the self-motion implausible", numbered(implausible)),
        ("depth-averaged current, m/s", f"{spread(size)}, {np.isfinite(size).sum()} profiles"),
        ("the same by the glide angle, m/s", spread(conventional)),
        ("difference of the two (vector), m/s", spread(difference)),
        ("surface drift where fixes allow, m/s", spread(
            np.hypot(chosen.surface_drift_north, chosen.surface_drift_east).to_numpy())),
        ("time adrift taken out between the fixes, s", spread((chosen.entry_surface_time + chosen.exit_surface_time).to_numpy(), ".0f")),
        ("displacement taken out with it, m", spread(
            np.hypot(chosen.entry_surface_north + chosen.exit_surface_north,
                     chosen.entry_surface_east + chosen.exit_surface_east).to_numpy(), ".0f")),
    ]  # fmt: skip


def compared_rows(tree: xr.DataTree, current: np.ndarray, reference: xr.Dataset) -> Rows:
    """The archive against what the vehicle's or the operator's own processing left in the source.

    `current` (m/s, north and east) has a row for every profile of the archive.
    """
    table = tree.ds.load()
    done = (table.status == "done").to_numpy()
    found = np.column_stack([table.dac_north.to_numpy(), table.dac_east.to_numpy()])[done]
    north, east = (found - current[done]).T
    return [
        ("depth-averaged current of the source, m/s", spread(np.hypot(*current[done].T))),
        ("profiles with both", f"{np.isfinite(north).sum()}"),
        ("ours less the source's: RMS to the north, to the east, of the vector, m/s",
            f"{rms(north):.3f}, {rms(east):.3f}, {rms(np.hypot(north, east)):.3f}"),
        ("mean to the north and to the east, m/s", f"{np.nanmean(north):+.3f}, {np.nanmean(east):+.3f}"),
        *_speed_rows(tree, table.profile.to_numpy()[done], reference),
    ]  # fmt: skip


def _speed_rows(tree: xr.DataTree, numbers: np.ndarray, reference: xr.Dataset) -> Rows:
    """Our speed through the water in steady glide against the source's, if it has one."""
    if "reference_speed" not in reference:
        both, apart_on_average = "not reported", "not reported"
    else:
        speeds = np.concatenate([_speeds(tree, int(number), reference) for number in numbers])
        apart, diving = speeds[:, 0] - speeds[:, 1], speeds[:, 2] < 0.0
        both = f"{rms(apart):.3f}"
        apart_on_average = f"{np.nanmean(apart[diving]):+.3f}, {np.nanmean(apart[~diving]):+.3f}"
    return [
        ("speed through the water in steady glide: RMS, m/s", both),
        ("mean over dives, over climbs, m/s", apart_on_average),
    ]


def source_current(folder: Path, tree: xr.DataTree, reference: xr.Dataset) -> np.ndarray | None:
    """Current of the source for every profile of the archive, north and east, m/s; None where it reports none."""
    if "reference_current_north" in reference:
        theirs = reference.reindex(reference_profile=tree.ds.profile.to_numpy())
        return np.column_stack([theirs.reference_current_north.to_numpy(), theirs.reference_current_east.to_numpy()])
    return _slocum_current(folder / NATIVE, tree) if (folder / NATIVE).exists() else None


def _slocum_current(path: Path, tree: xr.DataTree) -> np.ndarray:
    """What the Slocum's own dead reckoning gives for the same dives; missing where it was not reported soon after."""
    with xr.open_dataset(path) as native:
        own = native[["m_present_time", "m_final_water_vy", "m_final_water_vx"]].load()
    said = np.isfinite(own.m_final_water_vx.values)
    time, north, east = (own[name].values[said] for name in own.data_vars)
    start = tree.ds.start_time.to_numpy()
    end = start + (tree.ds.duration.to_numpy() * 1e9).astype("timedelta64[ns]")
    nearest = np.minimum(np.searchsorted(time, end), len(time) - 1)
    soon = (time[nearest] >= end) & (time[nearest] - end <= REPORTED_WITHIN)
    return np.where(soon[:, None], np.column_stack([north[nearest], east[nearest]]), np.nan)


def _speeds(tree: xr.DataTree, number: int, reference: xr.Dataset) -> np.ndarray:
    """Our speed, the source's (m/s) and the pitch, at the source's times in steady glide: one row a time."""
    state = tree["state"].ds.sel(profile=number).load()
    known = np.isfinite(state.u.to_numpy())
    time = (state.time.to_numpy()[known] - state.time.to_numpy()[0]) / _SECOND
    at = (reference.reference_time.to_numpy() - state.time.to_numpy()[0]) / _SECOND
    every = round(tree.attrs["output_interval"] / tree.attrs["step"])
    shaken = tree["series"].ds.quality.sel(profile=number).to_numpy()[::every][: known.size][known] & VIBRATION > 0
    speed = np.sqrt(state.u**2 + state.v**2 + state.w**2).to_numpy()[known]
    within = (at >= time[0]) & (at <= time[-1])
    rows = np.column_stack([
        np.interp(at, time, speed), reference.reference_speed.to_numpy(), np.interp(at, time, state.pitch.to_numpy()[known]),
    ])[within]  # fmt: skip
    return rows[np.interp(at[within], time, shaken.astype(float)) == 0.0]


def rms(values: np.ndarray) -> float:
    """Root of the mean square, without what is missing."""
    return float(np.sqrt(np.nanmean(values**2)))


def table_of(columns: Mapping[str, Rows]) -> list[str]:
    """Lines of a table, one column a mission."""
    lines = ["| | " + " | ".join(columns) + " |", "| --- |" + " --- |" * len(columns)]
    first = next(iter(columns.values()))
    for index, (what, _) in enumerate(first):
        lines.append(f"| {what} | " + " | ".join(rows[index][1] for rows in columns.values()) + " |")
    return lines


def page(found: Mapping[str, Rows], inverted: Mapping[str, Rows], compared: Mapping[str, Rows]) -> list[str]:
    """Lines of the page."""
    return [
        "# Real missions",
        "",
        "SeaExplorer SEA035 off British Columbia (M012 with `platform.buoyancy.neutral_volume=-215`), Slocum modena in the",
        f"Gulf of Mexico (one in {MISSIONS['modena'].every} of its complete profiles), Seaglider SG249 off Washington, SG561 in the",
        "Lofoten Basin, SG033 off Puerto Rico, with the shipped, uncalibrated hulls and default settings. Made by",
        "`python benchmarks/real_missions.py DATA_FOLDER`. Spreads are the median and the range from the 10th to the 90th",
        "percentile.",
        "",
        "## Import",
        "",
        *table_of(found),
        "",
        "## Inversion",
        "",
        "No truth exists for these: the table shows sizes and spread, not accuracy.",
        "",
        *table_of(inverted),
        "",
        "## Against the vehicle's or the operator's own solution",
        "",
        "The Seaglider files carry the basestation's depth-averaged current and the speed of its flight model, whose",
        "coefficients are regressed dive by dive; the hull here is the shipped one, for a vehicle of 52 kg and another trim.",
        "A Slocum reports the current of its own dead reckoning, after some of its dives. What is left is for a calibration of",
        "the hull to remove.",
        "",
        *table_of(compared),
    ]


def main(data: Path, work: Path) -> None:
    """Run the missions and write the page."""
    found: dict[str, Rows] = {}
    inverted: dict[str, Rows] = {}
    compared: dict[str, Rows] = {}
    for name, mission in MISSIONS.items():
        summary, tree = invert(name, data, work)
        found[name], inverted[name] = imported_rows(summary), inverted_rows(tree)
        reference = read_reference(summary.path)
        current = source_current(data / mission.folder, tree, reference)
        if current is not None:
            compared[name] = compared_rows(tree, current, reference)
    lines = page(found, inverted, compared)
    path = Path(__file__).resolve().parents[1] / "docs" / "real-missions.md"
    path.write_text("\n".join(lines) + "\n", "utf-8")
    print("\n".join(lines))


if __name__ == "__main__":
    if len(sys.argv) > 2:
        main(Path(sys.argv[1]), Path(sys.argv[2]))
    else:
        with tempfile.TemporaryDirectory() as folder:
            main(Path(sys.argv[1]), Path(folder))
