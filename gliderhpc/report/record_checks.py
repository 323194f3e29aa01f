"""Results of the record checks: table of the findings, and plain values."""

import math
from typing import Any

from gliderhpc.record_checks import Finding, Inspection

HEADINGS = ("check", "quantity", "unit", "size", "standard error", "threshold", "verdict", "suggestion", "remark")
"""Headings of the table of findings."""


def finding_row(finding: Finding) -> tuple[str, ...]:
    """Return a row of the table of findings, with a suggestion only for a positive finding."""
    figures = (f"{finding.size:+.3g}", f"{finding.error:.2g}", f"{finding.threshold:.2g}")
    return (
        finding.check,
        finding.quantity,
        finding.unit,
        *(figures if math.isfinite(finding.size) else ("", "", "")),
        finding.verdict.value,
        _suggestion(finding),
        finding.remark,
    )


def content(inspection: Inspection) -> dict[str, Any]:
    """Return the findings as plain values for JSON, None where undetermined."""
    return {
        "profiles": list(inspection.profiles),
        "findings": [
            {
                "check": finding.check,
                "quantity": finding.quantity,
                "unit": finding.unit,
                "size": _plain(finding.size),
                "standard_error": _plain(finding.error),
                "threshold": _plain(finding.threshold),
                "verdict": finding.verdict.value,
                "suggestion": _suggestion(finding),
                "remark": finding.remark,
            }
            for finding in inspection.findings
        ],
    }


def _suggestion(finding: Finding) -> str:
    return finding.suggestion if finding.found else ""


def _plain(value: float) -> float | None:
    return value if math.isfinite(value) else None
