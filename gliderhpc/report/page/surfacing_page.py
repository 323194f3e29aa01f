"""Page of a surfacing, with current, next surfacing, anomalies, hull and trim on the first screen."""

from pathlib import Path

from gliderhpc.findings.formatting import polar, signed, with_deviation
from gliderhpc.report.page.content import Block, Facts, Notice, Page, PageSection, Paragraph, Remarks
from gliderhpc.report.page.rendering import ReportFiles, write_page
from gliderhpc.surfacing.message import Current, Ellipse, SurfacingMessage
from gliderhpc.surfacing.recent_hull import joint_sentence
from gliderhpc.wording import counted

_DETERMINED = 0.7
"""Standard deviation, in plausible deviations, below which one dive determines an error of the hull."""

_LISTED = 5


def write_surfacing_page(message: SurfacingMessage, folder: Path, name: str) -> ReportFiles:
    """Write a message as one self-contained HTML page.

    Parameters
    ----------
    message : SurfacingMessage
        The message.
    folder : Path
        Output folder.
    name : str
        Name of the file; an existing one is replaced.

    Raises
    ------
    InputError
        The folder cannot be written.
    """
    return write_page(surfacing_page(message), folder, name, f"dive that began {message.start_time}")


def surfacing_page(message: SurfacingMessage) -> Page:
    """Assemble the page of a message."""
    depth = "" if message.max_depth is None else f", to {message.max_depth:.0f} m"
    subtitle = f"{message.platform} · {message.start_time} · {message.duration / 60.0:.0f} min{depth}"
    if message.revision:
        subtitle += f" · revision {message.revision}"
    sections = [
        PageSection("now", "Now", (Facts({**dive_facts(message), "inversion": _inversion(message)}),)),
        PageSection("odd", "Anomalies", _anomalies(message)),
        PageSection("hull", "Hull and trim", (*hull_blocks(message), *_hull_alone(message))),
    ]
    return Page(f"{message.mission or 'mission'} · dive {message.profile}", subtitle, tuple(sections))


def dive_facts(message: SurfacingMessage) -> dict[str, str]:
    """Return current, next surfacing and motion through the water, by name."""
    return {
        "current": current_text(message.current),
        "next surfacing": _next_surfacing(message),
        "through the water": _water(message),
    }


def hull_blocks(message: SurfacingMessage) -> tuple[Block, ...]:
    """Return changes of the hull, and the differences from the platform file that a pilot can change or correct."""
    warning = (Notice(message.hull_warning, "warning"),) if message.hull_warning else ()
    return (*warning, *_hull_changes(message), *_trim(message))


def _ellipse(ellipse: Ellipse, digits: int, unit: str) -> str:
    return (
        f"{ellipse.probability:.0%} ellipse {ellipse.major:.{digits}f} by {ellipse.minor:.{digits}f} {unit}, "
        f"longer towards {ellipse.direction:03.0f}°"
    )


def current_text(current: Current | None) -> str:
    """Return a current with its error ellipse as text."""
    if current is None:
        return "unknown"
    components = f"north {signed(current.north)}, east {signed(current.east)} m/s"
    return f"{polar(current.north, current.east)}; {components}; {_ellipse(current.ellipse, 3, 'm/s')}"


def _next_surfacing(message: SurfacingMessage) -> str:
    following = message.next_surfacing
    if following is None:
        return "unknown"
    position = f"{following.latitude:.4f}, {following.longitude:.4f} at {following.time}"
    predicted = polar(following.current_north, following.current_east)
    dive = f"a dive as planned ({following.plan})" if following.plan else "a dive like those before"
    return (
        f"{position}, after {dive}; {_ellipse(following.ellipse, 0, 'm')}; current until then {predicted} "
        f"({counted(following.dives, 'dive')})"
    )


def _water(message: SurfacingMessage) -> str:
    water = message.water
    if water is None:
        return "unknown"
    error = "" if water.horizontal_speed_std is None else f" ± {water.horizontal_speed_std:.3f}"
    return f"{water.speed:.3f} m/s along the path, {water.horizontal_speed:.3f}{error} m/s horizontally"


def _inversion(message: SurfacingMessage) -> str:
    inversion = message.inversion
    if inversion.status != "done" or inversion.converged_fraction is None:
        return f"{inversion.status}: {inversion.message}"
    return f"{inversion.converged_fraction:.0%} of {counted(inversion.windows, 'window')} converged"


def _anomalies(message: SurfacingMessage) -> tuple[Block, ...]:
    changes = tuple(f"changed since revision {message.revision - 1}: {change}" for change in message.changes)
    remarks = (*message.odd, *changes)
    return (Remarks(remarks, "Anomalies in this dive"),) if remarks else (Paragraph("None."),)


def _hull_changes(message: SurfacingMessage) -> tuple[Block, ...]:
    if not message.hull_changes:
        return (
            Paragraph("Changes of the hull: not known yet; at least four dives with information on it are needed."),
        )
    rows = {
        change.meaning: f"changed with probability {change.probability:.2f}; if so, since dive {change.since} by "
        f"{change.size_text}"
        + (", and the next dive must confirm it" if change.is_shown_only_by(message.profile) else "")
        for change in message.hull_changes
    }
    joint = message.hull_joint_change
    if joint is not None:
        subject, _, text = joint_sentence(joint, named=message.names_a_change, last=message.profile).partition(": ")
        rows = {subject: text} | rows
    return Paragraph(f"Changes of the hull over the last {counted(message.hull_changes[0].dives, 'dive')}."), Facts(
        rows
    )


def _trim(message: SurfacingMessage) -> tuple[Block, ...]:
    if not message.trim:
        return ()
    rows = {
        quantity.quantity: f"{with_deviation(quantity.difference, quantity.difference_std)} {quantity.unit}"
        for quantity in message.trim
    }
    return (Facts(rows),)


def _hull_alone(message: SurfacingMessage) -> tuple[Block, ...]:
    known = [part for part in message.hull if part.error_std < _DETERMINED]
    if not known:
        return (Paragraph("Not determined from this dive alone."),)
    known.sort(key=lambda part: -abs(part.error) / part.error_std)
    rows = {part.parameter: f"{signed(part.error, '.2f')} ± {part.error_std:.2f}" for part in known[:_LISTED]}
    caption = "Errors of the platform file from this dive alone, in plausible deviations; the most significant first."
    return Paragraph(caption), Facts(rows)
