"""Twins of ``twin estimators`` by kind, the scores of every estimator on a twin, and their summary."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from gliderhpc.errors import InputError, ProfileError
from gliderhpc.estimation.priors import default_prior
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.platform import Platform
from gliderhpc.simulator import Scenario, load_scenario
from gliderhpc.studies.library.scores import correlation, rms
from gliderhpc.twins.cases import (
    RecordChanges,
    TwinCase,
    course_of,
    drawn_from,
    with_coefficient_errors,
    with_sample_interval,
    with_white_errors,
    without_impulses,
    world,
)
from gliderhpc.twins.estimators.methods import ESTIMATORS, Estimator, EstimatorResult, TwinCache
from gliderhpc.twins.inversion import TwinInversion
from gliderhpc.twins.scoring import (
    INTERVALS,
    YAW,
    Row,
    boundaries_of,
    coverage,
    find_impulses,
    mahalanobis,
    mean,
    seam_ratio,
)
from gliderhpc.twins.study import TwinPlan, TwinRun, TwinSize, finite, groups, labelled, quartiles, tidy_table
from gliderhpc.vocabulary import CHANNELS, PHASES

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

CALM = "calm"
IMPULSIVE = "impulsive"
HARSH = "harsh"
COEFFICIENTS = "coefficients within 15%"
PRIOR = "drawn from the prior"

EVENT_WIDTHS = 3.0
"""Maximum distance from the peak of an impulse that is inside the event, in widths of the impulse."""

_COEFFICIENT_STREAM = 4_000
_LABELS = ("kind", "arm", "seed", "outcome", "refused")


@dataclass(frozen=True, kw_only=True)
class EstimatorsSize(TwinSize):
    """Size of the study; `seeds` is the number of twins drawn from the prior.

    Attributes
    ----------
    depth : float
        Depth of the twins, m.
    intervals : tuple of float
        Sample intervals of the slow records, s.
    case_seeds : int
        Number of twins of every other kind.
    """

    depth: float
    intervals: tuple[float, ...]
    case_seeds: int


def estimator_runs(plan: TwinPlan[EstimatorsSize]) -> list[TwinRun]:
    """List every twin."""
    (platform,), size = plan.platforms, plan.size
    runs = [
        labelled(case, kind=name)
        for seed in plan.seeds[: size.case_seeds]
        for name, case in standard_cases(platform, size, seed).items()
    ]
    return runs + [labelled(prior_case(platform, size.depth, seed), kind=PRIOR) for seed in plan.seeds]


def standard_cases(platform: Platform, size: EstimatorsSize, seed: int) -> dict[str, TwinCase]:
    """Twins of a seed by kind, except the one drawn from the prior."""
    impulsive = world(size.depth)
    calm = without_impulses(impulsive)
    harsh = load_scenario("harsh").replaced({"profiles": 1, "depth": size.depth, "depth_spread": 0.0})
    wrong = with_coefficient_errors(platform, np.random.default_rng([seed, _COEFFICIENT_STREAM]))
    slow = {
        interval_name(interval): _case(
            platform,
            calm,
            seed,
            assumed=with_sample_interval(platform, interval),
            changes=RecordChanges(sample_interval=interval),
        )
        for interval in size.intervals
    }
    return {
        CALM: _case(platform, calm, seed),
        IMPULSIVE: _case(platform, impulsive, seed),
        HARSH: _case(platform, harsh, seed),
        **slow,
        COEFFICIENTS: _case(platform, impulsive, seed, assumed=wrong),
    }


def prior_case(platform: Platform, depth: float, seed: int) -> TwinCase:
    """Twin with the disturbances and sensors that filter and smoother assume."""
    return _case(platform, with_white_errors(world(depth, disturbances=drawn_from(default_prior(platform)))), seed)


def interval_name(interval: float) -> str:
    """Name of the calm twins with a given sample interval, s."""
    return f"calm, {interval:g} s"


def _case(platform: Platform, scenario: Scenario, seed: int, **fields: Any) -> TwinCase:
    return TwinCase(platform, scenario, seed, EstimationSettings(), course_of(seed), **fields)


def run_rows(run: TwinRun) -> list[Row]:
    """Rows of one twin, one per estimator, with the run's labels."""
    return [{**dict(run.labels), **row} for row in estimator_rows(run.case)]


def estimator_rows(case: TwinCase, estimators: Sequence[Estimator] = ESTIMATORS) -> list[Row]:
    """Apply estimators to one twin: one row each, which gives the reason if the record is refused."""
    twin = TwinCache(case)
    return [{"seed": case.seed, "arm": estimator.name} | _row(twin, estimator) for estimator in estimators]


def _row(twin: TwinCache, estimator: Estimator) -> Row:
    try:
        scale = np.array(default_prior(twin.case.hull).deviation)
        return result_scores(twin.usual, estimator.estimate(twin), scale)
    except (ProfileError, InputError) as error:
        return {"refused": str(error)}


def result_scores(twin: TwinInversion, result: EstimatorResult, scale: Array) -> Row:
    """Score an estimate over steady glide.

    Parameters
    ----------
    twin, result : TwinInversion, EstimatorResult
        Truth, and estimate that is compared with it.
    scale : (6,) array
        Units of the overall error, N and N m.

    Returns
    -------
    dict
        By channel: ``rmse_B_cu`` ..., ``truth_...`` (root mean square of the truth), ``correlation_...``, ``bias_...``
        (mean error), ``bias_dive_...``, ``bias_climb_...``, and, if the estimate has intervals, ``width_...`` (mean
        standard deviation), ``coverage_68_...``, ``coverage_95_...``. For all channels: ``overall``, the root mean
        square of the six RMSE, each over its scale. For yaw: ``rmse_inside`` and ``rmse_outside`` the events,
        ``coverage_68_inside`` ...; ``impulses`` (number of isolated ones), and the medians ``impulse_gain`` (identified
        over true height), ``impulse_gain_error``, ``impulse_delay`` and ``impulse_delay_size`` (s); ``seam_ratio`` at
        the boundaries of the adjoint's windows. Others: ``displacement_error`` (m) and ``displacement_deviations``
        (over its standard deviation, two components); ``seconds``, ``rounds``, ``converged``, ``outcome``.
    """
    return {
        **_channel_scores(twin, result, scale),
        **_event_scores(twin, result),
        **_impulse_scores(twin, result),
        **_displacement_scores(twin, result),
        "seam_ratio": _seam_ratio(twin, result),
        "duration": twin.profile_truth.duration,
        "seconds": result.seconds,
        "rounds": result.rounds,
        "converged": result.converged,
        "outcome": result.outcome,
    }


def _channel_scores(twin: TwinInversion, result: EstimatorResult, scale: Array) -> Row:
    steady, true = twin.steady, twin.truth
    error = result.disturbances - true
    row: Row = {}
    for i, name in enumerate(CHANNELS):
        row[f"rmse_{name}"] = rms(error[steady, i])
        row[f"truth_{name}"] = rms(true[steady, i])
        row[f"correlation_{name}"] = correlation(result.disturbances[steady, i], true[steady, i])
        row[f"bias_{name}"] = mean(error[steady, i])
        for phase, mask in twin.phases.items():
            row[f"bias_{phase}_{name}"] = mean(error[mask, i])
        if result.deviations is not None:
            row[f"width_{name}"] = mean(result.deviations[steady, i])
            for label, width in INTERVALS.items():
                row[f"coverage_{label}_{name}"] = coverage(error[steady, i], result.deviations[steady, i], width)
    relative = np.array([row[f"rmse_{name}"] for name in CHANNELS]) / scale
    return row | {"overall": float(np.sqrt(np.mean(relative**2)))}


def _event_scores(twin: TwinInversion, result: EstimatorResult) -> Row:
    inside = in_events(twin)
    error = result.disturbances[:, YAW] - twin.truth[:, YAW]
    row: Row = {}
    for where, mask in (("inside", twin.steady & inside), ("outside", twin.steady & ~inside)):
        row[f"rmse_{where}"] = rms(error[mask])
        if result.deviations is not None:
            for label, width in INTERVALS.items():
                row[f"coverage_{label}_{where}"] = coverage(error[mask], result.deviations[mask, YAW], width)
    return row


def in_events(twin: TwinInversion) -> Mask:
    """Mask ``(n,)`` of the steps within `EVENT_WIDTHS` widths of the peak of an impulse."""
    time = twin.estimate.series.time[:-1]
    inside = np.zeros(len(time), dtype=np.bool_)
    for impulse in twin.profile_truth.impulses:
        inside |= np.abs(time - impulse.time) <= EVENT_WIDTHS * impulse.width
    return inside


def _impulse_scores(twin: TwinInversion, result: EstimatorResult) -> Row:
    impulses = find_impulses(twin, result.disturbances[:, YAW])
    gain, delay = np.array([(impulse.gain, impulse.delay) for impulse in impulses]).reshape(-1, 2).T
    return {
        "impulses": len(impulses),
        "impulse_gain": _median(gain),
        "impulse_gain_error": _median(np.abs(gain - 1.0)),
        "impulse_delay": _median(delay),
        "impulse_delay_size": _median(np.abs(delay)),
    }


def _median(values: Array) -> float:
    return float(np.median(values)) if values.size else float("nan")


def _displacement_scores(twin: TwinInversion, result: EstimatorResult) -> Row:
    error = result.displacement - (twin.states[-1, 3:5] - twin.states[0, 3:5])
    row: Row = {"displacement_error": float(np.linalg.norm(error))}
    if result.displacement_covariance is not None:
        row["displacement_deviations"] = mahalanobis(error, result.displacement_covariance)
    return row


def _seam_ratio(twin: TwinInversion, result: EstimatorResult) -> float:
    """Seam ratio at the windows' boundaries; for an estimator without windows, at those of the usual adjoint."""
    source = twin.estimate.solution.source if result.source is None else result.source
    error = result.disturbances[:, YAW] - twin.truth[:, YAW]
    return seam_ratio(error, boundaries_of(source), twin.steady, twin.step)


def summarise(rows: Sequence[Row]) -> list[Row]:
    """Summarise rows, in the order of the runs and of `ESTIMATORS`.

    Returns
    -------
    list of dict
        ``kind``, ``arm`` (name of the estimator), ``twins`` (number estimated), ``refused``, ``outcomes`` (counts). For
        every score of the rows: its median, and the quartiles ``..._low`` and ``..._high``; for ``coverage_...`` and
        ``converged`` the mean instead of the median, which gives twins equal weight. ``offset_B_cu`` ...: root mean
        square of the mean errors of all dives and climbs.
    """
    table = tidy_table(rows)
    scores = [name for name in table.columns if name not in _LABELS]
    return [labels | _summary(group, scores) for labels, group in groups(table, ("kind", "arm"))]


def _summary(group: pd.DataFrame, scores: Sequence[str]) -> Row:
    estimated = group[group["refused"].isna()]
    line: Row = {"twins": len(estimated), "refused": len(group) - len(estimated)}
    line["outcomes"] = {str(name): int(count) for name, count in estimated["outcome"].value_counts().items() if name}
    for name in scores:
        values = finite(estimated, name)
        line |= quartiles(name, values)
        if values.size and (name.startswith("coverage") or name == "converged"):
            line[name] = float(values.mean())
    for channel in CHANNELS:
        biases = estimated[[f"bias_{phase}_{channel}" for phase in PHASES]].to_numpy(dtype=np.float64)
        line[f"offset_{channel}"] = rms(biases.ravel())
    return line


def paired(rows: Sequence[Row], kind: str, score: str, estimators: Sequence[Estimator] = ESTIMATORS) -> pd.DataFrame:
    """One score of a kind of twin, one row per seed and one column per estimator; only twins for which all have it."""
    seeds = dict.fromkeys(row["seed"] for row in rows if row["kind"] == kind)
    table = pd.DataFrame(np.nan, index=list(seeds), columns=[estimator.name for estimator in estimators])
    for row in rows:
        if row["kind"] == kind and row["arm"] in table.columns:
            table.loc[row["seed"], row["arm"]] = row.get(score, np.nan)
    return table.dropna()
