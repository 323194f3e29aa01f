"""Plan of the next dive, as commanded by the pilot, which replaces the assumption that it resembles the last one."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from gliderhpc.shipped import describe_unknown_key
from gliderhpc.yaml_text import number_rule, read_model, shown

Array = NDArray[np.float64]


class DivePlan(BaseModel):
    """Commands for the next dive; missing values are taken from the dives so far.

    Attributes
    ----------
    heading : float, optional
        Heading through the water, degrees clockwise from true north.
    duration : float, optional
        Time from the start of the dive to the surfacing, s.
    speed : float, optional
        Horizontal speed through the water, m/s.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    heading: float | None = Field(None, strict=True, ge=-360.0, le=360.0)
    duration: float | None = Field(None, strict=True, gt=0.0, le=864_000.0)
    speed: float | None = Field(None, strict=True, gt=0.0, le=5.0)

    @property
    def text(self) -> str:
        """Commands that are given, as text; empty if there are none."""
        heading = None if self.heading is None else f"heading {round(self.heading) % 360:03d}°"
        duration = None if self.duration is None else f"{self.duration / 60.0:.0f} min"
        speed = None if self.speed is None else f"{self.speed:g} m/s"
        return ", ".join(part for part in (heading, duration, speed) if part is not None)

    def displacement(self, expected: Array, duration: float) -> Array:
        """Return the planned displacement through the water.

        Parameters
        ----------
        expected : (2,) array
            Displacement expected without a plan, north and east, m.
        duration : float
            Duration that goes with it, s.
        """
        planned = duration if self.duration is None else self.duration
        length = float(np.hypot(*expected)) * planned / duration if self.speed is None else self.speed * planned
        angle = np.arctan2(expected[1], expected[0]) if self.heading is None else np.radians(self.heading)
        return length * np.array([np.cos(angle), np.sin(angle)])


def read_plan(path: Path) -> DivePlan:
    """Read the plan of the next dive from a YAML file.

    Raises
    ------
    InputError
        The file cannot be read, or a key or value cannot be used.
    """
    return read_model(path, "plan", DivePlan, _describe_fault)


def _describe_fault(fault: Mapping[str, Any]) -> str:
    key, known = ".".join(map(str, fault["loc"])), list(DivePlan.model_fields)
    if not key:
        return f"contains no plan; it may have the keys {', '.join(known)}, such as `heading: 120`"
    if fault["type"] == "extra_forbidden":
        return describe_unknown_key(key, known)
    return f"{key} is {shown(fault['input'])}: {number_rule(fault) or fault['msg']}"
