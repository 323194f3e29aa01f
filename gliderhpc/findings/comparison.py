"""Comparisons with the paper: one quantity each, as a table for a terminal and as JSON."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from rich.table import Table
from rich.text import Text

from gliderhpc.findings.formatting import ABSENT, number

COLUMNS = ("quantity", "unit", "paper", "ours", "spread", "ratio", "remark")
"""Columns of the table of comparisons."""

NUMBER_COLUMNS = ("paper", "ours", "spread", "ratio")
"""Those that hold numbers."""

_OPTIONAL = ("spread", "remark")


Paper = float | tuple[float, float] | None
"""Value of the paper, its range (lower end first), or None if the paper states none."""


@dataclass(frozen=True)
class Comparison:
    """Value of one quantity in the paper and in this study.

    Attributes
    ----------
    quantity : str
        Name of the quantity.
    unit : str
        Unit of all its numbers; ``1`` for a ratio or a count.
    ours : float
        Value of this study, NaN if there is none.
    paper : float, (float, float), optional
        Value of the paper, or its range with the lower end first; None if the paper states none.
    spread : (float, float), optional
        Range of our values over the runs: quartiles, unless `remark` states otherwise.
    paper_text : str
        Text of the paper if neither a number nor a range can express it (``<= 0.24``).
    remark : str
        Note for the reader, such as the data behind our value.
    """

    quantity: str
    unit: str
    ours: float
    paper: Paper = None
    spread: tuple[float, float] | None = None
    paper_text: str = ""
    remark: str = ""

    @property
    def ratio(self) -> float | None:
        """Ratio of our value to the paper's (the nearest end of a range, 1 inside it); None if that is meaningless."""
        reference = self.paper
        if isinstance(reference, tuple):
            reference = min(max(self.ours, reference[0]), reference[1])
        if reference is None or reference == 0.0 or not math.isfinite(self.ours):
            return None
        return self.ours / reference

    @property
    def cells(self) -> tuple[str, ...]:
        """Texts of the row, in the order of `COLUMNS`."""
        paper = self.paper_text or range_text(self.paper)
        return (
            self.quantity,
            self.unit,
            paper,
            number(self.ours),
            range_text(self.spread),
            number(self.ratio),
            self.remark,
        )


def range_text(value: Paper) -> str:
    """Format a value or a range as text; a range without ends is a dash, as a missing value is."""
    if not isinstance(value, tuple):
        return number(value)
    low, high = map(number, value)
    return low if low == high == ABSENT else f"{low} to {high}"


def comparison_table(rows: Sequence[Comparison], title: str) -> Table:
    """Format comparisons as a table for a terminal, with spread and remark only if a row has one."""
    shown = [name not in _OPTIONAL or any(getattr(row, name) for row in rows) for name in COLUMNS]
    table = Table(title=Text(title), title_justify="left")
    for column in _selected(COLUMNS, shown):
        table.add_column(column, justify="right" if column in NUMBER_COLUMNS else "left", overflow="fold")
    for row in rows:
        table.add_row(*map(Text, _selected(row.cells, shown)))
    return table


def comparisons_as_json(rows: Iterable[Comparison]) -> list[dict[str, Any]]:
    """Return comparisons as plain values, including the ratio."""
    return [{**asdict(row), "ratio": row.ratio} for row in rows]


def comparison_from_json(content: Mapping[str, Any]) -> Comparison:
    """Restore a comparison from an entry of `comparisons_as_json` that was read from a JSON file."""
    values = {name: value for name, value in content.items() if name != "ratio"}
    if "paper_said" in values:  # its name in files of earlier versions
        values["paper_text"] = values.pop("paper_said")
    values["ours"] = _known(values["ours"])
    for name in ("paper", "spread"):
        if isinstance(values.get(name), list):
            values[name] = tuple(_known(end) for end in values[name])
    return Comparison(**values)


def _known(value: float | None) -> float:
    return float("nan") if value is None else value


def _selected(values: Sequence[str], shown: Sequence[bool]) -> list[str]:
    return [value for value, is_shown in zip(values, shown, strict=True) if is_shown]
