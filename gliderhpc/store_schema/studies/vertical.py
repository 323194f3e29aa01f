"""Group ``vertical`` of an archive, and the names of its columns by leg."""

from gliderhpc.store_schema.schema import (
    PROFILE,
    Group,
    Variable,
    index_coordinate,
    of_profile,
    on_records,
    profile_coordinate,
)

LEGS = ("dive", "climb")

_HULL_NUMBERS = {
    "neutral_volume": "the neutral volume",
    "depth_slope": "the buoyancy gained with depth",
    "compressibility": "the hull's compressibility",
    "thermal_expansion": "the hull's thermal expansion",
    "K_D0": "the drag at zero angle of attack",
    "K_D": "the drag over angle of attack squared",
    "K_L": "the lift over angle of attack",
    "K_beta": "the side force over sideslip",
}
"""The hull's parameters that a still-water glide at a given attitude depends on."""


_VERTICAL = {
    "water_up_std": ("m s-1", "standard deviation of water_up: noise, rounded pitch and the hull's numbers"),
    "water_up_noise_std": ("m s-1", "part of it by the depth sensor's noise, which samples do not share"),
    "depth_rate": ("m s-1", "measured depth rate, filtered, positive down"),
    "depth_rate_still": ("m s-1", "depth rate of the hull's glide in still water, filtered alike"),
    "speed_still": ("m s-1", "speed through the water of that glide, not filtered"),
}


def leg_column(name: str, leg: str) -> str:
    """Name of a value of the dives or of the climbs of a profile: ``mean_dive``."""
    return f"{name}_{leg}"


def effect_column(parameter: str, leg: str) -> str:
    """Name of the change of a leg's mean by a parameter of the hull: ``by_K_D0_climb``."""
    return leg_column(f"by_{parameter}", leg)


def _on_either_leg(name: str, units: str, long_name: str) -> tuple[Variable, ...]:
    """Return one value for the dives and one for the climbs of a profile, ``NAME_dive`` and ``NAME_climb``."""
    return tuple(of_profile(leg_column(name, leg), units, f"{long_name}, {leg}s") for leg in LEGS)


def vertical_group() -> Group:
    """Declare group ``vertical``."""
    return Group(
        "vertical",
        "vertical velocity of the water: measured depth rate less that of the hull's glide in still water",
        (
            profile_coordinate(),
            index_coordinate("record", "output interval from the first observation"),
            Variable("water_up", (PROFILE, "record"), "float32", "m s-1",
                     "vertical velocity of the water, upward, at samples", "upward_sea_water_velocity"),
            *on_records(_VERTICAL, {}),
            of_profile("message", "1", "why the profile has no vertical velocity", dtype="string"),
            of_profile("window", "s", "length of the filter's window"),
            of_profile("count", "1", "samples with a vertical velocity"),
            of_profile("share", "1", "part of the samples that have one"),
            *_on_either_leg("mean", "m s-1", "mean of water_up"),
            *_on_either_leg("spread", "m s-1", "standard deviation of water_up about that mean"),
            *_on_either_leg("mean_std", "m s-1", "standard deviation of the mean by rounded pitch and hull's numbers"),
            of_profile("mean_square", "m2 s-2", "mean square of water_up, which a better hull makes smaller"),
            of_profile("noise_std", "m s-1", "median of water_up_noise_std"),
            of_profile("levels", "1", "levels of depth that were met on dives and on climbs"),
            of_profile("difference", "m s-1", "mean over these levels of dives' less climbs' water_up"),
            of_profile("difference_rms", "m s-1", "root mean square of the same"),
            of_profile("difference_std", "m s-1", "standard deviation of it by rounded pitch and hull's numbers"),
            *(variable
              for name, what in _HULL_NUMBERS.items()
              for leg in LEGS
              for variable in (of_profile(effect_column(name, leg), "m s-1",
                                          f"mean's change by a plausible one of {what}, {leg}s"),)),
            of_profile("error_rms", "m s-1", "root mean square of water_up less the truth"),
            of_profile("error_mean", "m s-1", "mean of the same"),
            of_profile("error_normalised", "1", "root mean square of the same over water_up_std"),
            of_profile("truth_correlation", "1", "correlation of water_up with the truth"),
        ),
    )  # fmt: skip
