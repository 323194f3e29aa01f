"""Runs of ``twin currents``: batches of drawn twins, and of twins in shear and gusts of several strengths."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.kernels.elementwise import LANES
from gliderhpc.platform import Platform
from gliderhpc.simulator import Scenario
from gliderhpc.studies.library.retrieval import DepthResolvedSettings
from gliderhpc.twins.cases import PRESETS, TwinCase, course_of, paper_dive, with_water, without_lag
from gliderhpc.twins.currents.resolved import resolved_row
from gliderhpc.twins.inversion import Refused, TwinInversion, invert_twins
from gliderhpc.twins.scoring import Row, motion_scores, twin_current
from gliderhpc.twins.study import TwinPlan, TwinRun, TwinSize, labelled

AVERAGED, LAGLESS, RESOLVED = "averaged", "averaged, without lag", "resolved"
"""Kinds of twins: of the depth-averaged current, the same with actuators at the recorded positions, and of the
depth-resolved current."""

STILL, SHEAR, FINE, GUSTS = "still water", "paper's shear", "fine shear", "broadband"
WORLDS = {
    STILL: ((0.0,), "no shear and no gusts: the effect of noise alone"),
    SHEAR: ((1.0, 5.0), "surface layer, modes and smooth profile of the scenario `paper`"),
    FINE: ((1.0, 5.0), "smooth random profile U(Z)"),
    GUSTS: (
        (1.0, 3.0),
        "frozen Gaussian field along the path with the spectrum of the scenario's gusts, across the course",
    ),
}
"""Waters of the depth-resolved twins: strengths, the realistic one first, and a description."""

FINE_SCALE, FINE_RMS = 1.5, 0.01
"""Correlation scale (m) and rms (m/s, north and east each) of the fine shear, at a strength of one."""
_QUIET_CURRENT = {"surface_rms": 0.0, "mode_rms": 0.0, "fine_rms": 0.0}

Batch = tuple[TwinRun, ...]
"""Twins inverted together, each in one lane."""

_DRAWS_STREAM = 4_000
_OFFSETS = ("roll_offset", "pitch_offset", "heading_offset")


@dataclass(frozen=True)
class Spreads:
    """Spread of the twins' properties about those that the estimator assumes; the coverage depends on it.

    Attributes
    ----------
    coefficients : float
        Relative range within which every viscous and added-mass coefficient is drawn, uniformly and independently.
    roll_offset, pitch_offset, heading_offset : float
        Standard deviations of constant errors of the attitude sensor, degree.
    neutral_volume : float
        Standard deviation of the neutral volume's error, cm3.
    battery_position : float
        Standard deviation of the error of the battery's zero, m.
    fix_error : float
        Standard deviation of a fix, north and east each, m.
    """

    coefficients: float = 0.15
    roll_offset: float = 0.5
    pitch_offset: float = 0.5
    heading_offset: float = 2.0
    neutral_volume: float = 30.0
    battery_position: float = 0.0005
    fix_error: float = 5.0


@dataclass(frozen=True, kw_only=True)
class CurrentsSize(TwinSize):
    """Size of the study.

    Attributes
    ----------
    depth : float
        Depth of the drawn twins, m.
    speed : (float, float)
        Range of the uniform part of the drawn twins' current, m/s.
    water_depth : float
        Depth of the twins in shear and gusts, m.
    water_seeds : int
        Number of twins per water, strength and preset.
    lagless_seeds : int
        Number of drawn twins that are also flown with actuators that do not lag.
    spreads : Spreads
        Spread of hull, sensors and trim.
    """

    depth: float
    speed: tuple[float, float] = (0.0, 0.45)
    water_depth: float
    water_seeds: int
    lagless_seeds: int
    spreads: Spreads = field(default_factory=Spreads)


def currents_runs(plan: TwinPlan[CurrentsSize]) -> list[Batch]:
    """List the batches."""
    (platform,) = plan.platforms
    scenario = paper_dive(plan.size.depth, speed=plan.size.speed)
    drawn = [_drawn_run(platform, plan.size, scenario, AVERAGED, seed) for seed in plan.seeds]
    prompt = without_lag(scenario)
    lagless = [_drawn_run(platform, plan.size, prompt, LAGLESS, seed) for seed in plan.seeds[: plan.size.lagless_seeds]]
    return [
        *_batches(drawn),
        *_batches(lagless),
        *(batch for preset in PRESETS for batch in _batches(_water_runs(platform, plan, preset))),
    ]


def currents_rows(batch: Batch) -> list[Row]:
    """Invert a batch and return a row per twin; a refused one gives the reason."""
    inversions = invert_twins([run.case for run in batch])
    return [_row(run, inversion) for run, inversion in zip(batch, inversions, strict=True)]


def _row(run: TwinRun, inversion: TwinInversion | Refused) -> Row:
    labels: Row = {**dict(run.labels), "seed": run.case.seed}
    if isinstance(inversion, Exception):
        return labels | {"refused": str(inversion)}
    if labels["kind"] != RESOLVED:
        return labels | offsets_of(run.case) | _averaged_row(inversion)
    return labels | resolved_row(inversion, run.case.hull, DepthResolvedSettings())


def _batches(runs: Sequence[TwinRun]) -> list[Batch]:
    return [tuple(runs[first : first + LANES]) for first in range(0, len(runs), LANES)]


def _drawn_run(platform: Platform, size: CurrentsSize, scenario: Scenario, kind: str, seed: int) -> TwinRun:
    return labelled(drawn_case(platform, scenario, size.spreads, EstimationSettings(), seed), kind=kind)


def _water_runs(platform: Platform, plan: TwinPlan[CurrentsSize], preset: str) -> list[TwinRun]:
    """Twins with exact coefficients, and sensors with noise but without offsets, in every water."""
    settings = EstimationSettings.model_validate({"preset": preset})
    dive = paper_dive(plan.size.water_depth, speed=plan.size.speed)
    return [
        labelled(
            TwinCase(platform, _water(dive, world, factor), seed, settings, course_of(seed)),
            kind=RESOLVED,
            preset=preset,
            world=world,
            factor=factor,
        )
        for world, (factors, _) in WORLDS.items()
        for factor in factors
        for seed in plan.seeds[: plan.size.water_seeds]
    ]


def _water(dive: Scenario, world: str, factor: float) -> Scenario:
    current, gust_rms = dict(_QUIET_CURRENT), 0.0
    if world == SHEAR:
        current = {name: factor * getattr(dive.current, name) for name in _QUIET_CURRENT}
    elif world == FINE:
        current |= {"fine_rms": factor * FINE_RMS, "fine_scale": FINE_SCALE}
    elif world == GUSTS:
        gust_rms = factor * dive.gusts.rms
    return with_water(dive, current, gust_rms)


def drawn_case(
    platform: Platform, scenario: Scenario, spreads: Spreads, settings: EstimationSettings, seed: int
) -> TwinCase:
    """Draw a twin of a scenario whose hull and sensors have errors, while the estimator assumes the platform file.

    The course is drawn uniformly. The simulator draws current, shear, gusts and errors of the fixes from the seed.
    """
    rng = np.random.default_rng([seed, _DRAWS_STREAM])
    offsets = {name: float(rng.normal(0.0, getattr(spreads, name))) for name in _OFFSETS}
    hull = _with_trim(
        platform,
        neutral_volume=float(rng.normal(0.0, spreads.neutral_volume)),
        battery=float(rng.normal(0.0, spreads.battery_position)),
    )
    sensors = {**scenario.sensors.model_dump(), **offsets, "fix_deviation": spreads.fix_error}
    steering = {**scenario.steering.model_dump(), "courses": (float(rng.uniform(0.0, 360.0)),), "waypoints": ()}
    drawn = scenario.replaced(
        {"sensors": sensors, "coefficients": {"spread": spreads.coefficients}, "steering": steering}
    )
    return TwinCase(hull, drawn, seed, settings, course_of(seed), assumed=platform)


def offsets_of(case: TwinCase) -> dict[str, Any]:
    """Errors drawn for a case: offsets (degree), neutral volume (cm3) and battery zero (m) minus the assumed ones."""
    assumed = case.assumed or case.hull
    return {
        **{name: getattr(case.scenario.sensors, name) for name in _OFFSETS},
        "neutral_volume_error": case.hull.buoyancy.neutral_volume - assumed.buoyancy.neutral_volume,
        "battery_position_error": case.hull.position.battery - assumed.position.battery,
    }


def _with_trim(platform: Platform, *, neutral_volume: float, battery: float) -> Platform:
    buoyancy, position = platform.buoyancy, platform.position
    return platform.model_copy(
        update={
            "buoyancy": buoyancy.model_copy(update={"neutral_volume": buoyancy.neutral_volume + neutral_volume}),
            "position": position.model_copy(update={"battery": position.battery + battery}),
        }
    )


def _averaged_row(inversion: TwinInversion) -> Row:
    """Estimated and true current (m/s), modelled track and its bridged part (m), drift time, error of the motion (m/s).

    The error is that of the mean motion through the water along and across the true track.
    """
    current = twin_current(inversion)
    drift = current.drift
    row: Row = {}
    for name, vector in (
        ("current", inversion.profile_truth.current),
        ("estimate", current.velocity),
        ("track", drift.track),
    ):
        row[f"{name}_north"], row[f"{name}_east"] = vector.tolist()
    motion = motion_scores(inversion)
    return row | {
        "bridged": drift.bridged,
        "duration": drift.elapsed,
        "position_variance": drift.position_variance,
        **{name: motion[name] for name in ("velocity_along", "velocity_across", "water_speed")},
    }
