"""What the study's table says of the reference, where one was given."""

import pandas as pd

from gliderhpc.findings.comparison import Comparison
from gliderhpc.studies.library.current_difference import COVERAGE

_MEDIANS = (
    ("reference_difference", "m/s", "vector difference from the reference's depth-averaged current, median"),
    ("reference_correlation", "1", "lateral current by depth with the reference's, correlation, median"),
    ("reference_gradient_correlation", "1", "the same with the reference's change with depth"),
)


def reference_rows(table: pd.DataFrame) -> tuple[Comparison, ...]:
    """Rows on the reference; none without one. The publication has no such thing beside."""
    medians = [
        Comparison(said, unit, float(table[name].median()))
        for name, unit, said in _MEDIANS
        if name in table and table[name].notna().any()
    ]
    if "reference_distance" not in table:
        return tuple(medians)
    distance = table["reference_distance"].dropna()
    shares = [
        Comparison(
            f"reference within {sigma} sigma, share of profiles", "1", float((distance <= sigma).mean()),
            remark=f"{int((distance <= sigma).sum())} of {len(distance)}; {expected:.2f} if both errors are "
            "independent and normal",
        )
        for sigma, expected in COVERAGE.items()
    ]  # fmt: skip
    return (*medians, *shares)
