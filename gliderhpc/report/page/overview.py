"""Overview of the mission: facts, outcomes, track, depths, currents and timing."""

import re

import numpy as np

from gliderhpc.archive.mission import Summary
from gliderhpc.archive.reader import Archive
from gliderhpc.outcomes import Outcome
from gliderhpc.report.facts import facts, failure_text
from gliderhpc.report.page.content import Block, Facts, FigureBlock, Notice, PageSection, Row, Table, limited_warnings
from gliderhpc.report.page.mission_figures import map_figure, profiles_figure, timing_figure
from gliderhpc.report.page.mission_table import SHOWN, MissionTable
from gliderhpc.store_schema import STATUS
from gliderhpc.studies.library.scores import finite_median
from gliderhpc.wording import counted


def overview_section(archive: Archive, summary: Summary) -> PageSection:
    """Assemble facts, outcomes of the profiles, their positions and depths, and computing times."""
    table = MissionTable.of(archive)
    failed = [failure_text(number, text) for number, (status, text) in summary.messages.items() if status == "failed"]
    blocks = (
        Facts(_facts(summary, table)),
        *limited_warnings(failed, "profiles failed; the table gives the reasons"),
        Table(
            "outcomes",
            "Outcomes of the profiles, and of the windows of the profiles that are done.",
            [*profile_outcomes(summary), *window_outcomes(archive)],
        ),
        *_figure_blocks(table),
        Table("profiles", "Every profile of the mission, from the archive's own table.", table.rows(), shown=SHOWN),
    )
    return PageSection("overview", "Mission overview", blocks)


_FIRST = ("mission", "platform", "profiles", "from", "to", "median current")
_LAST = ("computing time", "preset", "observations")
"""Facts of the archive that the overview shows; versions and digests are at the end of the page."""


def _facts(summary: Summary, table: MissionTable) -> dict[str, str]:
    """Collect the facts of greatest interest to an operator."""
    known, done = facts(summary), table.done
    hours = float(np.nansum(table.duration[done])) / 3600.0
    flight = {"time under water": f"{hours:.1f} h in {counted(int(done.sum()), 'profile')}"}
    if done.any():
        depths = table.depth[done]
        flight["maximum depth"] = f"{np.nanmin(depths):.0f} to {np.nanmax(depths):.0f} m"
    if table.with_current.any():
        speed = np.hypot(*table.current)
        flight["current speed"] = (
            f"median {np.nanmedian(speed):.3f} m/s, maximum {np.nanmax(speed):.3f} m/s; median standard deviation of "
            f"a component {finite_median(table.current_std):.3f} m/s; {table.adopted.label}"
        )
    if table.with_current.any():
        # The minus sign of the page's tables, which a terminal may lack.
        known["median current"] = re.sub(r"(?<!\S)-(?=\d)", "−", known["median current"])
    first, last = ({name: known[name] for name in names if name in known} for names in (_FIRST, _LAST))
    return {**first, **flight, **last}


def profile_outcomes(summary: Summary) -> list[Row]:
    """Count the pending, done and failed profiles."""
    total = max(1, sum(summary.statuses.values()))
    meanings = {"pending": "still to be estimated", "done": "estimated", "failed": "could not be estimated"}
    return [
        {
            "what": "profiles",
            "outcome": status,
            "count": summary.statuses[status],
            "share, %": 100.0 * summary.statuses[status] / total,
            "meaning": meanings[status],
        }
        for status in STATUS
    ]


def window_outcomes(archive: Archive) -> list[Row]:
    """Count the outcomes of the windows of all profiles."""
    codes = archive["windows"].to_dataset()["outcome"].values
    known = codes[np.isfinite(codes)].astype(int)
    return [
        {
            "what": "windows",
            "outcome": outcome.label,
            "count": int((known == outcome).sum()),
            "share, %": 100.0 * float((known == outcome).sum()) / max(1, known.size),
            "meaning": outcome.sentence,
        }
        for outcome in Outcome
    ]


def _figure_blocks(table: MissionTable) -> list[Block]:
    if not table.done.any():
        return [Notice("no profile is done yet, so there is nothing to draw; finish the run with run-mission --resume")]
    blocks: list[Block] = []
    track = map_figure(table)
    if track is None:
        blocks.append(Notice("no profile has a fix before and after it, so there is no map"))
    else:
        blocks.append(FigureBlock("map", _map_caption(table), _map_alternative(table), track))
    blocks.append(
        FigureBlock("profiles_over_time", _PROFILES_CAPTION, _profiles_alternative(table), profiles_figure(table))
    )
    blocks.append(
        FigureBlock(
            "timing",
            _timing_caption(table),
            "Computing time of every profile in seconds, and the dive's duration relative to it.",
            timing_figure(table),
        )
    )
    return blocks


def _map_caption(table: MissionTable) -> str:
    count = int(table.with_current.sum())
    return (
        "Dives from fix to fix (thick lines), the intervals between them (thin lines), and the depth-averaged current "
        f"of {counted(count, 'profile')} ({table.adopted.label}): the displacement between the fixes minus that "
        "through the water, divided by the dive's duration. The median standard deviation of a component is "
        f"{finite_median(table.current_std):.3f} m/s. Longitudes are scaled to distance at this latitude."
    )


def _map_alternative(table: MissionTable) -> str:
    latitude, longitude = table.middle
    known = np.isfinite(latitude)
    dives = counted(int(known.sum()), "dive")
    return (
        f"Map of {dives} between {np.min(latitude[known]):.2f} and {np.max(latitude[known]):.2f} degrees "
        f"north, {np.min(longitude[known]):.2f} and {np.max(longitude[known]):.2f} degrees east, with an arrow for "
        "the current of each."
    )


_PROFILES_CAPTION = (
    "For every profile: the maximum measured depth, with its outcome; the share of its windows that converged; and "
    "the two components of the depth-averaged current with error bars of one standard deviation, from the smoother "
    "where it is usable and otherwise from the adjoint; for comparison those from the adjoint and, without a model of "
    "the forces, from the glide angle."
)


def _profiles_alternative(table: MissionTable) -> str:
    return (
        f"{counted(len(table.number), 'profile')} over {table.days[table.done].max():.1f} days: maximum depth "
        f"{np.nanmin(table.depth):.0f} to {np.nanmax(table.depth):.0f} m, median share of converged windows "
        f"{finite_median(table.converged):.0%}, and the components of the current."
    )


def _timing_caption(table: MissionTable) -> str:
    return (
        "Computing time of the profiles (run_seconds of the archive: filter, smoother, inversion, current; "
        f"{np.nansum(table.seconds):.0f} s in total, each profile on one core). The first profile of a worker may "
        "include loading or compiling the kernels."
    )
