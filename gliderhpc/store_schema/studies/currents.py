"""Group ``currents`` of an archive, and the names of its columns by component and phase."""

from gliderhpc.store_schema.schema import (
    PROFILE,
    Group,
    Variable,
    index_coordinate,
    of_profile,
    on_records,
    profile_coordinate,
)

PHASES = ("dive", "climb", "both")
COMPONENTS = ("north", "east")


def component_column(name: str, component: str) -> str:
    """Name of a component: ``current_north``, ``both_shear_east``."""
    return f"{name}_{component}"


def bin_column(phase: str, kind: str) -> str:
    """Name, without a component, of a value of the bins of a phase: ``dive_count``, ``both_shear_noise_std``."""
    return f"{phase}_{kind}"


def currents_group() -> Group:
    """Declare group ``currents``."""
    return Group(
        "currents",
        "depth-averaged current with the terms of its uncertainty, and the shear-sensitive part by depth (sections 5.4 "
        "and 5.5)",
        (
            profile_coordinate(),
            index_coordinate("record", "output interval from the first observation"),
            index_coordinate("bin", "bin of depth from the surface"),
            of_profile("message", "1", "why there is no depth-resolved current", dtype="string"),
            *(of_profile(component_column("current", along), "m s-1", f"depth-averaged current to the {along}")
              for along in COMPONENTS),
            *(of_profile(f"current_{along}_std", "m s-1", f"standard deviation of current_{along}")
              for along in COMPONENTS),
            of_profile("current_covariance", "m2 s-2", "covariance of current_north and current_east"),
            of_profile("speed", "m s-1", "speed of the depth-averaged current"),
            of_profile("direction", "degree", "direction that it flows to, clockwise from north"),
            of_profile("axial_std", "m s-1", "standard deviation along the track by the weakly observed axial motion"),
            of_profile("cross_track_std", "m s-1", "standard deviation across the track beside that by the course"),
            of_profile("magnitude_std", "m s-1", "standard deviation along the current by its relative error"),
            of_profile("heading_std", "m s-1", "standard deviation across the track by the error of the course"),
            of_profile("fix_std", "m s-1", "standard deviation, either way, by the errors of the fixes and of the "
                       "drift at the surface"),
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
            *(of_profile(component_column("reference", along), "m s-1",
                         f"the reference's mean current over the dive to the {along}")
              for along in COMPONENTS),
            of_profile("reference_error", "m s-1", "its standard deviation either way, where the reference tells it"),
            of_profile("reference_covered", "1", "part of the dive's time that the reference covers"),
            of_profile("reference_difference", "m s-1", "length of the depth-averaged current less the reference's"),
            of_profile("reference_distance", "1", "the same in standard deviations of both together"),
            of_profile("reference_correlation", "1", "correlation over the bins of the lateral current with the "
                       "reference"),
            of_profile("reference_gradient_correlation", "1", "correlation over the bins of the lateral current with "
                       "the reference's change with depth"),
            *on_records(_LATERAL, {}),
            Variable("bin_depth", (PROFILE, "bin"), "float32", "m", "depth of the bin's middle", "depth"),
            *(variable for phase in PHASES for variable in _phase_bins(phase)),
            Variable("reference_count", (PROFILE, "bin"), "int32", "1", "the reference's velocities in the bin"),
            *(Variable(component_column("reference_by_depth", along), (PROFILE, "bin"), "float32", "m s-1",
                       f"mean of the reference's current in the bin to the {along}") for along in COMPONENTS),
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
        Variable(bin_column(phase, "count"), (PROFILE, "bin"), "int32", "1", f"records in the bin {during}"),
        *(
            Variable(
                component_column(bin_column(phase, kind), along),
                (PROFILE, "bin"),
                "float32",
                "m s-1",
                f"{text}, {along}",
            )
            for kind, text in kinds.items()
            for along in COMPONENTS
        ),
    )
