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


_PHASES = ("dive", "climb", "both")
_ALONG = ("north", "east")


def _currents() -> Group:
    return Group(
        "currents",
        "depth-averaged current with the terms of its uncertainty, and the shear-sensitive part by depth (sections 5.4 "
        "and 5.5)",
        (
            profile_coordinate(),
            index_coordinate("record", "output interval from the first observation"),
            index_coordinate("bin", "bin of depth from the surface"),
            of_profile("message", "1", "why there is no depth-resolved current", dtype="string"),
            *(of_profile(f"current_{along}", "m s-1", f"depth-averaged current to the {along}") for along in _ALONG),
            *(of_profile(f"current_{along}_std", "m s-1", f"standard deviation of current_{along}")
              for along in _ALONG),
            of_profile("current_covariance", "m2 s-2", "covariance of current_north and current_east"),
            of_profile("speed", "m s-1", "speed of the depth-averaged current"),
            of_profile("direction", "degree", "direction that it flows to, clockwise from north"),
            of_profile("axial_std", "m s-1", "standard deviation along the track by the weakly observed axial motion"),
            of_profile("magnitude_std", "m s-1", "standard deviation along the current by its relative error"),
            of_profile("heading_std", "m s-1", "standard deviation across the current by the heading's error"),
            of_profile("fix_std", "m s-1", "standard deviation, either way, by the errors of the fixes"),
            of_profile("actuation_std", "m s-1", "standard deviation, either way, by the displacement bridged while "
                       "actuators moved"),
            of_profile("ellipse_major", "m s-1", "longer semi-axis of the 1-sigma ellipse (39 % inside)"),
            of_profile("ellipse_minor", "m s-1", "shorter semi-axis of the 1-sigma ellipse"),
            of_profile("ellipse_direction", "degree", "direction of the longer axis, clockwise from north"),
            of_profile("sign_in_doubt", "1", "share of coefficient draws in which the yaw moment has the other sign"),
            of_profile("shear_rms", "m s-1", "root mean square of the lateral current, a lower bound"),
            of_profile("coefficient_share", "1", "its scatter under draws of the moment coefficients, over itself"),
            of_profile("coefficient_share_absolute", "1", "the same scatter over depth-averaged plus lateral current"),
            of_profile("significant_fraction", "1", "share of records whose yaw moment exceeds twice its noise"),
            of_profile("retrieved_fraction", "1", "share of the steady glide with a lateral current"),
            of_profile("rootless", "1", "samples whose equation 41 has no root"),
            of_profile("ill_conditioned", "1", "samples masked as viscous and Munk moments nearly cancel"),
            of_profile("interrupted", "1", "samples in stretches shorter than the smoothing window"),
            *on_records(_LATERAL, {}),
            Variable("bin_depth", (PROFILE, "bin"), "float32", "m", "depth of the bin's middle", "depth"),
            *(variable for phase in _PHASES for variable in _phase_bins(phase)),
        ),
    )  # fmt: skip


_LATERAL = {
    "yaw_moment": ("N m", "yaw moment less its moving average"),
    "lateral": ("m s-1", "shear-sensitive current across the hull, positive to starboard"),
    "lateral_coefficient_std": ("m s-1", "half the central 68 % of it under draws of the moment coefficients"),
    "lateral_noise_std": ("m s-1", "its standard deviation by the noise of the yaw moment"),
    "condition": ("1", "magnitudes of the yaw moment's terms over that of their sum"),
    "shear_north": ("m s-1", "lateral current to the north"),
    "shear_east": ("m s-1", "lateral current to the east"),
}


def _phase_bins(phase: str) -> tuple[Variable, ...]:
    during = {"dive": "on the dive", "climb": "on the climb", "both": "on dive and climb"}[phase]
    kinds = {
        "shear": f"mean lateral current {during}",
        "shear_spread": f"standard deviation of the lateral current within the bin {during}",
        "shear_coefficient_std": f"half the central 68 % of the mean {during} under draws of the moment coefficients",
        "shear_noise_std": f"standard deviation of the mean {during} by the noise of the yaw moment",
    }
    return (
        Variable(f"{phase}_count", (PROFILE, "bin"), "int32", "1", f"records in the bin {during}"),
        *(
            Variable(f"{phase}_{kind}_{along}", (PROFILE, "bin"), "float32", "m s-1", f"{text}, {along}")
            for kind, text in kinds.items()
            for along in _ALONG
        ),
    )


STUDIES = Schema(SCHEMA_VERSION, (_validation(), _reconstruction(), _currents()))
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
