"""Change of the compass's error during the mission, from currents of legs on different headings at different times.

Iron that moves, as with the battery pack, a damaged compass, or a setting that was changed, give an error of the
compass that is not the same in all profiles. Its mean over the mission may be too small to be found.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gliderhpc.distributions import f_quantile
from gliderhpc.record_checks.compass import (
    CHECK,
    UNIT,
    CompassFit,
    Leg,
    LegSystem,
    first_decisive,
    largest_threshold,
    undetermined_if_rotating,
)
from gliderhpc.record_checks.finding import (
    CheckSettings,
    Finding,
    judge_size,
    undetermined,
    undetermined_if_insensitive,
)
from gliderhpc.record_checks.turns import TurnInformation
from gliderhpc.wording import counted

CHANGE = "change of the compass's error during the mission"

MIN_LEGS = 8

_ERRORS, _CHANGES = 5, 3
"""Errors of the compass, and those that may change: the constant and the first harmonic of the heading."""

_UNKNOWNS = _ERRORS + _CHANGES

_ADVICE = (
    "compare profiles from the beginning and the end of the mission (`profiles`); correct each part with its own "
    "`records.heading_offset` and `records.heading_deviation`"
)


def _directions(errors: int, changes: int) -> NDArray[np.float64]:
    """Unknowns that are estimated: the first errors of the compass, and the first of their changes."""
    return np.eye(_UNKNOWNS)[:, [*range(errors), *range(_ERRORS, _ERRORS + changes)]]


MODELS = (_directions(5, 3), _directions(3, 3), _directions(1, 1))
"""Directions (8, k) that are estimated, tried in turn."""


def change_finding(legs: Sequence[Leg], checks: CheckSettings) -> Finding:
    """Estimate the change of the compass's error from the first leg to the last.

    Parameters
    ----------
    legs : sequence of Leg
        Profiles with a current.
    checks : CheckSettings
        Settings of the checks, with the level of significance.

    Notes
    -----
    The model of the currents is that of `gliderhpc.record_checks.compass.compass_findings`. The constant and the
    first harmonic of the heading may in addition grow linearly with time, which a step in the middle of the mission
    also does on the average. The size is the root of the sum of squares of the three changes, and is tested as the
    deviation is. With fewer harmonics determined, the constant alone is tested. A current that rotates with the
    inertial or the tidal period is no change of the compass.
    """
    if len(legs) < MIN_LEGS:
        return undetermined(CHECK, CHANGE, UNIT, f"{counted(len(legs), 'leg')}, but at least {MIN_LEGS} are needed")
    time = np.array([leg.time for leg in legs])
    elapsed = (time - time.mean()) / max(np.ptp(time), 1.0)
    growing = [
        replace(leg, by_error=np.hstack([leg.by_error, part * leg.by_error[:, :_CHANGES]]))
        for leg, part in zip(legs, elapsed.tolist(), strict=True)
    ]
    system = LegSystem(growing, TurnInformation(np.zeros((_UNKNOWNS, _UNKNOWNS)), np.zeros(_UNKNOWNS), 0), checks)
    fits = [fit for fit in map(system.fitted, MODELS) if np.isfinite(fit.largest_error)]
    findings = [_finding(fit, len(legs), checks) for fit in fits]
    chosen = first_decisive(findings, checks)
    finding = undetermined_if_insensitive(
        findings[chosen], largest_threshold(checks), f"{counted(len(legs), 'leg')}, but more are needed"
    )
    return undetermined_if_rotating(finding, system.model, fits[chosen].values, _tested(fits[chosen]))


def _tested(fit: CompassFit) -> list[int]:
    """Changes among the unknowns of a fit."""
    return [i for i in range(_ERRORS, _UNKNOWNS) if fit.directions[i].any()]


def _finding(fit: CompassFit, legs: int, checks: CheckSettings) -> Finding:
    tested = _tested(fit)
    statistic, rank = fit.test(np.array(tested))
    size = float(np.degrees(np.linalg.norm(fit.values[tested])))
    error = size / np.sqrt(statistic) if statistic > 0.0 else float("nan")
    limit = np.sqrt(rank * f_quantile(1.0 - checks.level, rank, fit.freedom(legs))) * error
    threshold = max(limit, checks.least_deviation)
    parts = "the constant and the first harmonic of the heading" if rank == _CHANGES else "the constant alone"
    remark = f"{counted(legs, 'leg')}; linear from the first to the last, in {parts}"
    return Finding(CHECK, CHANGE, UNIT, size, error, threshold, judge_size(size, threshold), _ADVICE, remark)
