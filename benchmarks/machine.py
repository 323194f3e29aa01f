"""Description of the machine on which the figures were measured."""

import datetime
import os
import platform
from importlib.metadata import version
from pathlib import Path
from typing import Any

from gliderhpc import __version__
from gliderhpc.mission.local_workers import default_workers

PACKAGES = ("numba", "numpy", "scipy")


def machine_row() -> dict[str, Any]:
    """CPU, cores, versions, day and the present load of other work (processes ready to run, over one minute)."""
    return {
        "cpu": cpu_model(),
        "cores": default_workers(),
        "system": platform.system(),
        "python": platform.python_version(),
        **{name: version(name) for name in PACKAGES},
        "gliderhpc": __version__,
        "day": datetime.datetime.now(datetime.UTC).date().isoformat(),
        "load": load_average(),
    }


def cpu_model() -> str:
    """Model of the CPU, with the core that the compiler takes it for where a virtual machine hides it."""
    from llvmlite.binding import get_host_cpu_name

    return f"{_model_name(Path('/proc/cpuinfo'))} ({get_host_cpu_name()})"


def load_average() -> float:
    """One-minute load average; NaN where the system has none."""
    return os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")


def _model_name(path: Path) -> str:
    if path.exists():
        for line in path.read_text("utf-8").splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor() or platform.machine()
