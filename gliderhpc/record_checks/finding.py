"""Findings of the checks of the records, and the settings of their thresholds."""

import math
from dataclasses import dataclass
from enum import Enum
from typing import Any

from pydantic import Field

from gliderhpc.estimation.settings import Settings

HEADINGS = ("check", "quantity", "unit", "size", "standard error", "threshold", "verdict", "suggestion", "remark")
"""Headings of the table of findings."""


class CheckSettings(Settings):
    """Settings of the checks of the records."""

    profiles: int = Field(48, ge=1, description="number of profiles examined, spread over the mission")
    lag_profiles: int = Field(12, ge=1, description="number of these profiles used to estimate the lag")
    level: float = Field(0.01, gt=0, lt=1, description="rate of false alarms of a check")
    timing_error: float = Field(
        0.5, ge=0, description="error of the actuators' recorded times, s; at least a quarter of a sample interval"
    )
    least_pitch: float = Field(0.5, ge=0, description="smaller offsets of the pitch are not reported, degree")
    least_deviation: float = Field(2.0, ge=0, description="smaller errors of the compass are not reported, degree")
    plausible_deviation: float = Field(
        20.0, gt=0, description="prior standard deviation of the errors of the compass, degree"
    )
    least_pitch_scale: float = Field(
        0.05, ge=0, description="smaller departures of the pitch's scale from one are not reported"
    )
    coefficient_error: float = Field(0.3, gt=0, description="relative error of the hull's drag and lift coefficients")
    drag_difference: float = Field(
        0.05, gt=0, description="relative error of the drag, of opposite sign in dives and in climbs"
    )


class CheckVerdict(Enum):
    """Outcome of a check."""

    NOTHING = "nothing found"
    FOUND = "found"
    UNDETERMINED = "not determined"


@dataclass(frozen=True)
class Finding:
    """One quantity of one check.

    Attributes
    ----------
    check, quantity, unit : str
        Name of the check, the quantity checked and its unit.
    size, error : float
        Estimate and standard error, in the unit; NaN where not determined.
    threshold : float
        Size above which an error is reported as found.
    verdict : CheckVerdict
        Outcome.
    suggestion : str
        Correction, a setting in backquotes if one makes it; empty where there is nothing to correct.
    remark : str
        Basis of the estimate, or the reason why it is not determined.
    """

    check: str
    quantity: str
    unit: str
    size: float
    error: float
    threshold: float
    verdict: CheckVerdict
    suggestion: str = ""
    remark: str = ""

    @property
    def found(self) -> bool:
        """Return whether the size lies beyond its threshold."""
        return self.verdict is CheckVerdict.FOUND

    @property
    def line(self) -> str:
        """One line for a log."""
        text = f"records: {self.quantity} {self.size:+.3g} {self.unit}, standard error {self.error:.2g}"
        return f"{text}; {self.suggestion}" if self.suggestion else text

    @property
    def cells(self) -> tuple[str, ...]:
        """Row of the table of findings, by `HEADINGS`, with a suggestion only if an error is found."""
        figures = (f"{self.size:+.3g}", f"{self.error:.2g}", f"{self.threshold:.2g}")
        return (
            self.check,
            self.quantity,
            self.unit,
            *(figures if math.isfinite(self.size) else ("", "", "")),
            self.verdict.value,
            self.suggestion if self.found else "",
            self.remark,
        )

    def as_json(self) -> dict[str, Any]:
        """Return plain values for JSON, None where undetermined, with a suggestion only if an error is found."""
        return {
            "check": self.check,
            "quantity": self.quantity,
            "unit": self.unit,
            "size": _finite_or_none(self.size),
            "standard_error": _finite_or_none(self.error),
            "threshold": _finite_or_none(self.threshold),
            "verdict": self.verdict.value,
            "suggestion": self.suggestion if self.found else "",
            "remark": self.remark,
        }


def _finite_or_none(value: float) -> float | None:
    return value if math.isfinite(value) else None


class UndeterminedError(Exception):
    """Reason why these records cannot decide a check."""


def undetermined(check: str, quantity: str, unit: str, why: str) -> Finding:
    """Return the finding of a check that these records cannot decide."""
    nan = float("nan")
    return Finding(check, quantity, unit, nan, nan, nan, CheckVerdict.UNDETERMINED, remark=why)


def judge_size(size: float, threshold: float) -> CheckVerdict:
    """Judge an estimate by its threshold."""
    return CheckVerdict.FOUND if abs(size) > threshold else CheckVerdict.NOTHING


def undetermined_if_insensitive(finding: Finding, plausible: float, remedy: str) -> Finding:
    """Return the finding, or "not determined" if an error of plausible size, in its unit, could have been missed."""
    if finding.verdict is not CheckVerdict.NOTHING or finding.threshold <= plausible:
        return finding
    unit = "" if finding.unit == "1" else f" {finding.unit}"
    why = (
        f"{finding.size:+.2g} ± {finding.error:.2g}{unit}, threshold {finding.threshold:.2g}: an error of "
        f"{plausible:.2g}{unit} would not be found; {remedy}"
    )
    return undetermined(finding.check, finding.quantity, finding.unit, why)
