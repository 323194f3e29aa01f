"""How studies write CSV and JSON."""

import csv
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

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
