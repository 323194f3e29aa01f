"""Forces, moments and currents that an underwater glider met, from its routine records alone.

The method is that of "Virtual sensing of ocean currents and hydrodynamic drift for underwater gliders via adjoint-based
dynamics inversion".

Examples
--------
>>> import gliderhpc as gh
>>> glider = gh.Glider("petrel-l")
>>> glider.input_diagonal().shape
(6,)
>>> dive = gh.invert("m12.nc", "petrel-l", profile=12)  # doctest: +SKIP
>>> gh.plot_profile(dive).savefig("dive.png")  # doctest: +SKIP
"""

import importlib
from typing import TYPE_CHECKING, Any

from gliderhpc._compiled_cache import use_compiled_cache
from gliderhpc.version import __version__

if TYPE_CHECKING:
    from gliderhpc.api.checks import inspect
    from gliderhpc.api.hulls import calibrate, tune
    from gliderhpc.api.missions import invert, run_mission
    from gliderhpc.api.records import import_records, open_records
    from gliderhpc.api.studies import analyze, plot_profile, validate
    from gliderhpc.archive.mission import open_mission
    from gliderhpc.errors import CalibrationError, GliderhpcError, InputError, ProfileError, RunStoppedError
    from gliderhpc.flight.glider import Glider
    from gliderhpc.flight.loading import load_platform
    from gliderhpc.mission.settings import MissionSettings
    from gliderhpc.platform import Platform
    from gliderhpc.report.page import write_report as report

__all__ = [
    "CalibrationError",
    "Glider",
    "GliderhpcError",
    "InputError",
    "MissionSettings",
    "Platform",
    "ProfileError",
    "RunStoppedError",
    "__version__",
    "analyze",
    "calibrate",
    "import_records",
    "inspect",
    "invert",
    "load_platform",
    "open_mission",
    "open_records",
    "plot_profile",
    "report",
    "run_mission",
    "tune",
    "validate",
]

_MODULES = {
    "CalibrationError": "gliderhpc.errors",
    "Glider": "gliderhpc.flight.glider",
    "GliderhpcError": "gliderhpc.errors",
    "InputError": "gliderhpc.errors",
    "MissionSettings": "gliderhpc.mission.settings",
    "Platform": "gliderhpc.platform",
    "ProfileError": "gliderhpc.errors",
    "RunStoppedError": "gliderhpc.errors",
    "analyze": "gliderhpc.api.studies",
    "calibrate": "gliderhpc.api.hulls",
    "import_records": "gliderhpc.api.records",
    "inspect": "gliderhpc.api.checks",
    "invert": "gliderhpc.api.missions",
    "load_platform": "gliderhpc.flight.loading",
    "open_mission": "gliderhpc.archive.mission",
    "open_records": "gliderhpc.api.records",
    "plot_profile": "gliderhpc.api.studies",
    "run_mission": "gliderhpc.api.missions",
    "tune": "gliderhpc.api.hulls",
    "validate": "gliderhpc.api.studies",
}
"""Each name's module, imported when the name is first used: a command loads only the libraries that it needs."""

# Before numba is imported, which reads its settings once.
use_compiled_cache()


def __getattr__(name: str) -> Any:
    if name == "report":
        # The package of this name, which can be called.
        return importlib.import_module("gliderhpc.report")
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(_MODULES[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
