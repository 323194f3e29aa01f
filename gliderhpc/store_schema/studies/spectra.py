"""Group ``spectra``: its variables, and the names of the columns of its fits."""

from typing import NamedTuple

from gliderhpc.store_schema.schema import PROFILE, Group, Variable, index_coordinate, of_profile, profile_coordinate
from gliderhpc.store_schema.studies.turbulence import actuated_column, interval_columns, interval_variables

WHOLE = "whole"

PARTS = {
    WHOLE: "the whole profile",
    "shallow": "the shallowest third of the time",
    "middle": "the middle third of the time by depth",
    "deep": "the deepest third of the time",
}
"""Parts of a profile that have a spectrum of their own, in the order of the thirds by depth."""

BETA, BETA_RESOLVED = "beta", "beta_resolved"

BANDS = {BETA: "the band of the fit", BETA_RESOLVED: "the part of it that the records resolve"}
"""Bands of a fit by the name of its exponent."""


class ExtentColumns(NamedTuple):
    """Columns of the depths that a part of a profile spans, and of its number of Welch segments."""

    shallowest: str
    deepest: str
    segments: str


class FitColumns(NamedTuple):
    """Columns of a power law: its exponent, the ends of the 95 % interval, the coefficient of determination."""

    exponent: str
    low: str
    high: str
    r2: str


def extent_columns(part: str) -> ExtentColumns:
    """Return the columns of the extent of a part of `PARTS`: ``PART_from``, ``PART_to`` and ``PART_segments``."""
    return ExtentColumns(f"{part}_from", f"{part}_to", f"{part}_segments")


def fit_columns(exponent: str, part: str | None = WHOLE) -> FitColumns:
    """Return the columns of the fit of an exponent of `BANDS`.

    That of part ``whole`` over the band of the fit has ``whole_beta``, ``whole_beta_low``, ``whole_beta_high`` and
    ``whole_beta_r2``. Without a part the fit is that of the whole profile with actuated samples included: ``beta_all``,
    ``beta_all_low``, ``beta_all_high`` and ``beta_all_r2``.
    """
    name = actuated_column(exponent) if part is None else f"{part}_{exponent}"
    return FitColumns(name, *interval_columns(name), f"{name}_r2")


def _fit_variables(columns: FitColumns, description: str) -> tuple[Variable, ...]:
    return (
        of_profile(columns.exponent, "1", f"exponent of the spectrum, {description}"),
        *interval_variables(columns.exponent),
        of_profile(columns.r2, "1", f"coefficient of determination of the fit of {columns.exponent}"),
    )


def _part_variables(part: str, description: str) -> tuple[Variable, ...]:
    shallowest, deepest, segments = extent_columns(part)
    return (
        of_profile(shallowest, "m", f"least depth of {description}"),
        of_profile(deepest, "m", f"greatest depth of {description}"),
        of_profile(segments, "1", f"Welch segments of {description}"),
        *(
            variable
            for exponent, band in BANDS.items()
            for variable in _fit_variables(fit_columns(exponent, part), f"{description}, {band}")
        ),
    )


def _density(name: str, long_name: str) -> Variable:
    attributes = {"comment": "the square of the channel's unit (N or N m, attribute settings) per Hz"}
    return Variable(name, (PROFILE, "frequency"), "float64", "s", long_name, attributes=attributes)


def spectra_group() -> Group:
    """Declare group ``spectra``."""
    included = "actuated samples included"
    return Group(
        "spectra",
        "spectra of a disturbance's fast part and their exponents (section 5.3, Table 1 and Figure 4 of the paper)",
        (
            profile_coordinate(),
            index_coordinate("frequency", "number of the frequency, from 0"),
            of_profile("message", "1", "why there is no spectrum, or what to mind about it", dtype="string"),
            of_profile("group", "1", "group by the depth-averaged current", dtype="string"),
            of_profile("speed", "m s-1", "speed of the depth-averaged current"),
            of_profile("nyquist", "Hz", "highest frequency that the records resolve"),
            of_profile("counted", "1", "part of the samples that count"),
            of_profile("rms", "1", "root mean square of the fast part, in the channel's unit (N or N m)"),
            *(variable for part, name in PARTS.items() for variable in _part_variables(part, name)),
            *(
                variable
                for exponent, band in BANDS.items()
                for variable in _fit_variables(fit_columns(exponent, None), f"{band}, {included}")
            ),
            Variable("frequency_hz", (PROFILE, "frequency"), "float64", "Hz", "frequency"),
            _density("density", "one-sided power spectral density of the whole profile"),
            _density("density_all", f"the same, {included}"),
        ),
    )
