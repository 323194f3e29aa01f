"""Groups of a mission's archive as tables: name, dimensions, type, unit, long name and CF standard name.

To change the content of an archive, edit the tables here; creation, writing and checks follow them. Angles on disk are
degrees, times are seconds since 1970 that CF-aware readers decode, and missing values are NaN except in flags and
counts.
"""

from collections.abc import Iterator, Mapping
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
    Group,
    Schema,
    Variable,
    index_coordinate,
    on_records,
    profile_coordinate,
)
from gliderhpc.vocabulary import CHANNELS, QUALITY

_PROFILES = (PROFILE,)
_SAMPLES, _RECORDS, _WINDOWS, _SEGMENTS = ((PROFILE, dim) for dim in ("sample", "record", "window", "segment"))

_ON_TIME = {"coordinates": "time"}
_ON_TIME_AND_DEPTH = {"coordinates": "time depth"}

_MISSING: dict[str, Any] = {"fill": -1, "masked": True}
"""Integers that a short or failed profile leaves empty; they decode to NaN."""

# Families of variables that several groups share.


def _family(
    dims: tuple[str, ...], table: Mapping[str, tuple[str, str]], qualifier: str, on: Mapping[str, Any]
) -> tuple[Variable, ...]:
    """Return the variables of a table of unit and name, qualified as in ``yaw moment, filter estimate``."""
    return tuple(
        Variable(name, dims, "float32", units, f"{long_name}, {qualifier}", attributes=on)
        for name, (units, long_name) in table.items()
    )


def _measurements(origin: str) -> tuple[Variable, ...]:
    """Return time, attitude and depth on the records; `origin` is ``measured``, ``reconstructed`` or ``smoothed``."""
    on, down = _ON_TIME, {"positive": "down", **_ON_TIME}
    roll, angle = f"{origin} roll, starboard down positive", f"{origin} heading, clockwise from true north"
    return (
        Variable("roll", _RECORDS, "float32", "degree", roll, _ROLL, attributes=on),
        Variable("pitch", _RECORDS, "float32", "degree", f"{origin} pitch, nose up positive", _PITCH, attributes=on),
        Variable("heading", _RECORDS, "float32", "degree", angle, _HEADING, attributes=on),
        Variable("depth", _RECORDS, "float32", "m", f"{origin} depth", "depth", attributes=down),
    )


_ROLL, _PITCH, _HEADING = "platform_roll_starboard_down", "platform_pitch_fore_up", "platform_orientation"


def _with_std(variables: tuple[Variable, ...]) -> Iterator[Variable]:
    """Yield each variable followed by its standard deviation."""
    for variable in variables:
        name, long_name = f"{variable.name}_std", f"standard deviation of {variable.name}"
        yield variable
        yield replace(variable, name=name, long_name=long_name, standard_name=None, attributes=_ON_TIME)


def _fix(end: str) -> tuple[Variable, ...]:
    return (
        Variable(f"{end}_time", _PROFILES, "float64", TIME_UNITS, f"time of the {end} fix", "time"),
        Variable(f"{end}_latitude", _PROFILES, "float64", "degrees_north", f"latitude of the {end} fix", "latitude"),
        Variable(f"{end}_longitude", _PROFILES, "float64", "degrees_east", f"longitude of the {end} fix", "longitude"),
    )


def _surface_drift(end: str, where: str) -> tuple[Variable, ...]:
    time = f"time {where} over which the drift at the surface is taken out"
    return (
        Variable(f"{end}_surface_time", _PROFILES, "float64", "s", time),
        Variable(f"{end}_surface_north", _PROFILES, "float64", "m", f"drift taken out {where}, to the north"),
        Variable(f"{end}_surface_east", _PROFILES, "float64", "m", f"drift taken out {where}, to the east"),
    )


_TIME_OF_SAMPLE = Variable("time", _SAMPLES, "float64", TIME_UNITS, "time of the sample", "time")
_TIME_OF_RECORD = replace(_TIME_OF_SAMPLE, dims=_RECORDS)
_RECORD = index_coordinate("record", "output interval from the first observation")

_SMOOTHED_ERRORS = (
    "from the smoother's displacement covariance (disturbance prior and sensors), the errors of speed and course "
    "through the water (settings current.*), of the fixes, and of the drift at the surface"
)
"""Sources of error that the smoothed current's uncertainty includes."""

COMMITS = "commits"
"""Group of the commit markers."""

# The groups. Columns: name, dimensions, type, unit, long name, CF standard name.
# fmt: off

_ROOT = Group(
    "/",
    "one row a profile",
    (
        profile_coordinate(),
        Variable("status", _PROFILES, "string", "1", "pending, done or failed", fill="pending"),
        Variable("message", _PROFILES, "string", "1", "why the profile failed, or what to mind about it"),
        Variable("start_time", _PROFILES, "float64", TIME_UNITS, "time of the first observation", "time"),
        Variable("elapsed_days", _PROFILES, "float64", "day", "time since the mission's first observation"),
        Variable("max_depth", _PROFILES, "float64", "m", "greatest measured depth"),
        Variable("duration", _PROFILES, "float64", "s", "time from the first to the last observation"),
        Variable("sample_count", _PROFILES, "int32", "1", "number of observations"),
        Variable("window_count", _PROFILES, "int32", "1", "number of windows solved"),
        Variable("converged_fraction", _PROFILES, "float64", "1", "part of the windows that converged"),
        Variable("iterations_median", _PROFILES, "float64", "1", "median of the windows' iterations"),
        Variable("gated_count", _PROFILES, "int32", "1", "observations that the filter's gate refused"),
        Variable("inflated_count", _PROFILES, "int32", "1", "observations whose noise the filter inflated"),
        Variable("reset_count", _PROFILES, "int32", "1", "resets of the filter after divergence"),
        Variable("disturbance_prior", _PROFILES, "int8", "1",
                 "disturbance prior of filter and transform: the usual one, or that for rough water where it failed",
                 flags=DISTURBANCE_PRIOR, **_MISSING),
        Variable("buoyancy", _PROFILES, "int8", "1",
                 "how the buoyancy goes with depth: the hull's depth slope, or the measured in-situ density",
                 flags=BUOYANCY, **_MISSING),
        Variable("run_seconds", _PROFILES, "float64", "s", "time the profile took to compute"),
        *_fix("entry"),
        *_fix("exit"),
        Variable("dac_north", _PROFILES, "float64", "m s-1",
                 "depth-averaged current to the north", "northward_sea_water_velocity"),
        Variable("dac_east", _PROFILES, "float64", "m s-1",
                 "depth-averaged current to the east", "eastward_sea_water_velocity"),
        Variable("dac_north_std", _PROFILES, "float64", "m s-1", "standard deviation of dac_north"),
        Variable("dac_east_std", _PROFILES, "float64", "m s-1", "standard deviation of dac_east"),
        Variable("dac_covariance", _PROFILES, "float64", "m2 s-2", "covariance of dac_north and dac_east"),
        Variable("dac_north_smoothed", _PROFILES, "float64", "m s-1",
                 "depth-averaged current to the north, by the smoother's displacement"),
        Variable("dac_east_smoothed", _PROFILES, "float64", "m s-1",
                 "depth-averaged current to the east, by the smoother's displacement"),
        Variable("dac_north_smoothed_std", _PROFILES, "float64", "m s-1",
                 f"standard deviation of dac_north_smoothed, {_SMOOTHED_ERRORS}"),
        Variable("dac_east_smoothed_std", _PROFILES, "float64", "m s-1",
                 f"standard deviation of dac_east_smoothed, {_SMOOTHED_ERRORS}"),
        Variable("dac_smoothed_covariance", _PROFILES, "float64", "m2 s-2",
                 f"covariance of dac_north_smoothed and dac_east_smoothed, {_SMOOTHED_ERRORS}"),
        Variable("dac_north_glide_angle", _PROFILES, "float64", "m s-1",
                 "depth-averaged current to the north, glide-angle method"),
        Variable("dac_east_glide_angle", _PROFILES, "float64", "m s-1",
                 "depth-averaged current to the east, glide-angle method"),
        Variable("glide_angle_masked_fraction", _PROFILES, "float64", "1",
                 "part of the time without a real glide-angle solution"),
        Variable("surface_drift_north", _PROFILES, "float64", "m s-1", "drift at the surface to the north"),
        Variable("surface_drift_east", _PROFILES, "float64", "m s-1", "drift at the surface to the east"),
        *_surface_drift("entry", "between the entry fix and the dive"),
        *_surface_drift("exit", "between the dive and the exit fix"),
        Variable("vibration_fraction", _PROFILES, "float64", "1", "part of the time inside the vibration set"),
        Variable("vibration_displacement", _PROFILES, "float64", "m",
                 "horizontal displacement bridged across the vibration set"),
    ),
)

_SERIES = Group(
    "series",
    "the adjoint's disturbances, one sample an integration step",
    (
        profile_coordinate(),
        index_coordinate("sample", "integration step from the first observation; B[k] acts from sample k to k+1"),
        _TIME_OF_SAMPLE,
        Variable("depth", _SAMPLES, "float32", "m", "measured depth", "depth", attributes={"positive": "down"}),
        *_family(_SAMPLES, CHANNELS, "adjoint estimate", _ON_TIME_AND_DEPTH),
        Variable("quality", _SAMPLES, "uint8", "1",
                 "what to mind about the sample", "quality_flag", flags=QUALITY, attributes=_ON_TIME_AND_DEPTH),
    ),
)

_PRIOR = Group(
    "prior",
    "the extended Kalman filter's disturbances",
    (
        profile_coordinate(),
        index_coordinate("sample", "integration step from the first observation"),
        *_family(_SAMPLES, CHANNELS, "filter estimate", {}),
    ),
)

_STATE = Group(
    "state",
    "the motion under the adjoint's disturbances, one record an output interval",
    (
        profile_coordinate(),
        _RECORD,
        _TIME_OF_RECORD,
        *_measurements("reconstructed"),
        *on_records(MOTION, _ON_TIME),
    ),
)

_OBSERVED = Group(
    "observed",
    "the measurements and controls on the same records",
    (
        profile_coordinate(),
        _RECORD,
        _TIME_OF_RECORD,
        *_measurements("measured"),
        Variable("sampled", _RECORDS, "int8", "1",
                 "whether this is the record nearest to a sample of attitude and depth; others are interpolated",
                 flags=YES_NO, attributes=_ON_TIME, **_MISSING),
        *on_records(CONTROLS, _ON_TIME),
        *(
            Variable(name, _RECORDS, "float32", units, long_name, standard, attributes=_ON_TIME)
            for name, (units, long_name, standard) in SEAWATER.items()
        ),
    ),
)

_SMOOTHED = Group(
    "smoothed",
    "the smoother's disturbances and motion, one record an output interval, each with its standard deviation",
    (
        profile_coordinate(),
        _RECORD,
        _TIME_OF_RECORD,
        *_with_std(
            (
                *_family(_RECORDS, CHANNELS, "smoothed estimate on the step that starts at the record", _ON_TIME),
                *_measurements("smoothed"),
                *on_records(MOTION, _ON_TIME),
            )
        ),
        Variable("passes", _PROFILES, "int32", "1", "linearisations of the smoother", **_MISSING),
        Variable("outcome", _PROFILES, "int8", "1",
                 "how the smoother ended; where it diverged, the filter's estimate stands in, without deviations",
                 flags=OUTCOME, **_MISSING),
        Variable("cost", _PROFILES, "float64", "1", "half the sum of all squares over variances at the estimate"),
        Variable("displacement_north", _PROFILES, "float64", "m",
                 "distance north through the water from start to end of the profile"),
        Variable("displacement_east", _PROFILES, "float64", "m",
                 "distance east through the water from start to end of the profile"),
        Variable("displacement_north_std", _PROFILES, "float64", "m", "standard deviation of displacement_north"),
        Variable("displacement_east_std", _PROFILES, "float64", "m", "standard deviation of displacement_east"),
        Variable("displacement_covariance", _PROFILES, "float64", "m2",
                 "covariance of displacement_north and displacement_east"),
        *(
            Variable(
                f"{name}_noise_factor", _PROFILES, "float64", "1", f"variance of the noise of {name} over its prior's"
            )
            for name in CHANNELS
        ),
    ),
)

_WINDOW = Group(
    "windows",
    "one entry a window of the inversion",
    (
        profile_coordinate(),
        index_coordinate("window", "number of the window within its profile, from 0"),
        Variable("start", _WINDOWS, "int32", "1", "first sample of the window", **_MISSING),
        Variable("stop", _WINDOWS, "int32", "1", "sample after the window's last interval", **_MISSING),
        Variable("cost", _WINDOWS, "float64", "1", "cost reached, eq. 28"),
        Variable("iterations", _WINDOWS, "int32", "1", "iterations of the solver", **_MISSING),
        Variable("evaluations", _WINDOWS, "int32", "1", "evaluations of cost and gradient", **_MISSING),
        Variable("gradient_norm", _WINDOWS, "float64", "1", "the preset's optimality measure at the solution"),
        Variable("retracted", _WINDOWS, "int8", "1",
                 "whether the next window starts a margin before this one's end", flags=YES_NO, **_MISSING),
        Variable("outcome", _WINDOWS, "int8", "1", "how the solve ended", flags=OUTCOME, **_MISSING),
    ),
)

_DRIFT_CURRENT = Group(
    "drift_current",
    "the current of each dive-climb cycle, eqs. 39 and 40",
    (
        profile_coordinate(),
        index_coordinate("segment", "number of the cycle within its profile, from 0"),
        Variable("north", _SEGMENTS, "float64", "m s-1", "drift velocity to the north"),
        Variable("east", _SEGMENTS, "float64", "m s-1", "drift velocity to the east"),
        Variable("start", _SEGMENTS, "int32", "1", "first sample of the cycle", **_MISSING),
        Variable("stop", _SEGMENTS, "int32", "1", "sample at which the cycle ends", **_MISSING),
    ),
)

_COMMIT = Group(
    COMMITS,
    "written last of all that belongs to a profile: a profile with a marker is complete",
    (
        profile_coordinate(),
        Variable("manifest", _PROFILES, "string", "1", "digests of the chunks of the profile's rows, as JSON"),
        Variable("marker", _PROFILES, "string", "1", "what the profile was made from and its table row, as JSON"),
    ),
)

# fmt: on

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
"""Names of variables in `export og1`, by group: attribute ``og1_name``."""


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


_GROUPS = (_ROOT, _SERIES, _PRIOR, _STATE, _OBSERVED, _SMOOTHED, _WINDOW, _DRIFT_CURRENT, _COMMIT)

MISSION = Schema(SCHEMA_VERSION, tuple(_with_og1_names(group) for group in _GROUPS))
"""The schema of a mission's archive."""
