"""One estimator's answer to one twin as a row of numbers."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gliderhpc.errors import InputError, ProfileError
from gliderhpc.estimation.settings import default_prior
from gliderhpc.studies.library.scores import correlation, rms
from gliderhpc.twins.estimators.arms import ARMS, Answer, Arm, Bench
from gliderhpc.twins.impulses import find_impulses
from gliderhpc.twins.inversion import TwinCase, TwinInversion
from gliderhpc.twins.runs import Row, TwinRun
from gliderhpc.twins.scoring import YAW, mean
from gliderhpc.twins.seams import boundaries_of, seam_ratio
from gliderhpc.twins.smoothing import INTERVALS, coverage, mahalanobis
from gliderhpc.vocabulary import CHANNELS

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

EVENT_WIDTHS = 3.0
"""Widths of an impulse on either side of its peak that count as inside the event."""

PHASES = ("dive", "climb")


def run_rows(run: TwinRun) -> list[Row]:
    """Rows of one twin, one an estimator, with the run's labels."""
    return [{**dict(run.labels), **row} for row in estimator_rows(run.case)]


def estimator_rows(case: TwinCase, arms: Sequence[Arm] = ARMS) -> list[Row]:
    """Put one twin before estimators: a row each, or a row with the reason where the record is refused."""
    bench = Bench(case)
    return [{"seed": case.seed, "arm": arm.name} | _row(bench, arm) for arm in arms]


def _row(bench: Bench, arm: Arm) -> Row:
    try:
        scale = np.array(default_prior(bench.case.hull).deviation)
        return answer_scores(bench.usual, arm.answer(bench), scale)
    except (ProfileError, InputError) as error:
        return {"refused": str(error)}


def answer_scores(twin: TwinInversion, answer: Answer, scale: Array) -> Row:
    """Score an answer over steady glide.

    Parameters
    ----------
    twin, answer : TwinInversion, Answer
        The truth, and what is held against it.
    scale : (6,) array
        Units of the overall error, N and N m.

    Returns
    -------
    dict
        A channel: ``rmse_B_cu`` ..., ``truth_...`` (root mean square of the truth), ``correlation_...``, ``bias_...``
        (mean error), ``bias_dive_...``, ``bias_climb_...``, and where there are intervals ``width_...`` (mean standard
        deviation), ``coverage_68_...``, ``coverage_95_...``; all together: ``overall``, the
        root mean square of the six RMSE, each over its scale. Yaw: ``rmse_inside``, ``rmse_outside`` of the events,
        ``coverage_68_inside`` ...; ``impulses`` (lonely ones), ``impulse_gain`` (identified over true height),
        ``impulse_gain_error``, ``impulse_delay`` and ``impulse_delay_size`` (s), medians; ``seam_ratio`` at the
        boundaries of the adjoint's windows. ``displacement_error`` (m) and ``displacement_deviations`` (over its
        standard deviation, two components); ``seconds``, ``rounds``, ``converged``, ``outcome``.
    """
    return {
        **_channel_scores(twin, answer, scale),
        **_event_scores(twin, answer),
        **_impulse_scores(twin, answer),
        **_displacement_scores(twin, answer),
        "seam_ratio": _seam_ratio(twin, answer),
        "duration": twin.profile_truth.duration,
        "seconds": answer.seconds,
        "rounds": answer.rounds,
        "converged": answer.converged,
        "outcome": answer.outcome,
    }


def _channel_scores(twin: TwinInversion, answer: Answer, scale: Array) -> Row:
    steady, true = twin.steady, twin.truth
    error = answer.disturbances - true
    row: Row = {}
    for i, name in enumerate(CHANNELS):
        row[f"rmse_{name}"] = rms(error[steady, i])
        row[f"truth_{name}"] = rms(true[steady, i])
        row[f"correlation_{name}"] = correlation(answer.disturbances[steady, i], true[steady, i])
        row[f"bias_{name}"] = mean(error[steady, i])
        for phase, mask in zip(PHASES, (twin.diving, ~twin.diving), strict=True):
            row[f"bias_{phase}_{name}"] = mean(error[steady & mask, i])
        if answer.deviations is not None:
            row[f"width_{name}"] = mean(answer.deviations[steady, i])
            for label, width in INTERVALS.items():
                row[f"coverage_{label}_{name}"] = coverage(error[steady, i], answer.deviations[steady, i], width)
    relative = np.array([row[f"rmse_{name}"] for name in CHANNELS]) / scale
    return row | {"overall": float(np.sqrt(np.mean(relative**2)))}


def _event_scores(twin: TwinInversion, answer: Answer) -> Row:
    inside = in_events(twin)
    error = answer.disturbances[:, YAW] - twin.truth[:, YAW]
    row: Row = {}
    for place, mask in (("inside", twin.steady & inside), ("outside", twin.steady & ~inside)):
        row[f"rmse_{place}"] = rms(error[mask])
        if answer.deviations is not None:
            for label, width in INTERVALS.items():
                row[f"coverage_{label}_{place}"] = coverage(error[mask], answer.deviations[mask, YAW], width)
    return row


def in_events(twin: TwinInversion) -> Mask:
    """Steps ``(n,)`` within `EVENT_WIDTHS` widths of the peak of an impulse."""
    time = twin.estimate.series.time[:-1]
    inside = np.zeros(len(time), dtype=np.bool_)
    for impulse in twin.profile_truth.impulses:
        inside |= np.abs(time - impulse.time) <= EVENT_WIDTHS * impulse.width
    return inside


def _impulse_scores(twin: TwinInversion, answer: Answer) -> Row:
    findings = find_impulses(twin, answer.disturbances[:, YAW])
    gain, delay = np.array([(finding.gain, finding.delay) for finding in findings]).reshape(-1, 2).T
    return {
        "impulses": len(findings),
        "impulse_gain": _median(gain),
        "impulse_gain_error": _median(np.abs(gain - 1.0)),
        "impulse_delay": _median(delay),
        "impulse_delay_size": _median(np.abs(delay)),
    }


def _median(values: Array) -> float:
    return float(np.median(values)) if values.size else float("nan")


def _displacement_scores(twin: TwinInversion, answer: Answer) -> Row:
    wrong = answer.displacement - (twin.states[-1, 3:5] - twin.states[0, 3:5])
    row: Row = {"displacement_error": float(np.linalg.norm(wrong))}
    if answer.displacement_covariance is not None:
        row["displacement_deviations"] = mahalanobis(wrong, answer.displacement_covariance)
    return row


def _seam_ratio(twin: TwinInversion, answer: Answer) -> float:
    """Of the windows' boundaries; for an estimator without windows those of the usual adjoint, so near one."""
    source = twin.estimate.solution.source if answer.source is None else answer.source
    error = answer.disturbances[:, YAW] - twin.truth[:, YAW]
    return seam_ratio(error, boundaries_of(source), twin.steady, twin.step)
