"""Change points of drag, axial force and moments as rows of the archive's group and of tables."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import xarray as xr

from gliderhpc.archive.profile import ADJOINT
from gliderhpc.archive.reader import Archive
from gliderhpc.store_schema.columns import MOMENT_CHANGE, change_column, moment_column
from gliderhpc.studies.archived import stored_attribute
from gliderhpc.studies.library.drift.change_search import PARTS, TOGETHER, Size, SizeKey
from gliderhpc.studies.library.drift.change_text import MOMENT_NAMES, drag_name, phases_text
from gliderhpc.studies.library.drift.changes import AXIAL, MISSING, MOMENTS, QUANTITIES, Change, Changes
from gliderhpc.studies.library.drift.medians import DRAG, PRIMARY
from gliderhpc.studies.library.drift.shape_fits import FORMS
from gliderhpc.vocabulary import PHASES

_AND = " and "
_GROUP, _KIND = "drift", "change_kind"
_ENDS = ("", "_low", "_high")
_MISSING = float("nan")
_MOMENT_PREFIX = "moment_"


def stored_changes(changes: Changes) -> dict[str, Any]:
    """Variables of the group, with one entry for each change; empty if there are none."""
    rows = [_row(change) for change in changes.found]
    return {name: [row[name] for row in rows] for name in rows[0]} if rows else {}


def read_changes(archive: Archive) -> Changes:
    """Read the change points stored in an archive's group.

    Raises
    ------
    InputError
        The study was written by a version of this program that did not search for change points.
    """
    p = stored_attribute(archive, _GROUP, "p_of_next_change")
    group = archive[_GROUP].to_dataset()
    changes = [_change(group.isel(change=index)) for index in range(group.sizes["change"])]
    return _as_read(changes, p, archive[_GROUP].attrs.get("next_change", ""))


def _as_read(changes: Iterable[Change | None], p: Any, following: str) -> Changes:
    """Return stored changes without missing ones; without a stored probability of the next one it is NaN."""
    found = tuple(change for change in changes if change is not None)
    return Changes(found, _MISSING if p is None else float(p), following)


def _row(change: Change) -> dict[str, Any]:
    sizes = {
        change_column(*key, end): value
        for key in _keys()
        for end, value in size_ends(change.sizes.get(key, MISSING)).items()
    }
    return stored_course(change) | sizes


def size_ends(size: Size) -> dict[str, float]:
    """Return value and ends of an interval by the ending of their column."""
    return dict(zip(_ENDS, (size.value, size.low, size.high), strict=True))


def stored_course(change: Change, prefix: str = "") -> dict[str, Any]:
    """Variables of a change other than its sizes; names begin with a prefix."""
    values = {
        _KIND: change.kind,
        "change_form": change.form,
        "change_phases": _AND.join(change.phases),
        "change_estimates": _AND.join(change.estimates),
        "first_profile": float(change.first),
        "last_profile": float(change.last),
        "back_profile": _MISSING if change.back is None else float(change.back),
        "first_day": change.days[0],
        "last_day": change.days[1],
        "back_day": change.back_day,
        "change_p": change.p,
        "change_mean": change.mean,
    }
    return {f"{prefix}{name}": value for name, value in values.items()}


def _change(entry: xr.Dataset) -> Change | None:
    return read_change(entry, {key: change_column(*key) for key in _keys()})


def read_change(entry: xr.Dataset, columns: Mapping[SizeKey, str], prefix: str = "") -> Change | None:
    """Read a change whose sizes are in given columns, with names that begin with a prefix; None if it is missing."""

    def number(name: str) -> float:
        return float(entry[f"{prefix}{name}"].values)

    def text(name: str) -> str:
        return str(entry[f"{prefix}{name}"].values)

    if not text(_KIND) or not np.isfinite(number("first_profile")):
        return None
    back = number("back_profile")
    sizes = {key: Size(*(float(entry[f"{name}{end}"].values) for end in _ENDS)) for key, name in columns.items()}
    return Change(
        text(_KIND),
        form=text("change_form"),
        phases=tuple(text("change_phases").split(_AND)),
        estimates=tuple(text("change_estimates").split(_AND)),
        first=int(number("first_profile")),
        last=int(number("last_profile")),
        back=int(back) if np.isfinite(back) else None,
        days=(number("first_day"), number("last_day")),
        back_day=number("back_day"),
        p=number("change_p"),
        mean=number("change_mean"),
        sizes={key: size for key, size in sizes.items() if np.isfinite(size.value)},
    )


def _keys() -> list[SizeKey]:
    return [(quantity, part, estimate) for quantity in QUANTITIES for part in PARTS for estimate in PRIMARY]


def course_row(change: Change) -> dict[str, Any]:
    """Return the columns that all tables of changes have: kind, form, phases, profiles, days, p and estimates."""
    return {
        "kind": change.kind,
        "form": FORMS[change.form],
        "phases": phases_text(change),
        "first_profile": change.first,
        "last_profile": change.last,
        "back_profile": change.back,
        "first_day": change.days[0],
        "last_day": change.days[1],
        "back_day": change.back_day,
        "p": change.p,
        "estimates": " and ".join(change.estimates),
    }


def change_rows(changes: Changes, reference: float) -> list[dict[str, Any]]:
    """Rows of the table of change points, one for each change and part of a profile; sizes in kg/m, percent and N."""
    return [
        {
            **course_row(change),
            "quantity": drag_name(change),
            "part": part,
            **_of_part(change, part, reference),
        }
        for change in changes.found
        for part in (*PHASES, TOGETHER)
    ]


def changes_as_json(changes: Changes, reference: float) -> dict[str, Any]:
    """Return the change points as plain values."""
    return {"p_of_next": changes.p, "next": changes.next, "found": change_rows(changes, reference)}


def _of_part(change: Change, part: str, reference: float) -> dict[str, float]:
    """Sizes of a part; that of both legs together contains the hull's part if both show the drag's change."""
    axial = change.size(AXIAL, part)
    drag = change.drag if part == TOGETHER and change.is_drag else change.size(DRAG, part)
    return {
        "K_D0_change": drag.value,
        "K_D0_change_low": drag.low,
        "K_D0_change_high": drag.high,
        "K_D0_change_percent": 100.0 * drag.value / reference,
        "K_D0_mean_percent": 100.0 * drag.value * change.mean / reference,
        "B_cu_change": axial.value,
        "B_cu_change_low": axial.low,
        "B_cu_change_high": axial.high,
    }


def stored_moment_changes(changes: Changes) -> dict[str, Any]:
    """Variables of the group, with one entry for each change of the moments; empty if there are none."""
    rows = [_moment_row(change) for change in changes.found]
    return {name: [row[name] for row in rows] for name in rows[0]} if rows else {}


def read_moment_changes(archive: Archive) -> Changes:
    """Read the changes of the moments stored in an archive's group; none if an earlier version made the study."""
    p, group = archive[_GROUP].attrs.get("p_of_next_moment_change"), archive[_GROUP].to_dataset()
    columns = {(name, phase, ADJOINT): moment_column(name, phase) for name in MOMENTS for phase in PHASES}
    if not {f"{_MOMENT_PREFIX}change_kind", *columns.values()} <= set(group):
        return Changes()
    entries = [group.isel({MOMENT_CHANGE: index}) for index in range(group.sizes[MOMENT_CHANGE])]
    changes = [read_change(entry, columns, _MOMENT_PREFIX) for entry in entries]
    return _as_read(changes, p, archive[_GROUP].attrs.get("next_moment_change", ""))


def _moment_row(change: Change) -> dict[str, Any]:
    sizes = {
        moment_column(name, phase, end): value
        for name in MOMENTS
        for phase in PHASES
        for end, value in size_ends(change.size(name, phase)).items()
    }
    return stored_course(change, _MOMENT_PREFIX) | sizes


def moment_rows(changes: Changes) -> list[dict[str, Any]]:
    """Rows of the table of changes of the moments, one for each change, moment and phase; sizes in N m."""
    return [
        {
            **course_row(change),
            "moment": MOMENT_NAMES[name],
            "channel": name,
            "phase": phase,
            **{f"change{end}": value for end, value in size_ends(change.size(name, phase)).items()},
        }
        for change in changes.found
        for name in MOMENTS
        for phase in PHASES
    ]


def moments_as_json(changes: Changes) -> dict[str, Any]:
    """Return the changes of the moments as plain values."""
    return {"p_of_next": changes.p, "next": changes.next, "found": moment_rows(changes)}
