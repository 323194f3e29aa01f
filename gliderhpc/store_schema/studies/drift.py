"""Group ``drift`` of an archive, and the names of its columns by quantity, phase and estimate."""

from gliderhpc.store_schema.schema import Dtype, Group, Variable, index_coordinate, of_profile, profile_coordinate
from gliderhpc.vocabulary import CHANNELS

SERIES, HULL, OFFSET = "series", "hull", "offset"
"""Dimensions of the coefficients' draws, by name: quantity and phase, the hulls, and the errors of the pitch."""

CHANGE = "change"
"""Dimension of the change points."""

PHASES = ("dive", "climb")

FORWARD_ERROR_COLUMN = "forward_rmse"
"""Name of the forward model's error in the study's table."""

_PHASES = {"dive": "on the dive", "climb": "on the climb"}
_ESTIMATES = {"prior": "filter estimate", "adjoint": "adjoint estimate", "smoothed": "smoothed estimate"}
_DRAG = "change of K_D0 that the disturbance is equivalent to"


def median_column(quantity: str, phase: str, estimate: str) -> str:
    """Name of a median: ``B_cu_dive_adjoint``."""
    return f"{quantity}_{phase}_{estimate}"


def phase_column(name: str, phase: str) -> str:
    """Name of a value of a phase that no estimate enters: ``count_dive``, ``weight_effect_climb``."""
    return f"{name}_{phase}"


def change_column(quantity: str, part: str, estimate: str, end: str = "") -> str:
    """Name of the size of a change: ``K_D0_change_together_adjoint``, and its ends with ``_low`` and ``_high``."""
    return f"{quantity}_change_{part}_{estimate}{end}"


def drift_group() -> Group:
    """Declare group ``drift``."""
    return Group(
        "drift",
        "medians of the disturbances over steady glide, whose trends tell a drift of the hull (section 5.6, Tables 5 "
        "and 6 and Figure 9 of the paper)",
        (
            profile_coordinate(),
            of_profile("message", "1", "why the profile has no median", dtype="string"),
            of_profile("epoch", "1", "number of the epoch, from 0"),
            of_profile(FORWARD_ERROR_COLUMN, "1", "longitudinal error of the forward model, as validate left it"),
            *(variable for phase, when in _PHASES.items() for variable in _of_phase(phase, when)),
            *_of_draws(),
            *_of_changes(),
        ),
    )


def _of_draws() -> tuple[Variable, ...]:
    unit = {"comment": "in the unit of the quantity: N, N m, or kg/m for K_D0"}
    return (
        Variable(SERIES, (SERIES,), "string", "1", "quantity and phase"),
        Variable(HULL, (HULL,), "string", "1", "nominal, the same with either error of the pitch, and hulls drawn"),
        Variable(OFFSET, (OFFSET,), "string", "1", "constant error of the pitch that was tried out"),
        Variable("slope", (SERIES, HULL), "float64", "day-1", "Theil-Sen slope over segments inverted anew",
                 attributes=unit),
        Variable("shift", (SERIES, OFFSET), "float64", "1", "median change of the series by the error of the pitch",
                 attributes=unit),
    )  # fmt: skip


def _of_change(name: str, units: str, long_name: str, dtype: Dtype = "float64") -> Variable:
    return Variable(name, (CHANGE,), dtype, units, long_name)


def _of_changes() -> tuple[Variable, ...]:
    return (
        index_coordinate(CHANGE, "number of the change point, from 0; where there is none, the one entry is missing"),
        _of_change("change_kind", "1", "step, ramp or episode", "string"),
        _of_change("change_form", "1", "form of the change over the days", "string"),
        _of_change("change_phases", "1", "phases that changed", "string"),
        _of_change("change_estimates", "1", "estimates that show it", "string"),
        _of_change("first_profile", "1", "first profile that is changed"),
        _of_change("last_profile", "1", "last profile that is changed"),
        _of_change("back_profile", "1", "first profile that is back"),
        _of_change("first_day", "day", "days from the first observation to the first profile that is changed"),
        _of_change("last_day", "day", "days from the first observation to the last profile that is changed"),
        _of_change("back_day", "day", "days from the first observation to the first profile that is back"),
        _of_change("change_p", "1", "probability of chance, over all positions, lengths and series"),
        _of_change("change_mean", "1", "mean of the change over its profiles, in parts of the largest"),
        *(
            _of_change(
                change_column(quantity, part, estimate, end), units, f"largest change of {what} {when}, {origin}{of}"
            )
            for quantity, units, what in (("K_D0", "kg m-1", "the equivalent K_D0"), ("B_cu", "N", "the axial force"))
            for part, when in {**_PHASES, "together": "on dive and climb together"}.items()
            for estimate, origin in _ESTIMATES.items()
            if estimate != "prior"
            for end, of in (("", ""), ("_low", ", lower end of the 95 % interval"), ("_high", ", upper end of it"))
        ),
    )


def _of_phase(phase: str, when: str) -> tuple[Variable, ...]:
    return (
        of_profile(phase_column("count", phase), "1", f"records that count {when}"),
        of_profile(phase_column("speed", phase), "m s-1", f"speed through the water {when}, median"),
        of_profile(phase_column("weight_effect", phase), "kg m-1 N-1", f"{_DRAG}, by one newton of weight {when}"),
        of_profile(
            phase_column("heave_effect", phase),
            "kg m-1 N-1",
            f"{_DRAG}, by one newton of heave that is not known {when}",
        ),
        *(
            of_profile(median_column(channel, phase, estimate), units, f"{long_name} {when}, median, {origin}")
            for estimate, origin in _ESTIMATES.items()
            for channel, (units, long_name) in CHANNELS.items()
        ),
        *(
            of_profile(median_column("K_D0", phase, estimate), "kg m-1", f"{_DRAG} {when}, median, {origin}")
            for estimate, origin in _ESTIMATES.items()
        ),
    )
