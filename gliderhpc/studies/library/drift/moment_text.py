"""Change points of the moments in words, in the archive's group and in tables."""

from typing import Any

from gliderhpc.archive.profile import ADJOINT
from gliderhpc.archive.reader import Archive
from gliderhpc.store_schema.columns import MOMENT_CHANGE, PHASES, moment_column
from gliderhpc.studies.library.drift.change_points import MOMENTS, Change, Changes
from gliderhpc.studies.library.drift.change_text import (
    course_row,
    describe_course,
    no_change_text,
    read_change,
    size_ends,
    stored_course,
)

NAMES = {"B_cp": "rolling moment", "B_cq": "pitching moment", "B_cr": "yawing moment"}

MEANINGS = {
    "B_cp": "an asymmetry of the hull, a lost wing, or a battery or payload that has shifted sideways",
    "B_cq": "a battery or payload that has shifted along the hull, ballast not as recorded, or growth or a lost part "
    "at nose or tail",
    "B_cr": "an asymmetry of the hull, a lost wing, or a bent fin or rudder",
}
"""Possible causes of a change, by the moment that changes most."""

SEARCHED_MOMENTS = "rolling, pitching or yawing moment"

_GROUP, _PREFIX = "drift", "moment_"


def stored_moment_changes(changes: Changes) -> dict[str, Any]:
    """Variables of the group, with one entry for each change of the moments; empty if there are none."""
    rows = [_row(change) for change in changes.found]
    return {name: [row[name] for row in rows] for name in rows[0]} if rows else {}


def read_moment_changes(archive: Archive) -> Changes:
    """Read the changes of the moments stored in an archive's group; none if an earlier version made the study."""
    p, group = archive[_GROUP].attrs.get("p_of_next_moment_change"), archive[_GROUP].to_dataset()
    columns = {(name, phase, ADJOINT): moment_column(name, phase) for name in MOMENTS for phase in PHASES}
    if not {f"{_PREFIX}change_kind", *columns.values()} <= set(group):
        return Changes()
    entries = [group.isel({MOMENT_CHANGE: place}) for place in range(group.sizes[MOMENT_CHANGE])]
    found = [read_change(entry, columns, _PREFIX) for entry in entries]
    return Changes(tuple(change for change in found if change is not None), float("nan") if p is None else float(p))


def _row(change: Change) -> dict[str, Any]:
    sizes = {
        moment_column(name, phase, end): value
        for name in MOMENTS
        for phase in PHASES
        for end, value in size_ends(change.size(name, phase)).items()
    }
    return stored_course(change, _PREFIX) | sizes


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
    return tuple(_describe(change, per_degree) for change in changes.found)


def _describe(change: Change, per_degree: float) -> str:
    lead, *others = change.moments
    largest = max(abs(change.size(lead, phase).value) for phase in change.phases)
    also = "".join(f"; also the {NAMES[name]}: {_sizes_text(change, name)}" for name in others)
    return describe_course(
        change,
        f"{NAMES[lead]}: {_sizes_text(change, lead)}, enough to tilt the hull by {largest / per_degree:.1f} degrees"
        f"{also}; compatible with {MEANINGS[lead]}",
    )


def _sizes_text(change: Change, name: str) -> str:
    sizes = {phase: change.size(name, phase) for phase in PHASES if change.size(name, phase).excludes_zero}
    return ", ".join(
        f"{size.value:+.2g} N m on {phase}s (95 % interval {size.low:+.2g} to {size.high:+.2g})"
        for phase, size in sizes.items()
    )


def moment_name(change: Change) -> str:
    """Return the name of the moment that changes most."""
    return NAMES[change.moments[0]]


def moment_rows(changes: Changes) -> list[dict[str, Any]]:
    """Rows of the table of changes of the moments, one for each change, moment and phase; sizes in N m."""
    return [
        {
            **course_row(change),
            "moment": NAMES[name],
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
