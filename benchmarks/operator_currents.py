"""SG249's depth-averaged currents compared with those of the operator's own processing; writes ``docs/operator-currents.md``.

Usage: ``python -m benchmarks.operator_currents DATA_FOLDER [WORK_FOLDER]``, where DATA_FOLDER holds the mission's folder.
An archive that is in WORK_FOLDER already is taken as it is.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import xarray as xr

from benchmarks.command_line import data_and_work_folders
from benchmarks.real_calibration import calibrated, shares
from benchmarks.real_missions import MISSIONS, rms, spread, table_of
from gliderhpc import load_platform, open_mission
from gliderhpc.archive.profile import ESTIMATES
from gliderhpc.mission.executors import local_executor
from gliderhpc.mission.local_workers import default_workers
from gliderhpc.mission.planning import prepare_mission
from gliderhpc.mission.run import run_mission
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.observations import open_observations
from gliderhpc.platform import Platform
from gliderhpc.studies.currents import STUDY
from gliderhpc.studies.library.retrieval import DepthResolvedSettings
from gliderhpc.studies.request import Request

Rows = list[tuple[str, str]]

MISSION = MISSIONS["SG249"]
FITTED_EVERY = 2
"""Of how many dives one is left out where the hull is calibrated."""


def hulls(path: Path) -> tuple[dict[str, Platform], tuple[int, ...], tuple[int, ...]]:
    """The shipped and the calibrated hull, all dives, and those that the calibration has not seen."""
    shipped = load_platform(MISSION.platform)
    with open_observations(path) as observations:
        unseen, fitted = shares(observations, FITTED_EVERY)
        found = calibrated(observations, shipped, fitted, unseen)
    if found is None:
        raise SystemExit(f"{path}: too few dives to calibrate on")
    every = tuple(sorted((*unseen, *fitted)))
    return {"shipped": shipped, "calibrated": found.platform}, every, tuple(unseen)


def studied(path: Path, platform: Platform, numbers: tuple[int, ...], store: Path, estimate: str) -> xr.Dataset:
    """Group ``currents`` of an archive of these dives, made where it is not there."""
    if not store.exists():
        with open_observations(path) as observations:
            prepared = prepare_mission(observations, platform, MissionSettings(), numbers)
            run_mission(prepared, store, lambda: local_executor(default_workers()))
    request = Request(store, lambda: local_executor(default_workers()), estimate=estimate, reference=path)
    STUDY.run(request, DepthResolvedSettings())
    with open_mission(store) as tree:
        return tree["currents"].to_dataset().drop_dims("record").load()


def rows(study: xr.Dataset, unseen: tuple[int, ...]) -> Rows:
    """Report of one hull and estimate."""
    distance = study["reference_distance"]
    known = distance.notnull()
    north, east = (study[f"current_{along}"] - study[f"reference_{along}"] for along in ("north", "east"))
    apart = study["reference_difference"].values

    def within(sigma: float, chosen: xr.DataArray) -> str:
        return f"{int((chosen <= sigma).sum())} of {int(chosen.notnull().sum())}"

    return [
        ("dives with both", f"{int(known.sum())}"),
        ("within 1 sigma (39 % if independent and normal)", within(1.0, distance)),
        ("within 2 sigma (86 %)", within(2.0, distance)),
        (
            "dives that no calibration saw: within 1, within 2 sigma",
            ", ".join(within(sigma, distance.sel(profile=list(unseen))) for sigma in (1.0, 2.0)),
        ),
        ("distance, sigma", spread(distance.values, ".2f")),
        ("vector difference, m/s", spread(apart)),
        ("its root mean square, m/s", f"{rms(apart):.3f}"),
        ("mean difference to the north, to the east, m/s", f"{float(north.mean()):+.3f}, {float(east.mean()):+.3f}"),
        (
            "semi-axes of our 1-sigma ellipse, m/s",
            f"{spread(study['ellipse_major'].values)}; {spread(study['ellipse_minor'].values)}",
        ),
        ("the operator's own error, m/s", spread(study["reference_error"].values)),
        ("the operator's current, m/s", spread(np.hypot(study["reference_north"], study["reference_east"]).values)),
    ]


def page(columns: Mapping[str, Rows], dives: int) -> list[str]:
    """Lines of the page."""
    return [
        "# Currents compared with an operator's own",
        "",
        "How well do the currents of `run-mission` agree with those that a glider's operator computes in the established way?",
        "",
        f"Seaglider SG249 off Washington, {dives} dives; made by `python -m benchmarks.operator_currents DATA_FOLDER` with",
        "`analyze currents --reference` on the imported file. The operator's current is the basestation's, from its flight model",
        "and the same fixes, so both contain the errors of the fixes; distances are in sigma of our ellipse and the operator's",
        "stated error combined. The hull is calibrated by the command `calibrate`",
        f"([calibration.md](calibration.md)) on one dive in {FITTED_EVERY}. Spreads are the median and the range from the 10th",
        "to the 90th percentile.",
        "",
        *table_of(columns),
        "",
        "Both methods take the drift between the same fixes as the current; they differ in the distance travelled through the water.",
        "The table therefore shows how well they agree on that distance, not the error of either current, which was not measured.",
    ]


def main(data: Path, work: Path) -> None:
    """Run the dives and write the page."""
    path = work / f"{MISSION.folder}.nc"
    MISSION.bring([data / MISSION.folder], path, overwrite=True)
    platforms, every, unseen = hulls(path)
    columns = {
        f"{kind} hull, {estimate}": rows(
            studied(path, platform, every, work / f"{MISSION.folder}-{kind}-all.zarr", estimate), unseen
        )
        for kind, platform in platforms.items()
        for estimate in ESTIMATES
    }
    lines = page(columns, len(every))
    target = Path(__file__).resolve().parents[1] / "docs" / "operator-currents.md"
    target.write_text("\n".join(lines) + "\n", "utf-8")
    print("\n".join(lines))


if __name__ == "__main__":
    with data_and_work_folders(__doc__) as folders:
        main(*folders)
