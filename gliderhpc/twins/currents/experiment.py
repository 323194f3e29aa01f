"""``twin currents``: coverage of the current's ellipses, and the response of the retrieved current to shear.

Twins of the scenario ``paper`` at its own depth have different currents, coefficients, offsets, trims and errors of the
fixes. They are inverted with the platform file's hull. Constants fitted to half of them are tested on the other half.
Twins with exact coefficients, in shear and gusts of realistic and larger strength, give gain, phase and coherence of
the depth-resolved current by vertical scale.
"""

from __future__ import annotations

from dataclasses import asdict
from functools import partial
from typing import TYPE_CHECKING, Any

from gliderhpc.errors import InputError
from gliderhpc.estimation.current_errors import MIN_TWINS, TERMS, Budget, budget_text
from gliderhpc.findings.results import Findings
from gliderhpc.studies.library.retrieval import DepthResolvedSettings
from gliderhpc.twins.currents.conclusions import compare_averaged, compare_resolved, describe_results
from gliderhpc.twins.currents.figure import draw_currents
from gliderhpc.twins.currents.results import (
    ALL,
    FITTED,
    CurrentsResults,
    currents_results,
)
from gliderhpc.twins.currents.runs import (
    FINE_RMS,
    FINE_SCALE,
    WORLDS,
    CurrentsSize,
    currents_rows,
    currents_runs,
)
from gliderhpc.twins.scoring import Row
from gliderhpc.twins.study import TwinPlan, TwinStudy, first, twin_findings

if TYPE_CHECKING:
    pass

NAME = "currents"
BUDGET = "currents_budget.yaml"
FULL = CurrentsSize(depth=400.0, water_depth=300.0, water_seeds=12, lagless_seeds=24, seeds=400)
QUICK = CurrentsSize(depth=100.0, water_depth=100.0, water_seeds=3, lagless_seeds=4, seeds=24)


def currents_study(budget: Budget | None) -> TwinStudy[CurrentsSize]:
    """Make the study, which compares its constants with those of a budget (``twin recoverability``), and updates these.

    Without a budget, identification noise and detection floor are unknown, and no budget is written.
    """
    return TwinStudy(
        NAME, FULL, QUICK, currents_runs, partial(conclude, budget=budget), job=currents_rows, min_seeds=4 * MIN_TWINS
    )


def conclude(plan: TwinPlan[CurrentsSize], rows: list[Row], budget: Budget | None) -> Findings:
    """Make findings, with a table of comparisons for the depth-averaged current and one for the depth-resolved.

    Raises
    ------
    InputError
        The budget belongs to another hull.
    """
    (platform,) = plan.platforms
    if budget is not None and budget.platform != platform.name:
        raise InputError(f"`budget`: was measured for {budget.platform}, and the twins are of {platform.name}")
    results = currents_results(plan, rows, budget)
    resolved = [{name: value for name, value in row.items() if name != "spectra"} for row in results.resolved]
    concluded = describe_results(results)
    return twin_findings(
        NAME,
        plan,
        {
            f"{platform.name}, depth-averaged current": compare_averaged(results),
            f"{platform.name}, depth-resolved current": compare_resolved(results),
        },
        rows=[*results.averaged, *resolved],
        figure=draw_currents(results),
        facts=_facts(results, concluded),
        documents=_documents(results, budget),
        remarks=(*concluded, *_remarks(results, budget)),
    )


def _facts(results: CurrentsResults, concluded: tuple[str, ...]) -> dict[str, Any]:
    band = results.band
    return {
        "waters": {world: {"factors": factors, "what": text} for world, (factors, text) in WORLDS.items()},
        "fine_shear": {"rms": FINE_RMS, "scale": FINE_SCALE},
        "settings": DepthResolvedSettings().model_dump(),
        "coverage": results.coverage,
        "constants": {name: settings.model_dump() for name, settings in results.constants.items()},
        "along_the_current": results.along,
        "mean_error": dict(zip(("along", "across"), results.bias, strict=True)),
        "mean_error_of_the_motion": results.motion_bias,
        "mean_error_without_lag": dict(zip(("along", "across"), results.lagless_bias, strict=True)),
        "summary": results.summary,
        "transfer": results.transfer,
        "formula": {
            **{name: value for name, value in asdict(band).items() if name != "settings"},
            "baseline_limit": band.baseline_limit,
            "smoothing_limit": band.smoothing_limit,
            "following_limit": band.following_limit,
            "band": band.band,
        },
        "seen": results.seen,
        "noise": results.noise,
        "refused": results.refused,
        "sentences": concluded,
    }


def _documents(results: CurrentsResults, budget: Budget | None) -> dict[str, str]:
    if budget is None:
        return {}
    tested = first(results.coverage, constants=FITTED, speed=ALL)
    how = (
        "maximum likelihood on twins of odd seeds, times the factor by which their ellipses cover them best; 1 and 2 "
        f"sigma hold {tested['inside_1']:.1%} and {tested['inside_2']:.1%} of the {tested['twins']} twins of even seeds"
    )
    fitted = {name: getattr(results.constants[FITTED], name) for name in TERMS}
    renewed = budget.model_copy(update={**fitted, "how": budget.how | dict.fromkeys(TERMS, how)})
    return {BUDGET: budget_text(renewed, NAME)}


def _remarks(results: CurrentsResults, budget: Budget | None) -> tuple[str, ...]:
    without_budget = (
        "no `budget` given: the constants of `twin recoverability` are not compared, and no budget is written, "
        "because its identification noise comes from that study"
    )
    refused = (f"{len(results.refused)} twins refused: {results.refused[0]}",) if results.refused else ()
    return (*refused, *(() if budget else (without_budget,)))
