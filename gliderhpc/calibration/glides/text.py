"""Results of a calibration as text: tables for terminal and pages, and provenance in the platform file."""

import math
from collections.abc import Sequence

import numpy as np

from gliderhpc.calibration.glides.fit import CalibratedParameter, GlideCalibration
from gliderhpc.calibration.glides.score import Score
from gliderhpc.calibration.glides.search import FIRST_SCALES, CalibrationVerdict
from gliderhpc.calibration.glides.segment_errors import LATERAL
from gliderhpc.estimation.steady_balance import QUANTITIES
from gliderhpc.flight.buoyancy import REFERENCE_TEMPERATURE
from gliderhpc.flight.hull_parameters import TREND
from gliderhpc.version import __version__
from gliderhpc.wording import capitalised, counted

PARAMETERS = ("parameter", "unit", "before", "after", "95 % interval", "scatter", "remark")
DIRECTIONS = ("singular value", "main parameters")
SCORES = ("profiles", "segments", "depth rate, cm/s", "pitch, degree", "roll, degree", "turn rate, degree/s")
"""Headings of the tables."""

IN_UNITS = np.array([100.0, *[180.0 / math.pi] * 3])
"""Factors from SI to the units of the scores."""

UNEXPLAINED = 2.0 * np.array(FIRST_SCALES)
"""Errors (SI) that a calibrated hull should not exceed."""

WRONG_VEHICLE_ERROR = 45.0
"""Error of the pitch before the calibration, degree, beyond which the platform's name is to be checked; the shipped
hulls miss the pitch of real missions by 18 to 34 degrees, and platforms with all plausible errors by up to 110."""

BY_DENSITY = (
    "buoyancy is computed from measured density, so the neutral volume refers to water of the platform's density at "
    f"the surface and {REFERENCE_TEMPERATURE:g} degC"
)

_OF_TURNS = QUANTITIES[2:]
_REPORTED_GROWTH = 3.0
"""Growth of an error, from the first scale on, that is reported although the trimmed one has not grown."""
_HOLD_LATERAL = (
    "if turns matter, hold the lateral coefficients with `calibration.hold="
    f"[{','.join(key.removeprefix('viscous.') for key in LATERAL)}]`"
)

_SHOWN = 0.3
_HELD = {
    CalibrationVerdict.UNDETERMINED: "not determined by these glides, so left unchanged",
    CalibrationVerdict.REFUTED: (
        "not determined, but the glides contradict the platform's value, so held at the most probable value"
    ),
    CalibrationVerdict.IMPLAUSIBLE: "the best fit lies outside the plausible range, so held at the bound of that range",
    CalibrationVerdict.UNSTABLE: "left unchanged, because the hull has no stable glide when they are fitted",
    CalibrationVerdict.CONFOUNDED: (
        "left unchanged, because with these fitted other parameters are known less well than the platform file states"
    ),
}


def parameter_rows(calibration: GlideCalibration) -> list[tuple[str, ...]]:
    """Return the rows of the table of parameters; *scatter* is the share of the interval due to profile scatter."""
    return [
        (p.parameter.key, p.parameter.unit, f"{p.before:.5g}", f"{p.after:.5g}", interval_text(p),
         "" if math.isnan(p.scatter_share) else f"{p.scatter_share:.0%}", remark_of(p))
        for p in calibration.parameters
    ]  # fmt: skip


def direction_rows(calibration: GlideCalibration) -> list[tuple[str, ...]]:
    """Return the rows of the table of directions: singular value, and the main parameters of the direction."""
    keys = [p.parameter.key for p in calibration.parameters if p.verdict is CalibrationVerdict.ESTIMATED]
    rows: list[tuple[str, ...]] = []
    for direction in calibration.directions:
        order = np.argsort(-np.abs(direction.vector))
        parts = [f"{direction.vector[i]:+.2f} {keys[i]}" for i in order if abs(direction.vector[i]) > _SHOWN]
        rows.append((f"{direction.singular_value:.3g}", ", ".join(parts)))
    return rows


def score_rows(fitted: Score, held_out: Score) -> list[tuple[str, ...]]:
    """Return the rows of the table of errors: fitted and held out, before and after."""
    return [
        (f"{name}, {when}", str(score.segments), *figures(values))
        for name, score in (("fitted", fitted), ("held out", held_out))
        for when, values in (("before", score.before), ("after", score.after))
        if score.segments
    ]


def notes(calibration: GlideCalibration) -> list[str]:
    """Return remarks that supplement the tables, without the warnings."""
    lines = [describe_fitted_profiles(calibration)]
    if calibration.left_out:
        profiles = "; ".join(f"profile {profile.number} ({profile.reason})" for profile in calibration.left_out)
        lines.append(
            f"left out of the fit, since no single hull fits both them and the others: {profiles}; check these for "
            "rough water, a change of the hull or faulty records"
        )
    if any(p.parameter is TREND for p in calibration.parameters):
        lines.append(f"the neutral volume is that at {np.datetime_as_string(calibration.reference_time, unit='m')} UTC")
    if calibration.platform.buoyancy.compressibility is not None:
        lines.append(BY_DENSITY)
    for verdict, words in _HELD.items():
        if held := [p.parameter.key for p in calibration.parameters if p.verdict is verdict]:
            lines.append(f"{words}: {', '.join(held)}")
    return [*lines, *score_notes(calibration.fitted, calibration.held_out)]


def warnings(calibration: GlideCalibration) -> list[str]:
    """Return warnings about errors of the balance that have grown, or that remain."""
    grown = [
        f"at the profiles {selection}, the {name} is in error by {after} {heading.partition(', ')[2]}, and by "
        f"{before} with the given platform; a few segments where the hull hardly balances cause this: {_HOLD_LATERAL}"
        for selection, score in (("fitted", calibration.fitted), ("held out", calibration.held_out))
        for name, heading, before, after, times in zip(
            QUANTITIES,
            SCORES[2:],
            figures(score.before),
            figures(score.after),
            score.after / np.maximum(score.before, FIRST_SCALES),
            strict=True,
        )
        if times > _REPORTED_GROWTH and name in _OF_TURNS
    ]
    return [*grown, *score_warnings(calibration.fitted)]


def score_warnings(fitted: Score) -> list[str]:
    """Return a warning for each error of the balance that is still too large, on steady glides or on whole dives."""
    return [
        f"the {name} is still in error by {value} {heading.partition(', ')[2]} at the profiles fitted: "
        "a parameter that is not fitted is wrong, or a fitted one is wrong by more than is plausible; check the "
        "zeros of the actuators, signs and units"
        for name, heading, value, after in zip(
            QUANTITIES, SCORES[2:], figures(fitted.after), fitted.after / UNEXPLAINED, strict=True
        )
        if after > 1.0
    ]


def score_notes(fitted: Score, held_out: Score) -> list[str]:
    """Return remarks on the errors of the balance, for a fit of the steady glides or of whole dives."""
    lines = []
    missed = np.degrees(fitted.before[QUANTITIES.index("pitch")])
    if missed > WRONG_VEHICLE_ERROR:
        lines.append(
            f"before the fit the given platform misses the pitch by more than {WRONG_VEHICLE_ERROR:.0f} degree, as "
            "after a change of ballast or trim, or because it is another vehicle's; check its name, since quantities "
            "that the glides do not determine are still those of the given platform"
        )
    if not held_out.segments:
        lines.append("no profile was held out, so the errors after calibration are those of the fit itself")
    return lines


def provenance(calibration: GlideCalibration, observations: str, digest: str, assignments: Sequence[str]) -> str:
    """Describe the calibration for the platform file: data, profiles, overrides, parameters and errors."""
    sentences = [
        describe_origin("Calibrated by `gliderhpc calibrate`", observations, digest, assignments),
        *map(capitalised, (*notes(calibration), *warnings(calibration))),
        "; ".join(_sentence(p) for p in calibration.parameters if p.verdict is CalibrationVerdict.ESTIMATED),
        *(
            score_sentence(name, score)
            for name, score in (("fitted", calibration.fitted), ("held out", calibration.held_out))
            if score.segments
        ),
    ]
    return ". ".join(filter(None, sentences)) + "."


def describe_origin(command: str, observations: str, digest: str, assignments: Sequence[str]) -> str:
    """Describe the origin of an estimated hull: command, version, records with their digest, and overrides."""
    overrides = f" with {' '.join(f'--set {assignment}' for assignment in assignments)}" if assignments else ""
    return f"{command} {__version__} on {observations} (sha256 {digest[:12]}){overrides}"


def describe_fitted_profiles(calibration: GlideCalibration) -> str:
    """Describe the fitted and the held-out profiles."""
    held_out = f"; held out {_numbers(calibration.held_out)}" if calibration.held_out.segments else ""
    return f"fitted on {_numbers(calibration.fitted)}{held_out}"


def interval_text(parameter: CalibratedParameter) -> str:
    """Format the 95 % interval, empty if the parameter was held fixed."""
    low, high = parameter.interval
    return "" if math.isnan(low) else f"{low:.4g} to {high:.4g}"


def remark_of(parameter: CalibratedParameter) -> str:
    """Return the remark on a parameter, empty if it was estimated."""
    if parameter.verdict is CalibrationVerdict.ESTIMATED:
        return ""
    alike = f" (correlated with {', '.join(parameter.confounded_with)})" if parameter.confounded_with else ""
    return f"{parameter.verdict.value}{alike}"


def figures(values: np.ndarray) -> list[str]:
    """Format the four errors in their units."""
    return ["" if math.isnan(value) else f"{value:.2f}" for value in IN_UNITS * values]


def _numbers(score: Score) -> str:
    plural = "s" if len(score.profiles) > 1 else ""
    return f"{counted(score.segments, 'segment')} of profile{plural} {', '.join(map(str, score.profiles))}"


def _sentence(p: CalibratedParameter) -> str:
    return f"{p.parameter.key} {p.before:.5g} to {p.after:.5g} {p.parameter.unit} ({interval_text(p)})"


def score_sentence(name: str, score: Score) -> str:
    """Describe the errors of the balance before and after."""
    pairs = zip(SCORES[2:], figures(score.before), figures(score.after), strict=True)
    return f"Root mean square errors, {name}: " + ", ".join(
        f"{heading} {before} before and {after} after" for heading, before, after in pairs if before
    )
