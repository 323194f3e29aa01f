"""Options of the importers: their names, types and ranges, for the command line, a watch and Python."""

import math
from collections.abc import Iterable, Mapping
from numbers import Real
from pathlib import Path
from typing import Any, NamedTuple

from gliderhpc.errors import InputError
from gliderhpc.yaml_text import shown


class NumberOption(NamedTuple):
    """Range and unit of a number; `optional` if the importer finds a value itself when none is given."""

    low: float
    high: float
    unit: str
    optional: bool = False

    @property
    def limits(self) -> tuple[float, float]:
        """Least and greatest value."""
        return self.low, self.high


NUMBERS: Mapping[str, NumberOption] = {
    "declination": NumberOption(-180.0, 180.0, " degree", optional=True),
    "linear_scale": NumberOption(-1.0, 1.0, " m per unit of LinPos"),
    "linear_zero": NumberOption(-1e6, 1e6, " units of LinPos"),
    "battery_scale": NumberOption(-100.0, 100.0, ""),
    "battery_zero": NumberOption(-10.0, 10.0, " m"),
}
"""Numbers by name."""

FLAGS = ("include_surfacing",)
FOLDERS = ("cache",)

BY_KIND: Mapping[str, tuple[str, ...]] = {
    "seaexplorer": ("linear_scale", "linear_zero", "include_surfacing", "declination"),
    "slocum": ("cache", "declination", "battery_scale", "battery_zero"),
    "seaglider": ("declination",),
    "og1": ("declination",),
}
"""Names of each importer's options."""


def check_option_names(kind: str | None, names: Iterable[str]) -> None:
    """Refuse options that the importer of a kind of records does not have; None for any of the importers.

    Raises
    ------
    InputError
        There is no such option; the message names those that there are.
    """
    known = BY_KIND.get(kind, ()) if kind is not None else tuple(dict.fromkeys(sum(BY_KIND.values(), ())))
    for name in names:
        if name not in known:
            options = f"the options are {', '.join(known)}" if known else "it has none"
            subject = "no importer has an option" if kind is None else f"the import of {kind} has no option"
            raise InputError(f"{subject} '{name}'; {options}")


def check_option_values(options: Mapping[str, Any]) -> None:
    """Refuse values of the wrong type, or out of range; options of other names are not checked.

    Raises
    ------
    InputError
        There is such a value; the message states the option, its value and what it must be.
    """
    for name, value in options.items():
        rule = _broken_rule(name, value)
        if rule:
            raise InputError(f"{name}={shown(value)}: it must be {rule}; correct the value")


def _broken_rule(name: str, value: Any) -> str | None:
    """Describe the requirement that a value violates; None if it is valid."""
    if name in NUMBERS:
        number = NUMBERS[name]
        valid = number.optional if value is None else _is_within(value, *number.limits)
        return None if valid else f"a number from {number.low:.7g} to {number.high:.7g}{number.unit}"
    if name in FLAGS:
        return None if isinstance(value, bool) else "true or false"
    if name in FOLDERS:
        return None if value is None or isinstance(value, str | Path) else "the name of a folder"
    return None


def _is_within(value: Any, low: float, high: float) -> bool:
    """Return whether a value is a finite number in a range; booleans do not count as numbers."""
    if isinstance(value, bool) or not isinstance(value, Real):
        return False
    number = float(value)
    return math.isfinite(number) and low <= number <= high
