"""The archive's schema as data: every group and variable that a mission's archive holds (interfaces.md 5).

To change what an archive holds, edit the tables here; creating, writing and checking follow. Angles on disk are
degrees, times are seconds since 1970 that CF-aware readers decode, and missing values are NaN save in flags and counts.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

SCHEMA_NAME = "gliderhpc-mission"
"""Root attribute ``schema`` by which an archive is known as one of ours."""

SCHEMA_VERSION = "1.3"
"""Root attribute ``schema_version``: the first number changes when old readers can no longer follow."""

CONVENTIONS = "CF-1.11"

TIME_UNITS = "seconds since 1970-01-01T00:00:00Z"

PROFILE = "profile"

Dtype = Literal["float32", "float64", "int64", "int32", "int8", "uint8", "string"]


@dataclass(frozen=True)
class Flags:
    """CF flags: the numbers a variable takes, or the bits that it sets, each with its meaning."""

    kind: Literal["flag_values", "flag_masks"]
    meanings: Mapping[str, int]

    def attributes(self) -> dict[str, Any]:
        """CF attributes, meanings as one string of words."""
        return {self.kind: list(self.meanings.values()), "flag_meanings": " ".join(self.meanings)}


@dataclass(frozen=True)
class Variable:
    """One array of the archive: what it is, not what is in it.

    Parameters
    ----------
    name : str
        Its name within its group.
    dims : tuple of str
        Names of its dimensions, outermost first.
    dtype : str
        Number type on disk, or ``string``.
    units : str
        UDUNITS string, ``1`` for counts, flags and text.
    long_name : str
        What it is, for people.
    standard_name : str, optional
        CF standard name where there is one.
    fill : optional
        Value of everything not yet written; NaN, 0 or empty text when not given.
    masked : bool
        Whether readers are told to take `fill` for missing (CF ``_FillValue``; integers then decode to floats).
    flags : Flags, optional
        Meanings of the values of a flag variable.
    attributes : mapping
        Further attributes.
    whole : bool
        Whether a variable of two dimensions is written at once, all profiles by one writer: it is one chunk then.
    """

    name: str
    dims: tuple[str, ...]
    dtype: Dtype
    units: str
    long_name: str
    standard_name: str | None = None
    fill: float | str | None = None
    masked: bool = False
    flags: Flags | None = None
    attributes: Mapping[str, Any] | None = None
    whole: bool = False

    @property
    def is_table(self) -> bool:
        """Whether it belongs to a table of profiles, which one writer fills: a value, or a few, a profile."""
        return self.dims == (PROFILE,) or (self.whole and self.dims[0] == PROFILE)

    @property
    def fill_value(self) -> float | str:
        """Value of everything not yet written."""
        if self.fill is not None:
            return self.fill
        if self.dtype == "string":
            return ""
        return float("nan") if self.dtype.startswith("float") else 0

    @property
    def is_time(self) -> bool:
        """Whether the values are instants, in seconds since 1970."""
        return self.units == TIME_UNITS

    def all_attributes(self) -> dict[str, Any]:
        """Every attribute the array carries on disk."""
        attributes: dict[str, Any] = {"units": self.units, "long_name": self.long_name}
        if self.standard_name is not None:
            attributes["standard_name"] = self.standard_name
        if self.is_time:
            attributes["calendar"] = "proleptic_gregorian"
        if self.masked:
            attributes["_FillValue"] = self.fill_value
        if self.flags is not None:
            attributes |= self.flags.attributes()
        return attributes | dict(self.attributes or {})


@dataclass(frozen=True)
class Group:
    """One group of the archive with its variables; the root is called ``/``."""

    name: str
    title: str
    variables: tuple[Variable, ...]

    def __getitem__(self, name: str) -> Variable:
        """Return the variable called `name`."""
        for variable in self.variables:
            if variable.name == name:
                return variable
        raise KeyError(f"the archive's group '{self.name}' has no variable '{name}'")

    @property
    def dims(self) -> tuple[str, ...]:
        """Dimensions its variables span, in order of appearance."""
        return tuple(dict.fromkeys(dim for variable in self.variables for dim in variable.dims))


@dataclass(frozen=True)
class Schema:
    """Every group of the archive."""

    version: str
    groups: tuple[Group, ...]

    def __iter__(self) -> Iterator[Group]:
        """Iterate over the groups, root first."""
        return iter(self.groups)

    def __getitem__(self, name: str) -> Group:
        """Return the group called `name`."""
        for group in self.groups:
            if group.name == name:
                return group
        raise KeyError(f"the archive has no group '{name}'")

    @property
    def dims(self) -> tuple[str, ...]:
        """Dimensions whose sizes belong to the mission, ``profile`` first."""
        return tuple(dict.fromkeys(dim for group in self.groups for dim in group.dims))


STATUS = ("pending", "done", "failed")
"""What a profile's `status` can be."""

QUALITY = Flags(
    "flag_masks",
    {
        "vibration": 1,
        "gap_in_the_record": 2,
        "prior_used_because_the_window_failed": 4,
        "implausible_self_motion": 8,
        "battery_rotated": 16,
        "climbing": 32,
        "window_not_converged": 64,
    },
)
"""Bits of `quality`."""

OUTCOME = Flags("flag_values", {"converged": 0, "iteration_limit": 1, "stalled": 2, "diverged": 3, "no_data": 4})
"""Values of a window's `outcome`."""

DISTURBANCE_PRIOR = Flags("flag_values", {"usual": 0, "rough_water": 1})
"""Values of a profile's `disturbance_prior`: the hull's usual one, or the one that lets sway and roll follow gusts."""

BUOYANCY = Flags("flag_values", {"depth_slope": 0, "density": 1})
"""Values of a profile's `buoyancy`: by the hull's depth slope, or by density and compressibility."""

YES_NO = Flags("flag_values", {"no": 0, "yes": 1})

CHANNELS = {
    "B_cu": ("N", "disturbance force along the surge axis"),
    "B_cv": ("N", "disturbance force along the sway axis"),
    "B_cw": ("N", "disturbance force along the heave axis"),
    "B_cp": ("N m", "disturbance moment about the roll axis"),
    "B_cq": ("N m", "disturbance moment about the pitch axis"),
    "B_cr": ("N m", "disturbance moment about the yaw axis"),
}
"""The six disturbances: unit and name."""

_SMOOTHED_CHANNELS = {
    name: (units, f"{long_name}, smoothed estimate on the step that starts at the record")
    for name, (units, long_name) in CHANNELS.items()
}

_ATTITUDE = {
    "roll": ("degree", "roll, starboard down positive", "platform_roll_starboard_down"),
    "pitch": ("degree", "pitch, nose up positive", "platform_pitch_fore_up"),
    "heading": ("degree", "heading, clockwise from true north", "platform_orientation"),
}

MOTION = {
    "X": ("m", "distance north of the start through the water"),
    "Y": ("m", "distance east of the start through the water"),
    "u": ("m s-1", "velocity through the water along the surge axis"),
    "v": ("m s-1", "velocity through the water along the sway axis"),
    "w": ("m s-1", "velocity through the water along the heave axis"),
    "p": ("degree s-1", "angular rate about the roll axis"),
    "q": ("degree s-1", "angular rate about the pitch axis"),
    "r": ("degree s-1", "angular rate about the yaw axis"),
}
"""Track and velocities of the reconstruction: unit and name."""

CONTROLS = {
    "battery_position": ("m", "translation of the moving battery, forward positive"),
    "battery_rotation": ("degree", "rotation of the moving battery"),
    "ballast_volume": ("cm3", "oil in the external bladder, buoyant positive"),
    "rudder": ("degree", "rudder angle"),
}
"""The recorded controls: unit and name."""

SEAWATER = {
    "water_density": ("kg m-3", "in-situ density of the water that the buoyancy goes by", "sea_water_density"),
    "water_temperature": ("degree_Celsius", "in-situ temperature of that water", "sea_water_temperature"),
    "water_pressure": ("dbar", "pressure of that water", "sea_water_pressure"),
}
"""The seawater along the record, where the buoyancy goes by it: unit, name and CF name."""

_DOWN = {"positive": "down"}


def profile_coordinate() -> Variable:
    """Coordinate of the profiles' numbers, the first variable of every group."""
    return Variable(PROFILE, (PROFILE,), "int64", "1", "number of the profile, from one surfacing to the next")


def index_coordinate(dim: str, long_name: str) -> Variable:
    """Coordinate that counts a group's second dimension from 0."""
    return Variable(dim, (dim,), "int64", "1", long_name)


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


def on_records(table: Mapping[str, tuple[str, str]], on: Mapping[str, Any]) -> tuple[Variable, ...]:
    """Variables on the records, from unit and name by name; `on` names their coordinates (CF ``coordinates``)."""
    return tuple(
        Variable(name, (PROFILE, "record"), "float32", units, long_name, attributes=on)
        for name, (units, long_name) in table.items()
    )


def of_profile(
    name: str, units: str, long_name: str, standard_name: str | None = None, dtype: Dtype = "float64"
) -> Variable:
    """One value a profile."""
    return Variable(name, (PROFILE,), dtype, units, long_name, standard_name)


def _fix(end: str) -> tuple[Variable, ...]:
    return (
        of_profile(f"{end}_time", TIME_UNITS, f"time of the {end} fix", "time"),
        of_profile(f"{end}_latitude", "degrees_north", f"latitude of the {end} fix", "latitude"),
        of_profile(f"{end}_longitude", "degrees_east", f"longitude of the {end} fix", "longitude"),
    )


_INCLUDED = (
    "from the smoother's displacement covariance (disturbance prior and sensors), the error of the fixes and that of "
    "the drift at the surface; errors of the hull's coefficients are not in it"
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


def _commits() -> Group:
    return Group(
        "commits",
        "written last of all that belongs to a profile: a profile with a marker is complete",
        (
            profile_coordinate(),
            Variable("marker", (PROFILE,), "string", "1", "what the worker reports of the finished profile, as JSON"),
        ),
    )


MISSION = Schema(
    SCHEMA_VERSION,
    (_root(), _series(), _prior(), _state(), _observed(), _smoothed(), _windows(), _drift_current(), _commits()),
)
"""The schema of a mission's archive."""
