"""Memory that this process may use: the machine's, or what its control group or its limits leave of it."""

import os
import resource
from collections.abc import Iterator
from pathlib import Path

_GROUPS = Path("/sys/fs/cgroup")
_OWN_GROUPS = Path("/proc/self/cgroup")


def memory_limit() -> float:
    """Bytes that all processes of a run here may take together; infinite where the system does not say."""
    return min(_physical(), *_group_limits(), _address_space())


def _physical() -> float:
    try:
        return float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    except (ValueError, OSError):
        return float("inf")


def _address_space() -> float:
    soft, _ = resource.getrlimit(resource.RLIMIT_AS)
    return float("inf") if soft == resource.RLIM_INFINITY else float(soft)


def _group_limits() -> Iterator[float]:
    """Limits of the control groups (versions 2 and 1) that this process is in, and of those above them."""
    try:
        lines = _OWN_GROUPS.read_text("utf-8").splitlines()
    except OSError:
        return
    for line in lines:
        _, controllers, group = line.split(":", 2)
        if controllers not in ("", "memory"):
            continue
        root, name = (_GROUPS, "memory.max") if not controllers else (_GROUPS / "memory", "memory.limit_in_bytes")
        place = root / group.lstrip("/")
        for folder in (place, *place.parents):
            if folder.is_relative_to(root):
                yield _limit_in(folder / name)


def _limit_in(file: Path) -> float:
    try:
        text = file.read_text("utf-8").strip()
    except OSError:
        return float("inf")
    return float(text) if text.isdigit() else float("inf")
