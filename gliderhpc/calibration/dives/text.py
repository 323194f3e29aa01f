"""Results of a hull estimated from dives, as text: tables, notes, and provenance in the platform file."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from gliderhpc.calibration.dives.rounds import HullRounds
from gliderhpc.calibration.glides.score import Score
from gliderhpc.calibration.glides.text import describe_origin, score_sentence
from gliderhpc.flight.buoyancy import REFERENCE_TEMPERATURE
from gliderhpc.surfacing.recent_hull import IMPLAUSIBLE, UNDETERMINED
from gliderhpc.wording import capitalised

PARAMETERS = ("parameter", "unit", "before", "after", "95 % interval", "remaining", "remark")
DIRECTIONS = ("remaining", "main parameters")
HELD_OUT = ("profile", "chi-square", "degrees of freedom")
"""Headings of the tables; *remaining* is the deviation after the dives as a fraction of the plausible one."""

_NORMAL_95 = 1.96
_SHOWN = 0.3
_DETERMINED = 0.5
"""Remaining fraction of the plausible deviation below which the dives determine a direction."""
_DOUBTED = 0.5
"""Weight below which a dive is listed as doubtful."""


def parameter_table(rounds: HullRounds) -> pd.DataFrame:
    """Tabulate the parameters: unit, before, after, 95 % interval, remaining plausible deviation, and a remark."""
    mean, std = rounds.errors.mean, rounds.errors.std
    rows = [
        {
            "unit": p.unit,
            "before": p.value(rounds.base),
            "after": p.value(rounds.platform),
            "low": low,
            "high": high,
            "remaining": float(deviation),
            "remark": _remark(float(x), float(deviation)),
        }
        for p, x, deviation in zip(rounds.parameters, mean, std, strict=True)
        for low, high in [
            sorted(p.moved(rounds.base, float(x + sign * _NORMAL_95 * deviation)) for sign in (-1.0, 1.0))
        ]
    ]
    return pd.DataFrame(rows, index=pd.Index([p.key for p in rounds.parameters], name="parameter"))


def _remark(steps: float, left: float) -> str:
    if left > UNDETERMINED:
        return "not determined by these dives"
    return f"{abs(steps):.1f} plausible deviations from the platform's" if abs(steps) > IMPLAUSIBLE else ""


def parameter_rows(rounds: HullRounds) -> list[tuple[str, ...]]:
    """Return the rows of the table of parameters."""
    return [
        (str(key), row["unit"], f"{row['before']:.5g}", f"{row['after']:.5g}", f"{row['low']:.4g} to {row['high']:.4g}",
         f"{row['remaining']:.3f}", row["remark"])
        for key, row in parameter_table(rounds).iterrows()
    ]  # fmt: skip


def direction_rows(rounds: HullRounds) -> list[tuple[str, ...]]:
    """Return the rows of the directions that the dives determine, beginning with the best determined one."""
    left, vectors = rounds.mission.directions()
    rows: list[tuple[str, ...]] = []
    for part, vector in zip(left, vectors, strict=True):
        order = np.argsort(-np.abs(vector))
        names = [f"{vector[i]:+.2f} {rounds.parameters[i].key}" for i in order if abs(vector[i]) > _SHOWN]
        if part < _DETERMINED:
            rows.append((f"{part:.3f}", ", ".join(names)))
    return rows


def held_out_rows(rounds: HullRounds) -> list[tuple[str, ...]]:
    """Return the rows of the table of held-out dives."""
    return [(str(number), f"{value:.1f}", str(freedom)) for number, value, freedom in rounds.held_out]


def history_table(rounds: HullRounds) -> pd.DataFrame:
    """Tabulate each dive and parameter: estimates from all dives and from those up to it, with standard deviations."""
    rows = []
    for index, number in enumerate(rounds.mission.numbers.tolist()):
        smoothed, sequential = rounds.mission.smoothed[index], rounds.mission.sequential[index]
        for i, p in enumerate(rounds.parameters):
            values = [float(x.mean[i]) for x in (smoothed, sequential)]
            slopes = [abs(p.slope(rounds.base, value)) for value in values]
            rows.append({
                "profile": number, "time": rounds.mission.times[index], "parameter": p.key, "unit": p.unit,
                "estimate": p.moved(rounds.base, values[0]), "estimate_std": slopes[0] * float(smoothed.std[i]),
                "estimate_sequential": p.moved(rounds.base, values[1]),
                "estimate_sequential_std": slopes[1] * float(sequential.std[i]),
                "weight": float(rounds.mission.weight[index]),
            })  # fmt: skip
    return pd.DataFrame(rows)


def notes(rounds: HullRounds) -> list[str]:
    """Return remarks that supplement the tables, without the warnings."""
    mission = rounds.mission
    left, _ = mission.directions()
    lines = [
        describe_fitted_profiles(rounds),
        f"{len(rounds.moves)} rounds over the dives; last change {rounds.moves[-1]:.2f} plausible deviations",
        f"{int((left < _DETERMINED).sum())} of {len(left)} directions are known to better than half of their plausible "
        "deviation",
        f"the dives' information on the hull is divided by {rounds.divisor:.1f}, and that on sway, roll and yaw by "
        f"{rounds.turning_divisor:.1f}, because errors of the model are the same in all dives",
        f"the variance between dives is {mission.inflation:.1f} times the expected one; log evidence "
        f"{mission.log_evidence:.1f}",
    ]
    if rounds.base.buoyancy.compressibility is not None:
        lines.append(
            "buoyancy is computed from measured density, so the neutral volume refers to water of the platform's "
            f"density at the surface and {REFERENCE_TEMPERATURE:g} degC"
        )
    doubted = [f"{n} ({w:.2f})" for n, w in zip(mission.numbers.tolist(), mission.weight, strict=True) if w < _DOUBTED]
    if doubted:
        lines.append(f"dives that do not fit the others, with their weight: {', '.join(doubted)}")
    if rounds.skipped:
        lines.append("left out: " + "; ".join(f"profile {dive.number}, {dive.message}" for dive in rounds.skipped))
    return lines


def warnings(rounds: HullRounds, tolerance: float) -> list[str]:
    """Return a warning if the rounds ended before the hull that fits the profiles best was reached."""
    ahead = float(np.abs(rounds.full_step).max())
    if rounds.moves[-1] >= tolerance:
        return ["the hull was still changing in the last round; allow more rounds with `rounds.most`"]
    if ahead >= tolerance:
        return [
            f"the rounds ended {ahead:.1f} plausible deviations from the hull that fits the profiles best, which has "
            "no stable glide; start from another platform"
        ]
    return []


def describe_fitted_profiles(rounds: HullRounds) -> str:
    """Describe the fitted and the held-out profiles."""
    held_out = f"; held out {', '.join(str(number) for number, *_ in rounds.held_out)}" if rounds.held_out else ""
    return f"fitted on the dives of profiles {', '.join(map(str, rounds.mission.numbers.tolist()))}{held_out}"


def provenance(
    lines: Sequence[str], scores: Sequence[tuple[str, Score]], observations: str, digest: str,
    assignments: Sequence[str],
) -> str:  # fmt: skip
    """Describe the calibration for the platform file: data, dives, overrides, remarks and errors."""
    sentences = [
        describe_origin("Calibrated by `gliderhpc calibrate`", observations, digest, assignments),
        *map(capitalised, lines),
        *(score_sentence(name, score) for name, score in scores if score.segments),
    ]
    return ". ".join(filter(None, sentences)) + "."
