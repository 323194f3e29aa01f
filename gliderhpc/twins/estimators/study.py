"""``twin estimators``: filter, smoother, heavy-tailed smoother and adjoint on the same records, and which for what.

Every twin is simulated once and put before all of them; what each makes of it is held against the truth channel by
channel, with the intervals where there are any.
"""

from dataclasses import asdict, replace

from gliderhpc.findings.files import as_plain
from gliderhpc.findings.findings import Findings
from gliderhpc.twins.estimators.arms import HEAVY_TAILS
from gliderhpc.twins.estimators.cases import CALM, IMPULSIVE, PRIOR, EstimatorsSize, estimator_runs
from gliderhpc.twins.estimators.figure import draw_estimators
from gliderhpc.twins.estimators.page import page_text
from gliderhpc.twins.estimators.results import estimator_results
from gliderhpc.twins.estimators.scoring import run_rows
from gliderhpc.twins.estimators.table import compare_estimators
from gliderhpc.twins.runs import Row
from gliderhpc.twins.study import TwinPlan, TwinStudy, twin_findings

NAME = "estimators"
PAGE = "estimators.md"
FULL = EstimatorsSize(depth=200.0, intervals=(2.0, 4.0, 10.0, 20.0), seeds=40, case_seeds=10)
QUICK = EstimatorsSize(depth=50.0, intervals=(4.0, 20.0), seeds=4, case_seeds=2)


def conclude(plan: TwinPlan[EstimatorsSize], rows_of_runs: list[list[Row]]) -> Findings:
    """Findings, one table of comparisons a kind of twin with exact coefficients, and the page beside them."""
    results = estimator_results(plan, [row for rows in rows_of_runs for row in rows])
    (platform,) = plan.platforms
    asked = [{**asdict(target), "met": target.met} for target in results.targets]
    facts = {
        "degrees_of_freedom": HEAVY_TAILS, "summary": results.summary, "targets": asked, "advice": results.advice,
        "sentences": results.sentences,
    }  # fmt: skip
    found = twin_findings(
        NAME, plan,
        {f"{platform.name}, {case}": compare_estimators(results, case) for case in (CALM, IMPULSIVE, PRIOR)},
        results.rows, draw_estimators(results.summary, platform.sensors.sample_interval, plan.size.intervals), facts,
        remarks=results.sentences,
    )  # fmt: skip
    return replace(found, documents={PAGE: page_text(as_plain(found.content), f"{NAME}.png")})


STUDY = TwinStudy(NAME, FULL, QUICK, estimator_runs, conclude, job=run_rows)
"""What the program runs."""
