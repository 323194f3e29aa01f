"""The runs of ``twin currents``: batches of drawn twins, and of twins in shear and gusts of several strengths."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.kernels.elementwise import LANES
from gliderhpc.platform import Platform
from gliderhpc.simulator import Scenario
from gliderhpc.studies.currents.settings import DepthResolvedSettings
from gliderhpc.twins.currents.averaged import averaged_row
from gliderhpc.twins.currents.draws import Spreads, drawn_case, offsets_of
from gliderhpc.twins.currents.resolved import resolved_row
from gliderhpc.twins.inversion import Refused, TwinCase, TwinInversion, invert_twins
from gliderhpc.twins.runs import Row, TwinRun, labelled
from gliderhpc.twins.study import TwinPlan, TwinSize
from gliderhpc.twins.worlds import course_of, paper_dive, with_water, without_lag

AVERAGED, LAGLESS, RESOLVED = "averaged", "averaged, without lag", "resolved"
"""Kinds of twins: of the depth-averaged current, the same with actuators that do what is recorded, and of the
depth-resolved current."""

PRESETS = ("recommended", "paper")
"""Of the depth-resolved twins; the drawn ones are inverted by the first."""

STILL, SHEAR, FINE, GUSTS = "still water", "paper's shear", "fine shear", "broadband"
WORLDS = {
    STILL: ((0.0,), "no shear and no gusts: what noise alone leaves"),
    SHEAR: ((1.0, 5.0), "surface layer, modes and smooth profile of the scenario `paper`"),
    FINE: ((1.0, 5.0), "smooth random profile U(Z)"),
    GUSTS: (
        (1.0, 3.0),
        "frozen Gaussian field along the path with the spectrum of the scenario's gusts, across the course",
    ),
}
"""Waters of the depth-resolved twins: their strengths, the realistic one first, and what they are."""

FINE_SCALE, FINE_RMS = 1.5, 0.01
"""Correlation scale (m) and rms (m/s, north and east each) of the fine shear, at a strength of one."""
_QUIET_CURRENT = {"surface_rms": 0.0, "mode_rms": 0.0, "fine_rms": 0.0}

Batch = tuple[TwinRun, ...]
"""Twins inverted side by side, each in one lane."""


@dataclass(frozen=True, kw_only=True)
class CurrentsSize(TwinSize):
    """How much is run.

    Attributes
    ----------
    depth : float
        Of the drawn twins, m.
    speed : (float, float)
        Of the uniform part of the drawn twins' current, m/s.
    water_depth : float
        Of the twins in shear and gusts, m.
    water_seeds : int
        Twins of each water, strength and preset.
    lagless_seeds : int
        Of the drawn twins, those flown again with actuators that do not lag.
    spreads : Spreads
        What is drawn of hull, sensors and trim.
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
    drawn = [_drawn(platform, plan.size, scenario, AVERAGED, seed) for seed in plan.seeds]
    prompt = without_lag(scenario)
    lagless = [_drawn(platform, plan.size, prompt, LAGLESS, seed) for seed in plan.seeds[: plan.size.lagless_seeds]]
    return [
        *_batches(drawn),
        *_batches(lagless),
        *(batch for preset in PRESETS for batch in _batches(_in_water(platform, plan, preset))),
    ]


def inverted_rows(batch: Batch) -> list[Row]:
    """Invert a batch and give a row a twin; one that was refused gives the reason."""
    inversions = invert_twins([run.case for run in batch])
    return [_row(run, inversion) for run, inversion in zip(batch, inversions, strict=True)]


def _row(run: TwinRun, inversion: TwinInversion | Refused) -> Row:
    labels: Row = {**dict(run.labels), "seed": run.case.seed}
    if isinstance(inversion, Exception):
        return labels | {"refused": str(inversion)}
    if labels["kind"] != RESOLVED:
        return labels | offsets_of(run.case) | averaged_row(inversion)
    return labels | resolved_row(inversion, run.case.hull, DepthResolvedSettings())


def _batches(runs: Sequence[TwinRun]) -> list[Batch]:
    return [tuple(runs[first : first + LANES]) for first in range(0, len(runs), LANES)]


def _drawn(platform: Platform, size: CurrentsSize, scenario: Scenario, kind: str, seed: int) -> TwinRun:
    return labelled(drawn_case(platform, scenario, size.spreads, EstimationSettings(), seed), kind=kind)


def _in_water(platform: Platform, plan: TwinPlan[CurrentsSize], preset: str) -> list[TwinRun]:
    """Twins with exact coefficients, and sensors with noise but without offsets."""
    settings = EstimationSettings.model_validate({"preset": preset})
    dive = paper_dive(plan.size.water_depth, speed=plan.size.speed)
    return [
        labelled(
            TwinCase(platform, _water(dive, world, factor), seed, settings, course_of(seed)),
            kind=RESOLVED, preset=preset, world=world, factor=factor,
        )
        for world, (factors, _) in WORLDS.items()
        for factor in factors
        for seed in plan.seeds[: plan.size.water_seeds]
    ]  # fmt: skip


def _water(dive: Scenario, world: str, factor: float) -> Scenario:
    current, gust_rms = dict(_QUIET_CURRENT), 0.0
    if world == SHEAR:
        current = {name: factor * getattr(dive.current, name) for name in _QUIET_CURRENT}
    elif world == FINE:
        current |= {"fine_rms": factor * FINE_RMS, "fine_scale": FINE_SCALE}
    elif world == GUSTS:
        gust_rms = factor * dive.gusts.rms
    return with_water(dive, current, gust_rms)
