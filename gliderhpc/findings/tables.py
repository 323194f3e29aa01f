"""Numbers as text, and tables of text."""

import math
from collections.abc import Collection, Iterable, Sequence

_ABSENT = "–"


def number(value: float | None) -> str:
    """Three significant digits without an exponent where that reads well, and a dash for what is missing."""
    if value is None or not math.isfinite(value):
        return _ABSENT
    if value != 0.0 and not 1e-3 <= abs(value) < 1e5:
        return f"{value:.2e}"
    digits = 2 if value == 0.0 else max(0, 2 - math.floor(math.log10(abs(value))))
    return f"{value:.{digits}f}"


def markdown(columns: Sequence[str], rows: Iterable[Sequence[str]], of_numbers: Collection[str] = ()) -> str:
    """Lay cells out as a Markdown table, the columns `of_numbers` to the right."""
    rules = ["---:" if column in of_numbers else "---" for column in columns]
    lines = [columns, rules, *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)
