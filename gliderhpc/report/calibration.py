"""What a calibration found, in words: tables for screen and pages, and the provenance for the platform file."""

import math
from collections.abc import Sequence

import numpy as np

from gliderhpc.flight.buoyancy import REFERENCE_TEMPERATURE
from gliderhpc.tuning.calibration import CalibratedParameter, Calibration, Score, Verdict
from gliderhpc.tuning.calibration_search import FIRST_SCALES
from gliderhpc.tuning.hull_parameters import TREND
from gliderhpc.tuning.steady_balance import QUANTITIES
from gliderhpc.version import __version__

PARAMETERS = ("parameter", "unit", "before", "after", "95 % interval", "scatter", "remark")
DIRECTIONS = ("singular value", "moves mostly")
SCORES = (
    "profiles", "segments", "depth rate, cm/s", "pitch, degree", "roll, degree", "turn rate, degree/s",
)  # fmt: skip
"""Headings of the tables."""

IN_UNITS = np.array([100.0, *[180.0 / math.pi] * 3])
"""From SI to the units of the scores."""

UNEXPLAINED = 2.0 * np.array(FIRST_SCALES)
"""Errors (SI) that a calibrated hull should not leave."""

BY_DENSITY = (
    "the buoyancy goes by measured density, so the neutral volume is that of water of the platform's density at the "
    f"surface and {REFERENCE_TEMPERATURE:g} degC"
)

_SHOWN = 0.3
_HELD = {
    Verdict.UNDETERMINED: "not determined by these glides, so left as they were",
    Verdict.REFUTED: "not determined, but the platform's value is refuted, so held at the most probable one",
    Verdict.IMPLAUSIBLE: "fitted only beyond what is plausible, so held at the bound of it",
    Verdict.UNSTABLE: "left as they were, since with them free the hull has no stable glide",
}


def parameter_rows(found: Calibration) -> list[tuple[str, ...]]:
    """Rows of the table of parameters; *scatter* is the interval's part that is scatter between profiles."""
    return [
        (p.parameter.key, p.parameter.unit, f"{p.before:.5g}", f"{p.after:.5g}", interval_text(p),
         "" if math.isnan(p.scatter_share) else f"{p.scatter_share:.0%}", remark_of(p))
        for p in found.parameters
    ]  # fmt: skip


def direction_rows(found: Calibration) -> list[tuple[str, ...]]:
    """Rows of the table of directions: singular value, and what the direction moves most."""
    keys = [p.parameter.key for p in found.parameters if p.verdict is Verdict.ESTIMATED]
    rows: list[tuple[str, ...]] = []
    for direction in found.directions:
        order = np.argsort(-np.abs(direction.vector))
        parts = [f"{direction.vector[i]:+.2f} {keys[i]}" for i in order if abs(direction.vector[i]) > _SHOWN]
        rows.append((f"{direction.singular_value:.3g}", ", ".join(parts)))
    return rows


def score_rows(found: Calibration) -> list[tuple[str, ...]]:
    """Rows of the table of errors: fitted and held out, before and after."""
    return [
        (f"{name}, {when}", str(score.segments), *figures(values))
        for name, score in (("fitted", found.fitted), ("held out", found.held_out))
        for when, values in (("before", score.before), ("after", score.after))
        if score.segments
    ]


def notes(found: Calibration) -> list[str]:
    """What the tables do not say."""
    lines = [profiles_text(found)]
    if any(p.parameter is TREND for p in found.parameters):
        lines.append(f"the neutral volume is that of {np.datetime_as_string(found.reference_time, unit='m')} UTC")
    if found.platform.buoyancy.compressibility is not None:
        lines.append(BY_DENSITY)
    for verdict, words in _HELD.items():
        if held := [p.parameter.key for p in found.parameters if p.verdict is verdict]:
            lines.append(f"{words}: {', '.join(held)}")
    lines += [
        f"WARNING: the {name} is still off by {value} {heading.partition(', ')[2]} at the profiles fitted: something "
        "that is not looked for, or further off than is plausible, such as the zero of an actuator, a sign or a unit"
        for name, heading, value, after in zip(
            QUANTITIES, SCORES[2:], figures(found.fitted.after), found.fitted.after / UNEXPLAINED, strict=True
        )
        if after > 1.0
    ]
    if not found.held_out.segments:
        lines.append("no profile was held out, so the errors after are those of the fit itself")
    return lines


def provenance(found: Calibration, observations: str, digest: str, assignments: Sequence[str]) -> str:
    """Sentences for the platform file: data, profiles, overrides, each parameter, errors before and after."""
    overrides = f" with {' '.join(f'--set {assignment}' for assignment in assignments)}" if assignments else ""
    sentences = [
        f"Calibrated by `gliderhpc calibrate` {__version__} on {observations} (sha256 {digest[:12]}){overrides}",
        *(line[0].upper() + line[1:] for line in notes(found)),
        "; ".join(_sentence(p) for p in found.parameters if p.verdict is Verdict.ESTIMATED),
        *(_score_sentence(name, score) for name, score in (("fitted", found.fitted), ("held out", found.held_out))
          if score.segments),
    ]  # fmt: skip
    return ". ".join(filter(None, sentences)) + "."


def profiles_text(found: Calibration) -> str:
    """Which profiles were used and which kept apart."""
    apart = f"; held out {_numbers(found.held_out)}" if found.held_out.segments else ""
    return f"fitted on {_numbers(found.fitted)}{apart}"


def interval_text(parameter: CalibratedParameter) -> str:
    """95 % interval, nothing where held."""
    low, high = parameter.interval
    return "" if math.isnan(low) else f"{low:.4g} to {high:.4g}"


def remark_of(parameter: CalibratedParameter) -> str:
    """What to know of a parameter, nothing where it was simply estimated."""
    if parameter.verdict is Verdict.ESTIMATED:
        return ""
    alike = f" (moves with {', '.join(parameter.alike)})" if parameter.alike else ""
    return f"{parameter.verdict.value}{alike}"


def figures(values: np.ndarray) -> list[str]:
    """The four errors in their units."""
    return ["" if math.isnan(value) else f"{value:.2f}" for value in IN_UNITS * values]


def _numbers(score: Score) -> str:
    plural = "s" if len(score.profiles) > 1 else ""
    return f"{score.segments} segments of profile{plural} {', '.join(map(str, score.profiles))}"


def _sentence(p: CalibratedParameter) -> str:
    return f"{p.parameter.key} {p.before:.5g} to {p.after:.5g} {p.parameter.unit} ({interval_text(p)})"


def _score_sentence(name: str, score: Score) -> str:
    pairs = zip(SCORES[2:], figures(score.before), figures(score.after), strict=True)
    return f"Root mean square errors, {name}: " + ", ".join(
        f"{heading} {before} before and {after} after" for heading, before, after in pairs if before
    )
