"""What study ``spectra`` adds to an archive."""

from gliderhpc.store_schema.schema import PROFILE, Group, Variable, index_coordinate, of_profile, profile_coordinate

_PARTS = {
    "whole": "the whole profile",
    "shallow": "the shallowest third of the time",
    "middle": "the middle third of the time by depth",
    "deep": "the deepest third of the time",
}

_BANDS = {"beta": "the band of the fit", "beta_resolved": "the part of it that the records resolve"}


def _exponent(name: str, where: str) -> tuple[Variable, ...]:
    return (
        of_profile(name, "1", f"exponent of the spectrum, {where}"),
        of_profile(f"{name}_low", "1", f"lower end of the 95 % interval of {name}"),
        of_profile(f"{name}_high", "1", f"upper end of the 95 % interval of {name}"),
        of_profile(f"{name}_r2", "1", f"coefficient of determination of the fit of {name}"),
    )


def _of_part(part: str, what: str) -> tuple[Variable, ...]:
    return (
        of_profile(f"{part}_from", "m", f"least depth of {what}"),
        of_profile(f"{part}_to", "m", f"greatest depth of {what}"),
        of_profile(f"{part}_segments", "1", f"Welch segments of {what}"),
        *(one for name, band in _BANDS.items() for one in _exponent(f"{part}_{name}", f"{what}, {band}")),
    )


def _density(name: str, what: str) -> Variable:
    attributes = {"comment": "the square of the channel's unit (N or N m, attribute settings) per Hz"}
    return Variable(name, (PROFILE, "frequency"), "float64", "s", what, attributes=attributes)


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
            *(variable for part, what in _PARTS.items() for variable in _of_part(part, what)),
            *(one for name, band in _BANDS.items() for one in _exponent(f"{name}_all", f"{band}, {included}")),
            Variable("frequency_hz", (PROFILE, "frequency"), "float64", "Hz", "frequency"),
            _density("density", "one-sided power spectral density of the whole profile"),
            _density("density_all", f"the same, {included}"),
        ),
    )
