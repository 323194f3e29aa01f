"""The estimators' errors beside what the paper gives of its own."""

from gliderhpc.findings.comparison import Comparison
from gliderhpc.twins.estimators.arms import ARMS, PAPER
from gliderhpc.twins.estimators.cases import IMPULSIVE
from gliderhpc.twins.estimators.results import EstimatorsResults
from gliderhpc.twins.estimators.targets import line_of
from gliderhpc.vocabulary import CHANNELS

PAPERS_YAW = 0.15
"""The paper's yaw error with windows of 30 s, N m (section 5.1.2)."""


def compare_estimators(results: EstimatorsResults, kind: str) -> list[Comparison]:
    """Lay every estimator's RMSE on one kind of twin in a table; the paper has a figure for its own yaw moment."""
    rows = []
    for channel in ("B_cr", "B_cu", "B_cw", "B_cq"):
        for arm in ARMS:
            line = line_of(results.summary, kind, arm.name)
            if not line:
                continue
            paper = PAPERS_YAW if channel == "B_cr" and arm is PAPER and kind == IMPULSIVE else None
            score = f"rmse_{channel}"
            rows.append(
                Comparison(
                    f"{channel} RMSE, {arm.label}", CHANNELS[channel][0], line[score], paper,
                    (line[f"{score}_low"], line[f"{score}_high"]),
                )
            )  # fmt: skip
    return rows
