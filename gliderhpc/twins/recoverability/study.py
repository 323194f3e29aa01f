"""``twin recoverability``: what can be found at all, and how far the unobserved part of the motion strays.

Yaw impulses of known amplitude and width against their detection, height and timing; the floor in multiples of the
identification noise; the axial offset and the velocity error of the under-determined self-motion, with exact
coefficients and with every one wrong by up to 15 %; and from these the budget of the current's uncertainty for the
platform at hand.
"""

from gliderhpc.estimation.current_budget import LEAST_TWINS, budget_text
from gliderhpc.findings.findings import Findings
from gliderhpc.twins.recoverability.figure import draw_recoverability
from gliderhpc.twins.recoverability.results import recoverability_results
from gliderhpc.twins.recoverability.runs import (
    PRESETS,
    RecoverabilitySize,
    recoverability_runs,
    recovered_rows,
)
from gliderhpc.twins.recoverability.table import compare_recoverability
from gliderhpc.twins.runs import Row
from gliderhpc.twins.study import TwinPlan, TwinStudy, twin_findings

NAME = "recoverability"
BUDGET = "budget.yaml"
FULL = RecoverabilitySize(
    impulse_depth=80.0,
    quiet_depth=200.0,
    motion_depth=200.0,
    amplitudes=(0.05, 0.1, 0.15, 0.2, 0.3, 0.45, 0.7, 1.0, 1.5, 3.0),
    widths=(0.3, 0.6, 1.2, 2.0, 3.0, 5.0),
    impulse_seeds=8,
    quiet_seeds=10,
    seeds=30,
)

QUICK = RecoverabilitySize(
    impulse_depth=40.0,
    quiet_depth=40.0,
    motion_depth=40.0,
    amplitudes=(0.1, 0.3, 1.0),
    widths=(0.6, 1.2, 2.0),
    impulse_seeds=1,
    quiet_seeds=3,
    seeds=4,
)


def conclude(plan: TwinPlan[RecoverabilitySize], rows_of_runs: list[list[Row]]) -> Findings:
    """Findings, one table of comparisons a preset, and the budget beside them."""
    results = recoverability_results(plan, [row for rows in rows_of_runs for row in rows])
    (platform,) = plan.platforms
    facts = {
        "noise": results.noise, "detection": results.detection, "floors": results.floors, "errors": results.errors,
        "budget": results.budget.model_dump(),
    }  # fmt: skip
    return twin_findings(
        NAME, plan,
        {f"{platform.name}, {preset}": compare_recoverability(results, preset) for preset in PRESETS},
        [*results.findings, *results.motions], draw_recoverability(results), facts,
        {BUDGET: budget_text(results.budget)},
    )  # fmt: skip


STUDY = TwinStudy(NAME, FULL, QUICK, recoverability_runs, conclude, job=recovered_rows, least_seeds=LEAST_TWINS)
"""What the program runs."""
