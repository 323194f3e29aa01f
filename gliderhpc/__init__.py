"""Forces, moments and currents that acted on an underwater glider, estimated from its routine records alone.

The method is that of "Virtual sensing of ocean currents and hydrodynamic drift for underwater gliders via adjoint-based
dynamics inversion".

Examples
--------
>>> import gliderhpc as gh
>>> glider = gh.Glider("petrel-l")
>>> glider.input_diagonal().shape
(6,)
>>> dive = gh.invert("m12.nc", "sea035.yaml", profile=44)  # doctest: +SKIP
>>> gh.plot_profile(dive).savefig("dive.png")  # doctest: +SKIP
"""

import importlib
from typing import TYPE_CHECKING, Any

from gliderhpc.version import __version__

if TYPE_CHECKING:
    from gliderhpc.api.currents import currents
    from gliderhpc.api.hulls import calibrate, tune
    from gliderhpc.api.missions import invert, run_mission
    from gliderhpc.api.records import import_records, inspect, open_records
    from gliderhpc.api.studies import analyze, plot_profile, validate
    from gliderhpc.archive.mission import open_mission
    from gliderhpc.errors import CalibrationError, GliderhpcError, InputError, ProfileError, RunStoppedError
    from gliderhpc.flight.glider import Glider, load_platform
    from gliderhpc.mission.settings import MissionSettings
    from gliderhpc.platform import Platform
    from gliderhpc.report.page.report import write_report as report

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
    "currents",
    "import_records",
    "inspect",
    "invert",
    "load_platform",
    "open_mission",
    "open_records",
    "plot_currents",
    "plot_profile",
    "report",
    "run_mission",
    "tune",
    "validate",
]

_NAMES = {
    "gliderhpc.api.currents": ("currents",),
    "gliderhpc.api.hulls": ("calibrate", "tune"),
    "gliderhpc.api.missions": ("invert", "run_mission"),
    "gliderhpc.api.records": ("import_records", "inspect", "open_records"),
    "gliderhpc.api.studies": ("analyze", "plot_currents", "plot_profile", "validate"),
    "gliderhpc.archive.mission": ("open_mission",),
    "gliderhpc.errors": ("CalibrationError", "GliderhpcError", "InputError", "ProfileError", "RunStoppedError"),
    "gliderhpc.flight.glider": ("Glider", "load_platform"),
    "gliderhpc.mission.settings": ("MissionSettings",),
    "gliderhpc.platform": ("Platform",),
}
"""Public names by module. A module is imported when one of its names is first used: a command loads only the libraries
that it needs."""


def __getattr__(name: str) -> Any:
    if name == "report":
        # The package of this name, which is callable.
        return importlib.import_module("gliderhpc.report")
    for module, names in _NAMES.items():
        if name in names:
            return getattr(importlib.import_module(module), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
