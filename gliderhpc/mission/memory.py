"""Memory available to a run on this machine."""

import os
from collections.abc import Iterator
from pathlib import Path

_GROUPS = Path("/sys/fs/cgroup")
_GROUPS_OF_PROCESS = Path("/proc/self/cgroup")


def memory_limit() -> float:
    """Return the memory (bytes) available to all processes of a run on this machine; infinite if unknown.

    It is the smallest of the physical memory, the limits of the control groups and the limit of the address space.
    """
    return min(_physical(), *_group_limits(), _address_space())


def _physical() -> float:
    try:
        return float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    except (ValueError, OSError):
        return float("inf")


def _address_space() -> float:
    try:
        import resource
    except ImportError:  # Windows has no such limit.
        return float("inf")
    soft, _ = resource.getrlimit(resource.RLIMIT_AS)
    return float("inf") if soft == resource.RLIM_INFINITY else float(soft)


def _group_limits() -> Iterator[float]:
    """Yield the limits of this process's control groups (versions 2 and 1) and of their parents."""
    try:
        lines = _GROUPS_OF_PROCESS.read_text("utf-8").splitlines()
    except OSError:
        return
    for line in lines:
        _, controllers, group = line.split(":", 2)
        if controllers not in ("", "memory"):
            continue
        root, name = (_GROUPS, "memory.max") if not controllers else (_GROUPS / "memory", "memory.limit_in_bytes")
        group_folder = root / group.lstrip("/")
        for folder in (group_folder, *group_folder.parents):
            if folder.is_relative_to(root):
                yield _limit_in(folder / name)


def _limit_in(file: Path) -> float:
    try:
        text = file.read_text("utf-8").strip()
    except OSError:
        return float("inf")
    return float(text) if text.isdigit() else float("inf")
