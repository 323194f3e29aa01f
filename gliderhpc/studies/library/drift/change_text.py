"""Change points in words, in the archive's group and in tables."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr

from gliderhpc.archive.reader import Archive
from gliderhpc.findings.findings import number
from gliderhpc.store_schema.columns import PHASES, change_column
from gliderhpc.studies.archived import stored_attribute
from gliderhpc.studies.library.drift.change_points import (
    AXIAL,
    PARTS,
    QUANTITIES,
    TOGETHER,
    Change,
    Changes,
    Size,
    SizeKey,
)
from gliderhpc.studies.library.drift.change_shapes import EPISODE, FORMS, RAMP
from gliderhpc.studies.library.drift.medians import DRAG, PRIMARY

_GROUP, _KIND = "drift", "change_kind"
_AND = " and "
_ENDS = ("", "_low", "_high")
_MISSING = float("nan")

_ARTICLES = {EPISODE: "an episode", RAMP: "a ramp"}

_NEARLY = 0.95
"""Ratio of a change's mean to its largest value above which the mean is not reported as well."""


def stored_changes(changes: Changes) -> dict[str, Any]:
    """Variables of the group, with one entry for each change; empty if there are none."""
    rows = [_row(one) for one in changes.found]
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
    found = [_change(group.isel(change=place)) for place in range(group.sizes["change"])]
    return Changes(tuple(one for one in found if one is not None), _MISSING if p is None else float(p))


def _row(change: Change) -> dict[str, Any]:
    sizes = {
        change_column(*key, end): getattr(change.sizes.get(key, Size(*[_MISSING] * 3)), field)
        for key in _keys()
        for end, field in zip(_ENDS, ("value", "low", "high"), strict=True)
    }
    return {
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
        **sizes,
    }


def _change(entry: xr.Dataset) -> Change | None:
    def number(name: str) -> float:
        return float(entry[name].values)

    kind = str(entry[_KIND].values)
    if not kind or not np.isfinite(number("first_profile")):
        return None
    back = number("back_profile")
    sizes = {key: Size(*(number(change_column(*key, end)) for end in _ENDS)) for key in _keys()}
    return Change(
        kind,
        form=str(entry["change_form"].values),
        phases=tuple(str(entry["change_phases"].values).split(_AND)),
        estimates=tuple(str(entry["change_estimates"].values).split(_AND)),
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


def change_lines(changes: Changes, reference: float) -> tuple[str, ...]:
    """Describe the change points of a mission, one per line; a single line if there are none.

    Parameters
    ----------
    changes : Changes
        Change points of the mission.
    reference : float
        K_D0 of the hull, kg/m.
    """
    if not changes.found:
        if changes.p != changes.p:
            return ("steps, ramps and episodes were not searched for: too few profiles, or a quick study",)
        return (f"no step, ramp or episode is shown (p {number(changes.p)})",)
    return tuple(describe_change(one, reference) for one in changes.found)


def describe_change(change: Change, reference: float) -> str:
    """Describe a change point: kind, profiles, phases, size, form, and return to the former state."""
    first, last = change.days
    when = f"day {first:.1f} to {last:.1f}" if change.kind == EPISODE else f"day {first:.1f}"
    back = (
        f"; back to the former level from profile {change.back}, day {change.back_day:.1f}"
        if change.back is not None
        else ""
    )
    sizes = "; ".join(_size_text(change, phase, reference) for phase in change.phases)
    return (
        f"{_ARTICLES.get(change.kind, f'a {change.kind}')}: {_profiles_text(change)} ({when}), {phases_text(change)}: "
        f"{sizes}; {FORMS[change.form]}{back}; {_apart(change)}by {' and '.join(change.estimates)}, "
        f"p {number(change.p)}"
    )


def kinds_text(changes: Changes) -> str:
    """Name the change points briefly, for the beginning of the verdict; empty if there are none."""
    named = "; ".join(
        f"{_ARTICLES.get(one.kind, f'a {one.kind}')} ({_profiles_text(one)}, {phases_text(one)})"
        for one in changes.found
    )
    return f"{named}; in addition, " if named else ""


def _profiles_text(change: Change) -> str:
    if change.kind == EPISODE:
        return f"profiles {change.first} to {change.last}"
    return f"from profile {change.first} on"


def phases_text(change: Change) -> str:
    """Return the phases that changed: ``dives``, ``climbs`` or both."""
    return " and ".join(f"{phase}s" for phase in change.phases)


def change_rows(changes: Changes, reference: float) -> list[dict[str, Any]]:
    """Rows of the table of change points, one for each change and part of a profile; sizes in kg/m, percent and N."""
    return [
        {
            "kind": one.kind,
            "form": FORMS[one.form],
            "phases": phases_text(one),
            "first_profile": one.first,
            "last_profile": one.last,
            "back_profile": one.back,
            "first_day": one.days[0],
            "last_day": one.days[1],
            "back_day": one.back_day,
            "p": one.p,
            "estimates": " and ".join(one.estimates),
            "part": part,
            **_of_part(one, part, reference),
        }
        for one in changes.found
        for part in (*PHASES, TOGETHER)
    ]


def changes_as_json(changes: Changes, reference: float) -> dict[str, Any]:
    """Return the change points as plain values."""
    return {"p_of_next": changes.p, "found": change_rows(changes, reference)}


def _of_part(change: Change, part: str, reference: float) -> dict[str, float]:
    drag, axial = change.size(DRAG, part), change.size(AXIAL, part)
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


def _size_text(change: Change, phase: str, reference: float) -> str:
    drag, axial = change.size(DRAG, phase), change.size(AXIAL, phase)
    low, high = (100.0 * end / reference for end in (drag.low, drag.high))
    name = f"{phase}s, drag" if len(change.phases) > 1 else "drag"
    mean = f", {100.0 * drag.value * change.mean / reference:+.0f} % on average" if change.mean < _NEARLY else ""
    return (
        f"{name} {100.0 * drag.value / reference:+.0f} % at its maximum (95 % interval {low:+.0f} to {high:+.0f} "
        f"%){mean}, axial force {axial.value:+.2g} N"
    )


def _apart(change: Change) -> str:
    """Return a remark if dive and climb change in opposite directions, which a change of drag cannot explain."""
    signs = [change.size(DRAG, phase).value > 0.0 for phase in change.phases]
    if len(set(signs)) < len(PHASES):
        return ""
    return "opposite on dive and climb, as for a change of weight in water or of the pitch sensor's offset; "


def shaded(changes: Sequence[Change], end: float) -> list[tuple[float, float, str]]:
    """Return first day, last day and name of every change, for a figure that ends on a given day."""
    return [
        (one.days[0], one.days[1] if one.kind == EPISODE else end, f"{one.kind}, {phases_text(one)}") for one in changes
    ]
