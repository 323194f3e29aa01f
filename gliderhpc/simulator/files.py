"""Files of a synthetic mission, appended profile by profile: the observations and the truth.

The truth file has four kinds of rows, each on its own axis: the steps (``truth_time``), the samples (``time``), the
impulses (``impulse``) and the profiles (``dive``, because ``profile`` is a variable along ``time``). The axis ``level``
has the depths of the true current profiles, and the axis ``leg`` has dive and climb.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from gliderhpc.observations.files.appended import AppendedFile, Column
from gliderhpc.observations.format import CONVENTIONS, SEAWATER, VARIABLES, VELOCITY, VELOCITY_STD
from gliderhpc.observations.records import Fix, ProfileRecord
from gliderhpc.observations.truth import OF_PROFILE
from gliderhpc.observations.writer import variable_attributes
from gliderhpc.simulator.profile import ProfileTruth
from gliderhpc.vocabulary import CHANNELS

_DECIMALS = 9
"""Decimals of degrees and cm3 in the file. They remove the rounding errors of the conversion to SI units and back, and
quantised values remain multiples of the quantum."""

_TIMES = {
    "time": ("time", {"standard_name": "time", "long_name": "time", "axis": "T"}),
    "fix_time": ("fix", {"standard_name": "time", "long_name": "time of the GPS fix"}),
}


def observation_file(
    path: Path, attributes: Mapping[str, str | int | float], *, overwrite: bool = False
) -> AppendedFile:
    """Open an observation file for appending; with `overwrite`, an existing file is replaced on completion."""
    return AppendedFile(path, {"Conventions": CONVENTIONS, **attributes}, {"fix": 1024}, overwrite=overwrite)


def observation_columns(record: ProfileRecord) -> dict[str, Column]:
    """Return the columns of one profile and its fixes for an observation file."""
    columns = {}
    for name, values in observation_variables([record]).items():
        dimension, attributes = _TIMES.get(name) or _of_format(name)
        columns[name] = Column((dimension,), values, attributes)
    return columns


def observation_variables(records: Sequence[ProfileRecord]) -> dict[str, npt.NDArray[np.generic]]:
    """Variables of the observation format, in the units of the format, from records in the order of the mission.

    Fixes are taken from `ProfileRecord.surface_fixes_before` and `surface_fixes_after`.
    """
    columns = [_columns(record) for record in records]
    variables = {name: np.concatenate([column[name] for column in columns]) for name in columns[0]}
    fixes = [fix for record in records for fix in (*record.surface_fixes_before, *record.surface_fixes_after)]
    return variables | _fix_columns(fixes)


def _of_format(name: str) -> tuple[str, dict[str, str]]:
    variable = VARIABLES[name]
    return variable.dimension, variable_attributes(variable)


def _columns(record: ProfileRecord) -> dict[str, npt.NDArray[np.generic]]:
    seawater = {name: values for name in SEAWATER if (values := getattr(record, name)) is not None}
    return {
        "time": record.instants,
        "profile": np.full(len(record.time), record.number, dtype=np.int32),
        "roll": np.round(np.degrees(record.roll), _DECIMALS),
        "pitch": np.round(np.degrees(record.pitch), _DECIMALS),
        "heading": np.mod(np.round(np.degrees(record.heading), _DECIMALS), 360.0),
        "depth": record.depth,
        "battery_position": record.battery_position,
        "battery_rotation": np.round(np.degrees(record.battery_rotation), _DECIMALS),
        "ballast_volume": np.round(record.ballast_volume * 1e6, _DECIMALS),
        **seawater,
        **_velocity(record),
    }


def _velocity(record: ProfileRecord) -> dict[str, npt.NDArray[np.generic]]:
    """Return the measured velocity relative to the water and its standard deviation; empty if there is none."""
    if record.velocity is None or record.velocity_std is None:
        return {}
    return dict(zip((*VELOCITY, *VELOCITY_STD), (*record.velocity.T, *record.velocity_std.T), strict=True))


def _fix_columns(fixes: Sequence[Fix]) -> dict[str, npt.NDArray[np.generic]]:
    return {
        "fix_time": np.array([fix.time for fix in fixes], dtype="datetime64[ns]"),
        "fix_latitude": np.array([fix.latitude for fix in fixes]),
        "fix_longitude": np.array([fix.longitude for fix in fixes]),
    }


_DISTURBANCES = {
    "B_cu": ("N", "axial disturbance force"),
    "B_cv": ("N", "lateral disturbance force"),
    "B_cw": ("N", "normal disturbance force"),
    "B_cp": ("N m", "disturbance roll moment"),
    "B_cq": ("N m", "disturbance pitch moment"),
    "B_cr": ("N m", "disturbance yaw moment"),
}
_MOTION = {
    "X": ("m", "displacement through the water to the north, from the start of the profile"),
    "Y": ("m", "displacement through the water to the east, from the start of the profile"),
    "u": ("m s-1", "velocity relative to the water, forward"),
    "v": ("m s-1", "velocity relative to the water, starboard"),
    "w": ("m s-1", "velocity relative to the water, downward in the body frame"),
    "p": ("degree s-1", "angular rate about the roll axis"),
    "q": ("degree s-1", "angular rate about the pitch axis"),
    "r": ("degree s-1", "angular rate about the yaw axis"),
    "water_north": ("m s-1", "current to the north where the glider is, without the gust"),
    "water_east": ("m s-1", "current to the east where the glider is, without the gust"),
    "gust": ("m s-1", "gust where the glider is, horizontal and to starboard of the course"),
    "water_up": ("m s-1", "vertical velocity of the water where the glider is, upward"),
}
_IMPULSES = {
    "impulse_amplitude": ("N m", "peak of an impulse of the yaw moment"),
    "impulse_width": ("s", "standard deviation of its Gaussian shape"),
}
_DIVES = {
    "current_north": ("m s-1", "velocity of the water to the north, averaged over the dive"),
    "current_east": ("m s-1", "velocity of the water to the east, averaged over the dive"),
    "surface_current_north_before": ("m s-1", "current to the north at the surface before the dive"),
    "surface_current_east_before": ("m s-1", "current to the east at the surface before the dive"),
    "surface_current_north_after": ("m s-1", "current to the north at the surface after the dive"),
    "surface_current_east_after": ("m s-1", "current to the east at the surface after the dive"),
    "course": ("degree", "course steered, clockwise from north"),
    "net_mass": ("kg", "net mass in water, not in any record"),
    "entry_latitude": ("degrees_north", "true latitude at the start of the dive"),
    "entry_longitude": ("degrees_east", "true longitude at the start of the dive"),
    "exit_latitude": ("degrees_north", "true latitude at the end of the dive"),
    "exit_longitude": ("degrees_east", "true longitude at the end of the dive"),
}
_TRUTH_TIMES = {
    "time": "time of the sample",
    "truth_time": "start of the interval over which the disturbance is averaged",
    "impulse_time": "time of the impulse's peak",
    "entry_time": "start of the dive",
    "exit_time": "end of the dive",
}
_RECORDED = {
    name: (VARIABLES[name].unit, f"true {VARIABLES[name].long_name}")
    for name in ("depth", "roll", "pitch", "heading", "battery_position", "battery_rotation", "ballast_volume")
}
_LEVELS = {
    "level": ("m", "depth of the current profile"),
    "profile_current_north": ("m s-1", "current to the north halfway through the dive, without gusts"),
    "profile_current_east": ("m s-1", "current to the east halfway through the dive, without gusts"),
}
_FORCE, _FORCE_ANGLE, _RATE = "kg m-1", "kg m-1 rad-1", "kg s"
_COEFFICIENTS = {
    "K_D0": _FORCE, "K_D": "kg m-1 rad-2", "K_beta": _FORCE_ANGLE, "K_L0": _FORCE, "K_L": _FORCE_ANGLE,
    "K_MR": "kg rad-1", "K_p": _RATE, "K_M0": "kg", "K_M": "kg rad-1", "K_q": _RATE, "K_MY": "kg rad-1", "K_r": _RATE,
    "M_f1": "kg", "M_f2": "kg", "M_f3": "kg", "I_f1": "kg m2", "I_f2": "kg m2", "I_f3": "kg m2",
}  # fmt: skip
_DESCRIPTIONS = {
    **_LEVELS,
    **{f"true_{name}": (unit, f"true {name} on dive and climb") for name, unit in _COEFFICIENTS.items()},
    **_DISTURBANCES,
    **_MOTION,
    **_IMPULSES,
    **_DIVES,
    **_RECORDED,
}


def truth_file(
    path: str | Path, attributes: Mapping[str, str | int | float], *, overwrite: bool = False
) -> AppendedFile:
    """Open a truth file for appending; with `overwrite`, an existing file is replaced on completion."""
    chunks = {"dive": 64, "impulse": 1024}
    return AppendedFile(Path(path), {"Conventions": "CF-1.11", **attributes}, chunks, overwrite=overwrite)


def append_truth(file: AppendedFile, truth: ProfileTruth) -> None:
    """Append one profile's truth."""
    file.append(_truth_columns(truth))


def _truth_columns(truth: ProfileTruth) -> dict[str, Column]:
    """Return the columns of one profile's rows, with their axes, by name."""
    columns: dict[str, Column] = {}
    for axes, values in (
        (("truth_time",), _step_rows(truth)),
        (("time",), _sample_rows(truth)),
        (("impulse",), _impulse_rows(truth)),
        (("dive",), _dive_row(truth)),
        (("dive", "leg"), _coefficient_row(truth)),
        (("dive", "level"), _level_row(truth)),
    ):
        columns |= {name: Column(axes, column, _attributes(name)) for name, column in values.items()}
    return columns | {"level": Column(("level",), truth.levels, _attributes("level"), grows=False)}


def _step_rows(truth: ProfileTruth) -> dict[str, npt.NDArray[np.generic]]:
    steps = len(truth.disturbances)
    # Rounding to single precision is a million times smaller than the error of any estimate, and halves the file.
    channels = truth.disturbances.T.astype(np.float32)
    return {
        "truth_time": _instants(truth, np.arange(steps, dtype=np.float64) * truth.step),
        "truth_profile": np.full(steps, truth.number, dtype=np.int32),
        **dict(zip(CHANNELS, channels, strict=True)),
    }


def _sample_rows(truth: ProfileTruth) -> dict[str, npt.NDArray[np.generic]]:
    phi, theta, psi, north, east, depth, u, v, w, p, q, r = truth.states.T
    position, rotation, volume = truth.actuators.T
    water_north, water_east, gust = truth.water.T
    values = {
        "roll": np.degrees(phi),
        "pitch": np.degrees(theta),
        "heading": np.mod(np.degrees(psi), 360.0),
        "depth": depth,
        "X": north,
        "Y": east,
        "u": u,
        "v": v,
        "w": w,
        "p": np.degrees(p),
        "q": np.degrees(q),
        "r": np.degrees(r),
        "battery_position": position,
        "battery_rotation": np.degrees(rotation),
        "ballast_volume": volume * 1e6,
        "water_north": water_north,
        "water_east": water_east,
        "gust": gust,
        "water_up": truth.water_up,
    }
    return {
        "time": _instants(truth, truth.time),
        "profile": np.full(len(truth.time), truth.number, dtype=np.int32),
        # The relative rounding error of 1e-7 is negligible, and doubles would fill the disk with noise.
        **{name: column.astype(np.float32) for name, column in values.items()},
    }


def _impulse_rows(truth: ProfileTruth) -> dict[str, npt.NDArray[np.generic]]:
    return {
        "impulse_time": _instants(truth, np.array([impulse.time for impulse in truth.impulses])),
        "impulse_profile": np.full(len(truth.impulses), truth.number, dtype=np.int32),
        "impulse_amplitude": np.array([impulse.amplitude for impulse in truth.impulses]),
        "impulse_width": np.array([impulse.width for impulse in truth.impulses]),
    }


def _dive_row(truth: ProfileTruth) -> dict[str, npt.NDArray[np.generic]]:
    scalars = {
        "current_north": truth.current[0],
        "current_east": truth.current[1],
        "surface_current_north_before": truth.surface_currents[0][0],
        "surface_current_east_before": truth.surface_currents[0][1],
        "surface_current_north_after": truth.surface_currents[1][0],
        "surface_current_east_after": truth.surface_currents[1][1],
        "course": np.degrees(truth.course) % 360.0,
        "net_mass": truth.net_mass,
        "entry_latitude": truth.entry[0],
        "entry_longitude": truth.entry[1],
        "exit_latitude": truth.exit[0],
        "exit_longitude": truth.exit[1],
    }
    return {
        "dive": np.array([truth.number], dtype=np.int32),
        "entry_time": _instants(truth, np.zeros(1)),
        "exit_time": _instants(truth, np.array([truth.duration])),
        **{name: np.array([value], dtype=np.float64) for name, value in scalars.items()},
    }


def _coefficient_row(truth: ProfileTruth) -> dict[str, npt.NDArray[np.generic]]:
    return {f"true_{name}": np.array([pair]) for name, pair in truth.coefficients.items()}


def _level_row(truth: ProfileTruth) -> dict[str, npt.NDArray[np.generic]]:
    return {
        "profile_current_north": truth.shear[None, :, 0].copy(),
        "profile_current_east": truth.shear[None, :, 1].copy(),
    }


def _instants(truth: ProfileTruth, seconds: npt.NDArray[np.float64]) -> npt.NDArray[np.generic]:
    return truth.epoch + np.rint(seconds * 1e9).astype("timedelta64[ns]")


def _attributes(name: str) -> dict[str, str]:
    if name in _TRUTH_TIMES:
        return {"long_name": _TRUTH_TIMES[name], "standard_name": "time"}
    if name in OF_PROFILE.values():
        return {"units": "1", "long_name": "number of the profile"}
    unit, long_name = _DESCRIPTIONS[name]
    return {"units": unit, "long_name": long_name}
