"""What is asked of the smoother, held against what the twins show."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from gliderhpc.findings.tables import number
from gliderhpc.twins.estimators.arms import ADJOINT, PAPER, SMOOTHER
from gliderhpc.twins.estimators.cases import EXACT, PRIOR
from gliderhpc.twins.estimators.summary import paired
from gliderhpc.twins.runs import Row
from gliderhpc.vocabulary import CHANNELS

RMSE_BOUNDS = (
    ("B_cr", PAPER, 0.5),
    ("B_cu", PAPER, 0.25),
    ("B_cq", PAPER, 0.25),
    ("B_cr", ADJOINT, 0.6),
    *((name, ADJOINT, 1.0) for name in CHANNELS if name != "B_cr"),
)
"""Channel, estimator and largest ratio of the smoother's RMSE to that estimator's."""

COVERAGE_BOUNDS = {"68": (0.62, 0.74), "95": (0.92, 0.97)}
"""Of the smoother's intervals on twins drawn from the prior, every channel that carries signal."""


@dataclass(frozen=True)
class Target:
    """One figure that is asked for.

    Attributes
    ----------
    kind, quantity : str
        Where, and what.
    value : float
        What the twins show.
    least, most : float
        Between what it is asked to lie.
    remark : str
        How it came about.
    """

    kind: str
    quantity: str
    value: float
    least: float
    most: float
    remark: str

    @property
    def met(self) -> bool:
        """Whether it does; not where there is no figure."""
        return self.least <= self.value <= self.most


def targets(rows: Sequence[Row], summary: Sequence[Row]) -> list[Target]:
    """Every target, from the runs' rows and their summary."""
    found = [target for kind in EXACT for target in _rmse_targets(rows, summary, kind)]
    return [*found, *_coverage_targets(summary)]


def line_of(summary: Sequence[Row], kind: str, arm: str) -> Row:
    """Line of a kind of twin and an estimator; empty where there is none."""
    return next((line for line in summary if line["kind"] == kind and line["arm"] == arm), {})


def carries_signal(line: Row, channel: str) -> bool:
    """Whether a channel's truth exceeds the mean posterior standard deviation: else its interval is the prior's own."""
    return bool(line.get(f"truth_{channel}", np.nan) > line.get(f"width_{channel}", np.nan))


def _rmse_targets(rows: Sequence[Row], summary: Sequence[Row], kind: str) -> Iterator[Target]:
    for channel, arm, most in RMSE_BOUNDS:
        score = f"rmse_{channel}"
        ours, theirs = (line_of(summary, kind, name) for name in (SMOOTHER.name, arm.name))
        medians = [line.get(score, np.nan) for line in (ours, theirs)]
        silent = " (truth zero)" if ours.get(f"truth_{channel}") == 0.0 else ""
        table = paired(rows, kind, score, (SMOOTHER, arm))
        held = int((table[SMOOTHER.name] <= most * table[arm.name]).sum())
        yield Target(
            kind, f"{channel} RMSE over that of {arm.label}{silent}", medians[0] / medians[1], 0.0, most,
            f"medians {number(medians[0])} and {number(medians[1])} {CHANNELS[channel][0]}; "
            f"so in {held} of {len(table)} twins",
        )  # fmt: skip


def _coverage_targets(summary: Sequence[Row]) -> Iterator[Target]:
    line = line_of(summary, PRIOR, SMOOTHER.name)
    for channel in CHANNELS:
        if not carries_signal(line, channel):
            continue
        for label, (least, most) in COVERAGE_BOUNDS.items():
            yield Target(
                PRIOR, f"{channel} coverage of {label} % intervals", line[f"coverage_{label}_{channel}"], least, most,
                f"mean over {line['twins']} twins; mean width {number(line[f'width_{channel}'])}, "
                f"truth {number(line[f'truth_{channel}'])} {CHANNELS[channel][0]}",
            )  # fmt: skip
