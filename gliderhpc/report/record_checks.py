"""What the checks of the records found, in rows for screen and pages, and as plain values for a file."""

import math
from typing import Any

from gliderhpc.tuning.record_checks import Finding, Inspection

HEADINGS = ("check", "quantity", "unit", "size", "standard error", "threshold", "verdict", "suggestion", "remark")
"""Of the table of findings."""


def finding_row(finding: Finding) -> tuple[str, ...]:
    """Row of the table of findings; a suggestion only where something was found."""
    figures = (f"{finding.size:+.3g}", f"{finding.error:.2g}", f"{finding.threshold:.2g}")
    return (
        finding.check, finding.quantity, finding.unit,
        *(figures if math.isfinite(finding.size) else ("", "", "")),
        finding.verdict.value, _suggestion(finding), finding.remark,
    )  # fmt: skip


def content(inspection: Inspection) -> dict[str, Any]:
    """Findings as JSON holds them; what is not determined is null."""
    return {
        "profiles": list(inspection.profiles),
        "findings": [
            {
                "check": finding.check, "quantity": finding.quantity, "unit": finding.unit,
                "size": _plain(finding.size), "standard_error": _plain(finding.error),
                "threshold": _plain(finding.threshold), "verdict": finding.verdict.value,
                "suggestion": _suggestion(finding), "remark": finding.remark,
            }
            for finding in inspection.findings
        ],
    }  # fmt: skip


def _suggestion(finding: Finding) -> str:
    return finding.suggestion if finding.found else ""


def _plain(value: float) -> float | None:
    return value if math.isfinite(value) else None
