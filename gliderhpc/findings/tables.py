"""Tables as CSV and Markdown, and plain values as JSON."""

import csv
import json
import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

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


Row = Mapping[str, Any]


def write_csv(path: Path, rows: Sequence[Row]) -> Path:
    """Write one line a row; the columns are all keys in order of appearance, NaN and None are left empty."""
    names = list(dict.fromkeys(name for row in rows for name in row))
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(names)
        writer.writerows([_csv_cell(row.get(name)) for name in names] for row in rows)
    return path


def write_json(path: Path, content: Mapping[str, Any]) -> Path:
    """Write a study's figures."""
    path.write_text(json.dumps(as_plain(content), indent=1, ensure_ascii=False, allow_nan=False) + "\n", "utf-8")
    return path


def as_plain(value: Any) -> Any:
    """Turn numpy's and missing values into what JSON holds: NaN and infinities become null."""
    if isinstance(value, Mapping):
        return {str(key): as_plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [as_plain(entry) for entry in value]
    if isinstance(value, np.generic):
        return as_plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def _csv_cell(value: Any) -> Any:
    if isinstance(value, float):
        return "" if math.isnan(value) else f"{value:.8g}"
    return "" if value is None else value
