"""What study ``nulls`` adds to an archive."""

from gliderhpc.store_schema.schema import Dtype, Group, Variable, index_coordinate, profile_coordinate

NULL, COEFFICIENT = "null", "coefficient"
"""Dimensions: the realisations, and the coefficients that are drawn, by name."""


def _of_null(name: str, units: str, long_name: str, dtype: Dtype = "float64") -> Variable:
    return Variable(name, (NULL,), dtype, units, long_name)


def nulls_group() -> Group:
    """Declare group ``nulls``."""
    return Group(
        "nulls",
        "missions without turbulence, flown under recorded actuation and inverted as the archive was (section 5.3)",
        (
            profile_coordinate(),
            index_coordinate(NULL, "number of the realisation, from 0"),
            Variable(COEFFICIENT, (COEFFICIENT,), "string", "1", "name of the coefficient that is drawn"),
            _of_null("family", "1", "noise_only, model_error or gaussian", "string"),
            _of_null("message", "1", "why the realisation has no statistics, or what to mind about it", "string"),
            _of_null("source_profile", "1", "profile whose actuation was flown"),
            _of_null("realisation_seed", "1", "number that the realisation's draws follow from"),
            _of_null("duration", "s", "time flown"),
            _of_null("max_depth", "m", "greatest depth that was flown"),
            _of_null("converged_fraction", "1", "part of the inversion's windows that converged"),
            _of_null("flatness", "1", "flatness of the increments over the lag of the test"),
            _of_null("zeta_ratio", "1", "relative scaling exponent zeta_6 / zeta_3"),
            _of_null("kurtosis", "1", "kurtosis (3 for Gaussian) of the fast part"),
            _of_null("peak", "1", "largest magnitude of the fast part, in the channel's unit (N or N m)"),
            _of_null("rms", "1", "root mean square of the fast part, in the channel's unit (N or N m)"),
            _of_null("beta", "1", "exponent of the spectrum on the band of the fit"),
            _of_null("beta_resolved", "1", "exponent on the part of the band that the records resolve"),
            _of_null("p_value", "1", "one-sided p of the rank test of the flatness among the null's own surrogates'"),
            Variable("factor", (NULL, COEFFICIENT), "float64", "1", "true coefficient over the platform file's"),
        ),
    )
