"""The twins of ``twin estimators``: calm, impulsive, harsh, of slow sensors, of wrong coefficients, of the prior."""

from dataclasses import dataclass

import numpy as np

from gliderhpc.estimation.settings import EstimationSettings, default_prior
from gliderhpc.platform import Platform
from gliderhpc.simulator import Scenario, load_scenario
from gliderhpc.twins.changes import RecordChanges
from gliderhpc.twins.hulls import with_coefficient_errors, with_sample_interval
from gliderhpc.twins.inversion import TwinCase
from gliderhpc.twins.runs import TwinRun, labelled
from gliderhpc.twins.study import TwinPlan, TwinSize
from gliderhpc.twins.worlds import course_of, drawn_from, with_white_errors, without_impulses, world

CALM = "calm"
IMPULSIVE = "impulsive"
HARSH = "harsh"
COEFFICIENTS = "coefficients within 15%"
PRIOR = "drawn from the prior"

EXACT = (CALM, IMPULSIVE)
"""Twins whose hull the estimator knows exactly, at the platform's own sample interval."""

COEFFICIENT_ERROR = 0.15
_COEFFICIENT_STREAM = 4_000


@dataclass(frozen=True, kw_only=True)
class EstimatorsSize(TwinSize):
    """How much is run; `seeds` are the twins drawn from the prior.

    Attributes
    ----------
    depth : float
        Of the twins, m.
    intervals : tuple of float
        Sample intervals of the slow records, s.
    case_seeds : int
        Twins of every other kind.
    """

    depth: float
    intervals: tuple[float, ...]
    case_seeds: int


def estimator_runs(plan: TwinPlan[EstimatorsSize]) -> list[TwinRun]:
    """List every twin."""
    (platform,) = plan.platforms
    size = plan.size
    runs = [
        labelled(case, kind=name)
        for seed in plan.seeds[: size.case_seeds]
        for name, case in usual_cases(platform, size, seed).items()
    ]
    return runs + [labelled(prior_case(platform, size.depth, seed), kind=PRIOR) for seed in plan.seeds]


def usual_cases(platform: Platform, size: EstimatorsSize, seed: int) -> dict[str, TwinCase]:
    """Every twin of a seed but for that of the prior, by name."""
    impulsive = world(size.depth)
    calm = without_impulses(impulsive)
    rng = np.random.default_rng([seed, _COEFFICIENT_STREAM])
    wrong = with_coefficient_errors(platform, COEFFICIENT_ERROR, rng)
    slow = {
        interval_name(interval): _case(
            platform, calm, seed, assumed=with_sample_interval(platform, interval),
            changes=RecordChanges(sample_interval=interval),
        )
        for interval in size.intervals
    }  # fmt: skip
    return {
        CALM: _case(platform, calm, seed),
        IMPULSIVE: _case(platform, impulsive, seed),
        HARSH: _case(platform, harsh_world(size.depth), seed),
        **slow,
        COEFFICIENTS: _case(platform, impulsive, seed, assumed=wrong),
    }


def prior_case(platform: Platform, depth: float, seed: int) -> TwinCase:
    """Twin of the water and the sensors that filter and smoother assume."""
    return _case(platform, with_white_errors(world(depth, disturbances=drawn_from(default_prior(platform)))), seed)


def harsh_world(depth: float) -> Scenario:
    """Give one dive of the scenario ``harsh`` to a depth (m)."""
    return load_scenario("harsh").replaced({"profiles": 1, "depth": depth, "depth_spread": 0.0})


def interval_name(interval: float) -> str:
    """What the calm twin with a sample interval (s) is called."""
    return f"calm, {interval:g} s"


def _case(
    platform: Platform,
    scenario: Scenario,
    seed: int,
    *,
    assumed: Platform | None = None,
    changes: RecordChanges | None = None,
) -> TwinCase:
    return TwinCase(
        platform, scenario, seed, EstimationSettings(), course_of(seed), assumed, changes or RecordChanges()
    )
