"""What ``twin recoverability`` gives, out of its runs' rows."""

from dataclasses import dataclass

from gliderhpc.estimation.current_budget import Budget, fit_budget
from gliderhpc.twins.recoverability.detection import detection_table, floor_table, identification_noise
from gliderhpc.twins.recoverability.motion import current_errors, error_row
from gliderhpc.twins.recoverability.platform_budget import make_budget
from gliderhpc.twins.recoverability.runs import MODELS, PRESETS, RecoverabilitySize
from gliderhpc.twins.runs import Row
from gliderhpc.twins.study import TwinPlan


@dataclass(frozen=True, eq=False)
class RecoverabilityResults:
    """What the study gives.

    Attributes
    ----------
    noise : dict
        A preset: identification noise (RMS and largest, N m) and threshold.
    findings, motions : list of dict
        One an impulse; one a dive.
    detection : list of dict
        One an amplitude, width and preset: rate, amplitude error, timing.
    floors : list of dict
        One a width and preset: amplitude found nine times in ten, and in multiples of the noise.
    errors : list of dict
        One a preset and ensemble (exact, 15 %): axial offset, velocity error and the fitted terms.
    budget : Budget
        For preset `MAIN` with the coefficient error.
    """

    noise: dict[str, Row]
    findings: list[Row]
    motions: list[Row]
    detection: list[Row]
    floors: list[Row]
    errors: list[Row]
    budget: Budget


def recoverability_results(plan: TwinPlan[RecoverabilitySize], rows: list[Row]) -> RecoverabilityResults:
    """Detection, errors and budget out of the rows of every run.

    Raises
    ------
    InputError
        Too few twins for a budget, or no impulse of the grid was found nine times in ten.
    """
    noise = {preset: identification_noise(rows, preset) for preset in PRESETS}
    findings = [row for row in rows if row["kind"] == "impulse"]
    motions = [row for row in rows if row["kind"] == "motion"]
    detection = detection_table(findings, noise)
    floors = floor_table(detection, noise)
    errors = [
        error_row(motions, preset, model, fit_budget(current_errors(motions, preset, model)))
        for preset in PRESETS
        for model in MODELS
    ]
    budget = make_budget(plan.platforms[0], noise, floors, errors, len(plan.seeds))
    return RecoverabilityResults(noise, findings, motions, detection, floors, errors, budget)
