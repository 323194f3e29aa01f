"""What study ``intermittency`` adds to an archive."""

from gliderhpc.store_schema.schema import PROFILE, Group, Variable, index_coordinate, of_profile, profile_coordinate

RANGE = "range"
"""Dimension of the ranges of lags that exponents are fitted over."""

_STATISTICS = {
    "flatness": "flatness of the increments over the lag of the test",
    "zeta_ratio": "relative scaling exponent zeta_6 / zeta_3",
    "kurtosis": "kurtosis (3 for Gaussian) of the fast part",
    "peak": "largest magnitude of the fast part, in the channel's unit (N or N m)",
    "rms": "root mean square of the fast part, in the channel's unit (N or N m)",
    "beta": "exponent of the spectrum on the band of the fit",
    "beta_resolved": "exponent of the spectrum on the part of the band that the records resolve",
}


def _on(dim: str, name: str, long_name: str, units: str = "1") -> Variable:
    return Variable(name, (PROFILE, dim), "float64", units, long_name)


def _on_range(name: str, long_name: str) -> Variable:
    return Variable(name, (PROFILE, RANGE), "float64", "1", long_name, whole=True)


def _interval(name: str, what: str) -> tuple[Variable, ...]:
    return (
        of_profile(f"{name}_low", "1", f"lower end of the 95 % interval of {what}"),
        of_profile(f"{name}_high", "1", f"upper end of the 95 % interval of {what}"),
    )


def _envelope(name: str, what: str) -> tuple[Variable, ...]:
    return (
        of_profile(f"surrogate_{name}_least", "1", f"least {what} of the surrogates"),
        of_profile(f"surrogate_{name}_most", "1", f"largest {what} of the surrogates"),
    )


def _on_all(dim: str, name: str, what: str) -> tuple[Variable, ...]:
    return (
        _on(dim, name, what),
        _on(dim, f"{name}_low", f"lower end of the 95 % interval of {name}"),
        _on(dim, f"{name}_high", f"upper end of the 95 % interval of {name}"),
        _on(dim, f"surrogate_{name}_least", f"least {name} of the surrogates"),
        _on(dim, f"surrogate_{name}_most", f"largest {name} of the surrogates"),
    )


def intermittency_group() -> Group:
    """Declare group ``intermittency``."""
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
            *(of_profile(name, "1", what) for name, what in _STATISTICS.items()),
            *(of_profile(f"{name}_all", "1", f"{what}, actuated samples included")
              for name, what in _STATISTICS.items()),
            *_interval("flatness", "flatness"),
            *_interval("zeta_ratio", "zeta_ratio"),
            of_profile("zeta_ratio_least", "1", "least zeta_ratio over the ranges of lags that were tried"),
            of_profile("zeta_ratio_most", "1", "largest zeta_ratio over the ranges of lags that were tried"),
            of_profile("p_value", "1", "one-sided p of the exact rank test of the flatness among the surrogates'"),
            of_profile("p_value_all", "1", "the same, actuated samples included"),
            *_envelope("flatness", "flatness"),
            *_envelope("zeta_ratio", "zeta_ratio"),
            of_profile("surrogate_iterations", "1", "median of the surrogates' iterations"),
            of_profile("surrogate_converged", "1", "part of the surrogates that converged"),
            of_profile("surrogate_deviation", "1", "root mean square deviation of power in half-octave bands, median"),
            of_profile("surrogate_deviation_most", "1", "largest deviation of power in any such band, any surrogate"),
            _on("lag", "lag_time", "lag of the increments", "s"),
            *_on_all("lag", "flatness_by_lag", "flatness of the increments"),
            *_on_all("order", "zeta", "relative scaling exponent zeta_p / zeta_3"),
            Variable("range_from", (RANGE,), "float64", "s", "least lag of the range"),
            Variable("range_to", (RANGE,), "float64", "s", "greatest lag of the range"),
            _on_range("range_zeta_ratio", "zeta_ratio over the range"),
            _on_range("range_zeta_ratio_low", "lower end of the 95 % interval of it"),
            _on_range("range_zeta_ratio_high", "upper end of the 95 % interval of it"),
        ),
    )  # fmt: skip
