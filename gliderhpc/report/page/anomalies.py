"""Profiles of a mission that need attention, and remarks that many of them share."""

import re
from collections.abc import Iterator

from gliderhpc.archive.mission import Summary
from gliderhpc.report.facts import failure_text
from gliderhpc.report.page.mission_table import MissionTable
from gliderhpc.wording import counted

POORLY_CONVERGED = 0.8
"""Share of converged windows below which a profile is listed as an anomaly."""

_LISTED = 3
"""Maximum number of failed profiles whose messages are listed, of profile numbers in a list, and of common remarks."""

_COMMON = 0.1
"""Fraction of the estimated profiles at or above which a remark is common."""

_NUMBER = re.compile(r"\d+(?:\.\d+)?")


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
        yield f"no current of {name_profiles(unknown)}"


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
