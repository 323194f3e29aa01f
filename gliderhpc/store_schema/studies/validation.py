"""Group ``validation`` of an archive."""

from gliderhpc.store_schema.schema import (
    Group,
    index_coordinate,
    of_profile,
    on_records,
    profile_coordinate,
)

_FLOWN = {
    "roll": ("degree", "roll of the forward model"),
    "pitch": ("degree", "pitch of the forward model"),
    "heading": ("degree", "heading of the forward model"),
    "depth": ("m", "depth of the forward model, positive down"),
    "X": ("m", "distance north through the water, forward model"),
    "Y": ("m", "distance east through the water, forward model"),
    "X_glide_angle": ("m", "distance north through the water, glide-angle dead reckoning"),
    "Y_glide_angle": ("m", "distance east through the water, glide-angle dead reckoning"),
}


def validation_group() -> Group:
    """Declare group ``validation``."""
    return Group(
        "validation",
        "the fixed-parameter forward model, driven by the recorded controls, against the records",
        (
            profile_coordinate(),
            index_coordinate("record", "output interval from the first observation"),
            *on_records(_FLOWN, {}),
            of_profile("message", "1", "why the profile could not be flown", dtype="string"),
            of_profile("depth_rmse", "m", "root mean square of modelled minus measured depth over steady glide"),
            of_profile("pitch_rmse", "degree", "the same of pitch"),
            of_profile("heading_rmse", "degree", "the same of heading, wrapped"),
            of_profile("longitudinal_rmse", "1", "root mean square of the pitch and depth-rate residuals, each over "
                       "the root mean square of what was measured"),
            of_profile("flown_fraction", "1", "part of the profile before the modelled glider came to the surface"),
            of_profile("path_length", "m", "horizontal path through the water by the glide-angle method"),
            of_profile("horizontal_error", "m", "distance at the end, forward model from glide-angle dead reckoning"),
            of_profile("horizontal_error_rate", "1", "horizontal_error over path_length"),
            of_profile("horizontal_error_on_course", "m", "the same with the modelled speed on the recorded heading"),
            of_profile("surfacing_error", "m", "distance of the forward model's end from the exit fix"),
            of_profile("surfacing_error_rate", "1", "surfacing_error over path_length"),
            of_profile("surfacing_error_glide_angle", "m", "distance of the dead reckoning's end from the exit fix"),
        ),
    )  # fmt: skip
