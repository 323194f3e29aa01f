"""What ``twin estimators`` gives, out of its runs' rows."""

from dataclasses import dataclass

from gliderhpc.twins.estimators.advice import (
    interval_sentences,
    purposes,
    recommend,
    recommendation_sentence,
    tally_sentence,
)
from gliderhpc.twins.estimators.cases import EstimatorsSize
from gliderhpc.twins.estimators.summary import summarise
from gliderhpc.twins.estimators.targets import Target, targets
from gliderhpc.twins.runs import Row
from gliderhpc.twins.study import TwinPlan


@dataclass(frozen=True, eq=False)
class EstimatorsResults:
    """What the study gives.

    Attributes
    ----------
    rows, summary : list of dict
        One a twin and estimator; one a kind of twin and estimator.
    targets : list of Target
        What is asked of the smoother.
    advice : list of dict
        Which estimator for what.
    sentences : tuple of str
        The same in words, and what the intervals are worth.
    """

    rows: list[Row]
    summary: list[Row]
    targets: list[Target]
    advice: list[Row]
    sentences: tuple[str, ...]


def estimator_results(plan: TwinPlan[EstimatorsSize], rows: list[Row]) -> EstimatorsResults:
    """Summarise, judge and advise."""
    summary = summarise(rows)
    advice = [recommend(rows, purpose) for purpose in purposes(plan.size.intervals)]
    sentences = (
        *map(recommendation_sentence, advice), tally_sentence(advice), *interval_sentences(summary),
    )  # fmt: skip
    return EstimatorsResults(rows, summary, targets(rows, summary), advice, sentences)
