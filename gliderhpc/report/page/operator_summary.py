"""Summary for the operator, first on the mission's page: current, next surfacing, trim, anomalies, uncertainty."""

import re
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from gliderhpc.archive.mission import Summary
from gliderhpc.archive.profile import SMOOTHED, filter_fallbacks
from gliderhpc.archive.reader import Archive
from gliderhpc.errors import InputError
from gliderhpc.findings.formatting import polar, with_deviation
from gliderhpc.mission_hull.single_changes import POSSIBLE, PROBABLE
from gliderhpc.report.facts import failure_text
from gliderhpc.report.page.content import Facts, Notice, PageSection, Paragraph, Remarks
from gliderhpc.report.page.mission_table import MissionTable, last_current
from gliderhpc.report.page.surfacing_page import current_text, dive_facts, hull_blocks
from gliderhpc.report.studies import studies_in
from gliderhpc.report.studies.drift import drift_sentences
from gliderhpc.studies.archived import platform_or_none
from gliderhpc.studies.drift import NAME as DRIFT
from gliderhpc.studies.library.scores import finite_median
from gliderhpc.surfacing.dive_results import surfacing_message
from gliderhpc.surfacing.message import SurfacingMessage
from gliderhpc.surfacing.recent_hull import MUST_BE_CONFIRMED, joint_sentence
from gliderhpc.wording import counted

Array = NDArray[np.float64]

_MIN_TREND_DIVES = 5
"""Minimum number of dives for a trend."""

POORLY_CONVERGED = 0.8
"""Share of converged windows below which a profile is listed as an anomaly."""

_LISTED = 3
"""Maximum number of failed profiles whose messages are listed, of profile numbers in a list, and of common remarks."""

_COMMON = 0.1
"""Fraction of the estimated profiles at or above which a remark is common."""

_NUMBER = re.compile(r"\d+(?:\.\d+)?")


def operator_section(archive: Archive, summary: Summary) -> PageSection:
    """Assemble the results that an operator needs first: those of the last dive, and of the mission."""
    table = MissionTable.of(archive)
    anomalies = [*profile_anomalies(summary, table), *_unsmoothed(archive, table), *common_remarks(summary, table)]
    done = table.number[table.done].tolist()
    if not done:
        return PageSection("answers", "In short", (Notice("no profile is done yet"), *_remarks(anomalies)))
    message = surfacing_message(archive, int(done[-1]))
    anomalies = [*_changed_hull(message), *_drift(archive), *anomalies]
    last = {f"{name} (dive {message.profile})": text for name, text in dive_facts(message).items()}
    number, current = last_current(table)
    if message.current is None and current is not None:
        last[f"last known current (dive {number})"] = current_text(current)
    facts = {**last, **_mission_current(table), "uncertainty": "; ".join(_describe_uncertainty(archive, table))}
    return PageSection("answers", "In short", (Facts(facts), *hull_blocks(message), *_remarks(anomalies)))


def _remarks(anomalies: Sequence[str]) -> tuple[Remarks | Paragraph]:
    if anomalies:
        return (Remarks(tuple(anomalies), "Anomalies in this mission"),)
    return (Paragraph("No anomalies: every profile was estimated without a remark."),)


def _changed_hull(message: SurfacingMessage) -> Iterator[str]:
    """Yield a sentence for each probable or possible change of the hull, and for one that no parameter shows alone."""
    joint = message.hull_joint_change
    if joint is not None and joint.probability >= POSSIBLE and not message.names_a_change:
        yield joint_sentence(joint, named=False, last=message.profile)
    for change in message.hull_changes:
        if change.probability >= POSSIBLE:
            changed = "changed" if change.probability >= PROBABLE else "possibly changed"
            since = f"{changed} since profile {change.since}, by {change.size_text}"
            confirm = f"; {MUST_BE_CONFIRMED}" if change.is_shown_only_by(message.profile) else ""
            yield f"{change.meaning}: {since} (probability {change.probability:.2f}){confirm}"


def _drift(archive: Archive) -> Iterator[str]:
    """Yield the findings of the study of drift, which unlike those of a dive's message include episodes."""
    if DRIFT not in studies_in(archive):
        return
    try:
        sentences = drift_sentences(archive)
    except InputError:
        return  # The study's own section shows the reason.
    yield from (f"study {DRIFT}: {sentence}" for sentence in sentences)


def _unsmoothed(archive: Archive, table: MissionTable) -> Iterator[str]:
    """Yield a sentence on the estimated profiles without a smoothed estimate, in which something unusual happened."""
    if SMOOTHED in archive.children and (without := filter_fallbacks(archive, table.number[table.done].tolist())):
        yield f"the smoother has no estimate for {name_profiles(without)}"


def _mission_current(table: MissionTable) -> dict[str, str]:
    """Return mean and trend of the depth-averaged currents; empty without a current."""
    known = table.with_current
    if not known.any():
        return {}
    north, east = (component[known] for component in table.current)
    facts = {"mean current": f"{polar(north.mean(), east.mean())} ({counted(int(known.sum()), 'dive')})"}
    days = table.days[known]
    if known.sum() >= _MIN_TREND_DIVES and np.ptp(days) > 0.0:
        slopes = [_trend(days, component) for component in (north, east)]
        texts = [with_deviation(slope, error) for slope, error in slopes]
        facts["trend of the current"] = f"north {texts[0]}, east {texts[1]} m/s per day, from the scatter of the dives"
    return facts


def _trend(days: Array, values: Array) -> tuple[float, float]:
    """Return the slope of a straight line by least squares, and its standard deviation from the residuals."""
    centred = days - days.mean()
    square = float(centred @ centred)
    slope = float(centred @ values) / square
    residuals = values - values.mean() - slope * centred
    return slope, float(np.sqrt(residuals @ residuals / (len(days) - 2) / square))


def _describe_uncertainty(archive: Archive, table: MissionTable) -> Iterator[str]:
    """Yield sentences on the uncertainty of the results."""
    deviation, converged = finite_median(table.current_std), finite_median(table.converged[table.done])
    if np.isfinite(deviation):
        yield f"median standard deviation of a current's component {deviation:.3f} m/s ({table.adopted.label})"
    if np.isfinite(converged):
        yield f"{converged:.0%} of the windows of a profile converged (median)"
    platform = platform_or_none(archive)
    if platform is not None:
        yield "the hull was calibrated" if platform.calibration else "the hull was not calibrated (gliderhpc calibrate)"


# Anomalies


def profile_anomalies(summary: Summary, table: MissionTable) -> Iterator[str]:
    """Describe failed and pending profiles, and those that are poorly converged or without a current."""
    yield from _failures(summary)
    if pending := summary.statuses.get("pending", 0):
        yield f"{pending} {'profile' if pending == 1 else 'profiles'} still to be estimated"
    poor = table.number[table.done & (table.converged < POORLY_CONVERGED)].tolist()
    if poor:
        yield f"less than {POORLY_CONVERGED:.0%} of the windows converged in {name_profiles(poor)}"
    unknown = table.number[table.done & ~table.with_current].tolist()
    if unknown:
        yield f"no current for {name_profiles(unknown)}"


def common_remarks(summary: Summary, table: MissionTable) -> Iterator[str]:
    """Yield the most common remarks on estimated profiles, with the number of profiles; numbers may differ in each."""
    by_pattern: dict[str, list[str]] = {}
    for status, text in summary.messages.values():
        if status == "done":
            own = {_NUMBER.sub("N", remark): remark for remark in filter(None, text.split("; "))}
            for pattern, remark in own.items():
                by_pattern.setdefault(pattern, []).append(remark)
    done = int(table.done.sum())
    common = sorted(by_pattern.values(), key=len, reverse=True)
    for remarks in common[:_LISTED]:
        if len(remarks) > 1 and len(remarks) >= _COMMON * done:
            example = remarks[0] if len(set(remarks)) == 1 else f"{remarks[0]} (values of the first)"
            yield f"in {len(remarks)} of {counted(done, 'profile')}: {example}"


def _failures(summary: Summary) -> Iterator[str]:
    failed = [(number, text) for number, (status, text) in summary.messages.items() if status == "failed"]
    yield from (failure_text(number, text) for number, text in failed[:_LISTED])
    if (more := summary.statuses.get("failed", 0) - len(failed[:_LISTED])) > 0:
        yield f"{more} more failed"


def name_profiles(numbers: list[int]) -> str:
    """Return the first of some profile numbers as text, and how many more there are."""
    shown = ", ".join(map(str, numbers[:_LISTED]))
    more = f" and {len(numbers) - _LISTED} more" if len(numbers) > _LISTED else ""
    return f"profile {shown}" if len(numbers) == 1 else f"profiles {shown}{more}"
