"""Calibration with the documented commands, on real missions and very wrong hulls; a section of ``docs/calibration.md``.

Usage: ``python -m benchmarks.calibration_field WORK_FOLDER [NAME=OBSERVATIONS:PLATFORM ...]``, where OBSERVATIONS are
imported records. What lies in WORK_FOLDER already is taken as it is.
"""

import contextlib
import io
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.calibration import FIELD, UNFLOWN
from benchmarks.command_line import positional
from benchmarks.sections import with_section
from gliderhpc import Glider, load_platform, open_mission
from gliderhpc.calibration.glides.text import SCORES
from gliderhpc.cli.main import main as gliderhpc
from gliderhpc.errors import GliderhpcError
from gliderhpc.findings.formatting import markdown
from gliderhpc.flight.hull_parameters import PARAMETERS, with_values
from gliderhpc.flight.steady_glide import glides_stably
from gliderhpc.platform import Platform
from gliderhpc.simulator import Scenario, simulate_mission

TWINS = 40
FIRST_SEED = 2000
HULLS = ("petrel-l", "seaglider", "slocum", "seaexplorer")
FAR = ("position.reservoir.0", "battery_eccentricity", "position.battery")
"""Parameters that are three plausible deviations off, in turn; all else is drawn within one."""
DEVIATIONS = 3.0
PROFILES = 8
SCENARIO = Scenario().replaced(
    {"profiles": PROFILES, "depth": 90.0, "steering": {"interval": 200.0, "longest_turn": 150.0}}
)
INVERTED = 2
"""Held-out profiles of a real mission that are inverted."""

PAGE = Path(__file__).resolve().parents[1] / "docs" / "calibration.md"
QUANTITIES = SCORES[2:]


@dataclass(frozen=True)
class Answer:
    """Outcome of the commands on one mission.

    Attributes
    ----------
    status : int
        Exit status of ``calibrate``.
    held_out : mapping of str to (float, float)
        Errors at the profiles held out before and after, in the units of `QUANTITIES`.
    profiles : list of int
        The profiles held out.
    inverted : str
        What ``run-mission`` did with some of them; empty where it was not asked.
    line : str
        Last line of the command's messages.
    """

    status: int
    held_out: Mapping[str, tuple[float, float]]
    profiles: list[int]
    inverted: str = ""
    line: str = ""

    @property
    def is_worse(self) -> bool:
        """True where pitch or roll is further off than before, by more than the tables show."""
        return any(after > before + 0.1 for name, (before, after) in self.held_out.items() if "degree" in name)


def command(*arguments: object) -> tuple[int, str, str]:
    """Run the program in this process: exit status, output, messages."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            gliderhpc([str(argument) for argument in arguments])
        except SystemExit as end:
            return int(end.code or 0), out.getvalue(), err.getvalue()
    return 0, out.getvalue(), err.getvalue()


def calibrated(observations: Path, hull: str, out: Path) -> Answer:
    """Calibrate by the plain command and read the file that it wrote."""
    status, _, messages = (
        (0, "", "") if out.exists() else command("calibrate", observations, "--platform", hull, "--out", out)
    )
    last = (messages.splitlines() or [""])[-1]
    if not out.exists():
        return Answer(status, {}, [], line=last)
    source = load_platform(out).source
    return Answer(status, scores_in(source), held_out_in(source), line=last)


def scores_in(source: str) -> dict[str, tuple[float, float]]:
    """Errors at the profiles held out, by the platform file's own words."""
    _, _, words = source.partition("Root mean square errors, held out: ")
    found = {}
    for name in QUANTITIES:
        match = re.search(rf"{re.escape(name)} ([\d.]+) before and ([\d.]+) after", words)
        if match:
            found[name] = (float(match[1]), float(match[2].rstrip(".")))
    return found


def held_out_in(source: str) -> list[int]:
    """Profiles held out, by the platform file's own words."""
    match = re.search(r"held out \d+ segments of profiles? ([\d, ]+)", source)
    return [int(number) for number in match[1].rstrip(", ").split(", ")] if match else []


def inverted(observations: Path, platform: Path, store: Path, numbers: Sequence[int]) -> str:
    """Run some profiles by the plain command; how many are done, and of their windows the part that converged."""
    if not store.exists():
        status, _, messages = command(
            "run-mission", observations, "--platform", platform, "--store", store, "--workers", "0",
            "--profiles", ",".join(map(str, numbers)),
        )  # fmt: skip
        if not store.exists():
            return f"exit status {status}: {(messages.splitlines() or [''])[-1]}"
    with open_mission(store) as tree:
        table = tree.ds[["status", "window_count", "converged_fraction"]].load()
    done = (table.status == "done").to_numpy()
    counts = table.window_count.to_numpy()[done]
    share = np.average(table.converged_fraction.to_numpy()[done], weights=counts) if counts.sum() else np.nan
    return f"{done.sum()} of {done.size} done, {share:.0%} of windows"


def real(label: str, work: Path) -> tuple[str, str, Answer]:
    """Name, hull and result of one mission, given as ``NAME=OBSERVATIONS:PLATFORM``."""
    name, _, rest = label.partition("=")
    path, _, hull = rest.rpartition(":")
    out = work / f"{name}.yaml"
    found = calibrated(Path(path), hull, out)
    if found.profiles:
        chosen = found.profiles[:: max(len(found.profiles) // INVERTED, 1)][:INVERTED]
        ran = inverted(Path(path), out, work / f"{name}.zarr", chosen)
        found = Answer(found.status, found.held_out, found.profiles, ran, found.line)
    return name, hull, found


def far_hull(platform: Platform, key: str, sign: float, rng: np.random.Generator) -> Platform:
    """Draw a hull with one number three plausible deviations off, the others within one, until it glides stably."""
    while True:
        steps = {p.key: rng.uniform(-1.0, 1.0) for p in PARAMETERS if p.key != UNFLOWN} | {key: sign * DEVIATIONS}
        hull = with_values(platform, {p.key: p.moved(platform, steps[p.key]) for p in PARAMETERS if p.key in steps})
        if glides_stably(Glider(hull)):
            return hull


def twin(seed: int, work: Path) -> tuple[str, str, Answer]:
    """Name of the error, hull and result of one simulated mission."""
    number = seed - FIRST_SEED
    key, name = FAR[number % len(FAR)], HULLS[number % len(HULLS)]
    sign = 1.0 if number % 2 else -1.0
    rng, path = np.random.default_rng(seed), work / f"twin-{seed}.nc"
    while not path.exists():
        part = path.with_name(f"part-{path.name}")
        try:
            simulate_mission(
                far_hull(load_platform(name), key, sign, rng), part, scenario=SCENARIO, seed=seed, overwrite=True
            )
        except GliderhpcError:
            # A hull that cannot fly this scenario is no twin.
            continue
        part.replace(path)
    return f"`{key}` {sign * DEVIATIONS:+g}", name, calibrated(path, name, path.with_suffix(".yaml"))


def mission_table(rows: Sequence[tuple[str, str, Answer]]) -> str:
    """Markdown of the real missions."""
    return markdown(
        ("mission", "hull", "`calibrate`", *(f"held out: {name}" for name in QUANTITIES), "`run-mission`, held out"),
        [
            [name, f"`{hull}`", outcome(found), *(change(found, quantity) for quantity in QUANTITIES), found.inverted]
            for name, hull, found in rows
        ],
    )  # fmt: skip


def outcome(found: Answer) -> str:
    """Exit status, with the reason where it is not zero."""
    return "0" if found.status == 0 else f"{found.status}: {found.line.removeprefix('gliderhpc: ')}"


def change(found: Answer, quantity: str) -> str:
    """Before and after."""
    return "{:.2f} → {:.2f}".format(*found.held_out[quantity]) if quantity in found.held_out else ""


def twin_table(rows: Sequence[tuple[str, str, Answer]]) -> str:
    """Markdown of the twins by type of error."""
    lines = []
    for off in sorted({name for name, _, _ in rows}):
        own = [found for name, _, found in rows if name == off]
        written = [found for found in own if found.held_out]
        cells = [off, str(len(own)), str(len(written)), str(sum(found.is_worse for found in written))]
        for quantity in QUANTITIES:
            pairs = np.array([found.held_out[quantity] for found in written if quantity in found.held_out])
            cells.append(
                f"{np.median(pairs[:, 0]):.2f} → {np.median(pairs[:, 1]):.2f}, {pairs[:, 1].max():.2f}"
                if len(pairs)
                else ""
            )
        lines.append(cells)
    return markdown(
        ("error, plausible deviations", "twins", "files that load", "worse than before", *QUANTITIES), lines
    )


def section(missions: Sequence[tuple[str, str, Answer]], twins: Sequence[tuple[str, str, Answer]]) -> str:
    """Text of the section."""
    lines = [
        "## By the documented commands",
        "",
        "`gliderhpc import`, `calibrate` and `run-mission` as the pages show them, without settings. The errors are root",
        "mean squares at the held-out profiles, before and after, as the written file states them.",
        "",
    ]
    if missions:
        lines += [mission_table(missions), ""]
    refused = [found for _, _, found in twins if not found.held_out]
    lines += [
        f"{len(twins)} twins of hulls with one parameter wrong by {DEVIATIONS:g} plausible deviations, the others within one,",
        f"about {', '.join(f'`{name}`' for name in HULLS)} in turn; {PROFILES} dives to {SCENARIO.depth:g} m at one pitch,",
        f"simulated with disturbances and sensors; seeds {FIRST_SEED} to {FIRST_SEED + len(twins) - 1}. Medians before and",
        f"after, and the largest after. Refused with exit status 1: {len(refused)}.",
        "",
        twin_table(twins),
    ]
    return "\n".join(lines)


def main(work: Path, missions: Sequence[str], count: int = TWINS) -> None:
    """Calibrate missions and twins, and write the section."""
    work.mkdir(parents=True, exist_ok=True)
    found = [real(label, work) for label in missions]
    twins = [twin(seed, work) for seed in range(FIRST_SEED, FIRST_SEED + count)]
    text = section(found, twins)
    print(text)
    PAGE.write_text(with_section(PAGE.read_text("utf-8"), FIELD, text), "utf-8")


if __name__ == "__main__":
    given = positional(__doc__, work={"type": Path}, missions={"nargs": "*"})
    main(given.work, given.missions)
