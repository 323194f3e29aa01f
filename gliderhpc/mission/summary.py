"""Summary of a run for the terminal: one line for each profile, and medians of the mission."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from rich.table import Table
from rich.text import Text

from gliderhpc.archive.current import adopted_current
from gliderhpc.mission.profile_rows import Row
from gliderhpc.mission.run import MissionResult

_MESSAGE_WIDTH = 60


def summary_table(result: MissionResult) -> Table:
    """Return a table of a run's profiles."""
    table = Table(
        title="Profiles",
        title_justify="left",
        caption="current by the smoother; a: by the adjoint, where the smoother has none",
        caption_justify="left",
    )
    for heading in ("profile", "status", "depth m", "hours", "windows", "converged", "current N m/s", "E m/s", "s"):
        table.add_column(heading, justify="left" if heading == "status" else "right", no_wrap=True)
    table.add_column("message", max_width=_MESSAGE_WIDTH, overflow="fold")
    for number, row in sorted(result.rows.items()):
        table.add_row(
            str(number),
            row["status"],
            _number(row, "max_depth", ".0f"),
            _number(row, "duration", ".2f", 1.0 / 3600.0),
            _number(row, "window_count", "d"),
            _number(row, "converged_fraction", ".0%"),
            *_current(row),
            _number(row, "run_seconds", ".1f"),
            Text(row.get("message", "")),
        )
    return table


def closing_line(result: MissionResult, store: str) -> str:
    """Return a sentence with counts, median current and duration."""
    done = [row for row in result.rows.values() if row["status"] == "done"]
    parts = [f"{len(done)} of {len(result.rows)} profiles done"]
    if result.reused:
        parts[0] += f" ({len(result.reused)} of them by an earlier run)"
    if result.failed:
        parts.append(f"{len(result.failed)} failed: {', '.join(map(str, result.failed))}")
    current = adopted_current(columns_of(done))
    if current.known.any():
        speed = np.median(np.hypot(current.north, current.east)[current.known])
        parts.append(f"median current {speed:.3f} m/s over {current.known.sum()} profiles ({current.label})")
    return f"{'; '.join(parts)}; {result.seconds:.1f} s; {store}"


def columns_of(rows: Sequence[Row]) -> dict[str, list[Any]]:
    """Collect the columns ``dac_*`` of rows; NaN where a row lacks one."""
    names = dict.fromkeys(name for row in rows for name in row if name.startswith("dac_"))
    return {name: [row.get(name, np.nan) for row in rows] for name in names}


def _current(row: Row) -> tuple[str, str]:
    """Format north and east of the adopted current, marked where it is not the smoother's."""
    current = adopted_current(row)
    if not current.known:
        return "-", "-"
    mark = "" if current.smoothed else " a"
    return f"{float(current.north):+.3f}{mark}", f"{float(current.east):+.3f}{mark}"


def _number(row: Row, name: str, form: str, factor: float = 1.0) -> str:
    value = row.get(name)
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "-"
    return format(value * factor if factor != 1.0 else value, form)
