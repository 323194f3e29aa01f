"""Values as a reader sees them in a table; the CSV beside it keeps all their digits."""

import datetime
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from gliderhpc.findings.tables import number
from gliderhpc.report.page.content import Grid

MOST_ROWS = 60
"""More are left to the CSV."""

_PLACES = ("latitude", "longitude")

_PROSE = 30
"""Letters; longer text is prose."""


@dataclass(frozen=True)
class Column:
    """A column that the page shows, and whether it holds numbers."""

    name: str
    numeric: bool


def columns_of(grid: Grid) -> list[Column]:
    """Keys of a table's rows in order of appearance, as many as are shown."""
    return [Column(name, _holds_numbers(row.get(name) for row in grid.rows)) for name in _names(grid)[: grid.shown]]


def shown_rows(grid: Grid) -> Sequence[Any]:
    """Rows that the page shows."""
    return grid.rows[:MOST_ROWS]


def left_out(grid: Grid) -> str:
    """Say how many rows and columns the page does not show, nothing where it shows all."""
    rows = max(0, len(grid.rows) - MOST_ROWS)
    columns = 0 if grid.shown is None else max(0, len(_names(grid)) - grid.shown)
    parts = [f"{count} more {what}" for count, what in ((rows, "rows"), (columns, "columns")) if count]
    return f"{' and '.join(parts)} are in {grid.stem}.csv." if parts else ""


def _names(grid: Grid) -> list[str]:
    return list(dict.fromkeys(name for row in grid.rows for name in row))


def is_number(value: Any) -> bool:
    """Whether a value belongs to the right of its cell."""
    return isinstance(value, int | float | np.number) and not isinstance(value, bool | np.bool_)


def is_long(value: Any) -> bool:
    """Whether a value is prose, which takes some width to be readable."""
    return isinstance(value, str) and len(value) > _PROSE


def _holds_numbers(values: Iterable[Any]) -> bool:
    known = [value for value in values if value is not None]
    return bool(known) and all(is_number(value) for value in known)


def cell(value: Any, column: str = "") -> str:
    """One value as text: three significant digits, places to 10 m, times to the second, a dash for what is missing."""
    if value is None:
        return number(None)
    if isinstance(value, np.datetime64 | datetime.datetime):
        instant = pd.Timestamp(value)
        return number(None) if pd.isna(instant) else f"{instant:%Y-%m-%d %H:%M:%S}"
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    if isinstance(value, float | np.floating):
        place = column.startswith(_PLACES) and math.isfinite(value)
        return f"{value:.4f}".replace("-", "−") if place else _decimal(float(value))
    return str(value)


def _decimal(value: float) -> str:
    if math.isfinite(value) and value == round(value) and abs(value) < 1e5:
        return f"{value:.0f}".replace("-", "−")
    return number(value).replace("-", "−", 1) if math.isfinite(value) and value < 0.0 else number(value)
