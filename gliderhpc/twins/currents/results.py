"""What ``twin currents`` gives, out of its runs' rows: coverage by several constants, and transfer functions."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gliderhpc.errors import InputError
from gliderhpc.estimation.current_budget import PUBLISHED_TERMS, TERMS, Budget
from gliderhpc.estimation.current_errors import CurrentErrors
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.studies.currents.passband import Passband, passband
from gliderhpc.studies.currents.settings import DepthResolvedSettings
from gliderhpc.twins.currents.coverage import (
    Beliefs,
    along_the_current,
    coverage_lines,
    fitted_to_cover,
    track_offset,
    without_offset,
)
from gliderhpc.twins.currents.runs import (
    AVERAGED,
    GUSTS,
    LAGLESS,
    PRESETS,
    RESOLVED,
    STILL,
    WORLDS,
    CurrentsSize,
)
from gliderhpc.twins.currents.transfer import seen_band, summary_lines, transfer_lines
from gliderhpc.twins.runs import Row
from gliderhpc.twins.study import TwinPlan

PUBLISHED, RECOVERABILITY = "published", "recoverability"
FITTED_FORM, FITTED, CENTRED = "fitted, published form", "fitted", "fitted, mean error taken out"
"""Names of the constants: of section 5.5, of a given budget, and of this study: with three terms, with four, and with
four to errors from which their mean along the track was taken."""

RESOLVING = PRESETS[1]
"""Preset whose transfer function the limits are read from; it starts the lateral channels from zero."""


@dataclass(frozen=True, eq=False)
class CurrentsResults:
    """What the study gives.

    Attributes
    ----------
    averaged, resolved : list of dict
        A row a twin.
    refused : list of str
        Why twins have no row.
    coverage : list of dict
        One line a set of constants and bin of speed.
    constants : dict of str to CurrentErrors
        By the name of the set.
    along : list of dict
        Error along the current by bin of speed.
    bias : (float, float)
        Mean error along and across the track, m/s.
    lagless_bias : (float, float)
        The same of the twins whose actuators do not lag.
    motion_bias : float
        Mean error of the modelled motion through the water along the track, m/s.
    summary, transfer : list of dict
        Medians, and gain, phase and coherence by vertical scale.
    band : Passband
        By formula, at the twins' median vertical speed.
    seen : dict of str to (float, float)
        Vertical scales seen by each preset in the strongest broadband water, m.
    noise : dict of str to float
        Lateral current that noise alone leaves with each preset, rms, m/s.
    """

    averaged: list[Row]
    resolved: list[Row]
    refused: list[str]
    coverage: list[Row]
    constants: dict[str, CurrentErrors]
    along: list[Row]
    bias: tuple[float, float]
    lagless_bias: tuple[float, float]
    motion_bias: float
    summary: list[Row]
    transfer: list[Row]
    band: Passband
    seen: dict[str, tuple[float, float]]
    noise: dict[str, float]


def currents_results(plan: TwinPlan[CurrentsSize], rows: Sequence[Row], budget: Budget | None) -> CurrentsResults:
    """Count coverage and form transfer functions.

    The constants of this study are fitted to the twins of odd seeds and held against those of even seeds; the published
    ones and the given budget's are held against all.

    Raises
    ------
    InputError
        So many twins were refused that nothing can be fitted or held against.
    """
    known = [row for row in rows if "refused" not in row]
    averaged = [row for row in known if row["kind"] == AVERAGED]
    resolved = [row for row in known if row["kind"] == RESOLVED]
    every = _beliefs(averaged, budget)
    if not resolved:
        raise InputError("every twin in shear and gusts was refused, so there is no transfer function")
    transfer, summary = transfer_lines(resolved), summary_lines(resolved)
    seen = {preset: seen_band(strongest(transfer, preset)) for preset in PRESETS}
    return CurrentsResults(
        averaged=averaged,
        resolved=resolved,
        refused=[row["refused"] for row in rows if "refused" in row],
        coverage=[line for beliefs in every for line in coverage_lines(beliefs)],
        constants={beliefs.name: beliefs.settings for beliefs in every},
        along=along_the_current(averaged),
        bias=track_offset(averaged),
        lagless_bias=track_offset([row for row in known if row["kind"] == LAGLESS]),
        motion_bias=float(np.mean([row["velocity_along"] for row in averaged])),
        summary=summary,
        transfer=transfer,
        band=_band(plan, resolved),
        seen=seen,
        noise={line["preset"]: line["lateral_rms"] for line in summary if line["world"] == STILL},
    )


def strongest(transfer: Sequence[Row], preset: str) -> list[Row]:
    """Lines of the strongest broadband water."""
    factor = WORLDS[GUSTS][0][-1]
    return [line for line in transfer if (line["preset"], line["world"], line["factor"]) == (preset, GUSTS, factor)]


def _beliefs(averaged: Sequence[Row], budget: Budget | None) -> list[Beliefs]:
    ours, others = ([row for row in averaged if row["seed"] % 2 == odd] for odd in (1, 0))
    if not (ours and others):
        raise InputError("no twin is left to fit to, or to hold the ellipses against; give more --seeds")
    offset, _ = track_offset(ours)
    centred, others_centred = without_offset(ours, offset), without_offset(others, offset)
    given = [] if budget is None else [Beliefs(RECOVERABILITY, budget.current, averaged)]
    return [
        Beliefs(PUBLISHED, CurrentErrors(), averaged),
        *given,
        Beliefs(FITTED_FORM, fitted_to_cover(ours, PUBLISHED_TERMS), others),
        Beliefs(FITTED, fitted_to_cover(ours, TERMS), others),
        Beliefs(CENTRED, fitted_to_cover(centred, TERMS), others_centred),
    ]


def _band(plan: TwinPlan[CurrentsSize], resolved: Sequence[Row]) -> Passband:
    (platform,) = plan.platforms
    return passband(
        platform,
        speed=float(np.median([row["speed"] for row in resolved])),
        vertical_speed=float(np.median([row["depth_rate"] for row in resolved])),
        step=EstimationSettings().step,
        settings=DepthResolvedSettings(),
    )
