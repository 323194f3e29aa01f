"""``twin windows``: window, margin, handover and transform compared with the truth (section 5.1.2, Fig. 5).

The operating point is chosen by the error relative to the truth and never by the cost, which decreases when noise is
fitted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from gliderhpc.estimation.priors import default_prior
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.findings.comparison import Comparison
from gliderhpc.findings.formatting import number
from gliderhpc.findings.results import Findings
from gliderhpc.platform import Platform
from gliderhpc.twins.cases import OPERATING_LENGTH, PRESETS, TwinCase, course_of, world
from gliderhpc.twins.inversion import invert_twin
from gliderhpc.twins.scoring import LONGITUDINAL_AND_YAW, YAW, Row, boundaries_of
from gliderhpc.twins.study import (
    TwinPlan,
    TwinRun,
    TwinSize,
    TwinStudy,
    finite,
    first,
    groups,
    labelled,
    quartiles,
    select,
    tidy_table,
    twin_findings,
)
from gliderhpc.twins.windows.figure import Excerpt, draw_windows

EXCERPT = 160.0
"""Duration of panels (a) and (b) of the figure, s."""

SCORES = (
    "rmse_B_cr", "rmse_B_cu", "rmse_B_cw", "rmse_B_cq", "overall", "correlation_B_cr", "tracking_roll",
    "tracking_pitch", "tracking_heading", "tracking_depth", "cost_per_30s", "iterations", "capped", "seam_ratio",
    "seam_ratio_signal", "jump_ratio", "retracted", "velocity_error",
)  # fmt: skip
"""Scores that are summarised over the seeds."""

_NEGLIGIBLE_SHARE = 0.01
"""Share of windows at the iteration limit above which a window length is regarded as limited."""


@dataclass(frozen=True, kw_only=True)
class WindowsSize(TwinSize):
    """Size of the sweeps.

    Attributes
    ----------
    depth : float
        Depth of the twins, m.
    lengths : tuple of float
        Window lengths, s.
    margins : tuple of float
        Margins at the operating length, s.
    thresholds, tolerances, yaw_scales, other_scales : tuple of float
        Thresholds tau_c (rad2 s); tolerances on ``max |s g|``; factors of the transform's scale, for yaw and for the
        other channels.
    """

    depth: float
    lengths: tuple[float, ...]
    margins: tuple[float, ...]
    thresholds: tuple[float, ...]
    tolerances: tuple[float, ...]
    yaw_scales: tuple[float, ...]
    other_scales: tuple[float, ...]


def window_runs(plan: TwinPlan[WindowsSize]) -> list[TwinRun]:
    """List every run, those of one twin together."""
    scenario = world(plan.size.depth)
    return [
        labelled(
            TwinCase(platform, scenario, seed, settings, course_of(seed)), hull=platform.name, preset=preset, **labels
        )
        for seed in plan.seeds
        for platform in plan.platforms
        for preset in PRESETS
        for labels, settings in _variants(platform, preset, plan.size)
    ]


def _variants(platform: Platform, preset: str, size: WindowsSize) -> list[tuple[dict[str, Any], EstimationSettings]]:
    """Labels and settings of every sweep; the operating point is part of the sweep of lengths."""
    sweeps = [
        *(("sliding", length, _window(length)) for length in size.lengths),
        *(("not sliding", length, _window(length, margin=0.0)) for length in size.lengths),
        *(("margin", value, _window(margin=value)) for value in size.margins),
        *(("tau_c", value, _window(cost_threshold=value)) for value in size.thresholds),
        *(("tolerance", value, _optimizer(tolerance=value)) for value in size.tolerances),
    ]
    if preset == "recommended":
        sweeps += _scale_variants(platform, size)
    return [
        ({"sweep": sweep, "value": value}, EstimationSettings.model_validate({"preset": preset, **settings}))
        for sweep, value, settings in sweeps
    ]


def _scale_variants(platform: Platform, size: WindowsSize) -> list[tuple[str, float, dict[str, Any]]]:
    prior = default_prior(platform)
    share = np.minimum(1.0, 2.0 * OPERATING_LENGTH / np.array(prior.correlation_time))
    usual = np.array(prior.deviation) * np.sqrt(share)
    is_yaw = np.arange(6) == YAW
    return [
        (sweep, factor, _optimizer(scale=tuple(np.where(mask, factor * usual, usual).tolist())))
        for sweep, mask, factors in (
            ("scale of yaw", is_yaw, size.yaw_scales),
            ("scale of the others", ~is_yaw, size.other_scales),
        )
        for factor in factors
    ]


def _window(length: float = OPERATING_LENGTH, **others: float) -> dict[str, Any]:
    return {"window": {"length": length, **others}}


def _optimizer(**values: Any) -> dict[str, Any]:
    return {**_window(), "optimizer": values}


def make_excerpt(platform: Platform, size: WindowsSize, preset: str, sliding: bool) -> Excerpt:
    """Invert one twin at the operating length and select steady glide around its strongest disturbance."""
    window = _window() if sliding else _window(margin=0.0)
    settings = EstimationSettings.model_validate({"preset": preset, **window})
    inversion = invert_twin(TwinCase(platform, world(size.depth), 1, settings, course_of(1)))
    count = round(EXCERPT / inversion.step)
    start = strongest_stretch(np.where(inversion.steady, inversion.truth[:, YAW], 0.0), inversion.steady, count)
    part = slice(start, start + count)
    seams = boundaries_of(inversion.estimate.solution.source) - start
    return Excerpt(
        hull=platform.name,
        preset=preset,
        sliding=sliding,
        time=np.arange(count, dtype=np.float64) * inversion.step,
        truth=inversion.truth[part, YAW],
        estimate=inversion.estimate.solution.disturbances[part, YAW],
        boundaries=np.asarray(seams[(seams > 0) & (seams < count)] * inversion.step, dtype=np.float64),
    )


def strongest_stretch(signal: NDArray[np.float64], steady: NDArray[np.bool_], count: int) -> int:
    """Index of the first of `count` samples with the most energy, at least nine tenths as steady as the steadiest."""
    count = min(count, len(signal))
    ones = np.ones(count)
    calm = np.convolve(steady.astype(np.float64), ones, mode="valid")
    energy = np.convolve(signal**2, ones, mode="valid")
    return int(np.argmax(np.where(calm >= 0.9 * calm.max(), energy, -1.0)))


def overall_error(row: Row) -> float:
    """Root mean square, over the four disturbed channels, of RMSE over the truth's root mean square."""
    if "refused" in row:
        return float("nan")
    return float(np.sqrt(np.mean([(row[f"rmse_{name}"] / row[f"truth_{name}"]) ** 2 for name in LONGITUDINAL_AND_YAW])))


def summarise(table: pd.DataFrame) -> list[Row]:
    """Median and quartiles of the scores over the seeds, one line per setting."""
    lines = []
    for labels, group in groups(table, ("hull", "preset", "sweep", "value"), sort=True):
        line = labels | {"seeds": len(group)}
        for name in SCORES:
            line |= quartiles(name, finite(group, name))
        lines.append(line)
    return lines


def verdict(table: pd.DataFrame, hull: str, preset: str) -> Row:
    """Judge the operating point of 30 s, 10 s and 0.2 for one hull and preset.

    Take the difference between a length's error and that of the best length, seed by seed. The length is *as good as*
    the best if the median of this difference does not exceed its quartile spread.
    """
    frame = table[(table["hull"] == hull) & (table["preset"] == preset)]
    sliding = {name: _by_seed(frame, "sliding", name) for name in ("rmse_B_cr", "overall", "seam_ratio", "capped")}
    not_sliding = {name: _by_seed(frame, "not sliding", name) for name in ("rmse_B_cr", "overall", "seam_ratio")}
    best_yaw, best_overall = (_best(sliding[name]) for name in ("rmse_B_cr", "overall"))
    capped = sliding["capped"].mean()
    line: Row = {
        "hull": hull,
        "preset": preset,
        "best_length_yaw": best_yaw,
        "best_length_overall": best_overall,
        "as_good_as_best": as_good_as_best(sliding["overall"]),
        "as_good_as_best_yaw": as_good_as_best(sliding["rmse_B_cr"]),
        "capped_from": next((float(length) for length in capped.index if capped[length] > _NEGLIGIBLE_SHARE), None),
    }
    if OPERATING_LENGTH in sliding["overall"]:
        at_operating = {name: scores[OPERATING_LENGTH] for name, scores in sliding.items()}
        line["yaw_over_best"] = float((at_operating["rmse_B_cr"] / sliding["rmse_B_cr"][best_yaw]).median())
        line["overall_over_best"] = float((at_operating["overall"] / sliding["overall"][best_overall]).median())
        for name, scores in not_sliding.items():
            line[f"unslid_over_slid_{name}"] = float((scores[OPERATING_LENGTH] / at_operating[name]).median())
    line["tau_c_change"] = _largest_change(frame)
    line["best_tolerance"] = _best(_by_seed(frame, "tolerance", "overall"))
    line["best_tolerance_yaw"] = _best(_by_seed(frame, "tolerance", "rmse_B_cr"))
    return line


def as_good_as_best(scores: pd.DataFrame) -> list[float]:
    """Values (columns) whose error exceeds the best one's by no more than the spread over the seeds (rows)."""
    excess = scores.sub(scores[_best(scores)], axis=0)
    spread = excess.quantile(0.75) - excess.quantile(0.25)
    return [float(value) for value in scores.columns if excess[value].median() <= spread[value]]


def describe_verdict(line: Row) -> str:
    """Describe whether 30 s / 10 s / 0.2 is right for a hull and preset."""
    good = line["as_good_as_best"]
    right = OPERATING_LENGTH in good
    limit = "never reached" if line["capped_from"] is None else f"reached from {line['capped_from']:g} s on"
    yaw, seam = line.get("unslid_over_slid_rmse_B_cr", np.nan), line.get("unslid_over_slid_seam_ratio", np.nan)
    return (
        f"{line['hull']}, {line['preset']}: 30 s is {'as good as any length' if right else 'not the best length'}. "
        f"Best length over all channels: {line['best_length_overall']:g} s (as good: "
        f"{', '.join(f'{value:g}' for value in good)} s); for yaw alone: {line['best_length_yaw']:g} s (at 30 s the "
        f"yaw error is {number(line.get('yaw_over_best'))} times that). Non-overlapping windows multiply the yaw "
        f"error by {number(yaw)} and the seam ratio by {number(seam)}. The iteration limit is {limit}. A tau_c from "
        f"0.05 to 3.2 changes the yaw error by at most {line['tau_c_change']:.1%}. Best tolerance over all channels: "
        f"{line['best_tolerance']:g}, for yaw alone: {line['best_tolerance_yaw']:g}."
    )


def _by_seed(frame: pd.DataFrame, sweep: str, score: str) -> pd.DataFrame:
    """One score, a row per seed and a column per value of the sweep."""
    return frame[frame["sweep"] == sweep].pivot_table(index="seed", columns="value", values=score, aggfunc="first")


def _best(scores: pd.DataFrame) -> float:
    medians = scores.median()
    return float(medians.index.to_numpy()[int(np.argmin(medians.to_numpy()))])


def _largest_change(frame: pd.DataFrame) -> float:
    """Largest relative change of the yaw error over the sweep of tau_c and all seeds."""
    scores = _by_seed(frame, "tau_c", "rmse_B_cr")
    spread = (scores.max(axis=1) - scores.min(axis=1)) / scores.min(axis=1)
    return float(spread.max())


NAME = "windows"
FULL = WindowsSize(
    depth=50.0,
    seeds=10,
    lengths=(15.0, 20.0, 30.0, 45.0, 60.0, 90.0),
    margins=(5.0, 15.0, 20.0),
    thresholds=(0.05, 0.1, 0.4, 0.8, 1.6, 3.2),
    tolerances=(5e-3, 2e-3, 1e-3, 5e-4, 2e-4, 1e-4, 3e-5, 1e-5),
    yaw_scales=(0.1, 0.3, 3.0),
    other_scales=(0.1, 0.3, 3.0, 10.0),
)
QUICK = WindowsSize(
    depth=30.0,
    seeds=2,
    lengths=(15.0, 30.0, 60.0),
    margins=(5.0,),
    thresholds=(0.05, 3.2),
    tolerances=(5e-3, 1e-4),
    yaw_scales=(0.3,),
    other_scales=(3.0,),
)


def conclude(plan: TwinPlan[WindowsSize], rows: list[Row]) -> Findings:
    """Make findings, with one table of comparisons per hull and preset."""
    rows = [row | {"overall": overall_error(row)} for row in rows]
    table = tidy_table(rows)
    summary = summarise(table)
    pairs = [(platform.name, preset) for platform in plan.platforms for preset in PRESETS]
    verdicts = [verdict(table, *pair) for pair in pairs]
    excerpts = [make_excerpt(plan.platforms[0], plan.size, PRESETS[0], sliding) for sliding in (True, False)]
    sentences = tuple(describe_verdict(line) for line in verdicts)
    return twin_findings(
        NAME,
        plan,
        {f"{hull}, {preset}": compare_windows(summary, verdicts, hull, preset) for hull, preset in pairs},
        rows=rows,
        figure=draw_windows(summary, excerpts),
        facts={"verdicts": verdicts, "sentences": sentences, "summary": summary},
        remarks=sentences,
    )


STUDY = TwinStudy(NAME, FULL, QUICK, window_runs, conclude)
"""The study that the program runs."""


def compare_windows(summary: Sequence[Row], verdicts: Sequence[Row], hull: str, preset: str) -> list[Comparison]:
    """Compare the paper's figures of section 5.1.2 and Fig. 5 with ours, for one hull and preset."""
    lines = {(line["sweep"], line["value"]): line for line in select(summary, hull=hull, preset=preset)}
    at = first(verdicts, hull=hull, preset=preset)
    slid, unslid = lines["sliding", OPERATING_LENGTH], lines["not sliding", OPERATING_LENGTH]
    longest = lines["sliding", max(value for sweep, value in lines if sweep == "sliding")]
    good = ", ".join(f"{value:g}" for value in at["as_good_as_best"])
    return [
        _row("yaw RMSE, 30 s overlapping", "N m", slid, "rmse_B_cr", 0.15),
        _row("yaw RMSE, 30 s non-overlapping", "N m", unslid, "rmse_B_cr"),
        _row("surge RMSE, 30 s overlapping", "N", slid, "rmse_B_cu"),
        _row("pitch moment RMSE, 30 s overlapping", "N m", slid, "rmse_B_cq"),
        _row("seam ratio, 30 s overlapping", "1", slid, "seam_ratio", 1.0, paper_text="near 1"),
        _row("seam ratio, 30 s non-overlapping", "1", unslid, "seam_ratio", 20.0, paper_text="> 20"),
        _row("jump ratio, 30 s overlapping", "1", slid, "jump_ratio"),
        _row("jump ratio, 30 s non-overlapping", "1", unslid, "jump_ratio", remark="a discontinuity alone"),
        Comparison(
            "cost, 30 s non-overlapping over overlapping", "1", unslid["cost_per_30s"] / slid["cost_per_30s"],
            remark="paper: lower",
        ),
        _row("iterations per window, 30 s", "1", slid, "iterations", 37.0),
        _row(f"share at the iteration limit, {longest['value']:g} s", "1", longest, "capped",
             remark="paper: no convergence beyond 45 s"),
        Comparison("best length for yaw alone", "s", at["best_length_yaw"], 30.0),
        Comparison("best length over all channels", "s", at["best_length_overall"], 30.0, remark=f"as good: {good} s"),
        Comparison("yaw error at 30 s over the best's", "1", at.get("yaw_over_best", np.nan), 1.0),
        Comparison(
            "largest change of yaw error, tau_c 0.05-3.2", "1", at["tau_c_change"], 0.0, paper_text="invariant",
            remark="relative, over all twins",
        ),
        Comparison("best tolerance over all channels", "1", at["best_tolerance"],
                   remark=f"on max |s g|; for yaw alone {at['best_tolerance_yaw']:g}"),
    ]  # fmt: skip


def _row(
    quantity: str, unit: str, line: Row, name: str, paper: float | None = None, paper_text: str = "", remark: str = ""
) -> Comparison:
    spread = (line[f"{name}_low"], line[f"{name}_high"])
    return Comparison(quantity, unit, line[name], paper, spread, paper_text, remark)
