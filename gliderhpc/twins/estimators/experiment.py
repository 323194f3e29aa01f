"""``twin estimators``: filter, smoother, heavy-tailed smoother and adjoint on the same records, and their best uses.

Every twin is simulated once for all estimators. Each estimate is compared with the truth channel by channel, including
the coverage of intervals if the estimator gives any.
"""

from dataclasses import replace

from gliderhpc.findings.results import Findings, as_plain
from gliderhpc.twins.estimators.conclusions import (
    compare_estimators,
    describe_intervals,
    describe_recommendation,
    describe_tally,
    purposes,
    recommend,
)
from gliderhpc.twins.estimators.figure import draw_estimators
from gliderhpc.twins.estimators.methods import DEGREES_OF_FREEDOM
from gliderhpc.twins.estimators.page import page_text
from gliderhpc.twins.estimators.runs import (
    CALM,
    IMPULSIVE,
    PRIOR,
    EstimatorsSize,
    estimator_runs,
    run_rows,
    summarise,
)
from gliderhpc.twins.scoring import Row
from gliderhpc.twins.study import TwinPlan, TwinStudy, twin_findings

NAME = "estimators"
PAGE = "estimators.md"
FULL = EstimatorsSize(depth=200.0, intervals=(2.0, 4.0, 10.0, 20.0), seeds=40, case_seeds=10)
QUICK = EstimatorsSize(depth=50.0, intervals=(4.0, 20.0), seeds=4, case_seeds=2)


def conclude(plan: TwinPlan[EstimatorsSize], rows: list[Row]) -> Findings:
    """Make findings, with a table of comparisons for three kinds of twin, and the page."""
    (platform,) = plan.platforms
    summary = summarise(rows)
    advice = [recommend(rows, purpose) for purpose in purposes(plan.size.intervals)]
    sentences = (*map(describe_recommendation, advice), describe_tally(advice), *describe_intervals(summary))
    findings = twin_findings(
        NAME,
        plan,
        {f"{platform.name}, {kind}": compare_estimators(summary, kind) for kind in (CALM, IMPULSIVE, PRIOR)},
        rows=rows,
        figure=draw_estimators(summary, platform.sensors.sample_interval, plan.size.intervals),
        facts={"degrees_of_freedom": DEGREES_OF_FREEDOM, "summary": summary, "advice": advice, "sentences": sentences},
        remarks=sentences,
    )
    return replace(findings, documents={PAGE: page_text(as_plain(findings.content), f"{NAME}.png")})


STUDY = TwinStudy(NAME, FULL, QUICK, estimator_runs, conclude, job=run_rows)
"""The study that the program runs."""
