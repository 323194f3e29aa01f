"""Change points of drag, axial force and moments in words."""

from collections.abc import Callable, Sequence

from gliderhpc.findings.formatting import number
from gliderhpc.studies.library.drift.change_search import Size
from gliderhpc.studies.library.drift.changes import AXIAL, MOMENTS, Change, Changes
from gliderhpc.studies.library.drift.medians import DRAG
from gliderhpc.studies.library.drift.shape_fits import EPISODE, FORMS, RAMP
from gliderhpc.vocabulary import PHASES

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
            f"no step, ramp or episode of {searched} is reported: too few profiles, a quick study, or none that is "
            "large enough"
        )
    strongest = f"; the most probable is {changes.next}" if changes.next else ""
    return f"no step, ramp or episode of {searched} was detected (p {number(changes.p)}){strongest}"


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
    return "; ".join(describe_briefly(change, name_of) for change in changes.found)


def describe_briefly(change: Change, name_of: Callable[[Change], str]) -> str:
    """Describe a change by its kind, quantity, profiles and phases."""
    return f"{with_article(change)} of the {name_of(change)} ({_profiles_text(change)}, {phases_text(change)})"


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

ALL_MOMENTS = "a lost or bent wing or fin, or damage to the hull"
"""Further possible causes where rolling, pitching and yawing moment change at the same profile."""

SEARCHED_MOMENTS = "rolling, pitching or yawing moment"


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
        f"{largest / per_degree:.1f} degrees{also}; compatible with {MOMENT_MEANINGS[lead]}{_further_causes(change)}",
    )


def _further_causes(change: Change) -> str:
    """Return the causes that change all three moments at once; empty where only one or two change."""
    if not set(change.moments) >= set(MOMENTS):
        return ""
    return f"; since all three moments change at the same profile, also with {ALL_MOMENTS}"


def _moment_sizes_text(change: Change, name: str) -> str:
    sizes = {phase: change.size(name, phase) for phase in PHASES if change.size(name, phase).excludes_zero}
    return ", ".join(
        f"{size.value:+.2g} N m on {phase}s (95 % interval {size.low:+.2g} to {size.high:+.2g})"
        for phase, size in sizes.items()
    )


def moment_name(change: Change) -> str:
    """Return the name of the moment that changes most."""
    return MOMENT_NAMES[change.moments[0]]
