"""Rows of ``twin estimators`` with given scores."""

from gliderhpc.twins.estimators.methods import ESTIMATORS
from gliderhpc.vocabulary import CHANNELS


def row(arm, seed, kind="impulsive", **scores):
    """A row with every score at one."""
    names = (
        *(f"{score}_{name}" for name in CHANNELS for score in ("rmse", "truth", "bias_dive", "bias_climb")),
        "converged",
    )  # fmt: skip
    return {"kind": kind, "arm": arm, "seed": seed, "outcome": "CONVERGED", **dict.fromkeys(names, 1.0), **scores}


def rows_of(values, score="rmse_B_cr"):
    """Rows of the impulsive twins; `values` gives a score a twin, by estimator."""
    others = {estimator.name: [9.0] * 4 for estimator in ESTIMATORS} | values
    return [row(arm, seed, **{score: value}) for arm, scores in others.items() for seed, value in enumerate(scores)]
