"""The twin experiment of the windows, which is of no mission, from the files that it left."""

import csv
import json
from contextlib import suppress
from pathlib import Path
from typing import Any

from gliderhpc.errors import InputError
from gliderhpc.findings.comparison import comparison_from_json
from gliderhpc.report.page.content import Block, Commands, Grid, Notice, Picture, Section, Words
from gliderhpc.report.page.studies import comparison_grid

NAME = "windows"
TITLE = "Length of the windows, on twin experiments"

_WHAT = (
    "Simulated dives whose disturbance is known, inverted with windows of several lengths, margins and tolerances, "
    "sliding and not (Figure 5 of the publication). It is of no mission, and says how the windows were chosen."
)
_CAPTION = (
    "(a) and (b): the identified yaw moment beside the truth, windows sliding and not. (c): errors against the "
    "truth, cost and what shows at the seams, over the length of the windows; (d) to (f): over other settings. Marks "
    "are medians over the twins; how many there were is in the table."
)


def windows_section(twins: Path | None, platform: str) -> Section:
    """The twin experiment that a folder holds, or the command that makes it."""
    if twins is None:
        command = f"gliderhpc twin windows --platform {platform} --out twins"
        how = "These were not given with --twins. This makes them, for `gliderhpc report ... --twins twins`:"
        return Section(NAME, TITLE, (Words(_WHAT), Commands(how, (command,))))
    content, rows = _read(twins)
    blocks: list[Block] = [Words(_WHAT)]
    if content.get("quick"):
        blocks.append(Notice("a quick study: few twins and settings, for a first look and not for a result"))
    hulls, seeds = ", ".join(content["platforms"]), len(content["seeds"])
    caption = f"{hulls}, {seeds} twins a setting. {_CAPTION}"
    shown = "Yaw moment by sliding and by separate windows beside the truth, and scores over the windows' length."
    blocks.append(Picture("windows_windows", caption, shown, twins / f"{NAME}.png"))
    blocks += [
        comparison_grid(f"windows_comparison_{index}", [comparison_from_json(row) for row in table], f"{title}. ")
        for index, (title, table) in enumerate(content["comparisons"].items()) if table
    ]  # fmt: skip
    blocks.append(Grid("windows_runs", "Every twin that was inverted.", rows, shown=12))
    return Section(NAME, TITLE, tuple(blocks))


def _read(twins: Path) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """What ``twin windows`` left in a folder: the content of its JSON, and the rows of its CSV.

    Raises
    ------
    InputError
        The folder does not hold it.
    """
    try:
        content: dict[str, Any] = json.loads((twins / f"{NAME}.json").read_text("utf-8"))
        with (twins / f"{NAME}.csv").open(encoding="utf-8", newline="") as file:
            rows = [{name: _number_or_text(text) for name, text in row.items()} for row in csv.DictReader(file)]
        (twins / f"{NAME}.png").stat()
    except OSError as error:
        raise InputError(
            f"{error.filename}: cannot be read ({error.strerror}); give the folder that `gliderhpc twin windows` left"
        ) from None
    except (json.JSONDecodeError, UnicodeDecodeError):
        raise InputError(f"{twins / NAME}.json: not what `gliderhpc twin windows` left; run it again") from None
    return content, rows


def _number_or_text(text: str) -> Any:
    for kind in (int, float):
        with suppress(ValueError):
            return kind(text)
    return text or None
