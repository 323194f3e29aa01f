"""Import, calibrate and invert the available real missions; writes ``docs/real-missions.md`` from the archives.

Usage: ``python -m benchmarks.real_missions DATA_FOLDER [WORK_FOLDER]``, where DATA_FOLDER holds the folders named in
`MISSIONS`. An archive that is in WORK_FOLDER already is taken as it is.
"""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from benchmarks.command_line import data_and_work_folders
from benchmarks.real_calibration import (
    MOST_FITTED,
    Rows,
    balance_rows,
    calibrated,
    disturbance_rows,
    flags_of,
    merged,
    shares,
)
from gliderhpc import load_platform, open_mission
from gliderhpc.calibration.estimated_hulls import CalibratedHull
from gliderhpc.mission.executors import local_executor
from gliderhpc.mission.local_workers import default_workers
from gliderhpc.mission.planning import prepare_mission
from gliderhpc.mission.run import run_mission
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.observations import open_observations
from gliderhpc.observations.format import read_reference
from gliderhpc.observations.importing.workflow import ImportSummary
from gliderhpc.observations.instruments.og1 import import_og1
from gliderhpc.observations.instruments.seaexplorer import import_seaexplorer
from gliderhpc.observations.instruments.seaglider import import_seaglider
from gliderhpc.observations.instruments.slocum import import_slocum
from gliderhpc.platform import Platform
from gliderhpc.vocabulary import QUALITY


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
    every : int
        Of how many complete profiles one is inverted; the hull is calibrated on the others.
    """

    folder: str
    bring: Callable[..., ImportSummary]
    platform: str
    every: int


@dataclass(frozen=True, eq=False)
class Inverted:
    """Outcome of a mission.

    Attributes
    ----------
    summary : ImportSummary
        What the import found.
    shipped : xarray.DataTree
        The archive with the shipped hull.
    found : CalibratedHull or None
        The hull calibrated on profiles that are not in the archives; None where there are too few.
    calibrated : xarray.DataTree or None
        The archive of the same profiles with that hull.
    """

    summary: ImportSummary
    shipped: xr.DataTree
    found: CalibratedHull | None
    calibrated: xr.DataTree | None

    def both(self, rows: Callable[[xr.DataTree], Rows]) -> tuple[Rows, Rows | None]:
        """Rows of the archive with the shipped hull and of that with the calibrated one."""
        return rows(self.shipped), None if self.calibrated is None else rows(self.calibrated)


MISSIONS: Mapping[str, Mission] = {
    "SEA035 M010": Mission("seaexplorer-sea035-M010", import_seaexplorer, "seaexplorer", 4),
    "SEA035 M012": Mission("seaexplorer-sea035-M012", import_seaexplorer, "seaexplorer", 2),
    "modena": Mission("slocum-modena-2015", import_slocum, "slocum", 24),
    "SG249": Mission("seaglider-sg249-nanoos-2024", import_seaglider, "seaglider", 2),
    "SG561": Mission("seaglider-sg561-lofoten-2016", import_seaglider, "seaglider", 1),
    "SG033 (OG1)": Mission("seaglider-sg033-og1-2010", import_og1, "seaglider", 10),
}
NATIVE = "modena-2015-native-days0-20.nc"
REPORTED_WITHIN = np.timedelta64(20, "m")
"""A Slocum reports the current of a dive as long after it, at most."""
STALLED = 0.05
"""Slower than this the source's slope of the glide is not solved, m/s."""
_SECOND = np.timedelta64(1, "s")


def invert(name: str, data: Path, work: Path) -> Inverted:
    """Import a mission, calibrate its hull on some profiles, and run the others with and without that calibration."""
    mission = MISSIONS[name]
    path = work / f"{mission.folder}.nc"
    summary = mission.bring([data / mission.folder], path, overwrite=True)
    shipped = load_platform(mission.platform)
    with open_observations(path) as observations:
        inverted, fitted = shares(observations, mission.every)
        found = calibrated(observations, shipped, fitted, inverted)

        def run(platform: Platform, kind: str) -> xr.DataTree:
            store = work / f"{mission.folder}-{kind}.zarr"
            if not store.exists():
                prepared = prepare_mission(observations, platform, MissionSettings(), inverted)
                run_mission(prepared, store, lambda: local_executor(default_workers()))
            return open_mission(store)

        return Inverted(summary, run(shipped, "shipped"), found, run(found.platform, "calibrated") if found else None)


def imported_rows(summary: ImportSummary) -> Rows:
    """Findings of the import."""
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
    for number in numbers:
        state = tree["state"].ds[["u", "v", "w"]].sel(profile=number).load()
        value = (_speed(state) if name == "speed" else np.degrees(np.arctan2(state.w, state.u))).to_numpy()
        parts.append(value[~_vibrating(tree, number)[: value.size] & np.isfinite(value)])
    return np.concatenate(parts)


def _vibrating(tree: xr.DataTree, number: int) -> np.ndarray:
    return flags_of(tree, number) & QUALITY.meanings["vibration"] > 0


def _speed(state: xr.Dataset) -> xr.DataArray:
    """Speed through the water, m/s."""
    return np.sqrt(state.u**2 + state.v**2 + state.w**2)


def numbered(numbers: list[int], most: int = 12) -> str:
    """Numbers of profiles, or how many there are where they are too many to name."""
    return ", ".join(map(str, numbers)) or "none" if len(numbers) <= most else f"{len(numbers)} of them"


def inverted_rows(tree: xr.DataTree) -> Rows:
    """Report of one mission."""
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
        ("profiles done, of those selected", f"{done.sum()} of {done.size}"),
        ("not inverted, and why", "; ".join(failed.values()) or "none"),
        ("windows converged", f"{np.average(chosen.converged_fraction, weights=windows):.1%} of {windows.sum()}"),
        ("iterations per window, median (p10 to p90 over profiles)", spread(chosen.iterations_median.to_numpy(), ".0f")),
        ("filter: samples gated, inflated, reset", " ".join(
            str(int(chosen[f"{what}_count"].sum())) for what in ("gated", "inflated", "reset"))),
        ("vibration set, share of the time", spread(chosen.vibration_fraction.to_numpy())),
        ("speed through water in steady glide, m/s", spread(speed)),
        ("angle of attack in steady glide, degree", spread(attack, ".1f")),
        ("share of steady glide with an angle of attack within 10 degrees", f"{np.mean(np.abs(attack) <= 10.0):.1%}"),
        ("profiles whose message calls the self-motion implausible", numbered(implausible)),
        ("depth-averaged current, m/s", f"{spread(size)}, {np.isfinite(size).sum()} profiles"),
        ("the same from the glide angle, m/s", spread(conventional)),
        ("difference of the two (vector), m/s", spread(difference)),
        ("surface drift where fixes allow, m/s", spread(
            np.hypot(chosen.surface_drift_north, chosen.surface_drift_east).to_numpy())),
        ("time adrift removed between the fixes, s", spread((chosen.entry_surface_time + chosen.exit_surface_time).to_numpy(), ".0f")),
        ("displacement removed with it, m", spread(
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
        ("ours minus the source's: RMS to the north, to the east, of the vector, m/s",
            f"{rms(north):.3f}, {rms(east):.3f}, {rms(np.hypot(north, east)):.3f}"),
        ("mean to the north and to the east, m/s", f"{np.nanmean(north):+.3f}, {np.nanmean(east):+.3f}"),
        *_speed_rows(tree, table.profile.to_numpy()[done], reference),
    ]  # fmt: skip


def _speed_rows(tree: xr.DataTree, numbers: np.ndarray, reference: xr.Dataset) -> Rows:
    """Our speeds through the water in steady glide against the source's, and the source's two against each other."""
    known = "reference_speed" in reference
    speeds = pd.concat([_speeds(tree, int(number), reference) for number in numbers]) if known else NO_SPEEDS
    return [
        (f"{what}: RMS; mean over dives, over climbs, m/s", _apart(speeds[one] - speeds[other], speeds.pitch))
        for what, one, other in (
            ("speed, adjoint, minus the source's flight model", "adjoint", "model"),
            ("speed, smoothed, minus the source's flight model", "smoothed", "model"),
            ("speed, adjoint, minus the source's lift, drag and depth rate", "adjoint", "slope"),
            ("speed, smoothed, minus the source's lift, drag and depth rate", "smoothed", "slope"),
            ("the source's flight model minus its lift, drag and depth rate", "model", "slope"),
        )
    ]


NO_SPEEDS = pd.DataFrame(columns=["adjoint", "smoothed", "model", "slope", "pitch"], dtype=float)


def _apart(difference: pd.Series, pitch: pd.Series) -> str:
    if not difference.notna().any():
        return "not reported"
    return f"{rms(difference):.3f}; {difference[pitch < 0.0].mean():+.3f}, {difference[pitch >= 0.0].mean():+.3f}"


def source_current(folder: Path, tree: xr.DataTree, reference: xr.Dataset) -> np.ndarray | None:
    """Current of the source for every profile of the archive, north and east, m/s; None where it reports none."""
    if "reference_current_north" in reference:
        theirs = reference.reindex(reference_profile=tree.ds.profile.to_numpy())
        return np.column_stack([theirs.reference_current_north.to_numpy(), theirs.reference_current_east.to_numpy()])
    return _slocum_current(folder / NATIVE, tree) if (folder / NATIVE).exists() else None


def _slocum_current(path: Path, tree: xr.DataTree) -> np.ndarray:
    """Currents by the Slocum's own dead reckoning of the same dives; missing where it was not reported soon after."""
    with xr.open_dataset(path) as native:
        own = native[["m_present_time", "m_final_water_vy", "m_final_water_vx"]].load()
    known = np.isfinite(own.m_final_water_vx.values)
    time, north, east = (own[name].values[known] for name in own.data_vars)
    start = tree.ds.start_time.to_numpy()
    end = start + (tree.ds.duration.to_numpy() * 1e9).astype("timedelta64[ns]")
    nearest = np.minimum(np.searchsorted(time, end), len(time) - 1)
    soon = (time[nearest] >= end) & (time[nearest] - end <= REPORTED_WITHIN)
    return np.where(soon[:, None], np.column_stack([north[nearest], east[nearest]]), np.nan)


def _speeds(tree: xr.DataTree, number: int, reference: xr.Dataset) -> pd.DataFrame:
    """Our speeds, the source's (m/s) and the pitch, at the source's times in steady glide."""
    state, smoothed = (tree[group].ds.sel(profile=number).load() for group in ("state", "smoothed"))
    known = np.isfinite(state.u.to_numpy())
    time = (state.time.to_numpy()[known] - state.time.to_numpy()[0]) / _SECOND
    at = (reference.reference_time.to_numpy() - state.time.to_numpy()[0]) / _SECOND
    within = (at >= time[0]) & (at <= time[-1])

    def there(values: np.ndarray) -> np.ndarray:
        return np.interp(at[within], time, values[: known.size][known])

    ours = {"adjoint": _speed(state), "smoothed": _speed(smoothed), "pitch": state.pitch}
    theirs = {"model": "reference_speed", "slope": "reference_slope_speed"}
    table = pd.DataFrame(
        {name: there(values.to_numpy()) for name, values in ours.items()}
        | {
            name: reference[source].to_numpy()[within] if source in reference else np.nan
            for name, source in theirs.items()
        }
    )
    return table[(there(_vibrating(tree, number).astype(float)) == 0.0) & ~(table.slope < STALLED)]


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


def page(missions: Mapping[str, Inverted], currents: Mapping[str, np.ndarray]) -> list[str]:
    """Lines of the page; `currents` are those of the sources that report one."""
    references = {name: read_reference(missions[name].summary.path) for name in currents}
    compared = {
        name: missions[name].both(lambda tree, name=name: compared_rows(tree, currents[name], references[name]))
        for name in currents
    }
    found = {name: mission.found for name, mission in missions.items() if mission.found}
    return [
        *PREAMBLE,
        "## Import", "",
        *table_of({name: imported_rows(mission.summary) for name, mission in missions.items()}), "",
        "## Inversion with the shipped hulls", "",
        "No truth exists for these: the tables show sizes and spread, not accuracy.", "",
        *table_of({name: inverted_rows(mission.shipped) for name, mission in missions.items()}), "",
        "## Inversion with the calibrated hulls", "",
        "The same profiles. SG561's two profiles are too few to calibrate its hull.", "",
        *table_of({name: inverted_rows(missions[name].calibrated) for name in found}), "",
        *CHANGE,
        *table_of({name: balance_rows(calibration) for name, calibration in found.items()}), "",
        *table_of(merged({name: mission.both(disturbance_rows) for name, mission in missions.items()})), "",
        *AGAINST,
        *table_of(merged(compared)), "",
        *SPEEDS,
    ]  # fmt: skip


PREAMBLE = [
    "# Real missions",
    "",
    "What do the estimates of real gliders look like, before and after calibration, and do they agree with what vehicle and",
    "operator report? This page gives import, inversion and comparison for six missions:",
    "",
    "SeaExplorer SEA035 off British Columbia, Slocum modena in the Gulf of Mexico, Seaglider SG249 off Washington, SG561 in",
    "the Lofoten Basin, SG033 off Puerto Rico; default settings. Of the complete profiles one in "
    + ", ".join(f"{mission.every} ({name})" for name, mission in MISSIONS.items())
    + " is inverted, so that the page is made within an hour;",
    f"the hull is calibrated ([calibration.md](calibration.md)) on the others, at most {MOST_FITTED} of them. Made by",
    "`python -m benchmarks.real_missions DATA_FOLDER`. Spreads are the median and the range from the 10th to the 90th percentile.",
    "Buoyancy follows the measured density where there is one ([seawater.md](seawater.md)).",
    "",
]

CHANGE = [
    "## What calibration changes",
    "",
    "Errors of the steady balance at the profiles that are inverted, which the calibration has not seen, before and after; and",
    "the longitudinal disturbances over their steady-glide records. Heave is weakly observed: a heave force can replace lift",
    "at another angle of attack with hardly a trace in attitude and depth, so adjoint and smoothed estimate differ there.",
    "A prior tuned afterwards ([tuning.md](tuning.md)) limits the disturbances that remain with the calibrated hull.",
    "Windows that do not converge are those of slow sensors: the longer a window, the worse its conditioning (theory/estimate.md).",
    "",
]

AGAINST = [
    "## Against the vehicle's or the operator's own solution",
    "",
    "With the shipped and with the calibrated hull. The Seaglider files contain the basestation's depth-averaged current and two",
    "speeds: that of its flight model, from buoyancy and pitch, and that which its lift and drag give at the measured depth rate.",
    "A Slocum reports the current of its own dead reckoning, after some of its dives.",
    "",
]

SPEEDS = [
    "On SG249 our speed differs from that by lift, drag and depth rate half as much as the basestation's two speeds differ from",
    "each other. The flight model's depth rate hardly changes below the seasonal thermocline, while the measured one falls with",
    "depth in dives and rises with depth in climbs: the model's buoyancy does not increase with depth as the vehicle's does (its",
    "hull's compressibility), so its speed is steady. Ours follows the measured depth rate. The difference from the flight model",
    "is therefore neither drag nor a lag; with the measured depth rate, the same lift and drag give our speed.",
]


def main(data: Path, work: Path) -> None:
    """Run the missions and write the page."""
    missions = {name: invert(name, data, work) for name in MISSIONS}
    lines = page(missions, dict(_currents(missions, data)))
    path = Path(__file__).resolve().parents[1] / "docs" / "real-missions.md"
    path.write_text("\n".join(lines) + "\n", "utf-8")
    print("\n".join(lines))


def _currents(missions: Mapping[str, Inverted], data: Path) -> Iterator[tuple[str, np.ndarray]]:
    """Compare the sources of the current for the profiles of the archives."""
    for name, mission in missions.items():
        reference = read_reference(mission.summary.path)
        current = source_current(data / MISSIONS[name].folder, mission.shipped, reference)
        if current is not None:
            yield name, current


if __name__ == "__main__":
    with data_and_work_folders(__doc__) as folders:
        main(*folders)
