"""The closing summary of a run: one line a profile and the mission's medians."""

import math

import numpy as np
from rich.table import Table
from rich.text import Text

from gliderhpc.mission.profile_rows import Row
from gliderhpc.mission.run import MissionResult

_WIDEST_MESSAGE = 60


def summary_table(result: MissionResult) -> Table:
    """Table of a run's profiles."""
    table = Table(title="Profiles", title_justify="left")
    for heading in ("profile", "status", "depth m", "hours", "windows", "converged", "current N m/s", "E m/s", "s"):
        table.add_column(heading, justify="left" if heading == "status" else "right", no_wrap=True)
    table.add_column("message", max_width=_WIDEST_MESSAGE, overflow="fold")
    for number, row in sorted(result.rows.items()):
        table.add_row(
            str(number),
            row["status"],
            _number(row, "max_depth", ".0f"),
            _number(row, "duration", ".2f", 1.0 / 3600.0),
            _number(row, "window_count", "d"),
            _number(row, "converged_fraction", ".0%"),
            _number(row, "dac_north", "+.3f"),
            _number(row, "dac_east", "+.3f"),
            _number(row, "run_seconds", ".1f"),
            Text(row.get("message", "")),
        )
    return table


def closing_line(result: MissionResult, store: str) -> str:
    """Sentence with the counts, the medians and the time."""
    done = [row for row in result.rows.values() if row["status"] == "done"]
    parts = [f"{len(done)} of {len(result.rows)} profiles done"]
    if result.kept:
        parts[0] += f" ({len(result.kept)} of them by an earlier run)"
    if result.failed:
        parts.append(f"{len(result.failed)} failed: {', '.join(map(str, result.failed))}")
    speeds = [math.hypot(row["dac_north"], row["dac_east"]) for row in done if "dac_north" in row]
    if speeds:
        parts.append(f"median current {np.median(speeds):.3f} m/s over {len(speeds)} profiles")
    return f"{'; '.join(parts)}; {result.seconds:.1f} s; {store}"


def _number(row: Row, name: str, form: str, factor: float = 1.0) -> str:
    value = row.get(name)
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "-"
    return format(value * factor if factor != 1.0 else value, form)
