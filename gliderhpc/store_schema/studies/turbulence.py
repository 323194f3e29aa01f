"""Column names and statistics that the groups of the turbulence studies share.

Schemas, studies, tables and figures all derive the name of a column by the functions here and in the schemas of the
studies, so that a search for such a function finds every place at which the column is declared, written or read.
"""

from typing import NamedTuple

from gliderhpc.store_schema.schema import Variable, of_profile

STATISTICS = {
    "flatness": "flatness of the increments over the lag of the test",
    "zeta_ratio": "relative scaling exponent zeta_6 / zeta_3",
    "kurtosis": "kurtosis (3 for Gaussian) of the fast part",
    "peak": "largest magnitude of the fast part, in the channel's unit (N or N m)",
    "rms": "root mean square of the fast part, in the channel's unit (N or N m)",
    "beta": "exponent of the spectrum on the band of the fit",
    "beta_resolved": "exponent of the spectrum on the part of the band that the records resolve",
}
"""Statistics of a fast part, measured or of a null, with their long names."""


class Ends(NamedTuple):
    """Columns of the two ends of an interval or of an envelope."""

    low: str
    high: str


def interval_columns(name: str) -> Ends:
    """Return the columns of the 95 % interval of a column: ``NAME_low`` and ``NAME_high``."""
    return Ends(f"{name}_low", f"{name}_high")


def surrogate_columns(name: str) -> Ends:
    """Return the columns of the surrogates' envelope: ``surrogate_NAME_least`` and ``surrogate_NAME_most``."""
    return Ends(f"surrogate_{name}_least", f"surrogate_{name}_most")


def actuated_column(name: str) -> str:
    """Return the column of a statistic with the actuated samples included: ``NAME_all``."""
    return f"{name}_all"


def interval_variables(name: str) -> tuple[Variable, Variable]:
    """Declare the ends of the 95 % interval of a column with one value a profile."""
    low, high = interval_columns(name)
    return (
        of_profile(low, "1", f"lower end of the 95 % interval of {name}"),
        of_profile(high, "1", f"upper end of the 95 % interval of {name}"),
    )
