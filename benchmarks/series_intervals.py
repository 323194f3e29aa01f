"""Share of the truth in the intervals of the adjoint's and the smoother's disturbances on simulated missions.

Usage: ``python -m benchmarks.series_intervals [--seeds 1:2] [--dives 4]``. Writes the section ``intervals`` of
``docs/accuracy.md``.
"""

import argparse
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

import gliderhpc as gh
from benchmarks.hull_commands import believed_hull, flown_hull, run_commands, scenario_of
from benchmarks.sections import with_section
from gliderhpc.archive.profile import ADJOINT, ESTIMATES, done_profiles, read_profile_data, truth_on_samples
from gliderhpc.calibration.settings import USUAL_ROUNDS
from gliderhpc.findings.formatting import markdown
from gliderhpc.observations.truth import read_profile_truth, truth_path
from gliderhpc.platform import platform_yaml
from gliderhpc.simulator import simulate_mission
from gliderhpc.twins.scoring import INTERVALS, coverage
from gliderhpc.vocabulary import CHANNELS

PAGE = Path(__file__).resolve().parents[1] / "docs" / "accuracy.md"
SECTION = "intervals"
DEPTH, CALIBRATION_DIVES = 200.0, 16
NAMES = {
    "drawn": "drawn from the prior",
    "calm": "calm water",
    "impulses": "yaw impulses",
    "paper": "shear, lateral gusts",
    "demo": "shear, gusts, impulses, fouling",
}
EXACT: Mapping[str, Any] = {"smoother": {"hull": "believed"}}
"""Settings of a mission whose hull is known exactly: the intervals contain no errors of the hull."""

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Case:
    """Missions of one kind.

    Attributes
    ----------
    hull, kind : str
        Platform that flies, and kind of the disturbances.
    label : str
        Text of the table's row, in addition to the kind.
    settings : mapping
        Settings of the run.
    calibrated : bool
        Whether the hull is unknown and calibrated first; otherwise it is known exactly.
    """

    hull: str
    kind: str
    label: str = ""
    settings: Mapping[str, Any] = field(default_factory=lambda: EXACT)
    calibrated: bool = False


CASES = (
    *(Case("petrel-l", kind) for kind in NAMES),
    Case("petrel-l", "impulses", "`start=prior`", {**EXACT, "start": "prior"}),
    Case("petrel-l", "impulses", "`preset=paper`", {**EXACT, "preset": "paper"}),
    Case("petrel-l", "paper", "`preset=paper`", {**EXACT, "preset": "paper"}),
    Case("petrel-l", "impulses", "unknown hull, calibrated", calibrated=True),
    *(Case("seaglider", kind) for kind in ("calm", "impulses", "paper", "demo")),
)


def invert(case: Case, seed: int, dives: int, folder: Path) -> tuple[xr.DataTree, Path]:
    """Simulate a mission and invert it; return the archive and the records."""
    count = CALIBRATION_DIVES if case.calibrated else dives
    scenario = scenario_of(case.kind, gh.load_platform(case.hull), count, DEPTH)
    true, records = flown_hull(scenario, case.hull), folder / "mission.nc"
    simulate_mission(true, records, scenario=scenario, seed=seed)
    if not case.calibrated:
        return gh.run_mission(records, true, folder / "mission.zarr", workers=0, **case.settings), records
    hull = folder / "believed.yaml"
    hull.write_text(platform_yaml(believed_hull(true, seed)), "utf-8")
    return run_commands(records, hull, folder, USUAL_ROUNDS, workers=0)[1], records


def shares(tree: xr.DataTree, records: Path, number: int) -> Array:
    """Share ``(2, 2, 6)`` of a dive's steady steps within the 68 and 95 % intervals, of adjoint and smoother."""
    truth = read_profile_truth(truth_path(records), number)
    found = np.empty((len(ESTIMATES), len(INTERVALS), len(CHANNELS)))
    for e, estimate in enumerate(ESTIMATES):
        data = read_profile_data(tree, number, estimate)
        error = data.disturbances - truth_on_samples(data, truth)
        known = data.steady & np.isfinite(error).all(axis=1) & np.isfinite(data.disturbances_std).all(axis=1)
        for w, width in enumerate(INTERVALS.values()):
            for c in range(len(CHANNELS)):
                found[e, w, c] = coverage(error[known, c], data.disturbances_std[known, c], width)
    return found


def rows_of(case: Case, seeds: range, dives: int) -> list[list[str]]:
    """Return the table's rows of a case, one for each estimate: means over its dives."""
    found = []
    for seed in seeds:
        with tempfile.TemporaryDirectory() as folder:
            tree, records = invert(case, seed, dives, Path(folder))
            found += [shares(tree, records, number) for number in done_profiles(tree)]
            tree.close()
    mean = np.nanmean(found, axis=0)
    text = ", ".join(filter(None, (NAMES[case.kind], case.label)))
    rows = [
        [case.hull if estimate == ADJOINT else "", text if estimate == ADJOINT else "", estimate,
         *(f"{in_68:.2f} / {in_95:.2f}" for in_68, in_95 in mean[e].T)]
        for e, estimate in enumerate(ESTIMATES)
    ]  # fmt: skip
    print("\n".join(" | ".join(row) for row in rows), flush=True)
    return rows


def section(seeds: range, dives: int) -> str:
    """Return the section's text."""
    rows = [row for case in CASES for row in rows_of(case, seeds, dives)]
    table = markdown(["hull", "disturbances", "estimate", *CHANNELS], rows)
    return (
        "## Intervals of the disturbances\n\n"
        "Made by `python -m benchmarks.series_intervals`. Share of the truth within the 68 / 95 % intervals of the adjoint\n"
        "(`series.B_cu` with `state.B_cu_std` ...) and of the smoother (`smoothed.B_cu` with its `_std`), over the steps of\n"
        f"steady glide; means over the dives, to {DEPTH:.0f} m, of seeds {seeds[0]} to {seeds[-1]} with {dives} dives each.\n"
        "The hull is known exactly, except for its fouling, and the intervals contain no errors of the hull\n"
        "(`smoother.hull=believed`); the *unknown* one is wrong in all parameters by plausible deviations and calibrated on\n"
        f"the mission's {CALIBRATION_DIVES} dives ([unknown hulls](unknown-hull.md)).\n\n"
        "The adjoint's interval follows from the smoother's posterior and shares its faults: both are too wide where the\n"
        "disturbance is much calmer than its prior, and too narrow where a force departs from it, as the surge does in shear\n"
        f"and gusts and, in slow records, the sway in gusts.\n\n{table}"
    )


def main(arguments: list[str] | None = None) -> None:
    """Fly the missions and write the section."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", default="1:2", help="first and last seed of each mission")
    parser.add_argument("--dives", type=int, default=4)
    given = parser.parse_args(arguments)
    first, last = map(int, given.seeds.split(":"))
    text = section(range(first, last + 1), given.dives)
    PAGE.write_text(with_section(PAGE.read_text("utf-8"), SECTION, text), "utf-8")


if __name__ == "__main__":
    main()
