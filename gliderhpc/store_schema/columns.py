"""Names of the columns that studies add to an archive, by quantity, phase, estimate, part or statistic.

The table ``studies.txt`` spells out every name. Studies, tables and figures derive the names of families of columns
with the functions of this module; a search for such a function finds every place that writes or reads the column.
"""

from typing import NamedTuple

from gliderhpc.store_schema.schema import STUDIES

# Study `reconstruction`.


def tracked_column(prefix: str, quantity: str) -> str:
    """Return the name of a tracked quantity's residual: ``steady_roll``, ``open_loop_adjoint_depth``."""
    return f"{prefix}_{quantity}"


def regime_column(estimator: str, regime: str, statistic: str) -> str:
    """Return the name of a statistic of the yaw moment: ``yaw_prior_resting_std``."""
    return f"yaw_{estimator}_{regime}_{statistic}"


def truth_column(name: str) -> str:
    """Return the name of a value, by channel and estimator, of the comparison with a truth: ``truth_lag``."""
    return f"truth_{name}"


def impulse_column(name: str) -> str:
    """Return the name of a value of a true impulse: ``impulse_amplitude``."""
    return f"impulse_{name}"


# Study `currents`.

CURRENT_PHASES = ("dive", "climb", "both")


def component_column(name: str, component: str) -> str:
    """Return the name of a component: ``current_north``, ``both_shear_east``."""
    return f"{name}_{component}"


def bin_column(phase: str, kind: str) -> str:
    """Return the name, without component, of a value of a phase's bins: ``dive_count``, ``both_shear_noise_std``."""
    return f"{phase}_{kind}"


# Study `vertical`.


def leg_column(name: str, leg: str) -> str:
    """Return the name of a value of a profile's dive or climb: ``mean_dive``."""
    return f"{name}_{leg}"


def effect_column(parameter: str, leg: str) -> str:
    """Return the name of the change of a leg's mean due to a parameter of the hull: ``by_K_D0_climb``."""
    return leg_column(f"by_{parameter}", leg)


# The studies of turbulence: `spectra`, `intermittency` and `nulls`.


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


WHOLE = "whole"

PARTS = (WHOLE, "shallow", "middle", "deep")
"""Parts of a profile that have a spectrum: the whole, then the thirds by depth from the top."""

BETA, BETA_RESOLVED = "beta", "beta_resolved"
"""Exponents of a fit over its band, and over the part of the band that the records resolve."""


class ExtentColumns(NamedTuple):
    """Columns of the depths that a part of a profile spans, and of its number of Welch segments."""

    shallowest: str
    deepest: str
    segments: str


class FitColumns(NamedTuple):
    """Columns of a power law: its exponent, the ends of its 95 % interval, and the coefficient of determination."""

    exponent: str
    low: str
    high: str
    r2: str


def extent_columns(part: str) -> ExtentColumns:
    """Return the columns of the extent of a part of `PARTS`: ``PART_from``, ``PART_to`` and ``PART_segments``."""
    return ExtentColumns(f"{part}_from", f"{part}_to", f"{part}_segments")


def fit_columns(exponent: str, part: str | None = WHOLE) -> FitColumns:
    """Return the columns of the fit of exponent `BETA` or `BETA_RESOLVED`.

    For part ``whole`` and exponent `BETA` they are ``whole_beta``, ``whole_beta_low``, ``whole_beta_high`` and
    ``whole_beta_r2``. Without a part the fit is that of the whole profile with actuated samples included: ``beta_all``,
    ``beta_all_low``, ``beta_all_high`` and ``beta_all_r2``.
    """
    name = actuated_column(exponent) if part is None else f"{part}_{exponent}"
    return FitColumns(name, *interval_columns(name), f"{name}_r2")


RANGE = "range"
"""Dimension of the ranges of lags over which exponents are fitted."""


class CurveColumns(NamedTuple):
    """Variables of a curve: its values, the ends of their 95 % interval, and the surrogates' envelope."""

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


NOISE_MOMENTS = ("noise_variance", "noise_kurtosis", "noise_independent", "noise_score")
"""Moments of the smoother's standardised noise on dimension ``channel``."""

NULL, COEFFICIENT = "null", "coefficient"
"""Dimensions: the realisations, and the coefficients that are drawn, by name."""

NOISE_ONLY, MODEL_ERROR, GAUSSIAN = "noise_only", "model_error", "gaussian"
FAMILIES = (NOISE_ONLY, MODEL_ERROR, GAUSSIAN)
"""Values of `family`."""

REALISATIONS = tuple(variable for variable in STUDIES["nulls"].variables if variable.dims == (NULL,))[1:]
"""Variables with one value for each realisation, in the order of the table of nulls."""


# Study `events`.

EVENT = "event"
"""Dimension of the catalogue."""

MODEL = "model"
"""Dimension of the ocean models given to study `reanalysis`, by name."""

CATALOGUE = tuple(variable for variable in STUDIES["events"].variables if variable.dims == (EVENT,))[1:]
"""Variables with one value for each event, in the order of the catalogue."""


# Study `drift`.

CHANGE = "change"
"""Dimension of the change points."""

MOMENT_CHANGE = "moment_change"
"""Dimension of the change points of the moments."""

FORWARD_ERROR_COLUMN = "forward_rmse"
"""Name of the forward model's error in the study's table."""


def median_column(quantity: str, phase: str, estimate: str) -> str:
    """Return the name of a median: ``B_cu_dive_adjoint``."""
    return f"{quantity}_{phase}_{estimate}"


def phase_column(name: str, phase: str) -> str:
    """Return the name of a phase's value that is common to all estimates: ``count_dive``, ``weight_effect_climb``."""
    return f"{name}_{phase}"


def change_column(quantity: str, part: str, estimate: str, end: str = "") -> str:
    """Return the name of a change's size: ``K_D0_change_together_adjoint``; ``_low`` and ``_high`` end its interval."""
    return f"{quantity}_change_{part}_{estimate}{end}"


def moment_column(channel: str, phase: str, end: str = "") -> str:
    """Return the name of the size of a change of a moment: ``B_cp_change_dive``; ends as in `change_column`."""
    return f"{channel}_change_{phase}{end}"
