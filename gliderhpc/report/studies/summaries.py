"""Phrases for captions, and medians of columns, shared by the studies."""

from collections.abc import Sequence
from typing import Any

import pandas as pd

from gliderhpc.studies.archived import Provenance

ESTIMATES = {"adjoint": "the adjoint", "smoothed": "the smoother", "prior": "the filter"}
"""Names of the archive's estimates for use in a sentence."""


def describe_profiles(numbers: Sequence[int]) -> str:
    """Describe profiles: the only one, or their number and range."""
    if len(numbers) == 1:
        return f"profile {numbers[0]}"
    return f"{len(numbers)} profiles ({min(numbers)} to {max(numbers)})" if numbers else "no profile"


def describe_data(provenance: Provenance, used: Sequence[int] | None = None) -> str:
    """Describe the profiles in a figure or table, and whether it is a first look."""
    chosen = provenance.profiles if used is None else tuple(used)
    left_out = len(provenance.profiles) - len(chosen)
    text = describe_profiles(chosen)
    if left_out:
        text += f", {left_out} of {len(provenance.profiles)} left out"
    return f"{text}, quick study" if provenance.quick else text


def estimate_label(provenance: Provenance) -> str:
    """Name the estimate used in a study."""
    return ESTIMATES[provenance.estimate]


def shared_facts(provenance: Provenance) -> dict[str, Any]:
    """Return the first facts in the JSON of most studies: profiles, estimate and size."""
    return {"profiles": list(provenance.profiles), "estimate": provenance.estimate, "quick": provenance.quick}


def median_of(table: pd.DataFrame, name: str) -> float:
    """Return the median of a column, NaN if the table has no value."""
    return float(table[name].median()) if name in table and table[name].notna().any() else float("nan")
