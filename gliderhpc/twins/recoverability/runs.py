"""The runs of ``twin recoverability``: twins without disturbance, with impulses of one size, and usual ones."""

from dataclasses import dataclass

import numpy as np

from gliderhpc.errors import ProfileError
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.platform import Platform
from gliderhpc.twins.hulls import with_coefficient_errors
from gliderhpc.twins.impulses import find_impulses
from gliderhpc.twins.inversion import TwinCase, invert_twin
from gliderhpc.twins.recoverability.detection import quiet_row
from gliderhpc.twins.recoverability.motion import motion_row
from gliderhpc.twins.runs import Row, TwinRun, labelled
from gliderhpc.twins.study import TwinPlan, TwinSize
from gliderhpc.twins.worlds import QUIET, course_of, with_impulses, world

PRESETS = ("recommended", "paper")
COEFFICIENT_ERROR = 0.15
MODELS = ("exact", "within 15%")
"""What the estimator believes of the hull's coefficients."""

SPACING = 45.0
"""Mean time between impulses, s."""

_COEFFICIENT_STREAM = 3_000


@dataclass(frozen=True, kw_only=True)
class RecoverabilitySize(TwinSize):
    """How much is run: depths (m) of impulse, quiet and motion twins, amplitudes (N m), widths (s), twins of a kind."""

    impulse_depth: float
    quiet_depth: float
    motion_depth: float
    amplitudes: tuple[float, ...]
    widths: tuple[float, ...]
    impulse_seeds: int
    quiet_seeds: int


def recoverability_runs(plan: TwinPlan[RecoverabilitySize]) -> list[TwinRun]:
    """List every run."""
    (platform,) = plan.platforms
    size, seeds = plan.size, plan.seeds
    runs = []
    for preset in PRESETS:
        settings = EstimationSettings.model_validate({"preset": preset})
        runs += [_quiet_run(platform, size, settings, seed) for seed in seeds[: size.quiet_seeds]]
        runs += [
            _impulse_run(platform, size, settings, seed, amplitude, width)
            for seed in seeds[: size.impulse_seeds]
            for amplitude in size.amplitudes
            for width in size.widths
        ]
        runs += [_motion_run(platform, size, settings, seed, model) for seed in seeds for model in MODELS]
    return runs


def recovered_rows(run: TwinRun) -> list[Row]:
    """Invert one twin and give its rows: one an impulse, or one a dive."""
    labels = {**dict(run.labels), "seed": run.case.seed}
    try:
        inversion = invert_twin(run.case)
    except ProfileError as error:
        return [labels | {"kind": "refused", "refused": str(error)}]
    if labels["kind"] == "impulse":
        return [labels | vars(finding) for finding in find_impulses(inversion)]
    return [labels | (quiet_row(inversion) if labels["kind"] == "quiet" else motion_row(inversion))]


def _quiet_run(platform: Platform, size: RecoverabilitySize, settings: EstimationSettings, seed: int) -> TwinRun:
    case = TwinCase(platform, world(size.quiet_depth, disturbances=QUIET), seed, settings, course_of(seed))
    return labelled(case, kind="quiet", preset=settings.preset)


def _impulse_run(
    platform: Platform,
    size: RecoverabilitySize,
    settings: EstimationSettings,
    seed: int,
    amplitude: float,
    width: float,
) -> TwinRun:
    scenario = with_impulses(world(size.impulse_depth), amplitude, width, SPACING)
    case = TwinCase(platform, scenario, seed, settings, course_of(seed))
    return labelled(case, kind="impulse", preset=settings.preset, true_amplitude=amplitude, true_width=width)


def _motion_run(
    platform: Platform, size: RecoverabilitySize, settings: EstimationSettings, seed: int, model: str
) -> TwinRun:
    rng = np.random.default_rng([seed, _COEFFICIENT_STREAM])
    assumed = None if model == "exact" else with_coefficient_errors(platform, COEFFICIENT_ERROR, rng)
    case = TwinCase(platform, world(size.motion_depth), seed, settings, course_of(seed), assumed)
    return labelled(case, kind="motion", preset=settings.preset, model=model)
