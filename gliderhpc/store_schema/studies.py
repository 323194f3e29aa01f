"""The schema of what studies add to an archive, as data: one group a study, none of them required.

A study's group holds one row a profile of the archive, missing for profiles that the study left out, and its findings
as attributes. To add a study's group, add its tables here; creating, writing and checking follow.
"""

from __future__ import annotations

from gliderhpc.store_schema.schema import (
    MISSION,
    PROFILE,
    SCHEMA_VERSION,
    TIME_UNITS,
    Group,
    Schema,
    Variable,
    index_coordinate,
    of_profile,
    on_records,
    profile_coordinate,
)

COMPLETE = "complete"
"""Attribute of a study's group: whether the study came to its end."""

_TRACKED = {"roll": "degree", "pitch": "degree", "heading": "degree", "depth": "m"}


def _tracked(prefix: str, what: str) -> tuple[Variable, ...]:
    """Return one root mean square a tracked quantity, ``PREFIX_roll`` ... ``PREFIX_depth``."""
    return tuple(of_profile(f"{prefix}_{name}", unit, f"{what}, {name}") for name, unit in _TRACKED.items())


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


def _validation() -> Group:
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


def _regime(estimator: str, regime: str, what: str) -> tuple[Variable, ...]:
    prefix = f"yaw_{estimator}_{regime}"
    return (
        of_profile(f"{prefix}_std", "N m", f"standard deviation of the {what}"),
        of_profile(f"{prefix}_peak", "N m", f"largest magnitude about the median of the {what}"),
        of_profile(f"{prefix}_kurtosis", "1", f"kurtosis (3 for Gaussian) of the {what}"),
        of_profile(f"{prefix}_fast", "1", f"share of the variance above 0.05 Hz of the {what}"),
    )


_LABELS = {"adjoint": "adjoint's", "smoothed": "smoother's", "prior": "filter's"}


def _reconstruction() -> Group:
    return Group(
        "reconstruction",
        "how the estimated motion follows the records (section 5.1.1, Table 2 and Figure 3 of the paper)",
        (
            profile_coordinate(),
            of_profile("message", "1", "what to mind about the profile's row", dtype="string"),
            *_tracked("steady", "residual of the reconstruction over steady glide"),
            *_tracked("vibration", "residual of the reconstruction over the vibration intervals"),
            of_profile("segment_start", TIME_UNITS, "start of the steady segment of the open-loop runs", "time"),
            *_tracked("open_loop_adjoint", "open-loop residual under the adjoint's disturbance"),
            *_tracked("open_loop_smoothed", "open-loop residual under the smoother's disturbance"),
            *_tracked("open_loop_prior", "open-loop residual under the filter's disturbance"),
            *_tracked("no_slope_steady", "residual over steady glide of the inversion with k_z = 0"),
            *_tracked("no_slope_vibration", "residual over the vibration intervals of the inversion with k_z = 0"),
            of_profile("no_slope_heave_slope", "N m-1", "slope of B_cw with depth under k_z = 0, less that under k_z"),
            of_profile("no_slope_self_motion", "1", "change of the self-motion by k_z = 0, relative"),
            of_profile("vibration_fraction", "1", "part of the time inside the vibration set"),
            of_profile("vibration_speed", "m s-1", "displacement within the vibration set over the profile's duration"),
            of_profile("vibration_share", "1", "vibration_speed over the depth-averaged current"),
            of_profile("self_motion_spread", "1", "difference of estimated and glide-angle displacement, relative"),
            of_profile("self_motion_speed_spread", "1", "root mean square difference of estimated and glide-angle "
                       "horizontal speed over steady glide, over that of the glide-angle speed"),
            of_profile("iterations_median", "1", "median of the windows' iterations"),
            of_profile("iterations_spread", "1", "interquartile range of the windows' iterations"),
            of_profile("iterations_most", "1", "largest number of iterations of a window"),
            of_profile("window_seconds", "s", "computing time of the profile over its number of windows"),
            of_profile("profile_seconds", "s", "computing time of the profile"),
            of_profile("filter_seconds", "s", "computing time of the filter alone"),
            *(variable
              for estimator, label in _LABELS.items()
              for regime, when in (("resting", "battery not rotated"), ("rotated", "battery rotated"))
              for variable in _regime(estimator, regime, f"{label} yaw moment in steady glide, {when}")),
            of_profile("rotated_fraction", "1", "part of the steady glide with the battery rotated"),
            of_profile("yaw_correlation", "1", "correlation of the two yaw moments at the lag that raises it most"),
            of_profile("yaw_lag", "s", "that lag: the filter behind the estimate"),
        ),
    )  # fmt: skip


MODEL = "model"
"""Dimension of the ocean models that study `reanalysis` was given, by name."""


def _of_model(name: str, units: str, long_name: str, standard_name: str | None = None) -> Variable:
    return Variable(name, (PROFILE, MODEL), "float64", units, long_name, standard_name, whole=True)


def _reanalysis() -> Group:
    return Group(
        "reanalysis",
        "the depth-averaged current beside ocean models (section 5.5, Table 4 and Figure 8 of the paper)",
        (
            profile_coordinate(),
            Variable(MODEL, (MODEL,), "string", "1", "name of the ocean model"),
            of_profile("message", "1", "why the profile is not held against a model", dtype="string"),
            of_profile("time", TIME_UNITS, "time of the middle of the dive", "time"),
            of_profile("latitude", "degrees_north", "latitude of the middle of the dive", "latitude"),
            of_profile("longitude", "degrees_east", "longitude of the middle of the dive", "longitude"),
            of_profile("records", "1", "number of records, evenly spaced in time, at which models are sampled"),
            _of_model("north", "m s-1", "the model's current to the north, mean over the records of the dive",
                      "northward_sea_water_velocity"),
            _of_model("east", "m s-1", "the model's current to the east, mean over the records of the dive",
                      "eastward_sea_water_velocity"),
            _of_model("covered_fraction", "1", "part of the records for which the model has a velocity"),
            _of_model("outside_box", "1", "number of records outside the model's latitudes or longitudes"),
            _of_model("outside_time", "1", "number of those left that lie outside its times"),
            _of_model("outside_depth", "1", "number of those left that lie above or below its depths"),
            _of_model("on_land", "1", "number of those left that have land or bottom next to them"),
            _of_model("vector_difference", "m s-1", "length of the model's current less the glider's"),
            _of_model("speed_difference", "m s-1", "the model's speed less the glider's"),
            _of_model("direction_difference", "degree", "the model's direction less the glider's, clockwise positive"),
            _of_model("distance", "1", "Mahalanobis distance of the model from the glider's current by its covariance: "
                      "standard deviations"),
        ),
    )  # fmt: skip


STUDIES = Schema(SCHEMA_VERSION, (_validation(), _reconstruction(), _reanalysis()))
"""What studies may add."""


def study_called(name: str) -> Group:
    """Return a study's group.

    Raises
    ------
    KeyError
        No study writes a group of that name.
    """
    return STUDIES[name]


def group_called(name: str) -> Group:
    """Return a group of the mission's or of the studies' schema.

    Raises
    ------
    KeyError
        There is none of that name.
    """
    for schema in (MISSION, STUDIES):
        for group in schema:
            if group.name == name:
                return group
    raise KeyError(f"the archive has no group '{name}'")
