"""What ``twin windows`` gives, out of its runs' rows."""

from dataclasses import dataclass

from gliderhpc.twins.runs import Row
from gliderhpc.twins.study import TwinPlan
from gliderhpc.twins.windows.excerpt import Excerpt, draw_excerpt
from gliderhpc.twins.windows.sweeps import PRESETS, WindowsSize
from gliderhpc.twins.windows.verdict import overall_error, summarise, verdict


@dataclass(frozen=True, eq=False)
class WindowsResults:
    """What the study gives.

    Attributes
    ----------
    rows : list of dict
        One a run.
    summary : list of dict
        One a setting of a sweep, hull and preset: median, lower and upper quartile of each score over the seeds.
    excerpts : tuple of Excerpt
        Sliding and not.
    verdicts : list of dict
        One a hull and preset: what the evidence says of the operating point.
    """

    rows: list[Row]
    summary: list[Row]
    excerpts: tuple[Excerpt, ...]
    verdicts: list[Row]


def window_results(plan: TwinPlan[WindowsSize], rows: list[Row]) -> WindowsResults:
    """Summarise and judge the rows of every run, and draw the excerpts on the first hull."""
    rows = [row | {"overall": overall_error(row)} for row in rows]
    excerpts = tuple(
        draw_excerpt(plan.platforms[0], plan.size, preset, sliding) for preset in PRESETS for sliding in (True, False)
    )
    names = [(platform.name, preset) for platform in plan.platforms for preset in PRESETS]
    return WindowsResults(rows, summarise(rows), excerpts, [verdict(rows, *name) for name in names])
