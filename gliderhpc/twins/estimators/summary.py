"""Scores of the estimators over the twins: one line a kind of twin and estimator."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from gliderhpc.studies.library.scores import rms
from gliderhpc.twins.estimators.arms import ARMS, Arm
from gliderhpc.twins.estimators.scoring import PHASES
from gliderhpc.twins.runs import Row
from gliderhpc.vocabulary import CHANNELS

_LABELS = ("kind", "arm", "seed", "outcome", "refused")


def summarise(rows: Sequence[Row]) -> list[Row]:
    """Summarise rows, in the order of the runs and of `ARMS`.

    Returns
    -------
    list of dict
        ``kind``, ``arm``, ``twins`` (that were answered), ``refused``, ``outcomes`` (how often each). Every score of
        the rows: its median, and ``..._low`` and ``..._high``, the quartiles; for ``coverage_...`` and ``converged``
        the mean instead of the median, so that twins count alike. ``offset_B_cu`` ...: root mean square of the mean
        error of every dive and every climb.
    """
    frame = pd.DataFrame(rows)
    if "refused" not in frame:
        frame["refused"] = None
    scores = [name for name in frame.columns if name not in _LABELS]
    lines = []
    for kind in dict.fromkeys(frame["kind"]):
        for arm in ARMS:
            group = frame[(frame["kind"] == kind) & (frame["arm"] == arm.name)]
            if len(group):
                lines.append({"kind": kind, "arm": arm.name} | _line(group, scores))
    return lines


def _line(group: pd.DataFrame, scores: Sequence[str]) -> Row:
    answered = group[group["refused"].isna()]
    line: Row = {"twins": len(answered), "refused": len(group) - len(answered)}
    line["outcomes"] = {str(name): int(count) for name, count in answered["outcome"].value_counts().items() if name}
    for name in scores:
        known = answered[name].to_numpy(dtype=np.float64)
        known = known[np.isfinite(known)]
        if not known.size:
            line[name] = line[f"{name}_low"] = line[f"{name}_high"] = float("nan")
            continue
        low, middle, high = (float(value) for value in np.percentile(known, (25.0, 50.0, 75.0)))
        averaged = name.startswith("coverage") or name == "converged"
        line[name], line[f"{name}_low"], line[f"{name}_high"] = float(known.mean()) if averaged else middle, low, high
    for channel in CHANNELS:
        biases = answered[[f"bias_{phase}_{channel}" for phase in PHASES]].to_numpy(dtype=np.float64)
        line[f"offset_{channel}"] = rms(biases.ravel())
    return line


def paired(rows: Sequence[Row], kind: str, score: str, arms: Sequence[Arm] = ARMS) -> pd.DataFrame:
    """One score of a kind of twin, a row a seed and a column an estimator; only twins for which all of them have it."""
    seeds = dict.fromkeys(row["seed"] for row in rows if row["kind"] == kind)
    table = pd.DataFrame(np.nan, index=list(seeds), columns=[arm.name for arm in arms])
    for row in rows:
        if row["kind"] == kind and row["arm"] in table.columns:
            table.loc[row["seed"], row["arm"]] = row.get(score, np.nan)
    return table.dropna()
