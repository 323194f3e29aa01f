"""Change points of drag, axial force and moments in words, in the archive's group and in tables."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from gliderhpc.archive.profile import ADJOINT
from gliderhpc.archive.reader import Archive
from gliderhpc.findings.findings import number
from gliderhpc.store_schema.columns import MOMENT_CHANGE, change_column, moment_column
from gliderhpc.studies.archived import stored_attribute
from gliderhpc.studies.library.drift.change_points import AXIAL, MISSING, MOMENTS, QUANTITIES, Change, Changes
from gliderhpc.studies.library.drift.change_search import PARTS, TOGETHER, Size, SizeKey
from gliderhpc.studies.library.drift.medians import DRAG, PRIMARY
from gliderhpc.studies.library.drift.shape_fits import EPISODE, FORMS, RAMP
from gliderhpc.vocabulary import PHASES

_GROUP, _KIND = "drift", "change_kind"
_AND = " and "
_ENDS = ("", "_low", "_high")
_MISSING = float("nan")

_ARTICLES = {EPISODE: "an episode", RAMP: "a ramp"}

EQUIVALENT = "equivalent drag"
"""Name of a change along the path that a change of the hull's drag does not explain."""

SEARCHED_DRAG = "drag or axial force"

_OPPOSITE = (
    "so not a change of the hull's drag: vertical motion of the water, weight in water (ballast, payload, density of "
    "the water) or the pitch sensor's offset"
)
_ONE_LEG = (
    "on one leg alone, so not a drag that dives and climbs share: ballast not as recorded on that leg, vertical motion "
    "of the water, or something that drags on that leg alone"
)

_MAX_MEAN_RATIO = 0.95
"""Ratio of a change's mean to its largest value above which the mean is not reported as well."""


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
    found = [_change(group.isel(change=place)) for place in range(group.sizes["change"])]
    return Changes(tuple(change for change in found if change is not None), _MISSING if p is None else float(p))


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
        return (no_change_text(changes, SEARCHED_DRAG),)
    return tuple(describe_change(change, reference) for change in changes.found)


def no_change_text(changes: Changes, searched: str) -> str:
    """Describe a search that found nothing, or that was not made."""
    if changes.p != changes.p:
        return (
            f"no step, ramp or episode of {searched} is named: too few profiles, a quick study, or none that is large "
            "enough"
        )
    return f"no step, ramp or episode of {searched} is shown (p {number(changes.p)})"


def describe_change(change: Change, reference: float) -> str:
    """Describe a change of drag: kind, profiles, phases, size, form, and return to the former state."""
    return describe_course(change, f"{_sizes_text(change, reference)}; {_meaning(change, reference)}")


def describe_course(change: Change, content: str) -> str:
    """Describe a change with a text on its sizes and their meaning."""
    first, last = change.days
    when = f"day {first:.1f} to {last:.1f}" if change.kind == EPISODE else f"day {first:.1f}"
    back = (
        f"; back to the former level from profile {change.back}, day {change.back_day:.1f}"
        if change.back is not None
        else ""
    )
    return (
        f"{with_article(change)}: {_profiles_text(change)} ({when}), {phases_text(change)}: {content}; "
        f"{FORMS[change.form]}{back}; by {' and '.join(change.estimates)}, p {number(change.p)}"
    )


def with_article(change: Change) -> str:
    """Return the kind of a change with its article."""
    return _ARTICLES.get(change.kind, f"a {change.kind}")


def kinds_text(changes: Changes, name_of: Callable[[Change], str]) -> str:
    """Name the change points briefly, for the beginning of the verdict; empty if there are none."""
    return "; ".join(
        f"{with_article(change)} of the {name_of(change)} ({_profiles_text(change)}, {phases_text(change)})"
        for change in changes.found
    )


def drag_name(change: Change) -> str:
    """Return ``drag`` for a change that dives and climbs share, else `EQUIVALENT`."""
    return "drag" if change.is_drag else EQUIVALENT


def _profiles_text(change: Change) -> str:
    if change.kind == EPISODE:
        return f"profiles {change.first} to {change.last}"
    return f"from profile {change.first} on"


def phases_text(change: Change) -> str:
    """Return the phases that changed: ``dives``, ``climbs`` or both."""
    return " and ".join(f"{phase}s" for phase in change.phases)


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
    return {"p_of_next": changes.p, "found": change_rows(changes, reference)}


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


def _sizes_text(change: Change, reference: float) -> str:
    """Describe the drag that dives and climbs share, or the equivalent drag of each phase that changed."""
    if not change.is_drag:
        return "; ".join(
            f"{_leg_name(change, phase)}{EQUIVALENT} {_percent(change, change.size(DRAG, phase), reference)}, axial "
            f"force {change.size(AXIAL, phase).value:+.2g} N"
            for phase in change.phases
        )
    dive, climb = (100.0 * change.size(DRAG, phase).value / reference for phase in PHASES)
    forces = [change.size(AXIAL, phase).value for phase in PHASES]
    return (
        f"drag {_percent(change, change.drag, reference)}, mean of dives ({dive:+.0f} %) and climbs ({climb:+.0f} %), "
        "whose difference, as from other errors of the hull, is contained in the interval; axial force "
        f"{forces[0]:+.2g} and {forces[1]:+.2g} N"
    )


def _leg_name(change: Change, phase: str) -> str:
    return f"{phase}s, " if len(change.phases) > 1 else ""


def _percent(change: Change, size: Size, reference: float) -> str:
    value, low, high = (100.0 * part / reference for part in (size.value, size.low, size.high))
    mean = f", {value * change.mean:+.0f} % on average" if change.mean < _MAX_MEAN_RATIO else ""
    return f"{value:+.0f} % at its maximum (95 % interval {low:+.0f} to {high:+.0f} %){mean}"


def _meaning(change: Change, reference: float) -> str:
    """Describe possible causes of a change, given the phases that show it."""
    if change.is_drag:
        return "the same direction on dives and climbs, as for a change of the hull's drag"
    if not change.is_opposite:
        return _ONE_LEG
    others = [phase for phase in PHASES if phase not in change.phases]
    other = "".join(f" ({phase}s {100.0 * change.size(DRAG, phase).value / reference:+.0f} %)" for phase in others)
    ballast = ", or ballast not as recorded on one leg" if others else ""
    return f"opposite on dives and climbs{other}, {_OPPOSITE}{ballast}"


def shaded(changes: Sequence[Change], end: float) -> list[tuple[float, float, str]]:
    """Return first day, last day and name of every change, for a figure that ends on a given day."""
    return [
        (change.days[0], change.days[1] if change.kind == EPISODE else end, f"{change.kind}, {phases_text(change)}")
        for change in changes
    ]


# Changes of the moments

MOMENT_NAMES = {"B_cp": "rolling moment", "B_cq": "pitching moment", "B_cr": "yawing moment"}

MOMENT_MEANINGS = {
    "B_cp": "an asymmetry of the hull, a lost wing, or a battery or payload that has shifted sideways",
    "B_cq": "a battery or payload that has shifted along the hull, ballast not as recorded, or growth or a lost part "
    "at nose or tail",
    "B_cr": "an asymmetry of the hull, a lost wing, or a bent fin or rudder",
}
"""Possible causes of a change, by the moment that changes most."""

SEARCHED_MOMENTS = "rolling, pitching or yawing moment"

_MOMENT_PREFIX = "moment_"


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
    entries = [group.isel({MOMENT_CHANGE: place}) for place in range(group.sizes[MOMENT_CHANGE])]
    found = [read_change(entry, columns, _MOMENT_PREFIX) for entry in entries]
    return Changes(tuple(change for change in found if change is not None), float("nan") if p is None else float(p))


def _moment_row(change: Change) -> dict[str, Any]:
    sizes = {
        moment_column(name, phase, end): value
        for name in MOMENTS
        for phase in PHASES
        for end, value in size_ends(change.size(name, phase)).items()
    }
    return stored_course(change, _MOMENT_PREFIX) | sizes


def moment_lines(changes: Changes, per_degree: float) -> tuple[str, ...]:
    """Describe the changes of the moments of a mission, one per line; a single line if there are none.

    Parameters
    ----------
    changes : Changes
        Change points of the moments.
    per_degree : float
        Moment that tilts the hull by one degree, N m.
    """
    if not changes.found:
        return (no_change_text(changes, SEARCHED_MOMENTS),)
    return tuple(_describe_moments(change, per_degree) for change in changes.found)


def _describe_moments(change: Change, per_degree: float) -> str:
    lead, *others = change.moments
    largest = max(abs(change.size(lead, phase).value) for phase in change.phases)
    also = "".join(f"; also the {MOMENT_NAMES[name]}: {_moment_sizes_text(change, name)}" for name in others)
    return describe_course(
        change,
        f"{MOMENT_NAMES[lead]}: {_moment_sizes_text(change, lead)}, enough to tilt the hull by "
        f"{largest / per_degree:.1f} degrees{also}; compatible with {MOMENT_MEANINGS[lead]}",
    )


def _moment_sizes_text(change: Change, name: str) -> str:
    sizes = {phase: change.size(name, phase) for phase in PHASES if change.size(name, phase).excludes_zero}
    return ", ".join(
        f"{size.value:+.2g} N m on {phase}s (95 % interval {size.low:+.2g} to {size.high:+.2g})"
        for phase, size in sizes.items()
    )


def moment_name(change: Change) -> str:
    """Return the name of the moment that changes most."""
    return MOMENT_NAMES[change.moments[0]]


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
    return {"p_of_next": changes.p, "found": moment_rows(changes)}
