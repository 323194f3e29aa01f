"""Group ``nulls``: its variables, and the families of nulls."""

from gliderhpc.store_schema.schema import Dtype, Group, Variable, index_coordinate, profile_coordinate
from gliderhpc.store_schema.studies.turbulence import STATISTICS

NULL, COEFFICIENT = "null", "coefficient"
"""Dimensions: the realisations, and the coefficients that are drawn, by name."""

NOISE_ONLY, MODEL_ERROR, GAUSSIAN = "noise_only", "model_error", "gaussian"
FAMILIES = (NOISE_ONLY, MODEL_ERROR, GAUSSIAN)
"""Values of `family`."""

# The long name that archives of schema 1.5 carry in this group.
_STATISTICS = STATISTICS | {"beta_resolved": "exponent on the part of the band that the records resolve"}


def _null_variable(name: str, units: str, long_name: str, dtype: Dtype = "float64") -> Variable:
    return Variable(name, (NULL,), dtype, units, long_name)


REALISATIONS = (
    _null_variable("family", "1", "noise_only, model_error or gaussian", "string"),
    _null_variable("message", "1", "why the realisation has no statistics, or what to mind about it", "string"),
    _null_variable("source_profile", "1", "profile whose actuation was flown"),
    _null_variable("realisation_seed", "1", "number that the realisation's draws follow from"),
    _null_variable("duration", "s", "time flown"),
    _null_variable("max_depth", "m", "greatest depth that was flown"),
    _null_variable("converged_fraction", "1", "part of the inversion's windows that converged"),
    *(_null_variable(name, "1", long_name) for name, long_name in _STATISTICS.items()),
    _null_variable("p_value", "1", "one-sided p of the rank test of the flatness among the null's own surrogates'"),
)
"""Variables with one value a realisation, in the order of the table of nulls."""


def nulls_group() -> Group:
    """Declare group ``nulls``."""
    return Group(
        "nulls",
        "missions without turbulence, flown under recorded actuation and inverted as the archive was (section 5.3)",
        (
            profile_coordinate(),
            index_coordinate(NULL, "number of the realisation, from 0"),
            Variable(COEFFICIENT, (COEFFICIENT,), "string", "1", "name of the coefficient that is drawn"),
            *REALISATIONS,
            Variable("factor", (NULL, COEFFICIENT), "float64", "1", "true coefficient over the platform file's"),
        ),
    )
