"""``twin windows``: window, margin, handover and transform against the truth (section 5.1.2, Fig. 5).

The operating point is chosen by the error against the truth, never by the cost: the cost falls as noise is fitted.
"""

from gliderhpc.findings.findings import Findings
from gliderhpc.twins.runs import Row
from gliderhpc.twins.study import TwinPlan, TwinStudy, twin_findings
from gliderhpc.twins.windows.figure import draw_windows
from gliderhpc.twins.windows.results import window_results
from gliderhpc.twins.windows.sweeps import PRESETS, WindowsSize, window_runs
from gliderhpc.twins.windows.table import compare_windows
from gliderhpc.twins.windows.verdict import verdict_sentence

NAME = "windows"
FULL = WindowsSize(
    depth=50.0,
    seeds=10,
    lengths=(15.0, 20.0, 30.0, 45.0, 60.0, 90.0),
    margins=(5.0, 15.0, 20.0),
    thresholds=(0.05, 0.1, 0.4, 0.8, 1.6, 3.2),
    tolerances=(5e-3, 2e-3, 1e-3, 5e-4, 2e-4, 1e-4, 3e-5, 1e-5),
    yaw_scales=(0.1, 0.3, 3.0),
    other_scales=(0.1, 0.3, 3.0, 10.0),
)

QUICK = WindowsSize(
    depth=30.0,
    seeds=2,
    lengths=(15.0, 30.0, 60.0),
    margins=(5.0,),
    thresholds=(0.05, 3.2),
    tolerances=(5e-3, 1e-4),
    yaw_scales=(0.3,),
    other_scales=(3.0,),
)


def conclude(plan: TwinPlan[WindowsSize], rows: list[Row]) -> Findings:
    """Findings, one table of comparisons a hull and preset."""
    results = window_results(plan, rows)
    comparisons = {
        f"{platform.name}, {preset}": compare_windows(results, platform.name, preset)
        for platform in plan.platforms
        for preset in PRESETS
    }
    sentences = tuple(verdict_sentence(line) for line in results.verdicts)
    facts = {"verdicts": results.verdicts, "sentences": sentences, "summary": results.summary}
    return twin_findings(NAME, plan, comparisons, results.rows, draw_windows(results), facts, remarks=sentences)


STUDY = TwinStudy(NAME, FULL, QUICK, window_runs, conclude)
"""What the program runs."""
