"""``twin currents``: coverage of the current's ellipses, and the response of the retrieved current to shear.

Twins of the scenario ``paper`` at its own depth have different currents, coefficients, offsets, trims and errors of the
fixes. They are inverted with the platform file's hull. Constants fitted to half of them are tested on the other half.
Twins with exact coefficients, in shear and gusts of realistic and larger strength, give gain, phase and coherence of
the depth-resolved current by vertical scale.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from functools import partial
from typing import Any

from gliderhpc.errors import InputError
from gliderhpc.estimation.current_errors import MIN_TWINS, TERMS, Budget, budget_text
from gliderhpc.findings.comparison import Comparison
from gliderhpc.findings.results import Findings
from gliderhpc.studies.library.passband import HALF
from gliderhpc.studies.library.retrieval import DepthResolvedSettings
from gliderhpc.studies.library.scores import COVERAGE
from gliderhpc.twins.cases import PRESETS
from gliderhpc.twins.currents.figure import draw_currents
from gliderhpc.twins.currents.results import (
    ALL,
    FITTED,
    OVER,
    PUBLISHED,
    RESOLVING,
    CurrentsResults,
    currents_results,
    strongest,
)
from gliderhpc.twins.currents.runs import (
    FINE_RMS,
    FINE_SCALE,
    SHEAR,
    STILL,
    WORLDS,
    CurrentsSize,
    currents_rows,
    currents_runs,
)
from gliderhpc.twins.scoring import Row
from gliderhpc.twins.study import TwinPlan, TwinStudy, first, select, twin_findings

NAME = "currents"
BUDGET = "currents_budget.yaml"
FULL = CurrentsSize(depth=400.0, water_depth=300.0, water_seeds=12, lagless_seeds=24, seeds=400)
QUICK = CurrentsSize(depth=100.0, water_depth=100.0, water_seeds=3, lagless_seeds=4, seeds=24)

_UNITS = {"axial_error": "m/s", "relative_error": "1", "heading_error": "degree", "cross_track_error": "m/s"}

MIN_CORRELATION = 0.1
"""Correlation above which a retrieved signal is regarded as visible."""


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


# Comparisons with the paper, and sentences on ellipses and vertical scales


def compare_averaged(results: CurrentsResults) -> list[Comparison]:
    """Compare errors, shares inside the ellipses of every set of constants, and the fitted constants."""
    every = first(results.coverage, constants=PUBLISHED, speed=ALL)
    along, across = results.bias
    rows = [
        Comparison(
            "error of the depth-averaged current, median", "m/s", every["error_median"],
            remark=f"{every['twins']} twins",
        ),
        Comparison(
            "mean error along the track", "m/s", along,
            remark=f"with actuators that do not lag their commands {results.lagless_bias[0]:.4f}",
        ),
        Comparison("mean error across the track", "m/s", across),
    ]  # fmt: skip
    for line in select(results.coverage, speed=ALL):
        rows += _share_comparisons(line)
    fitted, published = results.constants[FITTED], results.constants[PUBLISHED]
    return rows + [
        Comparison(f"fitted: {name.replace('_', ' ')}", _UNITS[name], getattr(fitted, name), getattr(published, name))
        for name in TERMS
    ]


def compare_resolved(results: CurrentsResults) -> list[Comparison]:
    """Compare resolved scales, noise, correlation and gain of every preset, water and strength."""
    band = results.band
    rows = [
        Comparison("longest vertical scale seen, by formula", "m", band.band[1]),
        Comparison("shortest vertical scale seen, by formula", "m", band.band[0]),
    ]
    for preset in PRESETS:
        low, high = results.seen[preset]
        rows += [
            Comparison(f"{preset}: longest vertical scale seen", "m", high, remark="half the largest gain"),
            Comparison(f"{preset}: shortest vertical scale seen", "m", low, remark="half the largest gain"),
        ]
    return [*rows, *(row for line in results.summary for row in _summary_comparisons(line))]


def _share_comparisons(line: Row) -> Sequence[Comparison]:
    name, shares = line["constants"], []
    for sigma, share in COVERAGE.items():
        remark = f"sampling error {line[f'inside_{sigma}_error']:.3f}; {line['twins']} twins; {line['verdict']}"
        shares.append(Comparison(f"{name}: inside {sigma} sigma", "1", line[f"inside_{sigma}"], share, remark=remark))
    return [*shares, Comparison(f"{name}: mean area of the 1-sigma ellipse", "m2/s2", line["area"])]


def _summary_comparisons(line: Row) -> list[Comparison]:
    run = f"{line['preset']}, {line['world']} x {line['factor']:g}"
    strength = f"shear {line['shear_rms']:.2g} 1/s, forcing {line['forcing_rms']:.2g} m/s2 (rms)"
    retrieved = Comparison(f"{run}: lateral current, rms", "m/s", line["lateral_rms"], remark=strength)
    if line["world"] == STILL:
        return [retrieved]
    return [
        retrieved,
        Comparison(f"{run}: correlation with dU/dZ, dive", "1", line["correlation_shear_dive"]),
        Comparison(f"{run}: correlation with dU/dZ, climb", "1", line["correlation_shear_climb"]),
        Comparison(
            f"{run}: correlation with the forcing",
            "1",
            line["correlation_forcing"],
            remark=f"equally smoothed {line['correlation_alike']:.2f}",
        ),
        Comparison(
            f"{run}: gain on the forcing",
            "s",
            line["gain_forcing"],
            remark=f"equally smoothed {line['gain_alike']:.2g}",
        ),
    ]


def describe_results(results: CurrentsResults) -> tuple[str, ...]:
    """Describe the results on ellipses and scales in sentences."""
    return (
        *(_describe_coverage(line) for line in select(results.coverage, speed=ALL)),
        _describe_over_coverage(results),
        _describe_offset(results),
        _describe_limits(results),
        *(_describe_measured(results, preset) for preset in PRESETS),
        _describe_realistic(results),
    )


def _describe_coverage(line: Row) -> str:
    shares = " and ".join(
        f"{line[f'inside_{sigma}']:.1%} within {sigma} sigma (nominal {share:.0%}, sampling error "
        f"{line[f'inside_{sigma}_error']:.1%})"
        for sigma, share in COVERAGE.items()
    )
    return (
        f"Constants `{line['constants']}`: {shares} on {line['twins']} twins, mean area of the 1-sigma ellipse "
        f"{1e4 * line['area']:.2g} cm2/s2, so they {line['verdict'].replace('covers', 'cover')}."
    )


def _describe_over_coverage(results: CurrentsResults) -> str:
    share = results.constants[PUBLISHED].relative_error
    wide = [
        line["speed"]
        for line in results.coverage
        if line["constants"] == PUBLISHED and line["speed"] != ALL and line["verdict"] == OVER
    ]
    where = f"at currents of {', '.join(wide)}" if wide else "at no speed"
    relative = "; ".join(f"{line['relative']:.0%} at {line['speed']}" for line in results.along)
    published, fitted = (first(results.coverage, constants=name, speed=ALL) for name in (PUBLISHED, FITTED))
    return (
        f"The published terms, with {share:.0%} of the current's speed, over-cover {where}: the error along the "
        f"current over its speed (both root mean square) is {relative}, because it does not grow with the current. "
        f"The published ellipse has {published['area'] / fitted['area']:.2g} times the area of the fitted one."
    )


def _describe_offset(results: CurrentsResults) -> str:
    along, across = results.bias
    lagless = results.lagless_bias[0]
    lag = "so most of it is due to the lag" if abs(lagless) < 0.5 * abs(along) else "so it is not due to the lag"
    return (
        f"The errors have a mean of {along:+.4f} m/s along the track and {across:+.4f} m/s across it: the modelled "
        f"motion through the water is wrong by {results.motion_bias:+.4f} m/s along the track on average. With "
        f"actuators that do not lag their commands the mean along the track is {lagless:+.4f} m/s, {lag}. Ellipses "
        "centred on zero cannot have the nominal coverage at both one and two sigma if the errors have a mean; the "
        "last set of constants shows the coverage without the mean."
    )


def _describe_limits(results: CurrentsResults) -> str:
    band = results.band
    return (
        f"By formula, at {band.vertical_speed:.3g} m/s up or down, vertical scales longer than "
        f"{band.baseline_limit:.3g} m lose more than half to the moving average, those shorter than "
        f"{band.smoothing_limit:.3g} m to the smoothing; from {band.following_limit:.3g} m on the hull follows the "
        f"water more than it slips (time constant {band.following:.3g} s). All three retain at least {HALF:.0%} of "
        f"their largest response between {band.band[0]:.3g} and {band.band[1]:.3g} m."
    )


def _describe_measured(results: CurrentsResults, preset: str) -> str:
    low, high = results.seen[preset]
    lines = strongest(results.transfer, preset)
    best = max(lines, key=lambda line: float(line["gain_current"]))
    inside = [line["coherence"] for line in lines if low <= line["scale"] <= high]
    return (
        f"Measured with preset {preset}: at least half of the largest gain between {low:.2g} and {high:.2g} m; the "
        f"largest, {best['gain_current']:.2g} of the current across the hull, at {best['scale']:.2g} m; coherence "
        f"there {min(inside):.2f} to {max(inside):.2f}; noise alone gives {1e3 * results.noise[preset]:.2g} mm/s."
    )


def _describe_realistic(results: CurrentsResults) -> str:
    line = first(results.summary, preset=RESOLVING, world=SHEAR, factor=WORLDS[SHEAR][0][0])
    visible = abs(line["correlation_alike"]) > MIN_CORRELATION
    return (
        f"The shear of the scenario `paper` itself (rms {line['shear_rms']:.2g} 1/s) is "
        f"{'partly' if visible else 'not'} visible: correlation {line['correlation_alike']:+.2f} with the forcing of "
        f"the hull, {1e3 * line['lateral_rms']:.2g} mm/s retrieved against {1e3 * results.noise[RESOLVING]:.2g} mm/s "
        "by noise alone."
    )
