"""Numbers, values with their errors, currents, times and tables as text."""

import math
from collections.abc import Collection, Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

ABSENT = "–"
"""Text of a missing number."""

_MIN_DEVIATION = 1e-3
"""Standard deviation below which numbers have exponents."""


def number(value: float | None) -> str:
    """Format a number with three significant digits, without an exponent if legible; a missing one as a dash."""
    if value is None or not math.isfinite(value):
        return ABSENT
    if value != 0.0 and not 1e-3 <= abs(value) < 1e5:
        return f"{value:.2e}"
    digits = 2 if value == 0.0 else max(0, 2 - math.floor(math.log10(abs(value))))
    return f"{value:.{digits}f}"


def markdown(columns: Sequence[str], rows: Iterable[Sequence[str]], of_numbers: Collection[str] = ()) -> str:
    """Format cells as a Markdown table, with the columns `of_numbers` right-aligned."""
    rules = ["---:" if column in of_numbers else "---" for column in columns]
    lines = [columns, rules, *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)


def signed(value: float, form: str = ".3f") -> str:
    """Format a number with its sign, using the minus sign of the figures' axes."""
    return f"{value:+{form}}".replace("-", "−")


def with_deviation(value: float, deviation: float) -> str:
    """Format a value with its sign and its standard deviation, both to the second digit of the latter."""
    if not (math.isfinite(value) and deviation >= _MIN_DEVIATION and math.isfinite(deviation)):
        return f"{signed(value, '.3g')} ± {deviation:.2g}"
    decimals = max(0, 1 - math.floor(math.log10(deviation)))
    return f"{signed(value, f'.{decimals}f')} ± {deviation:.{decimals}f}"


def polar(north: float, east: float) -> str:
    """Format a current (m/s) as speed and the direction towards which it flows."""
    towards = round(np.degrees(np.arctan2(east, north))) % 360
    return f"{np.hypot(north, east):.3f} m/s towards {towards:03d}°"


def instant(epoch: np.datetime64) -> str:
    """Format a time to the second, UTC."""
    return str(np.datetime_as_string(epoch, unit="s")).replace("T", " ") + " UTC"


def iso_instant(time: np.datetime64 | NDArray[Any]) -> str | None:
    """Format a time in ISO 8601 to the second, UTC; None if it is not known."""
    return None if np.isnat(time) else str(np.datetime_as_string(time, unit="s")) + "Z"
