"""The runs of ``twin sensitivity``: every error beside the same twin without it."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.platform import Platform
from gliderhpc.simulator import Scenario
from gliderhpc.twins.changes import RecordChanges
from gliderhpc.twins.hulls import with_coefficient_errors, with_factors, with_sample_interval
from gliderhpc.twins.inversion import TwinCase
from gliderhpc.twins.runs import TwinRun, labelled
from gliderhpc.twins.study import TwinPlan, TwinSize
from gliderhpc.twins.worlds import QUIET, course_of, noiseless, world

COEFFICIENT_ERROR = 0.15
OFFSETS = ("pitch", "heading", "roll")
STEPS = (0.05, 0.2, 0.25)
INTERVALS = (2.0, 4.0, 5.0, 10.0, 20.0)
DROPOUTS = (0.05, 0.2, 0.5)
GAPS = (5.0, 10.0, 30.0, 60.0)
INITIAL_ERRORS = {"u": (6, 0.1), "v": (7, 0.05), "w": (8, 0.05), "q": (10, 0.02), "r": (11, 0.02)}
"""Index in the state (eq. 16) and error, m/s or rad/s."""

BASE = "base"
_COEFFICIENT_STREAM = 2_000


@dataclass(frozen=True, kw_only=True)
class SensitivitySize(TwinSize):
    """How much is run.

    Attributes
    ----------
    depth, noise_depth : float
        Of the twins, and of those without any disturbance, m.
    draws : int
        Draws of all coefficients a twin.
    presets, pitches, single_coefficients : tuple
        Presets, pitches of the twins with offsets (degree), coefficients that are also made wrong alone.
    """

    depth: float
    noise_depth: float
    draws: int
    presets: tuple[str, ...]
    pitches: tuple[float, ...]
    single_coefficients: tuple[str, ...]


def sensitivity_runs(plan: TwinPlan[SensitivitySize]) -> list[TwinRun]:
    """List every run, those of one twin together."""
    (platform,) = plan.platforms
    return [
        run
        for seed in plan.seeds
        for preset in plan.size.presets
        for run in (
            *_noise_runs(platform, plan.size, seed, preset),
            *_offset_runs(platform, plan.size, seed, preset),
            *_record_runs(platform, plan.size, seed, preset),
            *_coefficient_runs(platform, plan.size, seed, preset),
        )
    ]


def _noise_runs(platform: Platform, size: SensitivitySize, seed: int, preset: str) -> list[TwinRun]:
    quiet = world(size.noise_depth, disturbances=QUIET)
    return [
        _run(platform, scenario, seed, preset, sweep="quiet", value=value)
        for value, scenario in (("noise", quiet), ("perfect sensors", noiseless(quiet)))
    ]


def _offset_runs(platform: Platform, size: SensitivitySize, seed: int, preset: str) -> list[TwinRun]:
    runs = []
    for pitch in size.pitches:
        scenario = world(size.depth, pitch=pitch)
        runs.append(_run(platform, scenario, seed, preset, sweep=f"offset at {pitch:g}", value=BASE))
        for name in OFFSETS:
            for sign in (1.0, -1.0):
                changes = RecordChanges(**{f"{name}_offset": sign})
                labels: dict[str, Any] = {"sweep": f"offset at {pitch:g}", "value": f"{name} {sign:+g}"}
                runs.append(_run(platform, scenario, seed, preset, changes=changes, **labels))
    return runs


def _record_runs(platform: Platform, size: SensitivitySize, seed: int, preset: str) -> list[TwinRun]:
    """Steps, sample intervals, dropouts, gaps and the first guess of the state, on the usual twin."""
    scenario = world(size.depth)
    common = (platform, scenario, seed, preset)
    runs = [_run(*common, sweep="usual", value=BASE)]
    runs += [_run(*common, sweep="step", value=step, settings={"step": step}) for step in STEPS]
    runs += [
        _run(
            *common, sweep="sample interval", value=interval, changes=RecordChanges(sample_interval=interval),
            assumed=with_sample_interval(platform, interval),
        )
        for interval in INTERVALS
    ]  # fmt: skip
    runs += [_run(*common, sweep="dropout", value=share, changes=RecordChanges(dropout=share)) for share in DROPOUTS]
    runs += [_run(*common, sweep="gap", value=gap, changes=RecordChanges(gap=gap)) for gap in GAPS]
    runs += [
        _run(*common, sweep="initial state", value=name, initial_error=_initial_error(index, error))
        for name, (index, error) in INITIAL_ERRORS.items()
    ]
    return runs


def _coefficient_runs(platform: Platform, size: SensitivitySize, seed: int, preset: str) -> list[TwinRun]:
    scenario = world(size.depth)
    rng = np.random.default_rng([seed, _COEFFICIENT_STREAM])
    assumed = {
        f"draw {draw + 1}": with_coefficient_errors(platform, COEFFICIENT_ERROR, rng) for draw in range(size.draws)
    }
    runs = [
        _run(platform, scenario, seed, preset, sweep="coefficients", value=value, assumed=hull)
        for value, hull in assumed.items()
    ]
    runs += [
        _run(
            platform, scenario, seed, preset, sweep="one coefficient", value=name,
            assumed=with_factors(platform, {name: 1.0 + COEFFICIENT_ERROR}),
        )
        for name in size.single_coefficients
    ]  # fmt: skip
    return runs


def _initial_error(index: int, error: float) -> tuple[float, ...]:
    return tuple(error if i == index else 0.0 for i in range(12))


def _run(
    platform: Platform,
    scenario: Scenario,
    seed: int,
    preset: str,
    *,
    sweep: str,
    value: Any,
    settings: dict[str, Any] | None = None,
    assumed: Platform | None = None,
    changes: RecordChanges | None = None,
    initial_error: tuple[float, ...] | None = None,
) -> TwinRun:
    validated = EstimationSettings.model_validate({"preset": preset, **(settings or {})})
    case = TwinCase(
        platform, scenario, seed, validated, course_of(seed), assumed, changes or RecordChanges(), initial_error
    )
    return labelled(case, hull=platform.name, preset=preset, sweep=sweep, value=value)
