"""The groups of a mission's archive, as data: what `run-mission` writes (interfaces.md 5).

To change what an archive holds, edit the tables here; creating, writing and checking follow. Angles on disk are
degrees, times are seconds since 1970 that CF-aware readers decode, and missing values are NaN save in flags and counts.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from gliderhpc.store_schema.schema import (
    BUOYANCY,
    CONTROLS,
    DISTURBANCE_PRIOR,
    MOTION,
    OUTCOME,
    PROFILE,
    SCHEMA_VERSION,
    SEAWATER,
    TIME_UNITS,
    YES_NO,
    Dtype,
    Group,
    Schema,
    Variable,
    index_coordinate,
    of_profile,
    on_records,
    profile_coordinate,
)
from gliderhpc.vocabulary import CHANNELS, QUALITY, Flags

_SMOOTHED_CHANNELS = {
    name: (units, f"{long_name}, smoothed estimate on the step that starts at the record")
    for name, (units, long_name) in CHANNELS.items()
}

_ATTITUDE = {
    "roll": ("degree", "roll, starboard down positive", "platform_roll_starboard_down"),
    "pitch": ("degree", "pitch, nose up positive", "platform_pitch_fore_up"),
    "heading": ("degree", "heading, clockwise from true north", "platform_orientation"),
}

_DOWN = {"positive": "down"}


def _time(dim: str) -> Variable:
    return Variable("time", (PROFILE, dim), "float64", TIME_UNITS, "time of the sample", "time")


def _depth(dim: str, origin: str, on: Mapping[str, Any]) -> Variable:
    return Variable(
        "depth", (PROFILE, dim), "float32", "m", f"{origin} depth", "depth", attributes=dict(_DOWN) | dict(on)
    )


def _disturbances(origin: str, on: Mapping[str, Any]) -> tuple[Variable, ...]:
    """Return the six channels; `on` names the coordinates that belong to them (CF ``coordinates``)."""
    return tuple(
        Variable(name, (PROFILE, "sample"), "float32", units, f"{long_name}, {origin}", attributes=on)
        for name, (units, long_name) in CHANNELS.items()
    )


def _attitude(origin: str, on: Mapping[str, Any]) -> tuple[Variable, ...]:
    return tuple(
        Variable(name, (PROFILE, "record"), "float32", units, f"{origin} {long_name}", standard, attributes=on)
        for name, (units, long_name, standard) in _ATTITUDE.items()
    )


def _fix(end: str) -> tuple[Variable, ...]:
    return (
        of_profile(f"{end}_time", TIME_UNITS, f"time of the {end} fix", "time"),
        of_profile(f"{end}_latitude", "degrees_north", f"latitude of the {end} fix", "latitude"),
        of_profile(f"{end}_longitude", "degrees_east", f"longitude of the {end} fix", "longitude"),
    )


_INCLUDED = (
    "from the smoother's displacement covariance (disturbance prior and sensors), the errors of speed and course "
    "through the water (settings current.*), of the fixes, and of the drift at the surface"
)
"""What the smoothed current's uncertainty holds and what not."""


def _root() -> Group:
    return Group(
        "/",
        "one row a profile",
        (
            profile_coordinate(),
            Variable("status", (PROFILE,), "string", "1", "pending, done or failed", fill="pending"),
            of_profile("message", "1", "why the profile failed, or what to mind about it", dtype="string"),
            of_profile("start_time", TIME_UNITS, "time of the first observation", "time"),
            of_profile("elapsed_days", "day", "time since the mission's first observation"),
            of_profile("max_depth", "m", "greatest measured depth"),
            of_profile("duration", "s", "time from the first to the last observation"),
            of_profile("sample_count", "1", "number of observations", dtype="int32"),
            of_profile("window_count", "1", "number of windows solved", dtype="int32"),
            of_profile("converged_fraction", "1", "part of the windows that converged"),
            of_profile("iterations_median", "1", "median of the windows' iterations"),
            of_profile("gated_count", "1", "observations that the filter's gate refused", dtype="int32"),
            of_profile("inflated_count", "1", "observations whose noise the filter inflated", dtype="int32"),
            of_profile("reset_count", "1", "resets of the filter after divergence", dtype="int32"),
            Variable(
                "disturbance_prior",
                (PROFILE,),
                "int8",
                "1",
                "disturbance prior of filter and transform: the usual one, or that for rough water where it failed",
                fill=-1,
                masked=True,
                flags=DISTURBANCE_PRIOR,
            ),
            Variable(
                "buoyancy",
                (PROFILE,),
                "int8",
                "1",
                "how the buoyancy goes with depth: the hull's depth slope, or the measured in-situ density",
                fill=-1,
                masked=True,
                flags=BUOYANCY,
            ),
            of_profile("run_seconds", "s", "time the profile took to compute"),
            *_fix("entry"),
            *_fix("exit"),
            of_profile("dac_north", "m s-1", "depth-averaged current to the north", "northward_sea_water_velocity"),
            of_profile("dac_east", "m s-1", "depth-averaged current to the east", "eastward_sea_water_velocity"),
            of_profile("dac_north_std", "m s-1", "standard deviation of dac_north"),
            of_profile("dac_east_std", "m s-1", "standard deviation of dac_east"),
            of_profile("dac_covariance", "m2 s-2", "covariance of dac_north and dac_east"),
            of_profile(
                "dac_north_smoothed", "m s-1", "depth-averaged current to the north, by the smoother's displacement"
            ),
            of_profile(
                "dac_east_smoothed", "m s-1", "depth-averaged current to the east, by the smoother's displacement"
            ),
            of_profile("dac_north_smoothed_std", "m s-1", f"standard deviation of dac_north_smoothed, {_INCLUDED}"),
            of_profile("dac_east_smoothed_std", "m s-1", f"standard deviation of dac_east_smoothed, {_INCLUDED}"),
            of_profile(
                "dac_smoothed_covariance",
                "m2 s-2",
                f"covariance of dac_north_smoothed and dac_east_smoothed, {_INCLUDED}",
            ),
            of_profile("dac_north_glide_angle", "m s-1", "depth-averaged current to the north, glide-angle method"),
            of_profile("dac_east_glide_angle", "m s-1", "depth-averaged current to the east, glide-angle method"),
            of_profile("glide_angle_masked_fraction", "1", "part of the time without a real glide-angle solution"),
            of_profile("surface_drift_north", "m s-1", "drift at the surface to the north"),
            of_profile("surface_drift_east", "m s-1", "drift at the surface to the east"),
            *_surface("entry", "between the entry fix and the dive"),
            *_surface("exit", "between the dive and the exit fix"),
            of_profile("vibration_fraction", "1", "part of the time inside the vibration set"),
            of_profile("vibration_displacement", "m", "horizontal displacement bridged across the vibration set"),
        ),
    )


def _surface(end: str, where: str) -> tuple[Variable, ...]:
    return (
        of_profile(f"{end}_surface_time", "s", f"time {where} over which the drift at the surface is taken out"),
        of_profile(f"{end}_surface_north", "m", f"drift taken out {where}, to the north"),
        of_profile(f"{end}_surface_east", "m", f"drift taken out {where}, to the east"),
    )


def _series() -> Group:
    on = {"coordinates": "time depth"}
    return Group(
        "series",
        "the adjoint's disturbances, one sample an integration step",
        (
            profile_coordinate(),
            index_coordinate("sample", "integration step from the first observation; B[k] acts from sample k to k+1"),
            _time("sample"),
            _depth("sample", "measured", {}),
            *_disturbances("adjoint estimate", on),
            Variable(
                "quality",
                (PROFILE, "sample"),
                "uint8",
                "1",
                "what to mind about the sample",
                "quality_flag",
                flags=QUALITY,
                attributes=on,
            ),
        ),
    )


def _prior() -> Group:
    return Group(
        "prior",
        "the extended Kalman filter's disturbances",
        (
            profile_coordinate(),
            index_coordinate("sample", "integration step from the first observation"),
            *_disturbances("filter estimate", {}),
        ),
    )


def _state() -> Group:
    on = {"coordinates": "time"}
    return Group(
        "state",
        "the motion under the adjoint's disturbances, one record an output interval",
        (
            profile_coordinate(),
            index_coordinate("record", "output interval from the first observation"),
            _time("record"),
            *_attitude("reconstructed", on),
            _depth("record", "reconstructed", on),
            *on_records(MOTION, on),
        ),
    )


def _observed() -> Group:
    on = {"coordinates": "time"}
    return Group(
        "observed",
        "the measurements and controls on the same records",
        (
            profile_coordinate(),
            index_coordinate("record", "output interval from the first observation"),
            _time("record"),
            *_attitude("measured", on),
            _depth("record", "measured", on),
            Variable(
                "sampled", (PROFILE, "record"), "int8", "1",
                "whether this is the record nearest to a sample of attitude and depth; others are interpolated",
                fill=-1, masked=True, flags=YES_NO, attributes=on,
            ),
            *on_records(CONTROLS, on),
            *(
                Variable(name, (PROFILE, "record"), "float32", units, long_name, standard, attributes=on)
                for name, (units, long_name, standard) in SEAWATER.items()
            ),
        ),
    )  # fmt: skip


def _smoothed() -> Group:
    on = {"coordinates": "time"}
    return Group(
        "smoothed",
        "the smoother's disturbances and motion, one record an output interval, each with its standard deviation",
        (
            profile_coordinate(),
            index_coordinate("record", "output interval from the first observation"),
            _time("record"),
            *_with_deviation(on_records(_SMOOTHED_CHANNELS, on)),
            *_with_deviation(_attitude("smoothed", on)),
            *_with_deviation((_depth("record", "smoothed", on),)),
            *_with_deviation(on_records(MOTION, on)),
            Variable("passes", (PROFILE,), "int32", "1", "linearisations of the smoother", fill=-1, masked=True),
            Variable(
                "outcome", (PROFILE,), "int8", "1",
                "how the smoother ended; where it diverged, the filter's estimate stands in, without deviations",
                fill=-1, masked=True, flags=OUTCOME,
            ),
            of_profile("cost", "1", "half the sum of all squares over variances at the estimate"),
            of_profile("displacement_north", "m", "distance north through the water from start to end of the profile"),
            of_profile("displacement_east", "m", "distance east through the water from start to end of the profile"),
            of_profile("displacement_north_std", "m", "standard deviation of displacement_north"),
            of_profile("displacement_east_std", "m", "standard deviation of displacement_east"),
            of_profile("displacement_covariance", "m2", "covariance of displacement_north and displacement_east"),
            *(
                of_profile(f"{name}_noise_factor", "1", f"variance of the noise of {name} over its prior's")
                for name in CHANNELS
            ),
        ),
    )  # fmt: skip


def _with_deviation(variables: tuple[Variable, ...]) -> tuple[Variable, ...]:
    """Put the standard deviation behind each variable."""
    deviations = (
        replace(
            variable, name=f"{variable.name}_std", long_name=f"standard deviation of {variable.name}",
            standard_name=None, attributes={"coordinates": "time"},
        )
        for variable in variables
    )  # fmt: skip
    return tuple(one for pair in zip(variables, deviations, strict=True) for one in pair)


def _of_window(
    name: str, dtype: Dtype, units: str, long_name: str, dim: str = "window", flags: Flags | None = None
) -> Variable:
    """Integers of a row that a short profile leaves empty decode to NaN."""
    fill = None if dtype.startswith("float") else -1
    return Variable(name, (PROFILE, dim), dtype, units, long_name, fill=fill, masked=fill is not None, flags=flags)


def _windows() -> Group:
    return Group(
        "windows",
        "one entry a window of the inversion",
        (
            profile_coordinate(),
            index_coordinate("window", "number of the window within its profile, from 0"),
            _of_window("start", "int32", "1", "first sample of the window"),
            _of_window("stop", "int32", "1", "sample after the window's last interval"),
            _of_window("cost", "float64", "1", "cost reached, eq. 28"),
            _of_window("iterations", "int32", "1", "iterations of the solver"),
            _of_window("evaluations", "int32", "1", "evaluations of cost and gradient"),
            _of_window("gradient_norm", "float64", "1", "the preset's optimality measure at the solution"),
            _of_window(
                "retracted", "int8", "1", "whether the next window starts a margin before this one's end", flags=YES_NO
            ),
            _of_window("outcome", "int8", "1", "how the solve ended", flags=OUTCOME),
        ),
    )


def _drift_current() -> Group:
    return Group(
        "drift_current",
        "the current of each dive-climb cycle, eqs. 39 and 40",
        (
            profile_coordinate(),
            index_coordinate("segment", "number of the cycle within its profile, from 0"),
            _of_window("north", "float64", "m s-1", "drift velocity to the north", "segment"),
            _of_window("east", "float64", "m s-1", "drift velocity to the east", "segment"),
            _of_window("start", "int32", "1", "first sample of the cycle", "segment"),
            _of_window("stop", "int32", "1", "sample at which the cycle ends", "segment"),
        ),
    )


COMMITS = "commits"
"""Group of the commit markers."""


def _commits() -> Group:
    return Group(
        COMMITS,
        "written last of all that belongs to a profile: a profile with a marker is complete",
        (
            profile_coordinate(),
            Variable("manifest", (PROFILE,), "string", "1", "digests of the chunks of the profile's rows, as JSON"),
            Variable("marker", (PROFILE,), "string", "1", "what the profile was made from and its table row, as JSON"),
        ),
    )


_ENDS = ("entry", "exit")

OG1_NAMES = {
    "/": {
        **{f"{end}_{what}": f"{what.upper()}_GPS" for end in _ENDS for what in ("time", "latitude", "longitude")},
        "dac_north": "DAVG_CURR_NORTH_ADJOINT",
        "dac_east": "DAVG_CURR_EAST_ADJOINT",
        "dac_north_smoothed": "DAVG_CURR_NORTH_SMOOTHED",
        "dac_east_smoothed": "DAVG_CURR_EAST_SMOOTHED",
    },
    "series": {"time": "TIME", "depth": "DEPTH"},
    "observed": {"time": "TIME", "depth": "DEPTH", "roll": "ROLL", "pitch": "PITCH", "heading": "HEADING"},
}  # fmt: skip
"""What `export og1` calls a variable, by group: its attribute ``og1_name``."""


def _with_og1_names(group: Group) -> Group:
    names = OG1_NAMES.get(group.name, {})
    return replace(
        group,
        variables=tuple(
            replace(variable, attributes={**(variable.attributes or {}), "og1_name": names[variable.name]})
            if variable.name in names else variable
            for variable in group.variables
        ),
    )  # fmt: skip


_GROUPS = (_root(), _series(), _prior(), _state(), _observed(), _smoothed(), _windows(), _drift_current(), _commits())

MISSION = Schema(SCHEMA_VERSION, tuple(_with_og1_names(group) for group in _GROUPS))
"""The schema of a mission's archive."""
