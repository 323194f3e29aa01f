"""Values as a reader sees them in a table; the CSV beside it keeps all their digits."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from gliderhpc.analysis.tables import number
from gliderhpc.report.page.content import Grid

MOST_ROWS = 60
"""More are left to the CSV."""


def columns_of(grid: Grid) -> list[str]:
    """All keys of a table's rows, in order of appearance."""
    return list(dict.fromkeys(name for row in grid.rows for name in row))


def shown_rows(grid: Grid) -> Sequence[Any]:
    """Rows that the page shows."""
    return grid.rows[:MOST_ROWS]


def left_out(grid: Grid) -> int:
    """How many rows the page does not show."""
    return max(0, len(grid.rows) - MOST_ROWS)


def is_number(value: Any) -> bool:
    """Whether a value belongs to the right of its cell."""
    return isinstance(value, int | float | np.number) and not isinstance(value, bool | np.bool_)


def cell(value: Any) -> str:
    """One value as text: three significant digits, times to the second, a dash for what is missing."""
    if value is None:
        return number(None)
    if isinstance(value, np.datetime64):
        return number(None) if np.isnat(value) else str(np.datetime_as_string(value, unit="s")).replace("T", " ")
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    if isinstance(value, float | np.floating):
        return _decimal(float(value))
    return str(value)


def _decimal(value: float) -> str:
    if math.isfinite(value) and value == round(value) and abs(value) < 1e5:
        return f"{value:.0f}".replace("-", "−")
    return number(value).replace("-", "−", 1) if math.isfinite(value) and value < 0.0 else number(value)
