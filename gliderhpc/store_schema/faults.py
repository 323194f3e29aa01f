"""What is wrong with an archive, in as many lines as somebody reads."""

from collections.abc import Iterable
from dataclasses import dataclass

_SHOWN = 3
"""Chunks of a profile that are named, each in a line or all in one."""


@dataclass(frozen=True)
class Fault:
    """Something that is not as it was written: where, what is wrong, and what mends it."""

    profile: str
    variable: str
    what: str
    remedy: str


def as_lines(faults: Iterable[Fault]) -> list[str]:
    """One line a fault, or one for all of a profile that need the same remedy where there are more than a few."""
    grouped: dict[tuple[str, str], list[Fault]] = {}
    for fault in faults:
        grouped.setdefault((fault.profile, fault.remedy), []).append(fault)
    lines: list[str] = []
    for (profile, remedy), found in grouped.items():
        if len(found) <= _SHOWN:
            lines += [f"{profile}, {fault.variable}: {fault.what}; {remedy}" for fault in found]
        else:
            names = ", ".join(fault.variable for fault in found[:_SHOWN])
            lines.append(f"{profile}: {len(found)} chunks are missing or damaged ({names}, ...); {remedy}")
    return lines
