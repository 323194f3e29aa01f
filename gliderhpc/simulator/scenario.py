"""Scenario of a synthetic mission, and scenario files."""

import datetime
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import BeforeValidator, Field, NaiveDatetime, ValidationError, model_validator

from gliderhpc.errors import InputError
from gliderhpc.observations.times import FIRST_YEAR, LAST_YEAR
from gliderhpc.shipped import ShippedFiles, describe_unknown_key
from gliderhpc.simulator.sections import (
    Actuation,
    Coefficients,
    Current,
    Disturbances,
    Episode,
    Fouling,
    Gusts,
    Integration,
    Latitude,
    Longitude,
    Ocean,
    ScenarioSection,
    SensorErrors,
    Steering,
    Surface,
    VerticalCurrent,
)
from gliderhpc.yaml_text import first_fault, shown

_FILES = ShippedFiles("scenario", "gliderhpc.simulator", "scenarios", "such as `depth: 400`")


def _in_utc(start: object) -> object:
    """Return a time without its zone, in UTC."""
    if isinstance(start, datetime.datetime) and start.tzinfo is not None:
        return start.astimezone(datetime.UTC).replace(tzinfo=None)
    return start


class Scenario(ScenarioSection):
    """A synthetic mission, except for its hull and its seed."""

    name: str = Field("impulses", min_length=1, description="name of the scenario")
    profiles: int = Field(4, ge=1, description="number of profiles")
    depth: float = Field(200.0, ge=15, le=11_000, description="depth at which a dive is turned into a climb, m")
    depth_spread: float = Field(
        0.0, ge=0, description="half width of the uniform distribution of turning depths about depth, m"
    )
    start_depth: float = Field(1.0, ge=0, le=5, description="depth at which the records of a profile begin and end, m")
    start: Annotated[NaiveDatetime, BeforeValidator(_in_utc)] = Field(
        datetime.datetime(2024, 1, 1),
        ge=datetime.datetime(FIRST_YEAR, 1, 1),
        lt=datetime.datetime(LAST_YEAR, 1, 1),
        description="start of the mission, UTC",
    )
    origin: tuple[Latitude, Longitude] = Field((18.0, 115.0), description="latitude and longitude of the start, degree")
    actuation: Actuation = Actuation()
    steering: Steering = Steering()
    disturbances: Disturbances = Disturbances()
    current: Current = Current()
    vertical: VerticalCurrent = VerticalCurrent()
    gusts: Gusts = Gusts()
    ocean: Ocean | None = Field(None, description="stratification and CTD; null for water of one density")
    coefficients: Coefficients = Coefficients()
    fouling: Fouling = Fouling()
    episode: Episode = Episode()
    sensors: SensorErrors = SensorErrors()
    surface: Surface = Surface()
    integration: Integration = Integration()

    @model_validator(mode="after")
    def _spread_fits(self) -> Self:
        if self.depth - self.depth_spread < 15.0:
            raise ValueError(
                f"a depth_spread of {self.depth_spread:g} m leaves less than 15 m of the depth of {self.depth:g} m; "
                "make it smaller"
            )
        return self

    def replaced(self, values: Mapping[str, Any]) -> "Scenario":
        """Return the scenario with some top-level values replaced, validated again.

        Parameters
        ----------
        values : mapping
            New values by name; None leaves a value unchanged.

        Raises
        ------
        InputError
            A name does not belong to a scenario, or a value is out of range.
        """
        given = {name: value for name, value in values.items() if value is not None}
        return read_scenario({**self.model_dump(), **given})


def read_scenario(content: Mapping[str, Any], label: str = "scenario") -> Scenario:
    """Validate a scenario given as plain values; `label` names it in messages.

    Raises
    ------
    InputError
        A key is unknown or out of range; the message names the first one.
    """
    try:
        return Scenario.model_validate(content)
    except ValidationError as error:
        raise InputError(f"{label}: {_explanation(error)}") from None


def shipped_scenarios() -> list[str]:
    """Names of the scenarios shipped with the package, sorted."""
    return _FILES.names()


def load_scenario(name_or_path: str | Path) -> Scenario:
    """Read a scenario file; values that it omits are those of the scenario ``impulses``.

    Parameters
    ----------
    name_or_path : str or Path
        Name of a shipped scenario (which has priority over a file of the same name), or path of a YAML file.

    Raises
    ------
    InputError
        There is no such scenario or file, it is not YAML, a key is unknown, or a value is out of range.
    """
    label, content = _FILES.content(name_or_path)
    return read_scenario(content, label)


def _explanation(error: ValidationError) -> str:
    """Describe the first fault in one line; for an unknown key, name the nearest known one."""
    fault = first_fault(error)
    key = ".".join(str(part) for part in fault["loc"]) or "the scenario"
    if fault["type"] == "extra_forbidden":
        return describe_unknown_key(key, list(_section_at(fault["loc"][:-1]).model_fields))
    if fault["type"] == "value_error":
        return f"{key}: {fault['ctx']['error']}"
    return f"{key} is {shown(fault['input'])}: {fault['msg'][0].lower()}{fault['msg'][1:]}"


def _section_at(keys: tuple[int | str, ...]) -> type[ScenarioSection]:
    section: type[ScenarioSection] = Scenario
    for key in keys:
        annotation = section.model_fields[str(key)].annotation
        section = annotation if isinstance(annotation, type) and issubclass(annotation, ScenarioSection) else section
    return section
