"""Description of a glider: the platform file, its checks, and the hulls shipped with the package.

A platform file is YAML. Its keys have the file's units (degrees, cm3); properties ending in ``_rad`` or ``_m3`` give
the SI values that the model uses. The checks here are static, key by key;
:func:`gliderhpc.flight.glider.load_platform` checks whether the hull can glide at all.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Self, get_args

import numpy as np
import yaml
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, ValidationError, model_validator

from gliderhpc.errors import InputError
from gliderhpc.platform_ranges import check_plausible
from gliderhpc.platform_sections import (
    CalibrationErrors,
    Negative,
    NonNegative,
    NonNegativeVector,
    NonPositive,
    Number,
    Positive,
    PositiveVector,
    Section,
    SixPositive,
    Text,
    Uncertainty,
    Vector,
    has_number,
)  # fmt: skip
from gliderhpc.shipped import ShippedFiles, nearest
from gliderhpc.yaml_text import first_fault, number_rule, parse_value, parse_yaml, read_yaml_text, shown

GRAVITY = 9.81
"""Standard gravity of the model, m/s2."""

CUBIC_CENTIMETRE = 1e-6
"""One cm3 in m3."""

_FILES = ShippedFiles("platform", "gliderhpc", "platforms", "see `gliderhpc platforms petrel-l --yaml`")


class Mass(Section):
    """Masses in kg, without the oil; they need not add up to the total (docs/theory/model.md)."""

    total: Positive = Field(description="total mass m, kg")
    hull: Positive = Field(description="mass of the static hull m_h, kg")
    battery: Positive = Field(description="mass of the moving battery m_p, kg")


class Position(Section):
    """Positions in metres from the centre of buoyancy, x forward, y starboard, z down."""

    hull: Vector = Field(description="centre of the static hull r_h, m")
    battery: Number = Field(description="battery at rest r_p1 along x, m")
    bladder: Vector = Field(description="external bladder r_b, m")
    reservoir: Vector = Field(description="internal reservoir r_m, m")


class Buoyancy(Section):
    """Buoyancy engine, and the water in which it works."""

    neutral_volume: Number = Field(description="oil volume in the bladder at which the hull is neutrally buoyant, cm3")
    oil_density: Number = Field(ge=500.0, le=2000.0, description="density of the oil, kg/m3")
    water_density: Number = Field(ge=950.0, le=1100.0, description="density of the water, kg/m3")
    depth_slope: Number = Field(description="buoyancy gained with depth k_z, N/m")
    compressibility: NonNegative | None = Field(
        default=None,
        lt=1e-4,
        description="compressibility of the hull, 1/dbar; with it, measured seawater replaces the depth slope",
    )
    thermal_expansion: NonNegative = Field(default=0.0, lt=1e-2, description="thermal expansion of the hull, 1/K")

    @property
    def neutral_volume_m3(self) -> float:
        """Oil volume at which the hull is neutrally buoyant, m3."""
        return self.neutral_volume * CUBIC_CENTIMETRE


class Viscous(Section):
    """Coefficients of the viscous forces and moments, eqs. 11 and 12."""

    K_D0: Positive = Field(description="drag at zero angle of attack, kg/m")
    K_D: NonNegative = Field(description="drag over the angle of attack squared, kg/m/rad2")
    K_beta: Negative = Field(description="side force over sideslip, kg/m/rad")
    K_L: Positive = Field(description="lift over angle of attack, kg/m/rad")
    K_MR: Number = Field(description="roll moment over sideslip, kg/rad")
    K_p: NonPositive = Field(description="roll damping, kg s/rad")
    K_M0: Number = Field(description="pitch moment at zero angle of attack, kg")
    K_M: Number = Field(description="pitch moment over angle of attack, kg/rad")
    K_q: NonPositive = Field(description="pitch damping, kg s/rad")
    K_MY: Number = Field(description="yaw moment over sideslip, kg/rad")
    K_r: NonPositive = Field(description="yaw damping, kg s/rad")
    K_L0: Number = Field(default=0.0, description="lift at zero angle of attack, kg/m")
    K_delta: Number = Field(default=0.0, description="yaw moment over rudder angle, kg/rad")
    rate_damping_floor: NonNegative = Field(
        default=0.0, description="speed V_0 added in quadrature to the speed in the rate damping, m/s"
    )


class Sensors(Section):
    """Resolution and noise of the records, and their errors, which are removed; there are none by default."""

    attitude_resolution: Positive = Field(le=10.0, description="quantum of roll, pitch and heading, degree")
    depth_noise: Positive = Field(le=10.0, description="standard deviation of the depth, m")
    sample_interval: Positive = Field(le=3600.0, description="usual time between samples, s")
    roll_offset: Number = Field(default=0.0, ge=-45, le=45, description="subtracted from the roll, degree")
    pitch_offset: Number = Field(default=0.0, ge=-45, le=45, description="subtracted from the pitch, degree")
    pitch_scale: Number = Field(default=1.0, ge=0.5, le=2, description="factor on the recorded pitch less its offset")
    heading_offset: Number = Field(default=0.0, ge=-180, le=180, description="subtracted from the heading, degree")
    heading_deviation: tuple[Number, Number, Number, Number] = Field(
        default=(0.0, 0.0, 0.0, 0.0),
        description="subtracted from the heading: factors of sin, cos, sin 2 and cos 2 of the heading, degree",
    )
    depth_lag: Number = Field(default=0.0, description="delay of the recorded depth behind the attitude, s")
    actuator_lag: Number = Field(
        default=0.0, ge=-3600, le=3600, description="delay of the actuators behind their records, s"
    )

    @property
    def attitude_resolution_rad(self) -> float:
        """Quantum of roll, pitch and heading, rad."""
        return math.radians(self.attitude_resolution)


class Vibration(Section):
    """Actuator rates above which the sensors vibrate (docs/theory/estimate.md)."""

    battery_position_rate: Positive = Field(description="rate of the battery's translation, m/s")
    battery_rotation_rate: Positive = Field(description="rate of the battery's rotation, degree/s")
    ballast_rate: Positive = Field(description="rate of the bladder's volume, cm3/s")
    guard: NonNegative = Field(description="time added on either side, s")

    @property
    def battery_rotation_rate_rad(self) -> float:
        """Rate of the battery's rotation, rad/s."""
        return math.radians(self.battery_rotation_rate)

    @property
    def ballast_rate_m3(self) -> float:
        """Rate of the bladder's volume, m3/s."""
        return self.ballast_rate * CUBIC_CENTIMETRE


class DisturbancePrior(Section):
    """First-order Gauss-Markov prior of the six disturbances (docs/smoother.md), order u, v, w, p, q, r."""

    deviation: SixPositive = Field(description="stationary standard deviation, N and N m")
    correlation_time: SixPositive = Field(description="correlation time, s")

    @property
    def numbers(self) -> tuple[float, ...]:
        """The six deviations and the six correlation times."""
        return (*self.deviation, *self.correlation_time)


class Platform(Section):
    """Hull, actuators and sensors of a glider: the platform file (docs/how-to/platform.md), validated and immutable."""

    name: Text = Field(description="the hull's name")
    source: Text = Field(description="where each number comes from")
    mass: Mass
    position: Position
    battery_eccentricity: NonNegative = Field(description="eccentricity of the battery R_p, m")
    inertia: PositiveVector = Field(description="rigid-body inertia J_x, J_y, J_z, kg m2")
    added_mass: NonNegativeVector = Field(description="added mass M_f1, M_f2, M_f3, kg")
    added_inertia: NonNegativeVector = Field(description="added inertia I_f1, I_f2, I_f3, kg m2")
    buoyancy: Buoyancy
    viscous: Viscous
    sensors: Sensors
    vibration: Vibration
    prior: DisturbancePrior | None = Field(default=None, description="disturbance prior, as `gliderhpc tune` writes it")
    uncertainty: Uncertainty | None = Field(default=None, description="uncertainty of these numbers")

    @model_validator(mode="before")
    @classmethod
    def _read_former_calibration(cls, content: Any) -> Any:
        """Accept the section `calibration` of files before version 0.2 as ``uncertainty.covariance``."""
        if not isinstance(content, dict) or "calibration" not in content:
            return content
        content = dict(content)
        former, section = content.pop("calibration"), content.get("uncertainty") or {}
        if former is None:
            return content
        if not isinstance(section, dict) or section.get("covariance") is not None:
            raise ValueError(
                "there are both a calibration and an uncertainty.covariance; remove the section calibration"
            )
        return content | {"uncertainty": section | {"covariance": former}}

    @model_validator(mode="after")
    def _belong_together(self) -> Self:
        check_together(self)
        return self

    @property
    def calibration(self) -> CalibrationErrors | None:
        """Errors that remain after a calibration, None for a hull that has not been calibrated."""
        return None if self.uncertainty is None else self.uncertainty.covariance


def ballast_masses(platform: Platform, volume: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the masses of the oil outside and inside the hull for a bladder volume (docs/theory/model.md).

    Parameters
    ----------
    platform : Platform
        The hull.
    volume : array_like
        Oil volume in the external bladder, m3, any shape.

    Returns
    -------
    m_b, m_m : ndarray
        Effective in-water mass of the bladder's oil and mass of the reservoir's oil relative to trim, kg.

    Notes
    -----
    ``m_b = (rho_oil - rho_w) V`` and ``m_m = rho_w V_neutral - rho_oil V``. The net mass is therefore
    ``m_x = m_b + m_m = -rho_w (V - V_neutral)``: a fuller bladder makes the glider lighter.
    """
    buoyancy = platform.buoyancy
    volume = np.asarray(volume, dtype=np.float64)
    m_b = (buoyancy.oil_density - buoyancy.water_density) * volume
    m_m = buoyancy.water_density * buoyancy.neutral_volume_m3 - buoyancy.oil_density * volume
    return m_b, m_m


def shipped_platforms() -> list[str]:
    """Return the names of the hulls that come with the package, sorted."""
    return _FILES.names()


def read_platform(name_or_path: str | Path) -> Platform:
    """Read and validate a platform file, key by key.

    Parameters
    ----------
    name_or_path : str or Path
        Name of a shipped hull (it takes precedence over a file of the same name) or path of a YAML file.

    Returns
    -------
    Platform

    Raises
    ------
    InputError
        There is no such hull or file, it is not YAML, it has an unknown or missing key, or a value is out of range or
        implausible for a glider.
    """
    label, content = _FILES.content(name_or_path)
    platform = _validated(label, _with_covariance(label, content, Path(name_or_path).parent))
    check_plausible(label, platform)
    return platform


def _with_covariance(label: str, content: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Replace the name of a covariance's file, relative to the platform file's folder, by the file's content."""
    section = content.get("uncertainty")
    if not isinstance(section, dict) or not isinstance(section.get("covariance"), str):
        return content
    path = folder / section["covariance"]
    if not path.is_file():
        raise InputError(f"{label}: uncertainty.covariance is {path}, but there is no such file; correct its name")
    matrix = parse_yaml(read_yaml_text(path, "covariance"), str(path))
    return content | {"uncertainty": section | {"covariance": matrix}}


def platform_text(name_or_path: str | Path) -> str:
    """Return the unchecked text of a platform file; a missing file is refused as in :func:`read_platform`."""
    return _FILES.text(name_or_path)[1]


def platform_yaml(platform: Platform) -> str:
    """Return a platform as the text of a platform file, without keys that were left at their defaults."""
    content = platform.model_dump(mode="json", exclude_unset=True, exclude_none=True)
    return str(yaml.safe_dump(content, sort_keys=False, allow_unicode=True, width=120, default_flow_style=None))


def with_overrides(platform: Platform, overrides: Mapping[str, Any]) -> Platform:
    """Return a platform with some values replaced, validated as if they were in the file.

    Parameters
    ----------
    platform : Platform
        The hull to start from; it is not changed.
    overrides : mapping of str to value
        Dotted keys of the platform file with their values, or these as YAML: ``{"buoyancy.neutral_volume": -215}``.

    Raises
    ------
    InputError
        A platform has no such key, or a value is out of range.
    """
    # What the hull does not state must stay unstated: the errors that it may have depend on that.
    content = platform.model_dump(exclude_unset=True, exclude_none=True)
    for key, value in overrides.items():
        _check_known_key(f"`platform.{key}`", key)
        expected = "neither a number nor a list such as [1, 2, 3]"
        given = parse_value(value, f"platform.{key}", expected) if isinstance(value, str) else value
        _assign(content, key.split("."), given)
    if not overrides:
        return platform
    return _validated(" ".join(f"`platform.{key}={value}`" for key, value in overrides.items()), content)


def _assign(content: dict[str, Any], keys: list[str], value: Any) -> None:
    for key in keys[:-1]:
        content = content.setdefault(key, {})
    content[keys[-1]] = value


def _sections() -> dict[str, type[Section]]:
    """Return the keys of the platform file that contain further keys, with their models."""
    sections = {}
    for name, field in Platform.model_fields.items():
        for annotation in (field.annotation, *get_args(field.annotation)):
            if isinstance(annotation, type) and issubclass(annotation, Section):
                sections[name] = annotation
    return sections


def _descriptions() -> dict[str, str]:
    """Return every dotted key that takes a value, with its description."""
    sections = _sections()
    keys = {name: field.description or "" for name, field in Platform.model_fields.items() if name not in sections}
    for section, model in sections.items():
        keys |= {f"{section}.{name}": field.description or "" for name, field in model.model_fields.items()}
    return keys


def _check_known_key(label: str, key: str) -> None:
    known = _descriptions()
    if key not in known:
        raise InputError(f"{label}: a platform has no key '{key}'{nearest(key, known)}; keys are {', '.join(known)}")


def _validated(label: str, content: Any) -> Platform:
    try:
        return Platform.model_validate(content)
    except ValidationError as error:
        raise InputError(f"{label}: {_explanation(error)}") from None


def _explanation(error: ValidationError) -> str:
    """Return one line on the first fault, with the number of the others."""
    fault, others = first_fault(error), error.error_count() - 1
    key = ".".join(part for part in fault["loc"] if isinstance(part, str))
    line = _fault_line(fault["type"], key, fault)
    return line + (f" (and {others} more fault{'s' if others > 1 else ''})" if others else "")


def _fault_line(kind: str, key: str, fault: Mapping[str, Any]) -> str:
    if kind == "value_error" and not key:
        # The fault is of several keys, which the message names; the value would be the whole file.
        return str(fault["ctx"]["error"])
    meaning = _descriptions().get(key, "")
    of = f" ({meaning})" if meaning else ""
    if kind == "extra_forbidden":
        known = [*_descriptions(), *_sections()]
        return f"unknown key '{key}'{nearest(key, known)}; remove it or correct its name"
    if kind == "missing" and not any(isinstance(part, int) for part in fault["loc"]):
        return f"missing key '{key}'{of}; add it, as in `gliderhpc platforms petrel-l --yaml`"
    return f"{key} is {shown(fault['input'])}{of}: {_rule(kind, key, fault)}"


_LIST = "a list of 3 numbers"
_LISTS = {
    "prior": "a list of 6 numbers",
    "sensors.heading_deviation": "a list of 4 numbers",
    "uncertainty": "a list, as `gliderhpc calibrate` writes it",
}
"""Kinds of the lists of some keys; all others have three numbers."""


def _rule(kind: str, key: str, fault: Mapping[str, Any]) -> str:
    if rule := number_rule(fault):
        return rule
    if kind in {"missing", "too_long", "too_short", "tuple_type"}:
        return f"it must be {next((text for start, text in _LISTS.items() if key.startswith(start)), _LIST)}"
    if kind in {"model_type", "model_attributes_type", "dict_type"}:
        return "it must hold `key: value` pairs, as in `gliderhpc platforms petrel-l --yaml`"
    if kind == "value_error":
        return f"it {fault['ctx']['error']}"
    return str(fault["msg"]).lower()


# Checks of several numbers at once: masses, moments of inertia, keys of uncertainties

ROUNDED_MASSES = 1.01
"""Largest ratio of the parts' mass to the total that rounding can cause."""

ROUNDED_MOMENTS = 1.1
"""Largest ratio of a moment of inertia to the sum of the other two that rounding to two digits can cause: a slender
hull has 12 kg m2 in pitch if it has 0.6 in roll and 11 in yaw."""


def check_together(platform: Platform) -> None:
    """Refuse numbers that are valid individually but impossible in combination.

    Raises
    ------
    ValueError
        There are such numbers; the message names the key and the rule.
    """
    _check_masses(platform)
    _check_inertia(platform)
    _check_uncertain_keys(platform)


def _check_masses(platform: Platform) -> None:
    """Refuse parts heavier than the whole; they need not add up to the total, which includes the oil."""
    mass = platform.mass
    if mass.hull + mass.battery > ROUNDED_MASSES * mass.total:
        raise ValueError(
            f"mass.total is {mass.total:g} (total mass m, kg): it must be at least that of mass.hull and mass.battery "
            f"together, {mass.hull + mass.battery:g}; correct the masses"
        )


def _check_inertia(platform: Platform) -> None:
    """Refuse a moment of inertia greater than the sum of the other two, which no body has."""
    moments = platform.inertia
    greatest = max(moments)
    others = sum(moments) - greatest
    if greatest > ROUNDED_MOMENTS * others:
        raise ValueError(
            f"inertia is [{', '.join(f'{moment:g}' for moment in moments)}] (rigid-body inertia J_x, J_y, J_z, kg m2): "
            f"each must be at most the sum of the other two, as in every body, but {greatest:g} is more than "
            f"{others:g}; correct the values"
        )


def _check_uncertain_keys(platform: Platform) -> None:
    for entry, keys in ({} if platform.uncertainty is None else platform.uncertainty.keys).items():
        for key in keys:
            if not has_number(platform, key):
                known = nearest(key, _number_keys(platform))
                raise ValueError(f"there is no number '{key}', which uncertainty.{entry} names{known}; correct the key")


def _number_keys(node: Any, key: str = "") -> Iterator[str]:
    """Yield the dotted keys of all single numbers of a section, with those of lists: ``position.hull.2``."""
    if isinstance(node, Section):
        parts = {name: getattr(node, name) for name in type(node).model_fields if name != "uncertainty"}
    elif isinstance(node, tuple):
        parts = {str(index): value for index, value in enumerate(node)}
    elif node is None or isinstance(node, float | int):
        yield key
        return
    else:
        return
    for name, value in parts.items():
        yield from _number_keys(value, f"{key}.{name}".removeprefix("."))
