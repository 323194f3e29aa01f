"""The windows of one profile: what each took, how it ended, and when."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gliderhpc.archive.profile import ProfileData
from gliderhpc.findings.drawing import ESTIMATE, FILTER, MEASURED, SHADE, SMOOTHER, label, legend, panels
from gliderhpc.outcomes import Outcome
from gliderhpc.report.page.content import Row

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_SIZE = (9.0, 6.6)
_MARKS = {
    Outcome.CONVERGED: (ESTIMATE, "o"), Outcome.ITERATION_LIMIT: (MEASURED, "s"), Outcome.STALLED: (SMOOTHER, "^"),
    Outcome.DIVERGED: (FILTER, "X"), Outcome.NO_DATA: (SHADE, "P"),
}  # fmt: skip
"""Colour and mark of an outcome: no two alike in either."""

_COLUMNS = ("cost", "iterations", "evaluations", "gradient_norm")


@dataclass(frozen=True, eq=False)
class Windows:
    """The windows of a profile: start and stop (s since its first sample), outcomes, and other columns of theirs."""

    start: NDArray[np.float64]
    stop: NDArray[np.float64]
    outcome: NDArray[np.int64]
    columns: dict[str, NDArray[np.float64]]


def windows_of(archive: xr.DataTree, data: ProfileData) -> Windows:
    """Read the windows of a profile."""
    table = archive["windows"].to_dataset().sel(profile=data.number).load()
    known = np.isfinite(table["outcome"].values)
    start, stop = (data.step * table[name].values[known].astype(np.float64) for name in ("start", "stop"))
    columns = {name: table[name].values[known].astype(np.float64) for name in _COLUMNS}
    return Windows(start, stop, table["outcome"].values[known].astype(np.int64), columns)


def window_rows(windows: Windows) -> list[Row]:
    """One row a window."""
    return [
        {"window": index, "start, s": windows.start[index], "stop, s": windows.stop[index],
         "outcome": Outcome(int(code)).name.lower().replace("_", " "),
         **{name.replace("_", " "): float(values[index]) for name, values in windows.columns.items()}}
        for index, code in enumerate(windows.outcome)
    ]  # fmt: skip


def windows_figure(data: ProfileData, windows: Windows) -> Figure:
    """Draw iterations, cost and optimality of the windows over the time of the profile, by outcome."""
    names = {"iterations": "iterations", "cost": "cost reached, eq. 28", "gradient_norm": "optimality measure"}
    figure, drawn = panels(3, 1, _SIZE, f"Windows of profile {data.number}", share_x=True)
    for axes, (name, title) in zip(drawn, names.items(), strict=True):
        _draw(axes, windows, name)
        label(axes, title, y="1")
    for axes in drawn[1:]:
        axes.set_yscale("symlog" if not _positive(windows, axes is drawn[1]) else "log")
    drawn[-1].set_xlabel("minutes since the profile's first sample")
    legend(drawn[0])
    return figure


def _positive(windows: Windows, cost: bool) -> bool:
    values = windows.columns["cost" if cost else "gradient_norm"]
    known = values[np.isfinite(values)]
    return bool(known.size and (known > 0.0).all())


def _draw(axes: Axes, windows: Windows, name: str) -> None:
    middle = (windows.start + windows.stop) / 120.0
    for outcome, (colour, mark) in _MARKS.items():
        chosen = windows.outcome == outcome
        if chosen.any():
            title = outcome.name.lower().replace("_", " ")
            axes.plot(middle[chosen], windows.columns[name][chosen], mark, color=colour, markersize=3.5, label=title)
