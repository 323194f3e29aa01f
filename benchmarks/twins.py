"""Write ``docs/twins.md`` and ``docs/estimators.md`` from the twin studies, so that none of their figures is typed.

Usage, after ``gliderhpc twin windows|sensitivity|recoverability|currents|estimators --out twins``: ``python -m
benchmarks.twins twins``. ``docs/twins.md`` needs the first three; ``currents`` gives its section on the current, by
itself too; the last gives ``docs/estimators.md`` and the README's claim about accuracy. A page or section whose studies
are not in the folder is left as it is.
"""

import json
import shutil
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from benchmarks.sections import section_of, with_section
from gliderhpc.estimation.current_budget import TERMS
from gliderhpc.findings.comparison import comparison_from_json, comparison_markdown
from gliderhpc.findings.tables import markdown, number
from gliderhpc.studies.library.current_difference import COVERAGE
from gliderhpc.twins.currents.runs import GUSTS as BROADBAND
from gliderhpc.twins.estimators.page import claim, page_text
from gliderhpc.vocabulary import CHANNELS

STUDIES = ("windows", "sensitivity", "recoverability")
CURRENTS = "currents"
ESTIMATORS = "estimators"
ROOT = Path(__file__).resolve().parents[1]
Row = dict[str, Any]

WINDOW_SCORES = {
    "rmse_B_cr": "yaw, N m", "rmse_B_cu": "surge, N", "rmse_B_cq": "pitch, N m", "overall": "all, relative",
    "cost_per_30s": "cost a 30 s", "iterations": "iterations", "capped": "at the cap", "seam_ratio": "seam ratio",
    "jump_ratio": "jump ratio",
}  # fmt: skip
TRANSFER_SCORES = {
    "gain_current": "gain on the current", "gain_rate": "gain on the forcing, s", "phase": "phase, degree",
    "coherence": "coherence",
}  # fmt: skip
SWEEPS = ("sliding", "not sliding", "margin", "tau_c", "tolerance", "scale of yaw", "scale of the others")


def read(folder: Path, study: str) -> Row:
    """Read a study."""
    content: Row = json.loads((folder / f"{study}.json").read_text("utf-8"))
    return content


def is_there(folder: Path, study: str) -> bool:
    """Whether a folder holds a study."""
    return (folder / f"{study}.json").exists()


def made_by(content: Row) -> str:
    """Say how a study was made."""
    size = "--quick" if content["quick"] else "the full size"
    hulls = ", ".join(content["platforms"])
    return f"`gliderhpc twin {content['study']}`, {size}, {len(content['seeds'])} twins of {hulls}."


def comparisons(content: Row) -> list[str]:
    """Tables of the paper's figures beside ours."""
    lines = []
    for title, rows in content["comparisons"].items():
        lines += [f"### {title}", "", comparison_markdown(comparison_from_json(row) for row in rows), ""]
    return lines


def sweep_table(content: Row, hull: str, preset: str) -> str:
    """Medians of every setting of one hull and preset."""
    rows = [
        [f"{line['sweep']} {line['value']:g}", *(number(line[name]) for name in WINDOW_SCORES)]
        for sweep in SWEEPS
        for line in content["summary"]
        if line["hull"] == hull and line["preset"] == preset and line["sweep"] == sweep
    ]
    return markdown(("setting", *WINDOW_SCORES.values()), rows)


def windows(content: Row) -> list[str]:
    """Section on the windows."""
    lines = [
        "## Windows",
        "",
        made_by(content),
        "The *seam ratio* is the root mean square of the high-passed (0.05 Hz) yaw-moment error within one second of a",
        "window's boundary over that elsewhere; the *jump ratio* sets the identified moment's step across a boundary",
        "against its steps elsewhere. The paper does not define its own ratio.",
        "*All, relative* is the error of surge, heave, pitch and yaw, each over its truth's root mean square, in one.",
        "The operating point is chosen by error against truth, never by cost. A length is as good as the best where the",
        "excess, seed by seed, does not stand out of its own quartile spread.",
        "",
        *(f"- {sentence}" for sentence in content["sentences"]),
        "",
        "![Window study](twins/windows.png)",
        "",
        *comparisons(content),
    ]
    for verdict in content["verdicts"]:
        hull, preset = verdict["hull"], verdict["preset"]
        lines += [f"### {hull}, {preset}: every setting (medians)", "", sweep_table(content, hull, preset), ""]
    return lines


def bias_table(rows: Iterable[Row], suffix: str = "") -> str:
    """Shifts of the six channels, dive and climb."""
    cells = [
        [f"{row['sweep']}: {row['value']}", row["phase"], *(number(row[f"{name}{suffix}"]) for name in CHANNELS),
         number(row["velocity_along_rms"])]
        for row in rows
    ]  # fmt: skip
    return markdown(("error", "phase", *CHANNELS, "along track, m/s"), cells)


def sensitivity(content: Row) -> list[str]:
    """Section on the sensitivities."""
    lines = [
        "## Sensitivity",
        "",
        made_by(content),
        "Shifts are differences from the same twin without that error. The paper's hull is not public: a pitch offset",
        "tilts weight and buoyancy in the body frame and changes the angle of attack that the model believes in, so what",
        "it leaves in surge and heave goes with net buoyancy and lift slope, and in pitch with the metacentric height.",
        "Heave is the least observed channel and keeps what a turn leaves: lag of the battery, and wrong lateral",
        "coefficients (K_beta, K_MR), which are felt in turns alone, stay in it for the rest of a leg.",
        "",
        "![Sensitivities](twins/sensitivity.png)",
        "",
        *comparisons(content),
    ]
    for preset in dict.fromkeys(row["preset"] for row in content["biases"]):
        ours = [row for row in content["biases"] if row["preset"] == preset]
        offsets = [row for row in ours if row["sweep"].startswith("offset")]
        others = [row for row in ours if row["sweep"] in ("one coefficient", "coefficients")]
        lines += [f"### Offsets, {preset} (N and N m a degree, medians)", "", bias_table(offsets), ""]
        lines += [f"### Coefficients, {preset} (N and N m, RMS; one at a time 15 % too large)", ""]
        lines += [bias_table(others, "_rms"), ""]
    return lines


def detection_matrix(rows: Sequence[Row], preset: str, score: str) -> str:
    """One score of the impulses, amplitudes down and widths across."""
    ours = {(row["amplitude"], row["width"]): row[score] for row in rows if row["preset"] == preset}
    amplitudes, widths = (sorted({key[i] for key in ours}) for i in (0, 1))
    cells = [[f"{a:g}", *(number(ours.get((a, w))) for w in widths)] for a in amplitudes]
    return markdown(("amplitude, N m", *(f"{width:g} s" for width in widths)), cells)


def recoverability(content: Row) -> list[str]:
    """Section on what can be recovered."""
    lines = [
        "## Recoverability",
        "",
        made_by(content),
        "Impulses are Gaussian; their width is its standard deviation. Detection: the high-passed identified moment",
        "passes, within two seconds and with the right sign, a threshold that sensor noise alone passes once an hour.",
        "",
        "![Recoverability](twins/recoverability.png)",
        "",
        *comparisons(content),
    ]
    for preset in content["noise"]:
        for score, title in (
            ("rate", "detection rate"),
            ("gain", "identified over true height"),
            ("delay", "delay, s"),
        ):
            lines += [f"### {preset}: {title}", "", detection_matrix(content["detection"], preset, score), ""]
    names = [name for name in content["errors"][0] if name not in ("preset", "model")]
    cells = [
        [f"{row['preset']}, coefficients {row['model']}", *(number(row[name]) for name in names)]
        for row in content["errors"]
    ]
    lines += ["### Self-motion and current (N, m/s; terms fitted)", "", markdown(("twins", *names), cells), ""]
    budget = content["budget"]
    figures = [[name, number(value)] for name, value in budget.items() if isinstance(value, float)]
    lines += ["### The budget", "", markdown(("key of `budget.yaml`", "value"), figures), ""]
    lines += [f"- `{name}`: {how}" for name, how in budget["how"].items()]
    return lines


def coverage_table(content: Row) -> str:
    """Shares inside the ellipses, by constants and speed."""
    rows = [
        [
            line["constants"], line["speed"], str(line["twins"]),
            *(f"{line[f'inside_{sigma}']:.3f} ± {line[f'inside_{sigma}_error']:.3f}" for sigma in COVERAGE),
            number(line["area"]), number(line["error_median"]), line["verdict"],
        ]
        for line in content["coverage"]
    ]  # fmt: skip
    asked = (f"within {sigma} sigma (asked {share:g})" for sigma, share in COVERAGE.items())
    return markdown(("constants", "current", "twins", *asked, "area, m2/s2", "median error, m/s", "verdict"), rows)


def constants_table(content: Row) -> str:
    """Constants of the ellipses."""
    rows = [[name, *(number(values[term]) for term in TERMS)] for name, values in content["constants"].items()]
    return markdown(("constants", *TERMS), rows)


def transfer_table(content: Row, preset: str) -> str:
    """Gain, phase and coherence of every water in which anything is seen, by vertical scale."""
    rows = [
        [f"{line['world']} x {line['factor']:g}", f"{line['scale_low']:.2g} to {line['scale_high']:.2g}",
         *(number(line[name]) for name in TRANSFER_SCORES)]
        for line in content["transfer"]
        if line["preset"] == preset and line["world"] == BROADBAND
    ]  # fmt: skip
    return markdown(("water", "vertical scale, m", *TRANSFER_SCORES.values()), rows)


def drawn(size: Row) -> str:
    """Say what the twins of the depth-averaged current draw."""
    spreads = size["spreads"]
    return (
        f"Dives to {size['depth']:g} m through the scenario `paper`'s shear, gusts and false samples. Drawn for each, "
        f"independently: a uniform current of {size['speed'][0]:g} to {size['speed'][1]:g} m/s in any direction and the "
        f"scenario's shear on it; the course; every viscous and added-mass coefficient within "
        f"{spreads['coefficients']:.0%}; normal offsets of {spreads['roll_offset']:g} degree in roll, "
        f"{spreads['pitch_offset']:g} in pitch and {spreads['heading_offset']:g} in heading, of "
        f"{spreads['neutral_volume']:g} cm3 in the neutral volume and {1e3 * spreads['battery_position']:g} mm in the "
        f"battery's zero (standard deviations); and {spreads['fix_error']:g} m a coordinate for every fix. Other draws "
        "give other constants and another coverage: that of the compass sets the error across the track. The estimator "
        "believes the platform file. What offsets and coefficients do to the current does not depend on how long a dive "
        "lasts; what the fixes and the bridged inflection do goes with one over it, and is a term of its own. So the "
        "published dives of about three hours need no other constants than these shorter ones."
    )


def current_section(content: Row) -> str:
    """Section on the current's ellipses and on what the yaw moment shows of shear."""
    waters = [f"- *{name}*, strengths {', '.join(f'{factor:g}' for factor in water['factors'])}: {water['what']}"
              for name, water in content["waters"].items()]  # fmt: skip
    fine = content["fine_shear"]
    lines = [
        "## Currents",
        "",
        made_by(content),
        "",
        drawn(content["size"]),
        "",
        *(f"- {sentence}" for sentence in content["sentences"]),
        "",
        "![Currents](twins/currents.png)",
        "",
        *comparisons(content),
        "### Coverage of the ellipses, by speed of the current",
        "",
        "The ellipse of a twin is that of `analyze currents`, fixes and bridged displacement included. *Published* and",
        "*recoverability* are held against all twins; fitted constants against the half they were not fitted to.",
        "",
        coverage_table(content),
        "",
        constants_table(content),
        "",
        "### The depth-resolved part, by vertical scale",
        "",
        f"Dives to {content['size']['water_depth']:g} m, {content['size']['water_seeds']} twins of each water, strength",
        "and preset, with exact coefficients and noise but no offsets. *Forcing* is the rate at which the current across",
        "the hull changes along the path, without its moving average; *smoothed alike* has gone through the retrieval's",
        "own smoothing. The scale is the vertical speed over the frequency.",
        "",
        *waters,
        f"- Fine shear of strength 1: {fine['rms']:g} m/s (north and east each), correlation scale {fine['scale']:g} m.",
        "",
    ]
    for preset in content["seen"]:
        lines += [f"#### {preset}", "", transfer_table(content, preset), ""]
    return "\n".join(lines).rstrip()


def write_currents(folder: Path, docs: Path) -> None:
    """Put the section on the current into the page of the twins, its figure and its budget beside it."""
    page = docs / "twins.md"
    section = current_section(read(folder, CURRENTS))
    page.write_text(with_section(page.read_text("utf-8"), CURRENTS, section), "utf-8")
    budget = folder / "currents_budget.yaml"
    copy_beside(docs, [folder / f"{CURRENTS}.png", *([budget] if budget.exists() else [])])


def write_twins(folder: Path, docs: Path) -> None:
    """Write the page on windows, sensitivity and recoverability, and copy the figures beside it.

    The section on the current stays as it is.
    """
    studies = {study: read(folder, study) for study in STUDIES}
    page = docs / "twins.md"
    lines = [
        "# Twin experiments",
        "",
        "Worlds we made, inverted by the very pipeline that users run, and held against their truth. Made by",
        "`gliderhpc twin windows`, `sensitivity`, `recoverability` and `currents`, each with `--out twins` (the last",
        "also with `--budget twins/budget.yaml`), then `python -m benchmarks.twins twins`. The twins: the simulator's",
        "usual dives (slow longitudinal disturbances, yaw impulses of 0.6 to 3 N m) where nothing else is said, 1 Hz,",
        "attitude quantised to the platform's quantum, depth noise; the simulator steps at half the estimator's step and",
        "its actuators lag the commands that are recorded. Medians with quartiles over the twins unless said otherwise.",
        "",
        *windows(studies["windows"]),
        *sensitivity(studies["sensitivity"]),
        *recoverability(studies["recoverability"]),
        "",
        f"<!-- {CURRENTS} -->",
        *([section_of(page.read_text("utf-8"), CURRENTS)] if page.exists() else []),
        f"<!-- /{CURRENTS} -->",
    ]
    copy_beside(docs, [folder / f"{study}.png" for study in STUDIES] + [folder / "budget.yaml"])
    page.write_text("\n".join(lines) + "\n", "utf-8")


def write_estimators(folder: Path, docs: Path, readme: Path) -> None:
    """Write the page on the estimators, copy its figure beside it, and put its claim into the README."""
    content = read(folder, ESTIMATORS)
    copy_beside(docs, [folder / f"{ESTIMATORS}.png"])
    (docs / f"{ESTIMATORS}.md").write_text(page_text(content, f"twins/{ESTIMATORS}.png"), "utf-8")
    readme.write_text(with_section(readme.read_text("utf-8"), ESTIMATORS, claim(content)), "utf-8")


def copy_beside(docs: Path, files: Iterable[Path]) -> None:
    """Copy files to where the pages look for them."""
    (docs / "twins").mkdir(parents=True, exist_ok=True)
    for file in files:
        shutil.copy(file, docs / "twins" / file.name)


def main(folder: Path, docs: Path, readme: Path) -> None:
    """Write the pages whose studies are there."""
    twins, estimators = all(is_there(folder, study) for study in STUDIES), is_there(folder, ESTIMATORS)
    if twins:
        write_twins(folder, docs)
    currents = is_there(folder, CURRENTS)
    if currents:
        write_currents(folder, docs)
    if estimators:
        write_estimators(folder, docs, readme)
    if not (twins or currents or estimators):
        sys.exit(
            f"{folder}: neither {', '.join(STUDIES)} nor {CURRENTS} nor {ESTIMATORS}; "
            f"`gliderhpc twin STUDY --out {folder}` makes them"
        )


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "twins"), ROOT / "docs", ROOT / "README.md")
