"""The sweeps of ``twin windows``: length with and without margin, margin, tau_c, tolerance, the transform's scale."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from gliderhpc.estimation.settings import EstimationSettings, default_prior
from gliderhpc.platform import Platform
from gliderhpc.twins.inversion import TwinCase
from gliderhpc.twins.runs import TwinRun, labelled
from gliderhpc.twins.scoring import YAW
from gliderhpc.twins.study import TwinPlan, TwinSize
from gliderhpc.twins.worlds import course_of, world

PRESETS = ("recommended", "paper")
OPERATING_LENGTH = 30.0
"""Seconds; the paper's operating point, with a margin of 10 s and tau_c = 0.2."""


@dataclass(frozen=True, kw_only=True)
class WindowsSize(TwinSize):
    """How much is swept.

    Attributes
    ----------
    depth : float
        Of the twins, m.
    lengths : tuple of float
        Window lengths, s.
    margins : tuple of float
        At the operating length, s.
    thresholds, tolerances, yaw_scales, other_scales : tuple of float
        tau_c (rad2 s); on ``max |s g|``; factors of the transform's scale, yaw apart from the other channels.
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
        for labels, settings in variants(platform, preset, plan.size)
    ]


def variants(platform: Platform, preset: str, size: WindowsSize) -> list[tuple[dict[str, Any], EstimationSettings]]:
    """Settings of every sweep with their labels; the operating point itself is in the sweep of lengths."""
    every = [
        *(({"sweep": "sliding", "value": length}, window_of(length)) for length in size.lengths),
        *(({"sweep": "not sliding", "value": length}, window_of(length, margin=0.0)) for length in size.lengths),
        *(({"sweep": "margin", "value": value}, window_of(OPERATING_LENGTH, margin=value)) for value in size.margins),
        *(
            ({"sweep": "tau_c", "value": value}, window_of(OPERATING_LENGTH, cost_threshold=value))
            for value in size.thresholds
        ),
        *(({"sweep": "tolerance", "value": value}, _optimizer(tolerance=value)) for value in size.tolerances),
    ]
    if preset == "recommended":
        every += _scale_variants(platform, size)
    return [(labels, EstimationSettings.model_validate({"preset": preset, **values})) for labels, values in every]


def _scale_variants(platform: Platform, size: WindowsSize) -> list[tuple[dict[str, Any], dict[str, Any]]]:
    prior = default_prior(platform)
    share = np.minimum(1.0, 2.0 * OPERATING_LENGTH / np.array(prior.correlation_time))
    usual = np.array(prior.deviation) * np.sqrt(share)
    is_yaw = np.arange(6) == YAW
    return [
        ({"sweep": sweep, "value": factor}, _optimizer(scale=tuple(np.where(mask, factor * usual, usual).tolist())))
        for sweep, mask, factors in (
            ("scale of yaw", is_yaw, size.yaw_scales),
            ("scale of the others", ~is_yaw, size.other_scales),
        )
        for factor in factors
    ]


def window_of(length: float, **others: float) -> dict[str, Any]:
    """Settings of a window length (s) and what else is said of the window."""
    return {"window": {"length": length, **others}}


def _optimizer(**values: Any) -> dict[str, Any]:
    return {"window": {"length": OPERATING_LENGTH}, "optimizer": values}
