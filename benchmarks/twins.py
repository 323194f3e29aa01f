"""Write the pages on twin experiments and on the estimators, so that no figure is typed by hand.

Usage, after ``gliderhpc twin windows|sensitivity|recoverability|currents|estimators --out twins``: ``python -m
benchmarks.twins twins``. ``docs/twins.md`` gives the answers, ``docs/twins-tables.md`` the tables of every setting. Both
need the first three studies; ``currents`` gives their sections on the current, by itself too; the last gives
``docs/estimators.md`` and the README's claim about accuracy. A page or section whose studies are not in the folder is
left as it is.
"""

import json
import shutil
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from benchmarks.command_line import positional
from benchmarks.sections import section_of, with_section
from gliderhpc.estimation.current_errors import TERMS
from gliderhpc.findings.comparison import COLUMNS, NUMBER_COLUMNS, comparison_from_json
from gliderhpc.findings.formatting import markdown, number
from gliderhpc.studies.library.scores import COVERAGE
from gliderhpc.twins.currents.runs import GUSTS as BROADBAND
from gliderhpc.twins.estimators.page import claim, page_text
from gliderhpc.vocabulary import CHANNELS

STUDIES = ("windows", "sensitivity", "recoverability")
CURRENTS = "currents"
ESTIMATORS = "estimators"
PAGES = ("twins.md", "twins-tables.md")
"""Pages, and their templates, of the answers and of the tables of every setting."""
CURRENT_SECTIONS = ("currents.md", "currents-tables.md")
"""Templates of the sections on the current, in the same order."""
ROOT = Path(__file__).resolve().parents[1]
Row = dict[str, Any]
Cells = tuple[str, ...]

WINDOW_SCORES = {
    "rmse_B_cr": "yaw, N m", "rmse_B_cu": "surge, N", "rmse_B_cq": "pitch, N m", "overall": "all, relative",
    "cost_per_30s": "cost per 30 s", "iterations": "iterations", "capped": "at the iteration limit", "seam_ratio": "seam ratio",
    "jump_ratio": "jump ratio",
}  # fmt: skip
TRANSFER_SCORES = {
    "gain_current": "gain on the current",
    "gain_rate": "gain on the forcing, s",
    "phase": "phase, degree",
    "coherence": "coherence",
}
SAMPLING = {
    "sample interval": "with a sample every {} s: {}",
    "dropout": "with a fraction {} of the samples missing: {}",
    "gap": "with gaps of {} s: {}",
}
"""Sweeps of the sampling, with their words."""
_ABSENT = number(None)
SWEEPS = {
    "sliding": "overlapping", "not sliding": "non-overlapping", "margin": "margin", "tau_c": "tau_c",
    "tolerance": "tolerance", "scale of yaw": "scale of yaw", "scale of the others": "scale of the others",
}  # fmt: skip


def read(folder: Path, study: str) -> Row:
    """Read a study."""
    content: Row = json.loads((folder / f"{study}.json").read_text("utf-8"))
    return content


def has_study(folder: Path, study: str) -> bool:
    """Return whether a folder holds a study."""
    return (folder / f"{study}.json").exists()


def made_by(content: Row) -> str:
    """Describe the origin of a study."""
    size = "--quick" if content["quick"] else "full size"
    hulls = ", ".join(content["platforms"])
    return f"`gliderhpc twin {content['study']}`, {size}, {len(content['seeds'])} twins of {hulls}."


def comparisons(content: Row) -> list[tuple[str, str]]:
    """Titles and tables of the paper's figures compared with ours."""
    return [
        (title, markdown(COLUMNS, (comparison_from_json(row).cells for row in rows), NUMBER_COLUMNS))
        for title, rows in content["comparisons"].items()
    ]


def cases_of(content: Row) -> dict[str, list[Cells]]:
    """Cells of the comparisons with the paper, by case (hull and preset)."""
    return {title: [comparison_from_json(row).cells for row in rows] for title, rows in content["comparisons"].items()}


def case_table(cases: Mapping[str, Sequence[Cells]], also: str = "") -> str:
    """One column of values for each case, with the quantities for which the paper states a figure.

    Parameters
    ----------
    cases : mapping of str to sequence of tuple
        Cells of the comparisons, in the order of `COLUMNS`, by case.
    also : str, optional
        Beginning of the names of further quantities.
    """
    quantity, unit, paper, ours = range(4)
    shown: dict[str, Cells] = {}
    values: dict[tuple[str, str], str] = {}
    for case, rows in cases.items():
        for cells in rows:
            values[cells[quantity], case] = cells[ours]
            if cells[paper] != _ABSENT or (also and cells[quantity].startswith(also)):
                shown.setdefault(cells[quantity], cells)
    lines = [
        (name, cells[unit], cells[paper], *(values.get((name, case), _ABSENT) for case in cases))
        for name, cells in shown.items()
    ]
    return markdown(("quantity", "unit", "paper's figure", *cases), lines, ("paper's figure", *cases))


def sampling_sentences(cases: Mapping[str, Sequence[Cells]]) -> list[str]:
    """Error of the yaw moment against interval, loss and gaps of the samples, one sentence for each preset."""
    ending = ": yaw RMSE"
    sentences = []
    for case, rows in cases.items():
        values = {cells[0].removesuffix(ending): cells[3] for cells in rows if cells[0].endswith(ending)}
        parts = []
        for sweep, words in SAMPLING.items():
            figures = {
                name.removeprefix(f"{sweep} "): value for name, value in values.items() if name.startswith(sweep)
            }
            if figures:
                parts.append(words.format(", ".join(figures), ", ".join(figures.values())))
        sentences.append("; ".join([f"{case}: RMSE of the yaw moment {values['usual twin']} N m", *parts]) + ".")
    return sentences


def sweep_table(content: Row, hull: str, preset: str) -> str:
    """Medians of every setting of one hull and preset."""
    rows = [
        [f"{label} {line['value']:g}", *(number(line[name]) for name in WINDOW_SCORES)]
        for sweep, label in SWEEPS.items()
        for line in content["summary"]
        if line["hull"] == hull and line["preset"] == preset and line["sweep"] == sweep
    ]
    return markdown(("setting", *WINDOW_SCORES.values()), rows)


def bias_table(rows: Iterable[Row], suffix: str = "") -> str:
    """Shifts of the six channels, dive and climb."""
    cells = [
        [
            f"{row['sweep']}: {row['value']}",
            row["phase"],
            *(number(row[f"{name}{suffix}"]) for name in CHANNELS),
            number(row["velocity_along_rms"]),
        ]
        for row in rows
    ]
    return markdown(("error", "phase", *CHANNELS, "along track, m/s"), cells)


def biases(content: Row) -> list[tuple[str, str, str]]:
    """Presets, and the tables of their shifts by offsets and by coefficients."""
    tables = []
    for preset in dict.fromkeys(row["preset"] for row in content["biases"]):
        ours = [row for row in content["biases"] if row["preset"] == preset]
        offsets = [row for row in ours if row["sweep"].startswith("offset")]
        coefficients = [row for row in ours if row["sweep"] in ("one coefficient", "coefficients")]
        tables.append((preset, bias_table(offsets), bias_table(coefficients, "_rms")))
    return tables


def detection_matrix(rows: Sequence[Row], preset: str, score: str) -> str:
    """One score of the impulses, amplitudes down and widths across."""
    ours = {(row["amplitude"], row["width"]): row[score] for row in rows if row["preset"] == preset}
    amplitudes, widths = (sorted({key[i] for key in ours}) for i in (0, 1))
    cells = [[f"{a:g}", *(number(ours.get((a, w))) for w in widths)] for a in amplitudes]
    return markdown(("amplitude, N m", *(f"{width:g} s" for width in widths)), cells)


def error_table(errors: Sequence[Row]) -> str:
    """Axial offset, velocity error and fitted terms by preset and coefficients."""
    names = [name for name in errors[0] if name not in ("preset", "model")]
    cells = [
        [f"{row['preset']}, coefficients {row['model']}", *(number(row[name]) for name in names)] for row in errors
    ]
    return markdown(("twins", *names), cells)


def budget_table(budget: Row) -> str:
    """Figures of the budget."""
    figures = [[name, number(value)] for name, value in budget.items() if isinstance(value, float)]
    return markdown(("key of `budget.yaml`", "value"), figures)


def coverage_table(content: Row, speed: str | None = None) -> str:
    """Shares inside the ellipses, by constants and speed; by constants alone for one speed."""
    rows = [
        [
            line["constants"],
            *(() if speed else (line["speed"],)),
            str(line["twins"]),
            *(f"{line[f'inside_{sigma}']:.3f} ± {line[f'inside_{sigma}_error']:.3f}" for sigma in COVERAGE),
            number(line["area"]),
            number(line["error_median"]),
            line["verdict"],
        ]
        for line in content["coverage"]
        if speed in (None, line["speed"])
    ]
    shares = (f"within {sigma} sigma (nominal {share:g})" for sigma, share in COVERAGE.items())
    named = ("constants", *(() if speed else ("current",)), "twins")
    return markdown((*named, *shares, "area, m2/s2", "median error, m/s", "verdict"), rows)


def constants_table(content: Row) -> str:
    """Constants of the ellipses."""
    rows = [[name, *(number(values[term]) for term in TERMS)] for name, values in content["constants"].items()]
    return markdown(("constants", *TERMS), rows)


def transfer_table(content: Row, preset: str) -> str:
    """Gain, phase and coherence of the broadband water, by vertical scale."""
    rows = [
        [
            f"{line['world']} x {line['factor']:g}",
            f"{line['scale_low']:.2g} to {line['scale_high']:.2g}",
            *(number(line[name]) for name in TRANSFER_SCORES),
        ]
        for line in content["transfer"]
        if line["preset"] == preset and line["world"] == BROADBAND
    ]
    return markdown(("water", "vertical scale, m", *TRANSFER_SCORES.values()), rows)


def render(template: str, **values: Any) -> str:
    """Render a template of the folder ``templates``."""
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).with_name("templates")),
        # Markdown, not HTML: what is inserted comes from the studies' own JSON.
        autoescape=False,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=StrictUndefined,
    )
    tables = (bias_table, biases, budget_table, case_table, comparisons, constants_table, coverage_table)
    others = (cases_of, detection_matrix, error_table, made_by, sampling_sentences, sweep_table, transfer_table)
    environment.filters |= {function.__name__: function for function in (*tables, *others)}
    environment.filters |= {
        "g": "{:g}".format,
        "number": number,
        "one_line": lambda text: " ".join(text.split()) + "\n",
    }
    return environment.get_template(template).render(values).rstrip()


def write_currents(folder: Path, docs: Path) -> None:
    """Put the sections on the current into the pages of the twins, and copy their figure and budget."""
    content = read(folder, CURRENTS)
    for name, template in zip(PAGES, CURRENT_SECTIONS, strict=True):
        page = docs / name
        section = render(template, content=content, spreads=content["size"]["spreads"], **content)
        page.write_text(with_section(page.read_text("utf-8"), CURRENTS, section), "utf-8")
    budget = folder / "currents_budget.yaml"
    copy_figures(docs, [folder / f"{CURRENTS}.png", *([budget] if budget.exists() else [])])


def write_twins(folder: Path, docs: Path) -> None:
    """Write the pages on windows, sensitivity and recoverability, and copy the figures.

    The sections on the current are left as they are.
    """
    studies = {study: read(folder, study) for study in STUDIES}
    copy_figures(docs, [folder / f"{study}.png" for study in STUDIES] + [folder / "budget.yaml"])
    for name in PAGES:
        page = docs / name
        currents = section_of(page.read_text("utf-8"), CURRENTS) if page.exists() else None
        page.write_text(render(name, currents=currents, **studies) + "\n", "utf-8")


def write_estimators(folder: Path, docs: Path, readme: Path) -> None:
    """Write the page on the estimators, copy its figure, and put its claim into the README."""
    content = read(folder, ESTIMATORS)
    copy_figures(docs, [folder / f"{ESTIMATORS}.png"])
    (docs / f"{ESTIMATORS}.md").write_text(page_text(content, f"twins/{ESTIMATORS}.png"), "utf-8")
    readme.write_text(with_section(readme.read_text("utf-8"), ESTIMATORS, claim(content)), "utf-8")


def copy_figures(docs: Path, files: Iterable[Path]) -> None:
    """Copy files to the folder that the pages refer to."""
    (docs / "twins").mkdir(parents=True, exist_ok=True)
    for file in files:
        shutil.copy(file, docs / "twins" / file.name)


def main(folder: Path, docs: Path, readme: Path) -> None:
    """Write the pages of the studies in a folder."""
    twins, estimators = all(has_study(folder, study) for study in STUDIES), has_study(folder, ESTIMATORS)
    if twins:
        write_twins(folder, docs)
    currents = has_study(folder, CURRENTS)
    if currents:
        write_currents(folder, docs)
    if estimators:
        write_estimators(folder, docs, readme)
    if not (twins or currents or estimators):
        sys.exit(
            f"{folder}: neither {', '.join(STUDIES)} nor {CURRENTS} nor {ESTIMATORS}; `gliderhpc twin STUDY --out "
            f"{folder}` creates them"
        )


if __name__ == "__main__":
    main(
        positional(__doc__, folder={"type": Path, "nargs": "?", "default": Path("twins")}).folder,
        ROOT / "docs",
        ROOT / "README.md",
    )
