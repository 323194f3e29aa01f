"""Group ``intermittency``: its variables, and the names of its curves by lag and by order."""

from typing import NamedTuple

from gliderhpc.store_schema.schema import PROFILE, Group, Variable, index_coordinate, of_profile, profile_coordinate
from gliderhpc.store_schema.studies.turbulence import (
    STATISTICS,
    actuated_column,
    interval_columns,
    interval_variables,
    surrogate_columns,
)

RANGE = "range"
"""Dimension of the ranges of lags that exponents are fitted over."""


class CurveColumns(NamedTuple):
    """Variables of a curve: its values, the ends of their 95 % interval, the surrogates' envelope."""

    value: str
    low: str
    high: str
    surrogate_least: str
    surrogate_most: str


def _curve_columns(name: str) -> CurveColumns:
    return CurveColumns(name, *interval_columns(name), *surrogate_columns(name))


FLATNESS_BY_LAG = _curve_columns("flatness_by_lag")
"""Flatness of the increments on dimension ``lag``."""

ZETA = _curve_columns("zeta")
"""Relative scaling exponents on dimension ``order``."""

RANGE_STATISTICS = ("zeta_ratio", *interval_columns("zeta_ratio"))
"""Statistics of a profile over each range of lags."""


def range_column(statistic: str) -> str:
    """Return the variable of a statistic of `RANGE_STATISTICS` on dimension ``range``: ``range_NAME``."""
    return f"range_{statistic}"


def _curve_variable(dim: str, name: str, long_name: str, units: str = "1") -> Variable:
    return Variable(name, (PROFILE, dim), "float64", units, long_name)


def _curve_variables(dim: str, columns: CurveColumns, long_name: str) -> tuple[Variable, ...]:
    long_names = (
        long_name,
        f"lower end of the 95 % interval of {columns.value}",
        f"upper end of the 95 % interval of {columns.value}",
        f"least {columns.value} of the surrogates",
        f"largest {columns.value} of the surrogates",
    )
    return tuple(_curve_variable(dim, name, text) for name, text in zip(columns, long_names, strict=True))


def _envelope_variables(name: str) -> tuple[Variable, ...]:
    least, most = surrogate_columns(name)
    return (
        of_profile(least, "1", f"least {name} of the surrogates"),
        of_profile(most, "1", f"largest {name} of the surrogates"),
    )


def _range_variable(statistic: str, long_name: str) -> Variable:
    return Variable(range_column(statistic), (PROFILE, RANGE), "float64", "1", long_name, whole=True)


def intermittency_group() -> Group:
    """Declare group ``intermittency``."""
    ratio, ratio_low, ratio_high = RANGE_STATISTICS
    return Group(
        "intermittency",
        "increments of a disturbance's fast part beside surrogates of the same spectrum (section 5.3, Table 3 and "
        "Figure 6 of the paper)",
        (
            profile_coordinate(),
            index_coordinate("lag", "number of the lag, from 0"),
            index_coordinate("order", "order of the structure function, less one"),
            index_coordinate(RANGE, "number of the range of lags, from 0; that of the settings is the first"),
            of_profile("message", "1", "why there are no statistics, or what to mind about them", dtype="string"),
            of_profile("nyquist", "Hz", "highest frequency that the records resolve"),
            of_profile("counted", "1", "part of the samples that count"),
            of_profile("stretches", "1", "unbroken stretches of these"),
            *(of_profile(name, "1", long_name) for name, long_name in STATISTICS.items()),
            *(
                of_profile(actuated_column(name), "1", f"{long_name}, actuated samples included")
                for name, long_name in STATISTICS.items()
            ),
            *interval_variables("flatness"),
            *interval_variables("zeta_ratio"),
            of_profile("zeta_ratio_least", "1", "least zeta_ratio over the ranges of lags that were tried"),
            of_profile("zeta_ratio_most", "1", "largest zeta_ratio over the ranges of lags that were tried"),
            of_profile("p_value", "1", "one-sided p of the exact rank test of the flatness among the surrogates'"),
            of_profile(actuated_column("p_value"), "1", "the same, actuated samples included"),
            *_envelope_variables("flatness"),
            *_envelope_variables("zeta_ratio"),
            of_profile("surrogate_iterations", "1", "median of the surrogates' iterations"),
            of_profile("surrogate_converged", "1", "part of the surrogates that converged"),
            of_profile("surrogate_deviation", "1", "root mean square deviation of power in half-octave bands, median"),
            of_profile("surrogate_deviation_most", "1", "largest deviation of power in any such band, any surrogate"),
            _curve_variable("lag", "lag_time", "lag of the increments", "s"),
            *_curve_variables("lag", FLATNESS_BY_LAG, "flatness of the increments"),
            *_curve_variables("order", ZETA, "relative scaling exponent zeta_p / zeta_3"),
            Variable("range_from", (RANGE,), "float64", "s", "least lag of the range"),
            Variable("range_to", (RANGE,), "float64", "s", "greatest lag of the range"),
            _range_variable(ratio, "zeta_ratio over the range"),
            _range_variable(ratio_low, "lower end of the 95 % interval of it"),
            _range_variable(ratio_high, "upper end of the 95 % interval of it"),
        ),
    )
