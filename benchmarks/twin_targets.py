"""Targets of the estimators, compared with the results of ``gliderhpc twin estimators`` and ``currents``.

Usage, after ``gliderhpc twin estimators --out twins`` or ``gliderhpc twin currents --out twins``: ``python -m
benchmarks.twin_targets twins`` prints every target with its bounds and the value found.
"""

import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from benchmarks.command_line import positional
from gliderhpc.findings.formatting import markdown, number
from gliderhpc.twins.estimators.methods import ADJOINT, PAPER, SMOOTHER
from gliderhpc.twins.estimators.runs import CALM, IMPULSIVE, PRIOR, paired
from gliderhpc.twins.scoring import Row
from gliderhpc.twins.study import first
from gliderhpc.vocabulary import CHANNELS

EXACT = (CALM, IMPULSIVE)
"""Kinds of twin whose hull the estimators know exactly, at the platform's own sample interval."""

RMSE_BOUNDS = (
    ("B_cr", PAPER, 0.5),
    ("B_cu", PAPER, 0.25),
    ("B_cq", PAPER, 0.25),
    ("B_cr", ADJOINT, 0.6),
    *((name, ADJOINT, 1.0) for name in CHANNELS if name != "B_cr"),
)
"""Channel, estimator and largest ratio of the smoother's RMSE to that estimator's."""

COVERAGE_BOUNDS = {"68": (0.62, 0.74), "95": (0.92, 0.97)}
"""Bounds of the coverage of the smoother's intervals on twins drawn from the prior, in every channel with a signal."""

MAX_CURRENT_ERROR = 0.03
"""Largest median error of the depth-averaged current, m/s."""

CURRENT_ERROR = "error of the depth-averaged current, median"
"""Quantity of the study's table of comparisons."""


@dataclass(frozen=True)
class Target:
    """One target.

    Attributes
    ----------
    kind, quantity : str
        Kind of twin, and quantity.
    value : float
        Value found.
    least, most : float
        Bounds of the target.
    remark : str
        Origin of the value.
    """

    kind: str
    quantity: str
    value: float
    least: float
    most: float
    remark: str

    @property
    def met(self) -> bool:
        """True where the value lies within the bounds; False where there is none."""
        return self.least <= self.value <= self.most


def targets(rows: Sequence[Row], summary: Sequence[Row]) -> list[Target]:
    """Every target, from the rows of the study and their summary."""
    found = [target for kind in EXACT for target in _rmse_targets(rows, summary, kind)]
    return [*found, *_coverage_targets(summary)]


def has_signal(line: Row, channel: str) -> bool:
    """Return whether a channel's truth exceeds the mean standard deviation: otherwise its interval is the prior's."""
    return bool(line.get(f"truth_{channel}", np.nan) > line.get(f"width_{channel}", np.nan))


def _rmse_targets(rows: Sequence[Row], summary: Sequence[Row], kind: str) -> Iterator[Target]:
    for channel, estimator, most in RMSE_BOUNDS:
        score = f"rmse_{channel}"
        ours, theirs = (first(summary, kind=kind, arm=name) for name in (SMOOTHER.name, estimator.name))
        medians = [line.get(score, np.nan) for line in (ours, theirs)]
        silent = " (truth zero)" if ours.get(f"truth_{channel}") == 0.0 else ""
        table = paired(rows, kind, score, (SMOOTHER, estimator))
        met = int((table[SMOOTHER.name] <= most * table[estimator.name]).sum())
        yield Target(
            kind,
            f"{channel} RMSE over that of {estimator.label}{silent}",
            medians[0] / medians[1],
            0.0,
            most,
            f"medians {number(medians[0])} and {number(medians[1])} {CHANNELS[channel][0]}; met in {met} of "
            f"{len(table)} twins",
        )


def _coverage_targets(summary: Sequence[Row]) -> Iterator[Target]:
    line = first(summary, kind=PRIOR, arm=SMOOTHER.name)
    for channel in CHANNELS:
        if not has_signal(line, channel):
            continue
        for label, (least, most) in COVERAGE_BOUNDS.items():
            yield Target(
                PRIOR,
                f"{channel} coverage of {label} % intervals",
                line[f"coverage_{label}_{channel}"],
                least,
                most,
                f"mean over {line['twins']} twins; mean width {number(line[f'width_{channel}'])}, "
                f"truth {number(line[f'truth_{channel}'])} {CHANNELS[channel][0]}",
            )


def describe_targets(found: Sequence[Target]) -> str:
    """Describe how many targets are met, by the kind of twin."""
    counts = []
    for kind in dict.fromkeys(target.kind for target in found):
        met = [target.met for target in found if target.kind == kind]
        counts.append(f"{sum(met)} of {len(met)} on the twins *{kind}*")
    return f"Targets met: {', '.join(counts)}."


def target_table(found: Sequence[Target]) -> str:
    """Lay every target out with its bounds."""
    rows = [
        [
            target.kind,
            target.quantity,
            f"{target.least:g} to {target.most:g}" if target.least > 0.0 else f"at most {target.most:g}",
            number(target.value),
            "met" if target.met else "**not met**",
            target.remark,
        ]
        for target in found
    ]
    return markdown(("twins", "quantity", "target", "found", "", "origin"), rows, ("found",))


def current_target(comparisons: Mapping[str, Sequence[Row]]) -> Target:
    """Target of the depth-averaged current, from the comparisons of the study's JSON."""
    row = next(row for table in comparisons.values() for row in table if row["quantity"] == CURRENT_ERROR)
    return Target("drawn", CURRENT_ERROR, row["ours"], 0.0, MAX_CURRENT_ERROR, row["remark"])


def main(folder: Path) -> None:
    """Print the targets from the files of the studies in a folder."""
    found: list[Target] = []
    if (folder / "estimators.json").exists():
        rows = pd.read_csv(folder / "estimators.csv").to_dict("records")
        summary = _content(folder, "estimators")["summary"]
        found += targets([{str(name): value for name, value in row.items()} for row in rows], _with_missing(summary))
    if (folder / "currents.json").exists():
        found.append(current_target(_content(folder, "currents")["comparisons"]))
    if not found:
        sys.exit(
            f"{folder}: neither estimators.json nor currents.json; `gliderhpc twin STUDY --out {folder}` creates them"
        )
    print(f"{target_table(found)}\n\n{describe_targets(found)}")


def _content(folder: Path, study: str) -> Row:
    content: Row = json.loads((folder / f"{study}.json").read_text("utf-8"))
    return content


def _with_missing(summary: Sequence[Row]) -> list[Row]:
    """Return lines whose missing scores, null in JSON, are NaN."""
    return [{name: np.nan if value is None else value for name, value in line.items()} for line in summary]


if __name__ == "__main__":
    main(positional(__doc__, folder={"type": Path, "nargs": "?", "default": Path("twins")}).folder)
