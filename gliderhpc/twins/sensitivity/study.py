"""``twin sensitivity``: what noise, offsets, wrong coefficients, steps and gaps do to the answer (section 5.1.1).

Every disturbed run has a twin without that one error: the same dive, the same noise. Biases are differences of the two,
so that neither the estimator's own error nor the truth enters.
"""

from gliderhpc.findings.findings import Findings
from gliderhpc.twins.hulls import COEFFICIENTS
from gliderhpc.twins.runs import Row
from gliderhpc.twins.sensitivity.figure import draw_sensitivity
from gliderhpc.twins.sensitivity.runs import SensitivitySize, sensitivity_runs
from gliderhpc.twins.sensitivity.shifts import SensitivityResults, biases, summarise
from gliderhpc.twins.sensitivity.table import compare_sensitivity
from gliderhpc.twins.study import TwinPlan, TwinStudy, twin_findings

NAME = "sensitivity"
PRESETS = ("recommended", "paper")
PITCHES = (23.0, 35.0)
"""Of the twins with offsets, degree: the usual glide and a steep one."""

FULL = SensitivitySize(
    depth=120.0, noise_depth=300.0, seeds=10, draws=4, presets=PRESETS, pitches=PITCHES,
    single_coefficients=COEFFICIENTS,
)  # fmt: skip
QUICK = SensitivitySize(
    depth=40.0, noise_depth=60.0, seeds=2, draws=2, presets=PRESETS, pitches=PITCHES[:1],
    single_coefficients=("K_D0", "K_L"),
)  # fmt: skip


def conclude(plan: TwinPlan[SensitivitySize], rows: list[Row]) -> Findings:
    """Findings, one table of comparisons a preset."""
    results = SensitivityResults(rows, summarise(rows), biases(rows))
    (platform,) = plan.platforms
    comparisons = {f"{platform.name}, {preset}": compare_sensitivity(results, preset) for preset in plan.size.presets}
    facts = {"summary": results.summary, "biases": results.biases}
    return twin_findings(NAME, plan, comparisons, rows, draw_sensitivity(results), facts)


STUDY = TwinStudy(NAME, FULL, QUICK, sensitivity_runs, conclude)
"""What the program runs."""
