"""The budget of the current's uncertainty for the platform at hand, out of what the twins gave."""

from collections.abc import Sequence

import numpy as np

from gliderhpc.errors import InputError
from gliderhpc.estimation.current_budget import Budget
from gliderhpc.platform import Platform
from gliderhpc.twins.recoverability.detection import FALSE_ALARMS, FLOOR_RATE
from gliderhpc.twins.recoverability.runs import MODELS
from gliderhpc.twins.runs import Row

MAIN = "recommended"
"""The preset that the budget is written for."""

TYPICAL_WIDTH = 1.2
"""Seconds; the width that the floor is quoted for: the shortest of the usual scenario."""


def make_budget(
    platform: Platform, noise: dict[str, Row], floors: Sequence[Row], errors: Sequence[Row], twins: int
) -> Budget:
    """Put the figures of preset `MAIN` together.

    Raises
    ------
    InputError
        No amplitude of the grid was found nine times in ten.
    """
    exact, wrong = (next(row for row in errors if row["preset"] == MAIN and row["model"] == model) for model in MODELS)
    typical = min(
        (row for row in floors if row["preset"] == MAIN), key=lambda row: abs(float(row["width"]) - TYPICAL_WIDTH)
    )
    if not np.isfinite(typical["floor"]):
        raise InputError(f"{platform.name}: no yaw impulse of the grid is found nine times in ten")
    level = noise[MAIN]["noise"]
    fit = f"maximum likelihood of the covariance over {twins} twins, every coefficient wrong by up to 15 %"
    return Budget(
        platform=platform.name,
        axial_error=wrong["axial_error"],
        relative_error=wrong["relative_error"],
        heading_error=wrong["heading_error"],
        identification_noise=level,
        detection_floor=typical["floor"],
        axial_offset_dive=wrong["axial_dive"],
        axial_offset_climb=wrong["axial_climb"],
        axial_offset_rms=wrong["axial_rms"],
        exact_axial_error=exact["axial_error"],
        how={
            "axial_error": f"m/s; {fit}; compass and pitch sensor without offset",
            "relative_error": f"of the current's speed; {fit}",
            "heading_error": f"degree; {fit}",
            "identification_noise": (
                f"N m; RMS of the yaw moment above 0.05 Hz with sensor noise and no disturbance, preset {MAIN}"
            ),
            "detection_floor": (
                f"N m; amplitude of an impulse of {typical['width']:g} s (standard deviation) found in "
                f"{FLOOR_RATE:.0%} of all cases, at a threshold that noise alone passes {FALSE_ALARMS:g} time an hour"
            ),
            "axial_offset": "N; mean of identified minus true B_cu over steady glide, dive and climb apart",
            "exact_axial_error": "m/s; as axial_error, with the true coefficients",
        },
    )
