"""The catalogue drawn: every event by depth, and the strongest against the ceiling."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from gliderhpc.findings.drawing import FILTER, MODEL, SMALL, TRUTH, label, legend, panels
from gliderhpc.report.studies.turbulence.table_3 import unit_of
from gliderhpc.studies.events.settings import EventSettings
from gliderhpc.studies.library.turbulence.ensembles import NullFloor

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def events_figure(events: pd.DataFrame, settings: EventSettings, floor: NullFloor | None, title: str) -> Figure:
    """Draw (a) the events' amplitudes by depth and (b) the strongest in order."""
    unit, strongest = unit_of(settings.channel), events.head(settings.strongest)
    figure, (by_depth, ranked) = panels(1, 2, (10.5, 5.0), f"Events of {settings.channel}: {title}")
    by_depth.plot(events["amplitude"], events["depth"], "o", color=MODEL, markersize=3.0, alpha=0.6)
    by_depth.plot(strongest["amplitude"], strongest["depth"], "o", color=FILTER, markersize=4.0, label="strongest")
    by_depth.invert_yaxis()
    by_depth.set_xscale("symlog", linthresh=float(events["amplitude"].abs().min()))
    ranked.set_yscale("log")
    place = np.arange(len(strongest))
    ranked.bar(place, strongest["amplitude"].abs(), color=FILTER, width=0.7)
    ranked.set_xticks(place, [str(number) for number in strongest["source_profile"]], fontsize=SMALL)
    if floor is not None:
        for sign in (-1.0, 1.0):
            by_depth.axvline(sign * floor.ceiling, color=TRUTH, linewidth=0.7, linestyle="--")
        ranked.axhline(floor.ceiling, color=TRUTH, linewidth=0.9, linestyle="--", label="null ceiling")
    label(by_depth, f"(a) {len(events)} events", f"amplitude ({unit})", "depth (m)")
    label(ranked, "(b) the strongest", "profile", f"magnitude ({unit})")
    legend(by_depth)
    legend(ranked)
    return figure
